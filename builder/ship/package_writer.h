#pragma once
// The bytes of a .pfb package, entry by entry (common/package/tar_header.h). Throws Error.

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

#include "common/io/unique_fd.h"
#include "common/package/tar_header.h"

namespace panofix {

// Writes to a file that has no name until Publish.
class PackageWriter {
 public:
  // Beside `path`: on its disk.
  explicit PackageWriter(const std::filesystem::path& path);
  ~PackageWriter();
  PackageWriter(const PackageWriter&) = delete;
  PackageWriter& operator=(const PackageWriter&) = delete;

  void Add(const std::string& name, std::span<const std::uint8_t> bytes);
  void Add(const std::string& name, std::string_view text);
  // All entries of another writer, which is not published.
  void Append(const PackageWriter& other);
  // The end marks; then the file takes its place by one rename.
  void Publish();
  [[nodiscard]] std::uint64_t num_bytes() const { return num_bytes_; }

 private:
  void Put(std::span<const std::uint8_t> bytes);
  const std::filesystem::path path_;
  std::filesystem::path aside_;
  UniqueFd fd_;
  std::uint64_t num_bytes_ = 0;
};

}  // namespace panofix
