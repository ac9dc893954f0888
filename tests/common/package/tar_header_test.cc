#include "common/package/tar_header.h"

#include <gtest/gtest.h>

#include <cstring>

namespace panofix {
namespace {

const std::string kHash(64, 'a');

PackageEntry Entry() { return {"objects/" + kHash, 1234567}; }

// A header with `text` at `at` and its checksum made right again.
TarBlock With(std::size_t at, const std::string& text) {
  TarBlock block = EncodeTarHeader(Entry());
  if (at == 0) std::fill_n(block.begin(), 100, std::uint8_t{0});
  std::copy(text.begin(), text.end(), block.begin() + static_cast<std::ptrdiff_t>(at));
  std::fill_n(block.begin() + 148, 8, std::uint8_t{' '});
  unsigned int sum = 0;
  for (const std::uint8_t byte : block) sum += byte;
  char digits[8];
  std::snprintf(digits, sizeof digits, "%06o", sum);
  std::memcpy(block.data() + 148, digits, 7);
  return block;
}

Status Refusal(const TarBlock& block) { return DecodeTarHeader(block, "p.pfb").status(); }

TEST(TarHeader, RoundTrip) {
  for (const std::string& name :
       {std::string("delta.json"), std::string("manifest.json"),
        std::string("manifest.json.minisig"), "objects/" + kHash, "patches/" + kHash + ".zst",
        std::string("keys/0123456789ABCDEF.pub"),
        std::string("keys/0123456789ABCDEF.pub.minisig")}) {
    for (const std::uint64_t size : {std::uint64_t{0}, std::uint64_t{1}, kMaxEntryBytes}) {
      const auto entry = DecodeTarHeader(EncodeTarHeader({name, size}), "p.pfb");
      ASSERT_TRUE(entry.ok()) << entry.status().message();
      ASSERT_TRUE(entry->has_value());
      EXPECT_EQ((*entry)->name, name);
      EXPECT_EQ((*entry)->num_bytes, size);
    }
  }
  EXPECT_FALSE(DecodeTarHeader(TarBlock{}, "p.pfb").value().has_value());
}

TEST(TarHeader, NothingElseIsWritten) {
  EXPECT_THROW((void)EncodeTarHeader({"../x", 1}), std::logic_error);
  EXPECT_THROW((void)EncodeTarHeader({"manifest.json", kMaxEntryBytes + 1}), std::logic_error);
}

TEST(TarHeader, PathsThatLeadOutAreNamed) {
  EXPECT_NE(Refusal(With(0, "/etc/passwd")).message().find("absolute name"), std::string::npos);
  for (const char* name : {"../x", "objects/../../x", "objects/.."})
    EXPECT_NE(Refusal(With(0, name)).message().find("leads out"), std::string::npos) << name;
}

TEST(TarHeader, LinksAndSpecialFilesAreNamed) {
  for (const char* type : {"1", "2"})
    EXPECT_NE(Refusal(With(156, type)).message().find("link"), std::string::npos);
  for (const char* type : {"3", "4", "5", "6", "7", "x", "g", "L", "K", "S"})
    EXPECT_NE(Refusal(With(156, type)).message().find("no plain file"), std::string::npos) << type;
  // A prefix would make another name of it; an owner, a time or a mode is not ours.
  for (const auto& [at, text] :
       std::vector<std::pair<std::size_t, std::string>>{{345, "/etc"},
                                                        {157, "target"},
                                                        {108, "0001750"},
                                                        {136, "14000000000"},
                                                        {100, "0004755"},
                                                        {265, "root"},
                                                        {257, "ustar  "},
                                                        {124, "77777777777x"},
                                                        {124, std::string("\x80\0\0\0", 4)}}) {
    const Status status = Refusal(With(at, text));
    EXPECT_EQ(status.code(), ErrorCode::kBadData) << at;
    EXPECT_EQ(status.message().rfind("p.pfb: ", 0), 0U);
  }
}

TEST(TarHeader, OnlyNamesOfAPackage) {
  for (const std::string& name :
       {std::string(), std::string("x"), std::string("manifest.json/"),
        std::string("./manifest.json"), "objects/" + std::string(64, 'A'),
        "objects/" + kHash.substr(1), "objects/" + kHash + "a", "patches/" + kHash,
        "objects/" + std::string(64, 'g'), std::string("keys/0123456789abcdef.pub"),
        std::string("keys/.pub"), std::string("delta.json\0", 11)}) {
    EXPECT_FALSE(IsPackageName(name)) << name;
  }
}

TEST(TarHeader, EveryFlippedBitIsFound) {
  const TarBlock good = EncodeTarHeader(Entry());
  for (std::size_t bit = 0; bit < 8 * good.size(); ++bit) {
    TarBlock bad = good;
    bad[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
    EXPECT_EQ(Refusal(bad).code(), ErrorCode::kBadData) << bit;
  }
}

}  // namespace
}  // namespace panofix
