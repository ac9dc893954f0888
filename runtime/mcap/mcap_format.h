#pragma once
// Numbers of the MCAP format, version 0, as far as it is written and read here.

#include <cstdint>
#include <string_view>

namespace panofix::mcap_format {

inline constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);
inline constexpr std::uint8_t kHeader = 0x01, kFooter = 0x02, kSchema = 0x03, kChannel = 0x04,
                              kMessage = 0x05, kMetadata = 0x0C, kDataEnd = 0x0F;
inline constexpr std::size_t kRecordHeadBytes = 9;    // opcode, length
inline constexpr std::size_t kMessageHeadBytes = 22;  // channel, sequence, two times

}  // namespace panofix::mcap_format
