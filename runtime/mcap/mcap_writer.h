#pragma once
// Writes MCAP files (mcap.dev, version 0), unchunked: each message lies on disk whole before the
// next begins, so that a crash loses nothing.

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>

#include "common/base/status.h"
#include "common/io/unique_fd.h"

namespace panofix {

using McapMetadata = std::map<std::string, std::string>;

class McapWriter {
 public:
  // A file that is there already is never touched (kInvalidArgument).
  [[nodiscard]] static Result<McapWriter> Create(const std::filesystem::path& path);
  McapWriter(McapWriter&&) = default;
  McapWriter& operator=(McapWriter&&) = default;

  struct Schema {
    std::string name;      // "foxglove.CompressedImage"
    std::string encoding;  // "flatbuffer"
    std::span<const std::uint8_t> data;
  };
  // Ids count from 1. Messages of the channel follow `schema`.
  [[nodiscard]] Result<std::uint16_t> AddChannel(const std::string& topic, const Schema& schema);
  // `written_ns`: now; `captured_ns`: what the message is about. After a failure (kNoSpace, kIo)
  // the file ends with the last whole record and takes no more.
  [[nodiscard]] Status WriteMessage(std::uint16_t channel_id, std::uint64_t written_ns,
                                    std::uint64_t captured_ns, std::span<const std::uint8_t> data);
  [[nodiscard]] Status WriteMetadata(const std::string& name, const McapMetadata& metadata);
  // The end marks, and all of it flushed to disk.
  [[nodiscard]] Status Finish();
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  McapWriter(std::string path, UniqueFd fd) : path_(std::move(path)), fd_(std::move(fd)) {}
  [[nodiscard]] Status Append(const std::string& head, std::span<const std::uint8_t> data = {});

  std::string path_;
  UniqueFd fd_;
  std::int64_t num_bytes_ = 0;  // of whole records
  Status failure_;
  std::uint16_t num_channels_ = 0;
  std::map<std::uint16_t, std::uint32_t> num_messages_;  // by channel: their sequence numbers
};

}  // namespace panofix
