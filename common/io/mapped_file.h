#pragma once
// A whole file as read-only memory. It must not shrink meanwhile: for immutable files.

#include <cstdint>
#include <filesystem>
#include <span>

namespace panofix {

class MappedFile {
 public:
  // Regular files of at most `max_bytes`, never through a link at the end of the path; otherwise
  // not open.
  MappedFile(const std::filesystem::path& path, std::uint64_t max_bytes);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  [[nodiscard]] bool is_open() const { return is_open_; }
  [[nodiscard]] std::span<const std::uint8_t> bytes() const {
    return {static_cast<const std::uint8_t*>(data_), size_};
  }

 private:
  void* data_ = nullptr;
  std::size_t size_ = 0;
  bool is_open_ = false;
};

}  // namespace panofix
