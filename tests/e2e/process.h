#pragma once
// The real programs as child processes: what they print, how they end, and signals on the way.

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace panofix::e2e {

// A program in the background, its output kept in memory. The destructor kills what still runs.
class Process {
 public:
  // command[0] is a path. Adds a test failure where the program cannot be started.
  explicit Process(const std::vector<std::string>& command);
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  void Signal(int signal) const;
  // Exit code, or 128 + the signal that ended it; nullopt while it runs on after `timeout_s`.
  [[nodiscard]] std::optional<int> Wait(double timeout_s);
  [[nodiscard]] bool Running() { return !Wait(0); }
  // What it has written so far.
  [[nodiscard]] std::string Output() const;
  [[nodiscard]] std::string Errors() const;

 private:
  pid_t pid_ = -1;
  int output_fd_ = -1, errors_fd_ = -1;
  std::optional<int> exit_code_;
};

struct Outcome {
  int exit_code = -1;
  std::string output, errors;
};

// Runs a program to its end. One that outlives a minute's patience is killed and fails the test.
[[nodiscard]] Outcome RunProgram(const std::vector<std::string>& command);

// The programs of this build with their arguments.
[[nodiscard]] std::vector<std::string> TownCommand(const std::vector<std::string>& arguments);
[[nodiscard]] std::vector<std::string> BuilderCommand(const std::vector<std::string>& arguments);
[[nodiscard]] std::vector<std::string> RuntimeCommand(const std::vector<std::string>& arguments);
[[nodiscard]] inline Outcome Builder(const std::vector<std::string>& arguments) {
  return RunProgram(BuilderCommand(arguments));
}
[[nodiscard]] inline Outcome Runtime(const std::vector<std::string>& arguments) {
  return RunProgram(RuntimeCommand(arguments));
}

}  // namespace panofix::e2e
