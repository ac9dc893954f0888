#include "runtime/mcap/mcap_writer.h"

#include <fcntl.h>
#include <sys/uio.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "runtime/mcap/mcap_format.h"

namespace panofix {
namespace {

using namespace mcap_format;

template <typename T>
void Put(T value, std::string* out) {
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    out->push_back(static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * i) & 0xff));
  }
}

void PutText(const std::string& text, std::string* out) {
  Put(static_cast<std::uint32_t>(text.size()), out);
  *out += text;
}

void PutMap(const McapMetadata& map, std::string* out) {
  std::string pairs;
  for (const auto& [key, value] : map) {
    PutText(key, &pairs);
    PutText(value, &pairs);
  }
  PutText(pairs, out);  // prefixed by its bytes, as a text is
}

// `content` under its opcode; `surplus_bytes` of it follow.
std::string Record(std::uint8_t opcode, const std::string& content, std::size_t surplus_bytes = 0) {
  std::string record;
  Put(opcode, &record);
  Put(static_cast<std::uint64_t>(content.size() + surplus_bytes), &record);
  return record + content;
}

}  // namespace

Result<McapWriter> McapWriter::Create(const std::filesystem::path& path) {
  constexpr mode_t kMode = 0640;  // pictures of streets and people
  UniqueFd fd(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, kMode));
  if (!fd.valid() && errno == EEXIST) {
    return Status(ErrorCode::kInvalidArgument,
                  path.string() + ": there already; choose another name, or a folder");
  }
  if (!fd.valid()) {
    return Status(ErrorCode::kIo, path.string() + ": cannot create: " + std::strerror(errno) +
                                      "; check the folder");
  }
  McapWriter writer(path.string(), std::move(fd));
  std::string header;
  PutText("", &header);
  PutText("panofix", &header);
  if (Status status = writer.Append(std::string(kMagic) + Record(kHeader, header)); !status.ok()) {
    return status;
  }
  return writer;
}

// Head and data by one call; a file that could not take all of them is cut back to its last record.
Status McapWriter::Append(const std::string& head, std::span<const std::uint8_t> data) {
  if (!failure_.ok()) return failure_;
  const std::size_t size = head.size() + data.size();
  std::size_t done = 0;
  while (done < size) {
    const std::size_t in_data = done > head.size() ? done - head.size() : 0;
    iovec parts[2] = {};
    int num_parts = 0;
    if (done < head.size()) {
      parts[num_parts++] = {const_cast<char*>(head.data()) + done, head.size() - done};
    }
    if (in_data < data.size()) {
      parts[num_parts++] = {const_cast<std::uint8_t*>(data.data()) + in_data,
                            data.size() - in_data};
    }
    const ssize_t written = ::writev(fd_.get(), parts, num_parts);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      const int number = errno;
      failure_ = {number == ENOSPC || number == EDQUOT || number == EFBIG ? ErrorCode::kNoSpace
                                                                          : ErrorCode::kIo,
                  path_ + ": cannot write: " + std::strerror(number) +
                      "; the recording ends here, free some space"};
      if (::ftruncate(fd_.get(), num_bytes_) == 0) ::lseek(fd_.get(), num_bytes_, SEEK_SET);
      return failure_;
    }
    done += static_cast<std::size_t>(written);
  }
  num_bytes_ += static_cast<std::int64_t>(size);
  return {};
}

Result<std::uint16_t> McapWriter::AddChannel(const std::string& topic, const Schema& schema) {
  const std::uint16_t id = ++num_channels_;
  std::string content;
  Put(id, &content);
  PutText(schema.name, &content);
  PutText(schema.encoding, &content);
  PutText(std::string(schema.data.begin(), schema.data.end()), &content);
  const std::string record = Record(kSchema, content);
  content.clear();
  Put(id, &content);
  Put(id, &content);  // of the schema
  PutText(topic, &content);
  PutText(schema.encoding, &content);
  PutMap({}, &content);
  if (Status status = Append(record + Record(kChannel, content)); !status.ok()) return status;
  return id;
}

Status McapWriter::WriteMessage(std::uint16_t channel_id, std::uint64_t written_ns,
                                std::uint64_t captured_ns, std::span<const std::uint8_t> data) {
  std::string content;
  Put(channel_id, &content);
  Put(num_messages_[channel_id]++, &content);
  Put(written_ns, &content);
  Put(captured_ns, &content);
  return Append(Record(kMessage, content, data.size()), data);
}

Status McapWriter::WriteMetadata(const std::string& name, const McapMetadata& metadata) {
  std::string content;
  PutText(name, &content);
  PutMap(metadata, &content);
  return Append(Record(kMetadata, content));
}

Status McapWriter::Finish() {
  std::string data_end, footer;
  Put(std::uint32_t{0}, &data_end);  // no checksum
  Put(std::uint64_t{0}, &footer);    // no summary
  Put(std::uint64_t{0}, &footer);
  Put(std::uint32_t{0}, &footer);
  if (Status status =
          Append(Record(kDataEnd, data_end) + Record(kFooter, footer) + std::string(kMagic));
      !status.ok()) {
    return status;
  }
  if (::fsync(fd_.get()) != 0) {
    return {ErrorCode::kIo, path_ + ": cannot flush: " + std::strerror(errno)};
  }
  return {};
}

}  // namespace panofix
