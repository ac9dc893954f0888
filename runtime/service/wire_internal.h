#pragma once
// What the message sources share. Includes FlatBuffers: for .cc files of this module only.

#include <flatbuffers/flatbuffers.h>

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "common/base/log.h"
#include "common/base/status.h"
#include "runtime/service/messages.h"
#include "runtime/service/wire_bytes.h"
#include "schemas/Time_generated.h"

namespace panofix::wire_internal {

inline constexpr std::int64_t kNsPerS = 1'000'000'000;
// No message of ours nests deeper than 3 tables or holds more than 20; LocationFix has metadata.
inline constexpr flatbuffers::uoffset_t kMaxDepth = 8, kMaxTables = 64;
inline constexpr std::size_t kMaxStringBytes = 1024;

inline foxglove::Time ToWireTime(std::int64_t timestamp_ns) {
  if (!FitsWireTime(timestamp_ns)) throw std::logic_error("timestamp does not fit the wire");
  return {static_cast<std::uint32_t>(timestamp_ns / kNsPerS),
          static_cast<std::uint32_t>(timestamp_ns % kNsPerS)};
}

inline Status Bad(const std::string& what) { return {ErrorCode::kBadData, what}; }

inline Result<std::int64_t> FromWireTime(const foxglove::Time* time, const char* message) {
  if (time == nullptr) return Bad(std::string(message) + " has no timestamp; set it");
  if (time->nsec() >= kNsPerS) {
    return Bad(Format("%s: timestamp.nsec %u; must be below 1e9", message, time->nsec()));
  }
  return std::int64_t{time->sec()} * kNsPerS + time->nsec();
}

// The root table of aligned bytes, or null where they do not verify under `identifier`.
template <typename T>
const T* VerifiedRoot(std::span<const std::uint8_t> bytes, const char* identifier) {
  // The verifier asserts on lengths that its 32-bit offsets cannot hold.
  if (bytes.size() >= FLATBUFFERS_MAX_BUFFER_SIZE) return nullptr;
  flatbuffers::Verifier verifier(bytes.data(), bytes.size(), kMaxDepth, kMaxTables);
  if (!verifier.VerifyBuffer<T>(identifier)) return nullptr;
  return flatbuffers::GetRoot<T>(bytes.data());
}

inline bool HasIdentifier(std::span<const std::uint8_t> bytes, const char* identifier) {
  return bytes.size() >= 2 * sizeof(flatbuffers::uoffset_t) &&
         flatbuffers::BufferHasIdentifier(bytes.data(), identifier);
}

inline std::vector<std::uint8_t> TakeBytes(const flatbuffers::FlatBufferBuilder& builder) {
  return {builder.GetBufferPointer(), builder.GetBufferPointer() + builder.GetSize()};
}

// Text of a message: bounded and without control characters, so that it can go into a log or a CSV
// row. A missing string is an empty one.
inline Result<std::string> Text(const flatbuffers::String* text, const char* field) {
  if (text == nullptr) return std::string();
  if (text->size() > kMaxStringBytes) {
    return Bad(Format("%s: %u bytes; at most %zu", field, text->size(), kMaxStringBytes));
  }
  std::string value = text->str();
  for (const char c : value) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
      return Bad(std::string(field) + ": holds a control character");
    }
  }
  return value;
}

}  // namespace panofix::wire_internal
