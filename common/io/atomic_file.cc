#include "common/io/atomic_file.h"

#include <fcntl.h>
#include <sys/random.h>
#include <sys/stat.h>

#include <unistd.h>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>

#include <string>

#include "common/base/log.h"
#include "common/io/unique_fd.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

Status ErrnoStatus(const fs::path& path, const std::string& doing, int error) {
  const std::string fault = path.string() + ": " + doing + " failed (" + std::strerror(error) + ")";
  switch (error) {
    case ENOSPC:
    case EDQUOT:
      return {ErrorCode::kNoSpace, fault + "; free space on this disk and run again"};
    case ENOENT:
    case ENOTDIR:
      return {ErrorCode::kNotFound, fault + "; create the folder or name another"};
    case EACCES:
    case EPERM:
    case EROFS:
      return {ErrorCode::kIo, fault + "; choose a folder that this user may write to"};
    case EXDEV:
      return {ErrorCode::kInvalidArgument, fault + "; stage it on the target's file system"};
    default:
      return {ErrorCode::kIo, fault + "; check the disk"};
  }
}

Status WriteAll(int fd, std::span<const std::uint8_t> bytes, const fs::path& name) {
  while (!bytes.empty()) {
    const ssize_t put = ::write(fd, bytes.data(), bytes.size());
    if (put < 0 && errno == EINTR) continue;
    if (put < 0) return ErrnoStatus(name, "writing", errno);
    bytes = bytes.subspan(static_cast<std::size_t>(put));
  }
  return {};
}

// "out/bundle/" -> "out/bundle": rename and parent_path want the name itself.
fs::path WithoutTrailingSlash(const fs::path& path) {
  return path.has_filename() ? path : path.parent_path();
}

fs::path FolderOf(const fs::path& path) {
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

fs::path TemporarySibling(const fs::path& path) {
  return FolderOf(path) / Format(".%s.%s.tmp", path.filename().c_str(), UniqueWord().c_str());
}

// A pipe, terminal or device is written straight: renaming over /dev/stdout would replace it.
Status WriteThrough(const fs::path& path, std::span<const std::uint8_t> bytes) {
  const UniqueFd fd(::open(path.c_str(), O_WRONLY | O_CLOEXEC));
  if (!fd.valid()) return ErrnoStatus(path, "opening", errno);
  return WriteAll(fd.get(), bytes, path);
}

Status WriteAside(const fs::path& aside, const fs::path& path,
                  std::span<const std::uint8_t> bytes) {
  const UniqueFd fd(::open(aside.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
  if (!fd.valid()) return ErrnoStatus(path, "creating", errno);
  const Status written = WriteAll(fd.get(), bytes, path);
  if (!written.ok()) return written;
  if (::fsync(fd.get()) != 0) return ErrnoStatus(path, "flushing", errno);
  return {};
}

// For file systems without RENAME_EXCHANGE: a reader in between finds nothing, never a mixture.
Status ExchangeInTwoSteps(const fs::path& staged, const fs::path& target) {
  const fs::path aside = TemporarySibling(target);
  if (::rename(target.c_str(), aside.c_str()) != 0)
    return ErrnoStatus(target, "moving aside", errno);
  if (::rename(staged.c_str(), target.c_str()) != 0) {
    const int error = errno;
    if (::rename(aside.c_str(), target.c_str()) != 0) {
      return ErrnoStatus(target, "publishing (the old folder is now " + aside.string() + ")",
                         error);
    }
    return ErrnoStatus(target, "publishing", error);
  }
  if (::rename(aside.c_str(), staged.c_str()) != 0) return ErrnoStatus(aside, "moving", errno);
  return {};
}

}  // namespace

// Process numbers alone repeat: on two machines, and in containers, where every program is
// number 1.
std::string UniqueWord() {
  std::uint64_t word = 0;
  if (::getrandom(&word, sizeof word, 0) != static_cast<ssize_t>(sizeof word)) {
    static std::atomic<std::uint64_t> counter{0};
    word = counter++;
  }
  return Format("%ld-%016llx", static_cast<long>(::getpid()),
                static_cast<unsigned long long>(word));
}

Status WriteFileAtomically(const fs::path& path, std::span<const std::uint8_t> bytes) {
  std::error_code error;
  const fs::file_status state = fs::status(path, error);
  if (fs::is_directory(state) || !path.has_filename()) {
    return {ErrorCode::kInvalidArgument, path.string() + ": is a folder; name a file"};
  }
  if (fs::exists(state) && !fs::is_regular_file(state)) return WriteThrough(path, bytes);
  fs::path final_path = path;
  if (fs::is_symlink(path, error) && fs::exists(state)) final_path = fs::canonical(path, error);
  const fs::path aside = TemporarySibling(final_path);
  Status status = WriteAside(aside, path, bytes);
  if (status.ok() && ::rename(aside.c_str(), final_path.c_str()) != 0) {
    status = ErrnoStatus(path, "renaming into place", errno);
  }
  if (!status.ok()) {
    ::unlink(aside.c_str());
    return status;
  }
  return SyncPath(FolderOf(final_path));
}

Status WriteFileAtomically(const fs::path& path, std::string_view text) {
  return WriteFileAtomically(
      path, std::span(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()));
}

Status SyncPath(const fs::path& path) {
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd.valid()) return ErrnoStatus(path, "opening", errno);
  // EINVAL: this file system keeps nothing to flush.
  if (::fsync(fd.get()) != 0 && errno != EINVAL) return ErrnoStatus(path, "flushing", errno);
  return {};
}

Status PublishDirectory(const fs::path& staged_folder, const fs::path& target_folder) {
  const fs::path staged = WithoutTrailingSlash(staged_folder);
  const fs::path target = WithoutTrailingSlash(target_folder);
  std::error_code error;
  if (!fs::is_directory(fs::symlink_status(staged, error))) {
    return {ErrorCode::kNotFound, staged.string() + ": no such folder; stage it before publishing"};
  }
  const fs::file_status state = fs::symlink_status(target, error);
  if (fs::exists(state) && !fs::is_directory(state)) {
    return {ErrorCode::kInvalidArgument,
            target.string() + ": exists and is not a folder; move it away or name another"};
  }
  const bool replaces = fs::exists(state);
  if (replaces && fs::equivalent(staged, target, error)) {
    return {ErrorCode::kInvalidArgument,
            target.string() + ": is the staged folder itself; stage beside the target"};
  }
  const unsigned int flags = replaces ? RENAME_EXCHANGE : RENAME_NOREPLACE;
  if (::renameat2(AT_FDCWD, staged.c_str(), AT_FDCWD, target.c_str(), flags) != 0) {
    if (errno != EINVAL && errno != ENOSYS) return ErrnoStatus(target, "publishing", errno);
    if (replaces) {
      const Status moved = ExchangeInTwoSteps(staged, target);
      if (!moved.ok()) return moved;
    } else if (::rename(staged.c_str(), target.c_str()) != 0) {
      return ErrnoStatus(target, "publishing", errno);
    }
  }
  const Status synced = SyncPath(FolderOf(target));
  if (!synced.ok() || !replaces) return synced;
  fs::remove_all(staged, error);
  if (error) {
    return {ErrorCode::kIo, staged.string() + ": the replaced folder cannot be removed (" +
                                error.message() + "); remove it by hand"};
  }
  return {};
}

Status CheckParentIsWritable(const std::filesystem::path& path, const std::string& option) {
  std::error_code ignored;
  std::filesystem::path folder =
      std::filesystem::absolute(path, ignored).lexically_normal().parent_path();
  if (path.empty() || folder.empty()) {
    return {ErrorCode::kInvalidArgument, option + " is empty; name a path"};
  }
  // Folders that are missing are made later; what matters is the first that is there.
  while (!std::filesystem::exists(folder, ignored) && folder.has_relative_path())
    folder = folder.parent_path();
  if (!std::filesystem::is_directory(folder, ignored)) {
    return {ErrorCode::kIo, path.string() + ": cannot be made, " + folder.string() +
                                " is not a folder; choose another " + option};
  }
  if (::access(folder.c_str(), W_OK | X_OK) != 0) {
    return {ErrorCode::kIo, path.string() + ": cannot be made, " + folder.string() +
                                " is not writable for this user; choose another " + option};
  }
  return {};
}

Status CheckFileCanBeWritten(const std::filesystem::path& path, const std::string& option) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) {
    return {ErrorCode::kInvalidArgument,
            path.string() + ": is a folder; name a file for " + option};
  }
  if (std::filesystem::is_other(path, ignored)) return {};
  Status parent = CheckParentIsWritable(path, option);
  if (!parent.ok()) return parent;
  // The file's folder is not made on the way.
  const auto folder = std::filesystem::absolute(path, ignored).parent_path();
  if (!std::filesystem::is_directory(folder, ignored)) {
    return {ErrorCode::kNotFound,
            folder.string() + ": no such folder; make it, or choose another " + option};
  }
  return {};
}

Status MakeDirectories(const std::filesystem::path& folder, const std::string& option) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (!error) return {};
  return {ErrorCode::kIo, folder.string() + ": cannot be made (" + error.message() +
                              "); choose a " + option + " folder you may write to"};
}

}  // namespace panofix
