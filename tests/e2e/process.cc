#include "tests/e2e/process.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <thread>

extern char** environ;

namespace panofix::e2e {
namespace {

// Only a failing test waits this long; a loaded machine is slow.
constexpr double kPatience_s = 120 * PANOFIX_SLOWDOWN;

std::string ReadAll(int fd) {
  struct stat info {};
  if (::fstat(fd, &info) != 0) return {};
  std::string text(static_cast<std::size_t>(info.st_size), '\0');
  const ssize_t count = ::pread(fd, text.data(), text.size(), 0);
  text.resize(count > 0 ? static_cast<std::size_t>(count) : 0);
  return text;
}

std::vector<std::string> Command(const std::string& program,
                                 const std::vector<std::string>& arguments) {
  std::vector<std::string> command{PANOFIX_BIN_DIR "/" + program};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return command;
}

}  // namespace

Process::Process(const std::vector<std::string>& command)
    : output_fd_(::memfd_create("output", MFD_CLOEXEC)),
      errors_fd_(::memfd_create("errors", MFD_CLOEXEC)) {
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, output_fd_, STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, errors_fd_, STDERR_FILENO);
  const int failure =
      ::posix_spawn(&pid_, arguments[0], &actions, nullptr, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (failure != 0) {
    ADD_FAILURE() << command[0] << " cannot be started: " << std::strerror(failure);
    pid_ = -1;
    exit_code_ = -1;
  }
}

Process::~Process() {
  if (!exit_code_) {
    Signal(SIGKILL);
    static_cast<void>(::waitpid(pid_, nullptr, 0));
  }
  ::close(output_fd_);
  ::close(errors_fd_);
}

void Process::Signal(int signal) const {
  if (!exit_code_) ::kill(pid_, signal);
}

std::optional<int> Process::Wait(double timeout_s) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
  while (!exit_code_) {
    int status = 0;
    if (::waitpid(pid_, &status, WNOHANG) == pid_) {
      exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    } else if (std::chrono::steady_clock::now() >= end) {
      break;
    } else {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  }
  return exit_code_;
}

std::string Process::Output() const { return ReadAll(output_fd_); }
std::string Process::Errors() const { return ReadAll(errors_fd_); }

Outcome RunProgram(const std::vector<std::string>& command) {
  Process process(command);
  const auto exit_code = process.Wait(kPatience_s);
  if (!exit_code) ADD_FAILURE() << command[0] << " " << command[1] << " does not end";
  return {exit_code.value_or(-1), process.Output(), process.Errors()};
}

std::vector<std::string> TownCommand(const std::vector<std::string>& arguments) {
  return Command("panofix-town", arguments);
}
std::vector<std::string> BuilderCommand(const std::vector<std::string>& arguments) {
  return Command("panofix-builder", arguments);
}
std::vector<std::string> RuntimeCommand(const std::vector<std::string>& arguments) {
  return Command("panofix-runtime", arguments);
}

}  // namespace panofix::e2e
