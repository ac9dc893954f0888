#include "builder/ingest/depth_payload.h"

#include <zlib.h>

#include <array>
#include <bit>
#include <cmath>

#include "common/base/log.h"

namespace panofix {
namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr std::size_t kHeaderBytes = 8;
constexpr std::size_t kPlaneBytes = 16;
constexpr std::size_t kMaxPaddingBytes = 15;  // zeros that an exporter may add to align
constexpr std::size_t kMaxPayloadBytes = 255 + std::size_t{kMaxDepthWidth} * (kMaxDepthWidth / 2) +
                                         kMaxDepthPlanes * kPlaneBytes + kMaxPaddingBytes;
constexpr std::size_t kMaxTextBytes = kMaxPayloadBytes / 3 * 4 + 4096;
constexpr const char* kMend = "fetch or export the depth again";

Status Bad(const std::string& fault) { return {ErrorCode::kBadData, fault + "; " + kMend}; }

constexpr std::array<std::int8_t, 256> MakeBase64Values() {
  std::array<std::int8_t, 256> values{};
  values.fill(-1);
  constexpr std::string_view kAlphabet =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  for (std::size_t i = 0; i < kAlphabet.size(); ++i) {
    values[static_cast<std::uint8_t>(kAlphabet[i])] = static_cast<std::int8_t>(i);
  }
  values['-'] = 62;
  values['_'] = 63;
  return values;
}
constexpr auto kBase64Values = MakeBase64Values();

bool IsSpace(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }

std::size_t U16(Bytes bytes, std::size_t at) {
  return bytes[at] | static_cast<std::size_t>(bytes[at + 1]) << 8;
}

float F32(Bytes bytes, std::size_t at) {
  const std::uint32_t bits = static_cast<std::uint32_t>(U16(bytes, at)) |
                             static_cast<std::uint32_t>(U16(bytes, at + 2)) << 16;
  return std::bit_cast<float>(bits);
}

// A zlib header. Asked only where the first byte is not a raw payload's 8, which zlib allows too.
bool LooksLikeZlib(Bytes bytes) {
  return bytes.size() >= 2 && (bytes[0] & 0x0F) == 8 && bytes[0] <= 0x78 &&
         (bytes[0] * 256 + bytes[1]) % 31 == 0;
}

bool IsPadding(Bytes rest) {
  if (rest.size() > kMaxPaddingBytes) return false;
  for (const std::uint8_t byte : rest) {
    if (byte != 0) return false;
  }
  return true;
}

Result<std::vector<std::uint8_t>> Inflate(Bytes bytes) {
  z_stream stream{};
  if (inflateInit(&stream) != Z_OK) return Status(ErrorCode::kInternal, "zlib could not start");
  std::vector<std::uint8_t> payload;
  stream.next_in = const_cast<Bytef*>(bytes.data());  // zlib's interface lacks const
  stream.avail_in = static_cast<uInt>(bytes.size());
  int outcome = Z_OK;
  while (outcome == Z_OK && payload.size() <= kMaxPayloadBytes) {
    constexpr std::size_t kStep = std::size_t{256} << 10;
    const std::size_t filled = payload.size();
    payload.resize(filled + kStep);
    stream.next_out = payload.data() + filled;
    stream.avail_out = static_cast<uInt>(kStep);
    outcome = inflate(&stream, Z_NO_FLUSH);
    payload.resize(filled + kStep - stream.avail_out);
  }
  const std::size_t left = stream.avail_in;
  inflateEnd(&stream);
  if (outcome == Z_OK || payload.size() > kMaxPayloadBytes) {
    return Status(ErrorCode::kTooLarge,
                  Format("zlib stream inflates past %zu bytes; %s", kMaxPayloadBytes, kMend));
  }
  if (outcome == Z_BUF_ERROR) return Bad("zlib stream cut short");
  if (outcome != Z_STREAM_END) return Bad("zlib stream is damaged");
  if (!IsPadding(bytes.last(left))) return Bad(Format("%zu bytes after the zlib stream", left));
  return payload;
}

// Sizes and counts against their limits and against the bytes there are.
Status CheckHeader(Bytes raw, std::size_t* planes_at) {
  if (raw.size() < kHeaderBytes)
    return Bad(Format("payload of %zu bytes has no header", raw.size()));
  if (raw[0] != kHeaderBytes) return Bad(Format("header size %d instead of 8", raw[0]));
  const std::size_t num_planes = U16(raw, 1), width = U16(raw, 3), height = U16(raw, 5),
                    offset = raw[7];
  if (num_planes < 1 || num_planes > kMaxDepthPlanes) {
    return Bad(Format("%zu planes; 1 to %d are allowed", num_planes, kMaxDepthPlanes));
  }
  if (width == 0 || height == 0 || width != 2 * height) {
    return Bad(Format("depth is %zux%zu; the width must be twice the height", width, height));
  }
  if (width > kMaxDepthWidth) {
    return {ErrorCode::kTooLarge,
            Format("depth is %zux%zu; at most %d columns are read", width, height, kMaxDepthWidth)};
  }
  if (offset < kHeaderBytes) return Bad(Format("index offset %zu lies inside the header", offset));
  *planes_at = offset + width * height;
  const std::size_t needed = *planes_at + num_planes * kPlaneBytes;
  if (raw.size() < needed) {
    return Bad(Format("payload cut short: %zu bytes of %zu", raw.size(), needed));
  }
  if (!IsPadding(raw.subspan(needed))) {
    return Bad(Format("%zu bytes after the last plane", raw.size() - needed));
  }
  return {};
}

Result<DepthPayload> ParseRaw(Bytes raw) {
  std::size_t planes_at = 0;
  if (Status status = CheckHeader(raw, &planes_at); !status.ok()) return status;
  DepthPayload payload;
  payload.width = static_cast<int>(U16(raw, 3));
  payload.height = static_cast<int>(U16(raw, 5));
  payload.planes.resize(U16(raw, 1));
  for (std::size_t i = 1; i < payload.planes.size(); ++i) {
    const std::size_t at = planes_at + i * kPlaneBytes;
    DepthPlane& plane = payload.planes[i];
    plane.normal_in_pano = {F32(raw, at), F32(raw, at + 4), F32(raw, at + 8)};
    plane.d_m = F32(raw, at + 12);
    if (!plane.normal_in_pano.allFinite() || !std::isfinite(plane.d_m)) {
      return Bad(Format("plane %zu is not finite", i));
    }
  }
  const Bytes indices = raw.subspan(raw[7], planes_at - raw[7]);
  for (std::size_t i = 0; i < indices.size(); ++i) {
    if (indices[i] < payload.planes.size()) continue;
    const std::size_t width = U16(raw, 3);
    return Bad(Format("pixel %zu,%zu names plane %d of %zu", i % width, i / width, indices[i],
                      payload.planes.size()));
  }
  payload.plane_idx.assign(indices.begin(), indices.end());
  return payload;
}

}  // namespace

Result<std::vector<std::uint8_t>> DecodeBase64(std::string_view text) {
  while (!text.empty() && IsSpace(text.back())) text.remove_suffix(1);
  if (text.empty()) return Bad("file is empty");
  if (text.size() > kMaxTextBytes) {
    return Status(ErrorCode::kTooLarge, Format("text of %zu bytes; a depth file has at most %zu",
                                               text.size(), kMaxTextBytes));
  }
  const std::size_t padded_size = text.size();
  while (padded_size - text.size() < 2 && !text.empty() && text.back() == '=')
    text.remove_suffix(1);
  if (padded_size != text.size() && padded_size % 4 != 0) return Bad("base64 padding does not fit");
  if (text.size() % 4 == 1) return Bad("base64 text cut short");
  std::vector<std::uint8_t> bytes;
  bytes.reserve(text.size() / 4 * 3 + 2);
  std::uint32_t group = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto character = static_cast<std::uint8_t>(text[i]);
    const int value = kBase64Values[character];
    if (value < 0)
      return Bad(Format("character 0x%02X at position %zu is not base64", character, i));
    group = group << 6 | static_cast<std::uint32_t>(value);
    // Of every four characters the last three complete a byte each.
    if (i % 4 == 1) bytes.push_back(static_cast<std::uint8_t>(group >> 4));
    if (i % 4 == 2) bytes.push_back(static_cast<std::uint8_t>(group >> 2));
    if (i % 4 == 3) bytes.push_back(static_cast<std::uint8_t>(group));
  }
  return bytes;
}

Result<DepthPayload> ParseDepthPayload(Bytes bytes) {
  if (bytes.empty()) return Bad("payload is empty");
  if (bytes[0] == kHeaderBytes || !LooksLikeZlib(bytes)) return ParseRaw(bytes);
  const Result<std::vector<std::uint8_t>> inflated = Inflate(bytes);
  if (!inflated.ok()) return inflated.status();
  Result<DepthPayload> payload = ParseRaw(*inflated);
  if (payload.ok()) payload->is_zlib = true;
  return payload;
}

}  // namespace panofix
