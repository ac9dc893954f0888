#pragma once
// Content-addressed files: an object is named by its SHA-256 and is whole and right, or not there.

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "common/base/status.h"
#include "common/io/sha256.h"
#include "common/io/unique_fd.h"
#include "runtime/store/store_files.h"

namespace panofix {

// One object on its way in. Removes what it wrote unless Commit succeeds.
class ObjectWriter {
 public:
  // An object of this hash and size, exactly. kIo, kNoSpace.
  [[nodiscard]] static Result<std::unique_ptr<ObjectWriter>> Begin(const StoreLayout& layout,
                                                                   const std::string& sha256,
                                                                   std::uint64_t num_bytes);
  ~ObjectWriter();
  ObjectWriter(const ObjectWriter&) = delete;
  ObjectWriter& operator=(const ObjectWriter&) = delete;
  // kEndlessData once it is more than the size stated; nothing of the excess is written.
  [[nodiscard]] Status Write(std::span<const std::uint8_t> bytes);
  // Flushes and puts the object in its place. kIncomplete, kMixedParts (another hash).
  [[nodiscard]] Status Commit();

 private:
  ObjectWriter(const StoreLayout& layout, const std::string& sha256, std::uint64_t num_bytes);
  const StoreLayout layout_;
  const std::string sha256_;
  const std::uint64_t num_bytes_;
  std::filesystem::path staged_;
  UniqueFd fd_;
  Sha256 hash_;
  std::uint64_t written_ = 0;
  bool is_committed_ = false;
};

// Whether the object is there and its bytes are right (all of them are read).
[[nodiscard]] bool HasGoodObject(const StoreLayout& layout, const std::string& sha256,
                                 std::uint64_t num_bytes);

}  // namespace panofix
