#pragma once
// Reads MCAP files as McapWriter makes them: unchunked, front to back.

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "runtime/mcap/mcap_writer.h"

namespace panofix {

// A message, or a piece of metadata; records of other kinds are passed over.
struct McapRecord {
  bool is_message = false;
  std::string name;  // topic, or the metadata's name
  std::uint64_t captured_ns = 0;
  std::vector<std::uint8_t> data;  // of a message
  McapMetadata metadata;
};

// Bytes from outside: lengths are compared with `max_record_bytes` and the file before memory is
// taken.
class McapReader {
 public:
  [[nodiscard]] static Result<McapReader> Open(const std::filesystem::path& path,
                                               std::size_t max_record_bytes = std::size_t{128}
                                                                              << 20);
  // nullopt at the end, and where a file that a crash cut short ends: see was_cut(). kBadData names
  // the file and the offset.
  [[nodiscard]] Result<std::optional<McapRecord>> Next();
  [[nodiscard]] bool was_cut() const { return was_cut_; }

 private:
  McapReader(std::string path, std::ifstream file, std::uint64_t num_bytes, std::size_t max_record)
      : path_(std::move(path)),
        file_(std::move(file)),
        num_bytes_(num_bytes),
        max_record_bytes_(max_record) {}
  [[nodiscard]] Status Bad(const std::string& what) const;
  [[nodiscard]] Result<std::optional<McapRecord>> Parse(std::uint8_t opcode,
                                                        std::vector<std::uint8_t> content);

  std::string path_;
  std::ifstream file_;
  std::uint64_t num_bytes_ = 0, offset_ = 0;
  std::size_t max_record_bytes_ = 0;
  bool is_done_ = false, was_cut_ = false;
  std::map<std::uint16_t, std::string> topics_;
};

}  // namespace panofix
