#pragma once
// Files and folders that are whole or not there: written aside, flushed, renamed.

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

#include "common/base/status.h"

namespace panofix {

// Writes `path` through a temporary sibling, fsync and rename, and syncs the folder. kNoSpace on a
// full disk; the old file stays as it was on any failure.
[[nodiscard]] Status WriteFileAtomically(const std::filesystem::path& path,
                                         std::span<const std::uint8_t> bytes);
[[nodiscard]] Status WriteFileAtomically(const std::filesystem::path& path, std::string_view text);

// Flushes a finished file (or folder) to disk.
[[nodiscard]] Status SyncPath(const std::filesystem::path& path);

// A word that no other process uses, on whatever machine shares the folder: "PID-16 hex digits".
[[nodiscard]] std::string UniqueWord();

// Whether something can be made beside `path`: asked before long work whose result goes there. The
// message names the folder and `option`.
[[nodiscard]] Status CheckParentIsWritable(const std::filesystem::path& path,
                                           const std::string& option);

// Whether a file can be written at `path`: not a folder, its own folder writable. Devices and pipes
// pass.
[[nodiscard]] Status CheckFileCanBeWritten(const std::filesystem::path& path,
                                           const std::string& option);

// Puts the finished folder `staged` in the place of `target` by one rename: a target that exists is
// exchanged in one step (renameat2 RENAME_EXCHANGE) and then removed, so that a reader sees the old
// or the new whole folder. Both must lie on one file system.
[[nodiscard]] Status PublishDirectory(const std::filesystem::path& staged,
                                      const std::filesystem::path& target);

// Makes a folder and its parents; one that is there is fine. kIo names the folder and the mend:
// another value of `option`.
[[nodiscard]] Status MakeDirectories(const std::filesystem::path& folder,
                                     const std::string& option);

}  // namespace panofix
