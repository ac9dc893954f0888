#include "builder/validate/replay.h"

#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>

#include "common/base/cancel.h"
#include "common/base/log.h"

extern char** environ;

namespace panofix {
namespace {

namespace fs = std::filesystem;

// A fresh folder, removed with everything in it.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string pattern = (fs::temp_directory_path() / "panofix-XXXXXX").string();
    if (mkdtemp(pattern.data()) == nullptr) {
      throw Error(ErrorCode::kIo,
                  pattern + ": cannot be made: " + std::strerror(errno) + "; set TMPDIR");
    }
    path_ = pattern;
  }
  ~TemporaryFolder() {
    std::error_code error;
    fs::remove_all(path_, error);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

int Run(const std::vector<std::string>& command) {
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  pid_t child = 0;
  const int failure =
      posix_spawnp(&child, arguments[0], nullptr, nullptr, arguments.data(), environ);
  if (failure != 0)
    throw Error(ErrorCode::kIo, command[0] + ": cannot be started: " + std::strerror(failure));
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    // A signal sent to this process alone is the child's to obey as well.
    if (CancelRequested()) kill(child, SIGINT);
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

// The error that the runtime ended with, so that our own exit code is the same.
ErrorCode CodeOf(int exit_code) {
  for (const ErrorCode code :
       {ErrorCode::kInvalidArgument, ErrorCode::kBadData, ErrorCode::kNotFound, ErrorCode::kIo,
        ErrorCode::kUnsupportedVersion}) {
    if (ExitCode(code) == exit_code) return code;
  }
  return ErrorCode::kInternal;
}

}  // namespace

Result<fs::path> FindRuntime() {
  constexpr const char* kName = "panofix-runtime";
  std::error_code error;
  const fs::path self = fs::read_symlink("/proc/self/exe", error);
  if (!error && fs::exists(self.parent_path() / kName)) return self.parent_path() / kName;
  const char* path = std::getenv("PATH");
  std::string rest = path != nullptr ? path : "";
  while (!rest.empty()) {
    const std::size_t colon = std::min(rest.find(':'), rest.size());
    const fs::path candidate = fs::path(rest.substr(0, colon)) / kName;
    if (access(candidate.c_str(), X_OK) == 0) return candidate;
    rest.erase(0, colon + 1);
  }
  return Status(ErrorCode::kNotFound,
                "panofix-runtime is neither beside panofix-builder nor in PATH; give --runtime");
}

Replay ReplayDrive(const fs::path& runtime, const fs::path& bundle, const fs::path& drive,
                   const std::vector<std::string>& extra) {
  if (access(runtime.c_str(), X_OK) != 0) {
    throw Error(ErrorCode::kNotFound, runtime.string() + ": no program there; give --runtime");
  }
  const TemporaryFolder folder;
  const fs::path poses = folder.path() / "poses.csv", log = folder.path() / "log.json";
  std::vector<std::string> command = {runtime.string(), "localize",     "--bundle", bundle.string(),
                                      "--drive",        drive.string(), "--out",    poses.string(),
                                      "--log",          log.string()};
  command.insert(command.end(), extra.begin(), extra.end());
  const int code = Run(command);
  if (code == 130) throw Error(ErrorCode::kCancelled, "stopped by the user");
  if (code != 0) {
    throw Error(CodeOf(code), Format("%s localize ended with exit code %d; its message is above",
                                     runtime.c_str(), code));
  }
  return {ValueOrThrow(ReadPosesCsv(poses)), ValueOrThrow(ReadRunLog(log))};
}

}  // namespace panofix
