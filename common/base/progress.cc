#include "common/base/progress.h"

#include <unistd.h>

#include <cstdio>

#include "common/base/log.h"

namespace panofix {
namespace {

constexpr double kTerminalPeriod_s = 0.2;
constexpr double kPlainPeriod_s = 10.0;

std::string Duration(double seconds) {
  const auto whole = static_cast<std::int64_t>(seconds + 0.5);
  if (whole < 60) return Format("%ld s", static_cast<long>(whole));
  if (whole < 3600)
    return Format("%ld min %02ld s", static_cast<long>(whole / 60), static_cast<long>(whole % 60));
  return Format("%ld h %02ld min", static_cast<long>(whole / 3600),
                static_cast<long>(whole / 60 % 60));
}

double Seconds(std::chrono::steady_clock::duration duration) {
  return std::chrono::duration<double>(duration).count();
}

}  // namespace

Progress::Progress(std::string label, std::int64_t total, std::string unit)
    : label_(std::move(label)),
      unit_(std::move(unit)),
      total_(total),
      start_(std::chrono::steady_clock::now()),
      shown_(start_),
      terminal_(isatty(STDERR_FILENO) != 0) {}

Progress::~Progress() { Finish(); }

void Progress::Add(std::int64_t count) {
  done_ += count;
  const std::scoped_lock lock(mutex_);
  const double since_shown_s = Seconds(std::chrono::steady_clock::now() - shown_);
  if (!finished_ && since_shown_s >= (terminal_ ? kTerminalPeriod_s : kPlainPeriod_s)) Show(false);
}

void Progress::Finish() {
  const std::scoped_lock lock(mutex_);
  if (finished_) return;
  finished_ = true;
  Show(true);
}

std::string Progress::Line(const std::string& label, std::int64_t done, std::int64_t total,
                           const std::string& unit, double elapsed_s) {
  std::string line = Format("%s %ld/%ld %s", label.c_str(), static_cast<long>(done),
                            static_cast<long>(total), unit.c_str());
  const double rate = elapsed_s > 0 ? static_cast<double>(done) / elapsed_s : 0;
  if (done > 0) line += Format(", %.1f/s", rate);
  if (done >= total) {
    line += ", " + Duration(elapsed_s);
  } else if (rate > 0) {
    line += ", " + Duration(static_cast<double>(total - done) / rate) + " left";
  }
  return line;
}

void Progress::Show(bool last) {
  shown_ = std::chrono::steady_clock::now();
  const std::string line = Line(label_, done_, total_, unit_, Seconds(shown_ - start_));
  if (terminal_) {
    std::fprintf(stderr, "\r\033[K%s%s", line.c_str(), last ? "\n" : "");
  } else {
    std::fprintf(stderr, "%s\n", line.c_str());
  }
  std::fflush(stderr);
}

}  // namespace panofix
