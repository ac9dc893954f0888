#include "runtime/mcap/mcap_reader.h"

#include <cerrno>
#include <cstring>
#include <span>

#include "common/base/log.h"
#include "runtime/mcap/mcap_format.h"

namespace panofix {
namespace {

using namespace mcap_format;

// Takes fields off the front; once something is missing nothing more comes.
class Fields {
 public:
  explicit Fields(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  template <typename T>
  T Take() {
    if (!Has(sizeof(T))) return 0;
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i) value |= std::uint64_t{bytes_[i]} << (8 * i);
    bytes_ = bytes_.subspan(sizeof(T));
    return static_cast<T>(value);
  }
  std::string TakeText() {
    const auto size = Take<std::uint32_t>();
    if (!Has(size)) return {};
    std::string text(bytes_.begin(), bytes_.begin() + size);
    bytes_ = bytes_.subspan(size);
    return text;
  }
  [[nodiscard]] bool empty() const { return bytes_.empty(); }
  [[nodiscard]] bool ok() const { return ok_; }

 private:
  bool Has(std::size_t size) {
    ok_ = ok_ && bytes_.size() >= size;
    return ok_;
  }
  std::span<const std::uint8_t> bytes_;
  bool ok_ = true;
};

McapMetadata TakeMap(Fields* fields) {
  const std::string text = fields->TakeText();
  Fields pairs({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  McapMetadata map;
  while (pairs.ok() && !pairs.empty()) {
    const std::string key = pairs.TakeText();
    map[key] = pairs.TakeText();
  }
  return map;
}

}  // namespace

Result<McapReader> McapReader::Open(const std::filesystem::path& path,
                                    std::size_t max_record_bytes) {
  std::error_code error;
  const auto num_bytes = std::filesystem::file_size(path, error);
  std::ifstream file(path, std::ios::binary);
  if (error || !file) {
    return Status(ErrorCode::kNotFound, path.string() + ": cannot read; name an MCAP file");
  }
  McapReader reader(path.string(), std::move(file), num_bytes, max_record_bytes);
  std::string magic(kMagic.size(), '\0');
  if (!reader.file_.read(magic.data(), static_cast<std::streamsize>(magic.size())) ||
      magic != kMagic) {
    return reader.Bad("not an MCAP file of version 0");
  }
  reader.offset_ = magic.size();
  return reader;
}

Status McapReader::Bad(const std::string& what) const {
  return {ErrorCode::kBadData, Format("%s: at byte %llu: %s; record it again", path_.c_str(),
                                      static_cast<unsigned long long>(offset_), what.c_str())};
}

Result<std::optional<McapRecord>> McapReader::Next() {
  while (!is_done_) {
    std::uint8_t head[kRecordHeadBytes];
    const std::uint64_t left = num_bytes_ - std::min(offset_, num_bytes_);
    if (left < sizeof(head)) break;
    if (!file_.read(reinterpret_cast<char*>(head), sizeof(head))) return Bad("cannot read");
    Fields fields(head);
    const auto opcode = fields.Take<std::uint8_t>();
    const auto size = fields.Take<std::uint64_t>();
    if (opcode == kDataEnd || opcode == kFooter) {
      is_done_ = true;
      return std::optional<McapRecord>();
    }
    if (size > left - sizeof(head)) break;
    if (size > max_record_bytes_) return Bad(Format("a record of %.0f MB", double(size) / 1e6));
    std::vector<std::uint8_t> content(size);
    if (size > 0 &&
        !file_.read(reinterpret_cast<char*>(content.data()), static_cast<std::streamsize>(size))) {
      return Bad("cannot read");
    }
    auto record = Parse(opcode, std::move(content));
    if (!record.ok() || record->has_value()) return record;
    offset_ += sizeof(head) + size;
  }
  was_cut_ = was_cut_ || !is_done_;
  is_done_ = true;
  return std::optional<McapRecord>();
}

Result<std::optional<McapRecord>> McapReader::Parse(std::uint8_t opcode,
                                                    std::vector<std::uint8_t> content) {
  Fields fields(content);
  McapRecord record;
  if (opcode == kChannel) {
    const auto id = fields.Take<std::uint16_t>();
    static_cast<void>(fields.Take<std::uint16_t>());
    topics_[id] = fields.TakeText();
    if (!fields.ok()) return Bad("a channel that is cut short");
    return std::optional<McapRecord>();
  }
  if (opcode == kMetadata) {
    record.name = fields.TakeText();
    record.metadata = TakeMap(&fields);
    if (!fields.ok()) return Bad("metadata that are cut short");
  } else if (opcode == kMessage) {
    const auto topic = topics_.find(fields.Take<std::uint16_t>());
    static_cast<void>(fields.Take<std::uint32_t>());
    static_cast<void>(fields.Take<std::uint64_t>());
    record.captured_ns = fields.Take<std::uint64_t>();
    if (!fields.ok()) return Bad("a message that is cut short");
    if (topic == topics_.end()) return Bad("a message of no channel");
    record.is_message = true;
    record.name = topic->second;
    content.erase(content.begin(), content.begin() + kMessageHeadBytes);
    record.data = std::move(content);
  } else {
    return std::optional<McapRecord>();
  }
  offset_ += kRecordHeadBytes +
             (record.is_message ? record.data.size() + kMessageHeadBytes : content.size());
  return std::optional<McapRecord>(std::move(record));
}

}  // namespace panofix
