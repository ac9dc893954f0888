#include "common/base/cancel.h"

#include <unistd.h>
#include <csignal>

#include <atomic>

namespace panofix {
namespace {

std::atomic<bool> cancel_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free, "used in a signal handler");

extern "C" void OnSignal(int) {
  if (cancel_requested.exchange(true)) _exit(130);
}

}  // namespace

void InstallCancelHandlers() {
  struct sigaction action {};
  action.sa_handler = OnSignal;
  sigemptyset(&action.sa_mask);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

bool CancelRequested() { return cancel_requested.load(); }
void RequestCancel() { cancel_requested = true; }
void ClearCancel() { cancel_requested = false; }

}  // namespace panofix
