#include "common/package/tar_header.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

#include "common/base/log.h"

namespace panofix {
namespace {

constexpr std::size_t kNameBytes = 100, kSizeAt = 124, kSizeDigits = 11, kSumAt = 148,
                      kTypeAt = 156;
constexpr char kMend[] = "; get the package again, as panofix-builder wrote it";

void Put(TarBlock* block, std::size_t at, const std::string& text) {
  std::copy(text.begin(), text.end(), block->begin() + static_cast<std::ptrdiff_t>(at));
}

bool IsHex(std::string_view text, std::size_t size, const char* digits) {
  return text.size() == size && text.find_first_not_of(digits) == std::string_view::npos;
}

std::string_view Between(std::string_view text, std::string_view before, std::string_view after) {
  if (!text.starts_with(before) || !text.ends_with(after) ||
      text.size() < before.size() + after.size()) {
    return {};
  }
  text.remove_prefix(before.size());
  return text.substr(0, text.size() - after.size());
}

// What a header that is none of ours holds.
std::string FaultOf(const TarBlock& block, const std::string& entry) {
  const char type = static_cast<char>(block[kTypeAt]);
  if (type == '1' || type == '2') return "holds a link";
  if (entry.starts_with('/')) return "holds an absolute name";
  if (("/" + entry + "/").find("/../") != std::string::npos)
    return "holds a name that leads out of its folder";
  if (type != '0') return "holds something that is no plain file";
  if (!IsPackageName(entry)) return "holds a file that is no part of a package";
  return "holds a header that panofix does not write";
}

}  // namespace

bool IsPackageName(const std::string& name) {
  constexpr char kLower[] = "0123456789abcdef", kUpper[] = "0123456789ABCDEF";
  return name == "delta.json" || name == "manifest.json" || name == "manifest.json.minisig" ||
         IsHex(Between(name, "objects/", ""), 64, kLower) ||
         IsHex(Between(name, "patches/", ".zst"), 64, kLower) ||
         IsHex(Between(name, "keys/", ".pub"), 16, kUpper) ||
         IsHex(Between(name, "keys/", ".pub.minisig"), 16, kUpper);
}

TarBlock EncodeTarHeader(const PackageEntry& entry) {
  if (!IsPackageName(entry.name) || entry.num_bytes > kMaxEntryBytes)
    throw std::logic_error("no entry of a package: " + entry.name);
  TarBlock block{};
  Put(&block, 0, entry.name);
  Put(&block, kNameBytes, "0000444");
  Put(&block, 108, "0000000");  // owner
  Put(&block, 116, "0000000");  // group
  Put(&block, kSizeAt, Format("%011llo", static_cast<unsigned long long>(entry.num_bytes)));
  Put(&block, 136, "00000000000");  // time
  Put(&block, kSumAt, "        ");
  block[kTypeAt] = '0';
  Put(&block, 257, std::string("ustar\0", 6) + "00");
  unsigned int sum = 0;
  for (const std::uint8_t byte : block) sum += byte;
  Put(&block, kSumAt, Format("%06o", sum) + std::string("\0 ", 2));
  return block;
}

Result<std::optional<PackageEntry>> DecodeTarHeader(const TarBlock& block,
                                                    const std::string& name) {
  if (block == TarBlock{}) return std::optional<PackageEntry>();
  const char* text = reinterpret_cast<const char*>(block.data());
  PackageEntry entry;
  entry.name.assign(text, ::strnlen(text, kNameBytes));
  bool is_ours = IsPackageName(entry.name);
  for (std::size_t i = kSizeAt; i < kSizeAt + kSizeDigits; ++i) {
    const std::uint8_t digit = block[i];
    is_ours = is_ours && digit >= '0' && digit <= '7';
    entry.num_bytes = entry.num_bytes << 3 | static_cast<std::uint64_t>(digit & 7);
  }
  // One entry has one header: whatever else a header could say, ours do not.
  if (is_ours && EncodeTarHeader(entry) == block) return std::optional<PackageEntry>(entry);
  return Status(ErrorCode::kBadData, name + ": " + FaultOf(block, entry.name) + kMend);
}

}  // namespace panofix
