#pragma once
// A .pfb package from front to end, one entry after the other. Takes nothing for granted.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include "common/base/status.h"
#include "common/io/unique_fd.h"
#include "common/package/tar_header.h"

namespace panofix {

class PackageReader {
 public:
  [[nodiscard]] static Result<PackageReader> Open(const std::filesystem::path& path);
  // From an open descriptor, at its present position; `name` is for messages.
  PackageReader(UniqueFd fd, const std::string& name) : name_(name), fd_(std::move(fd)) {}

  // The next entry, what is left of the last one skipped; nullopt at the end, after which there is
  // nothing. kIncomplete where the file stops before, kBadData.
  [[nodiscard]] Result<std::optional<PackageEntry>> Next();
  // The next bytes of the present entry, as many as fit into `buffer`; 0 at its end.
  [[nodiscard]] Result<std::size_t> Read(std::span<std::uint8_t> buffer);
  // All of the present entry: kTooLarge above `max_bytes`.
  [[nodiscard]] Result<std::string> ReadAll(std::size_t max_bytes);

 private:
  [[nodiscard]] Status ReadExactly(std::span<std::uint8_t> buffer);
  [[nodiscard]] Status SkipRest();
  [[nodiscard]] Status CheckEnd();

  std::string name_;
  UniqueFd fd_;
  PackageEntry entry_;
  std::uint64_t left_ = 0;
  bool has_entry_ = false;
};

}  // namespace panofix
