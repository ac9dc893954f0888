#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "runtime/store/activate.h"

namespace panofix {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kMaxMessageBytes = 4096;

// In the child: what came of the work, as code and message. Exits without running anything that
// the parent registered.
[[noreturn]] void Report(int fd, pid_t parent, const std::function<Status()>& work) {
  // It shares the parent's hold of the store, and must not keep it when the parent is gone.
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != parent) ::_exit(1);
  Status status;
  try {
    status = work();
  } catch (const std::exception& error) {
    status = {ErrorCode::kInternal, error.what()};
  }
  const std::string text = static_cast<char>(status.code()) + status.message();
  const auto size = std::min(text.size(), kMaxMessageBytes);
  static_cast<void>(::write(fd, text.data(), size) == static_cast<ssize_t>(size));
  ::_exit(0);
}

// What the child wrote until it closed the pipe; false where time was up or the user stopped us.
bool ReadUntil(int fd, Clock::time_point end, std::string* text) {
  char buffer[kMaxMessageBytes];
  while (Clock::now() < end && !CancelRequested()) {
    struct pollfd waiting {
      fd, POLLIN, 0
    };
    constexpr int kWait_ms = 100;
    if (::poll(&waiting, 1, kWait_ms) <= 0) continue;
    const ssize_t got = ::read(fd, buffer, sizeof buffer);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return true;
    text->append(buffer, static_cast<std::size_t>(got));
  }
  return false;
}

}  // namespace

Status RunInChild(const std::function<Status()>& work, double timeout_s) {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0)
    return {ErrorCode::kIo, std::string("no pipe (") + std::strerror(errno) + "); free some files"};
  UniqueFd from_child(ends[0]), to_parent(ends[1]);
  const pid_t parent = ::getpid();
  const pid_t child = ::fork();
  if (child < 0)
    return {ErrorCode::kIo, std::string("no process (") + std::strerror(errno) + "); free memory"};
  if (child == 0) Report(to_parent.get(), parent, work);
  to_parent.Reset();
  std::string text;
  const auto patience = std::chrono::duration<double>(timeout_s);
  const bool is_done =
      ReadUntil(from_child.get(),
                Clock::now() + std::chrono::duration_cast<Clock::duration>(patience), &text);
  if (!is_done) ::kill(child, SIGKILL);
  int how = 0;
  while (::waitpid(child, &how, 0) < 0 && errno == EINTR) {
  }
  if (CancelRequested()) return {ErrorCode::kCancelled, "stopped by the user while it was probed"};
  if (!is_done) return {ErrorCode::kUnhealthy, Format("it gave no answer within %g s", timeout_s)};
  if (WIFSIGNALED(how))
    return {ErrorCode::kUnhealthy, Format("it crashed with signal %d", WTERMSIG(how))};
  if (text.empty()) return {ErrorCode::kUnhealthy, "it ended without a word"};
  const auto code = static_cast<ErrorCode>(text[0]);
  return code == ErrorCode::kOk ? Status() : Status(code, text.substr(1));
}

}  // namespace panofix
