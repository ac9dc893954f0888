#include "common/image/image_header.h"

#include <zlib.h>

#include <cstring>
#include <optional>

#include "common/base/log.h"

namespace panofix {
namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr std::uint8_t kPngSignature[8] = {0x89, 'P', 'N', 'G', 0x0D, 0x0A, 0x1A, 0x0A};
constexpr std::size_t kPngFirstChunkEnd = 8 + 8 + 13 + 4;
// Deflate shrinks at most 1032 : 1 (zlib, "Technical details"); a PNG that states more is a bomb.
constexpr std::uint64_t kMaxDeflateRatio = 1032;
// A progressive JPEG has about ten; each costs a pass over the picture, whatever bytes it has.
constexpr int kMaxJpegScans = 256;

std::uint32_t Big16(Bytes bytes, std::size_t at) {
  return static_cast<std::uint32_t>(bytes[at]) << 8 | bytes[at + 1];
}
std::uint32_t Big32(Bytes bytes, std::size_t at) {
  return Big16(bytes, at) << 16 | Big16(bytes, at + 2);
}

Status CutShort(const char* kind, std::size_t num_bytes) {
  return {ErrorCode::kBadData,
          Format("%s cut short at byte %zu; copy or export the image again", kind, num_bytes)};
}

bool IsJpeg(Bytes bytes) {
  return bytes.size() >= 3 && bytes[0] == 0xFF && bytes[1] == 0xD8 && bytes[2] == 0xFF;
}
bool IsPng(Bytes bytes) {
  return bytes.size() >= 8 && std::memcmp(bytes.data(), kPngSignature, 8) == 0;
}

// Steps through JPEG marker segments. After kScan the cursor is at the scan's entropy-coded data.
class JpegWalker {
 public:
  explicit JpegWalker(Bytes bytes) : bytes_(bytes) {}

  struct Segment {
    std::uint8_t marker;
    Bytes body;
  };
  // The next segment, its body without the length field; nullopt where the bytes end or do not
  // follow the format.
  std::optional<Segment> Next() {
    if (at_ >= bytes_.size() || bytes_[at_] != 0xFF) return std::nullopt;
    while (at_ < bytes_.size() && bytes_[at_] == 0xFF) ++at_;  // fill bytes may precede a marker
    if (at_ >= bytes_.size()) return std::nullopt;
    const std::uint8_t marker = bytes_[at_++];
    const bool stands_alone = marker == 0x01 || (marker >= 0xD0 && marker <= 0xD9);
    if (stands_alone) return Segment{marker, {}};
    if (bytes_.size() - at_ < 2) return std::nullopt;
    const std::size_t length = Big16(bytes_, at_);
    if (length < 2 || bytes_.size() - at_ < length) return std::nullopt;
    const Segment segment{marker, bytes_.subspan(at_ + 2, length - 2)};
    at_ += length;
    return segment;
  }
  // Moves to the marker that ends a scan: 0xFF followed by neither 0 (a stuffed data byte), nor a
  // restart marker, nor fill. False where there is none.
  bool SkipScan() {
    while (at_ < bytes_.size()) {
      const void* found = std::memchr(bytes_.data() + at_, 0xFF, bytes_.size() - at_);
      if (found == nullptr) break;
      at_ = static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - bytes_.data());
      if (at_ + 1 >= bytes_.size()) break;
      const std::uint8_t next = bytes_[at_ + 1];
      if (next == 0xFF) {
        ++at_;
      } else if (next == 0 || (next >= 0xD0 && next <= 0xD7)) {
        at_ += 2;
      } else {
        return true;
      }
    }
    at_ = bytes_.size();
    return false;
  }
  [[nodiscard]] std::size_t position() const { return at_; }
  [[nodiscard]] bool AtEnd() const { return at_ >= bytes_.size(); }

 private:
  Bytes bytes_;
  std::size_t at_ = 2;  // after the start-of-image marker
};

bool IsStartOfFrame(std::uint8_t marker) {
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

Result<ImageHeader> ParseJpegHeader(Bytes bytes) {
  JpegWalker walker(bytes);
  while (true) {
    const auto segment = walker.Next();
    if (!segment || segment->marker == 0xD9 || segment->marker == 0xDA) {
      return Status(ErrorCode::kBadData,
                    Format("JPEG without a size before byte %zu; copy or export the image again",
                           walker.position()));
    }
    if (!IsStartOfFrame(segment->marker)) continue;
    if (segment->body.size() < 6) return CutShort("JPEG frame header", walker.position());
    ImageHeader header;
    header.kind = ImageKind::kJpeg;
    header.bits_per_channel = segment->body[0];
    header.size = {static_cast<int>(Big16(segment->body, 3)),
                   static_cast<int>(Big16(segment->body, 1))};
    header.num_channels = segment->body[5];
    return header;
  }
}

Result<ImageHeader> ParsePngHeader(Bytes bytes) {
  if (bytes.size() < kPngFirstChunkEnd) return CutShort("PNG header", bytes.size());
  if (Big32(bytes, 8) != 13 || std::memcmp(bytes.data() + 12, "IHDR", 4) != 0) {
    return Status(ErrorCode::kBadData, "PNG does not start with IHDR; export the image again");
  }
  const std::uint32_t width_px = Big32(bytes, 16), height_px = Big32(bytes, 20);
  if (width_px > 0x7FFFFFFF || height_px > 0x7FFFFFFF) {
    return Status(ErrorCode::kBadData, "PNG size is out of range; export the image again");
  }
  ImageHeader header;
  header.kind = ImageKind::kPng;
  header.size = {static_cast<int>(width_px), static_cast<int>(height_px)};
  header.bits_per_channel = bytes[24];
  const std::uint8_t color_type = bytes[25];
  header.is_palette = color_type == 3;
  header.num_channels = color_type == 2 ? 3 : color_type == 4 ? 2 : color_type == 6 ? 4 : 1;
  return header;
}

Status CheckJpegComplete(Bytes bytes) {
  JpegWalker walker(bytes);
  int num_scans = 0;
  while (true) {
    const auto segment = walker.Next();
    if (!segment && walker.AtEnd()) return CutShort("JPEG", bytes.size());
    if (!segment) {
      return {ErrorCode::kBadData,
              Format("JPEG damaged or cut short at byte %zu; copy or export the "
                     "image again",
                     walker.position())};
    }
    if (segment->marker == 0xD9) break;
    if (segment->marker != 0xDA) continue;
    if (++num_scans > kMaxJpegScans) {
      return {ErrorCode::kTooLarge,
              Format("JPEG of more than %d scans; export it as a baseline JPEG", kMaxJpegScans)};
    }
    if (!walker.SkipScan()) return CutShort("JPEG", bytes.size());
  }
  if (num_scans == 0)
    return {ErrorCode::kBadData, "JPEG holds no picture data; export the image again"};
  return {};
}

Status CheckPngComplete(Bytes bytes, const ImageHeader& header) {
  std::uint64_t num_data_bytes = 0;
  for (std::size_t at = sizeof(kPngSignature);;) {
    if (bytes.size() - at < 12) return CutShort("PNG", bytes.size());
    const std::size_t length = Big32(bytes, at);
    if (bytes.size() - at - 12 < length) return CutShort("PNG", bytes.size());
    const auto computed = crc32(0, bytes.data() + at + 4, static_cast<uInt>(length + 4));
    if (computed != Big32(bytes, at + 8 + length)) {
      return {ErrorCode::kBadData,
              Format("PNG damaged in the chunk at byte %zu; copy or export the image again", at)};
    }
    const std::uint8_t* name = bytes.data() + at + 4;
    if (std::memcmp(name, "IEND", 4) == 0) break;
    if (std::memcmp(name, "IDAT", 4) == 0) num_data_bytes += length;
    at += length + 12;
  }
  const std::uint64_t bits =
      static_cast<std::uint64_t>(header.size.width_px) *
      static_cast<std::uint64_t>(header.num_channels * header.bits_per_channel);
  const std::uint64_t raw_bytes =
      (bits / 8 + 1) * static_cast<std::uint64_t>(header.size.height_px);
  if (raw_bytes / kMaxDeflateRatio > num_data_bytes) {
    return {ErrorCode::kBadData, "PNG holds too little data for its size; export the image again"};
  }
  return {};
}

}  // namespace

Result<ImageHeader> ParseImageHeader(Bytes bytes) {
  if (!IsJpeg(bytes) && !IsPng(bytes)) {
    return Status(ErrorCode::kBadData,
                  "neither a JPEG nor a PNG; convert the image to one of them");
  }
  Result<ImageHeader> header = IsJpeg(bytes) ? ParseJpegHeader(bytes) : ParsePngHeader(bytes);
  if (header.ok() && (header->size.width_px <= 0 || header->size.height_px <= 0)) {
    return Status(ErrorCode::kBadData, Format("image size %dx%d; export the image again",
                                              header->size.width_px, header->size.height_px));
  }
  return header;
}

Status CheckImageComplete(Bytes bytes, const ImageHeader& header) {
  return header.kind == ImageKind::kJpeg ? CheckJpegComplete(bytes)
                                         : CheckPngComplete(bytes, header);
}

}  // namespace panofix
