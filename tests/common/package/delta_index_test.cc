#include "common/package/delta_index.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace panofix {
namespace {

using Json = nlohmann::ordered_json;

DeltaIndex Full() {
  return {
      std::string(64, 'a'),
      std::string(64, 'b'),
      {{std::string(64, 'c'), std::string(64, 'd')}, {std::string(64, 'e'), std::string(64, 'd')}}};
}

TEST(DeltaIndex, RoundTrip) {
  for (const std::string& base : {Full().base, std::string()}) {
    DeltaIndex index = Full();
    index.base = base;
    const auto back = ParseDeltaIndex(ToJson(index), "p.pfb");
    ASSERT_TRUE(back.ok()) << back.status().message();
    EXPECT_EQ(back->base, base);
    EXPECT_EQ(back->target, index.target);
    EXPECT_EQ(back->patches, index.patches);
  }
}

TEST(DeltaIndex, OtherFormatsAndNonsenseAreRefused) {
  const auto code = [](const std::string& pointer, const Json& value) {
    Json json = Json::parse(ToJson(Full()));
    json[Json::json_pointer(pointer)] = value;
    return ParseDeltaIndex(json.dump(), "p.pfb").status().code();
  };
  EXPECT_EQ(code("/format/major", 2), ErrorCode::kUnsupportedVersion);
  EXPECT_EQ(code("/format/minor", 9), ErrorCode::kOk);
  EXPECT_EQ(code("/format/name", "panofix-bundle"), ErrorCode::kBadData);
  EXPECT_EQ(code("/target", "../../etc/passwd"), ErrorCode::kBadData);
  EXPECT_EQ(code("/base", ""), ErrorCode::kBadData);
  EXPECT_EQ(code("/patches/0/from", std::string(64, 'X')), ErrorCode::kBadData);
  EXPECT_EQ(code("/patches/1/object", std::string(64, 'c')), ErrorCode::kBadData);
  EXPECT_EQ(code("/patches", 3), ErrorCode::kBadData);
  for (const char* text : {"", "{", "[]", "null", "\xff"})
    EXPECT_EQ(ParseDeltaIndex(text, "p").status().code(), ErrorCode::kBadData) << text;
}

TEST(DeltaIndex, WindowsHoldBothSizesAndNoMoreThanAGigabyte) {
  EXPECT_EQ(PatchWindowLog(0, 0), 10);
  EXPECT_EQ(PatchWindowLog(1 << 19, 1 << 19), 20);
  EXPECT_EQ(PatchWindowLog((1 << 19) + 1, 1 << 19), 21);
  EXPECT_EQ(PatchWindowLog(kMaxPatchedBytes, kMaxPatchedBytes), 30);
  EXPECT_EQ(PatchWindowLog(std::uint64_t{1} << 40, 1), 30);
}

}  // namespace
}  // namespace panofix
