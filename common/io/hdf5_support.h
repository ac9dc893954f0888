#pragma once
// What the HDF5 reader and writer share: the library's lock, owned handles, errors as text.
// Included by the .cc files of this folder only.

#include <hdf5.h>

#include <cstddef>
#include <mutex>
#include <string>
#include <utility>

#include "common/base/status.h"
#include "common/io/hdf5_file.h"

namespace panofix::hdf5 {

// Debian's HDF5 is the serial build: one call at a time in the whole process. Also silences the
// library's own printing to standard error.
class Lock {
 public:
  Lock();
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;

 private:
  std::lock_guard<std::mutex> guard_;
};

// An owned HDF5 identifier. Made and destroyed under Lock.
class Handle {
 public:
  using Closer = herr_t (*)(hid_t);
  Handle() = default;
  Handle(hid_t id, Closer closer) : id_(id), closer_(closer) {}
  ~Handle() { Close(); }
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), closer_(other.closer_) {}
  Handle& operator=(Handle&& other) noexcept {
    if (this != &other) {
      Close();
      id_ = std::exchange(other.id_, -1);
      closer_ = other.closer_;
    }
    return *this;
  }
  [[nodiscard]] hid_t get() const { return id_; }
  [[nodiscard]] bool valid() const { return id_ >= 0; }
  // False where the library failed to close, for a file: to write what it still held.
  bool Close() { return id_ < 0 || closer_(std::exchange(id_, -1)) >= 0; }

 private:
  hid_t id_ = -1;
  Closer closer_ = nullptr;
};

// Makes a file access list read and write the open descriptor `fd`, whatever name is opened with
// it; under Lock. `fd` must outlive the file.
[[nodiscard]] bool UseDescriptor(hid_t access_list, int fd);

// The library's innermost complaint about its last failure, in one line; under Lock.
[[nodiscard]] std::string LastError();
// "file: doing failed (complaint); mend", kNoSpace where the disk is full; under Lock.
[[nodiscard]] Status FailureStatus(const std::string& file, const std::string& doing,
                                   ErrorCode otherwise, const std::string& mend);

[[nodiscard]] hid_t DiskType(ArrayType type);
[[nodiscard]] std::size_t ElementBytes(ArrayType type);
[[nodiscard]] const char* TypeName(ArrayType type);

}  // namespace panofix::hdf5
