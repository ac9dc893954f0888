#include "tests/support/crash_disk.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <stdarg.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace panofix {
namespace {

template <typename Function>
Function* Real(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

using Inode = std::pair<dev_t, ino_t>;

Inode InodeOf(int fd) {
  struct stat info {};
  return ::fstat(fd, &info) == 0 ? Inode{info.st_dev, info.st_ino} : Inode{};
}

Inode InodeOfFolder(const std::string& path) {
  const auto slash = path.rfind('/');
  struct stat info {};
  const std::string folder = slash == std::string::npos ? "." : path.substr(0, slash);
  return ::stat(folder.c_str(), &info) == 0 ? Inode{info.st_dev, info.st_ino} : Inode{};
}

// A change of names that its folder has not been flushed for.
struct PendingName {
  Inode folder;
  std::function<void()> undo;
};

struct State {
  CrashPlan plan;
  bool is_armed = false, is_busy = false;
  std::int64_t num_calls = 0;
  std::map<Inode, int> dirty;  // unflushed files, each with a descriptor of its own
  std::vector<PendingName> names;
};

State& Disk() {
  static State state;
  return state;
}

void LosePower() {
  State& disk = Disk();
  for (const auto& [inode, fd] : disk.dirty) {
    struct stat info {};
    if (::fstat(fd, &info) == 0) static_cast<void>(!::ftruncate(fd, info.st_size / 2));
  }
  // A journal keeps the order: the first changes hold, the later ones are undone from the end.
  std::size_t held = disk.names.empty() ? 0 : disk.plan.seed % (disk.names.size() + 1);
  while (disk.names.size() > held) {
    disk.names.back().undo();
    disk.names.pop_back();
  }
}

// Counts a call; true where it must fail with errno set.
bool FailsNow(bool needs_space) {
  State& disk = Disk();
  if (!disk.is_armed || disk.is_busy) return false;
  const std::int64_t call = ++disk.num_calls;
  if (disk.plan.at_call == 0 || call < disk.plan.at_call) return false;
  disk.is_busy = true;
  switch (disk.plan.kind) {
    case CrashPlan::Kind::kPowerLoss:
      LosePower();
      ::_exit(kCrashExitCode);
    case CrashPlan::Kind::kKill:
      ::_exit(kCrashExitCode);
    case CrashPlan::Kind::kDiskFull:
      disk.is_busy = false;
      errno = ENOSPC;
      return needs_space;
    case CrashPlan::Kind::kIoError:
      disk.is_busy = false;
      errno = EIO;
      return call == disk.plan.at_call;
  }
  return false;
}

bool KeepsTrack() {
  const State& disk = Disk();
  return disk.is_armed && !disk.is_busy && disk.plan.kind == CrashPlan::Kind::kPowerLoss;
}

void MarkDirty(int fd) {
  if (!KeepsTrack()) return;
  const Inode inode = InodeOf(fd);
  auto& dirty = Disk().dirty;
  if (!dirty.contains(inode)) dirty[inode] = ::fcntl(fd, F_DUPFD_CLOEXEC, 100);
}

void MarkClean(int fd) {
  if (!KeepsTrack()) return;
  State& disk = Disk();
  const Inode inode = InodeOf(fd);
  const auto found = disk.dirty.find(inode);
  if (found != disk.dirty.end()) {
    ::close(found->second);
    disk.dirty.erase(found);
  }
  std::erase_if(disk.names, [&](const PendingName& name) { return name.folder == inode; });
}

void NameChanged(const std::string& path, std::function<void()> undo) {
  if (KeepsTrack()) Disk().names.push_back({InodeOfFolder(path), std::move(undo)});
}

// A second name for what a rename replaces, so that it can come back.
std::string Backup(const std::string& path) {
  static int counter = 0;
  const std::string backup = path + ".before-" + std::to_string(counter++);
  return Real<int(const char*, const char*)>("link")(path.c_str(), backup.c_str()) == 0 ? backup
                                                                                        : "";
}

}  // namespace

void ArmCrash(const CrashPlan& plan) {
  Disk().plan = plan;
  Disk().num_calls = 0;
  Disk().is_armed = true;
}

std::int64_t NumDiskCalls() { return Disk().num_calls; }

}  // namespace panofix

// The C library's names, found before its own.
extern "C" {

int open(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(arguments, mode_t) : 0;
  va_end(arguments);
  const bool creates = (flags & O_CREAT) != 0 && ::access(path, F_OK) != 0;
  if (creates && panofix::FailsNow(true)) return -1;
  const int fd = panofix::Real<int(const char*, int, ...)>("open")(path, flags, mode);
  if (fd >= 0 && creates) {
    panofix::MarkDirty(fd);
    panofix::NameChanged(path, [name = std::string(path)] { ::unlink(name.c_str()); });
  }
  return fd;
}

ssize_t write(int fd, const void* data, size_t size) {
  // Pipes and terminals are no disk.
  struct stat info {};
  const bool is_file = ::fstat(fd, &info) == 0 && S_ISREG(info.st_mode);
  if (is_file && panofix::FailsNow(true)) return -1;
  if (is_file) panofix::MarkDirty(fd);
  return panofix::Real<ssize_t(int, const void*, size_t)>("write")(fd, data, size);
}

int fsync(int fd) {
  if (panofix::FailsNow(true)) return -1;
  const int result = panofix::Real<int(int)>("fsync")(fd);
  if (result == 0) panofix::MarkClean(fd);
  return result;
}

int rename(const char* from, const char* to) {
  if (panofix::FailsNow(false)) return -1;
  const std::string before = panofix::KeepsTrack() ? panofix::Backup(to) : "";
  const int result = panofix::Real<int(const char*, const char*)>("rename")(from, to);
  if (result == 0) {
    panofix::NameChanged(to, [before, old_name = std::string(from), new_name = std::string(to)] {
      const auto move = panofix::Real<int(const char*, const char*)>("rename");
      move(new_name.c_str(), old_name.c_str());
      if (!before.empty()) move(before.c_str(), new_name.c_str());
    });
  }
  return result;
}

int renameat2(int from_fd, const char* from, int to_fd, const char* to, unsigned int flags) {
  if (panofix::FailsNow(false)) return -1;
  const auto real =
      panofix::Real<int(int, const char*, int, const char*, unsigned int)>("renameat2");
  const int result = real(from_fd, from, to_fd, to, flags);
  if (result == 0) {
    panofix::NameChanged(to, [=, a = std::string(from), b = std::string(to)] {
      // An exchange is its own inverse; a move goes back.
      (flags & RENAME_EXCHANGE) != 0 ? real(from_fd, a.c_str(), to_fd, b.c_str(), flags)
                                     : real(to_fd, b.c_str(), from_fd, a.c_str(), flags);
    });
  }
  return result;
}

int link(const char* from, const char* to) {
  if (panofix::FailsNow(true)) return -1;
  const int result = panofix::Real<int(const char*, const char*)>("link")(from, to);
  if (result == 0) panofix::NameChanged(to, [name = std::string(to)] { ::unlink(name.c_str()); });
  return result;
}

int mkdir(const char* path, mode_t mode) {
  if (panofix::FailsNow(true)) return -1;
  const int result = panofix::Real<int(const char*, mode_t)>("mkdir")(path, mode);
  if (result == 0)
    panofix::NameChanged(path, [name = std::string(path)] { ::rmdir(name.c_str()); });
  return result;
}

int unlinkat(int fd, const char* path, int flags) {
  if (panofix::FailsNow(false)) return -1;
  return panofix::Real<int(int, const char*, int)>("unlinkat")(fd, path, flags);
}

}  // extern "C"
