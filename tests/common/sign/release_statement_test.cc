#include "common/sign/release_statement.h"

#include <gtest/gtest.h>

#include "common/sign/minisign.h"

namespace panofix {
namespace {

ReleaseStatement Full() {
  ReleaseStatement s;
  s.name = "quartier \"latin\" é";
  s.build = 42;
  s.created_s = 1800000000, s.expires_s = 1802592000;
  s.revoked_keys = {"0123456789ABCDEF"};
  s.quality = {{"share_fix", 0.925}, {"num_frames", 200}};
  return s;
}

TEST(ReleaseStatement, RoundTripOnOneLine) {
  const auto text = FormatStatement(Full());
  ASSERT_TRUE(text.ok()) << text.status().message();
  EXPECT_EQ(text->find('\n'), std::string::npos);
  EXPECT_NE(text->find("\"created\":\"2027-01-15T08:00:00Z\""), std::string::npos) << *text;
  const auto back = ParseStatement(*text, "m");
  ASSERT_TRUE(back.ok()) << back.status().message();
  EXPECT_EQ(back->name, Full().name);
  EXPECT_EQ(back->build, 42);
  EXPECT_EQ(back->created_s, Full().created_s);
  EXPECT_EQ(back->expires_s, Full().expires_s);
  EXPECT_EQ(back->revoked_keys, Full().revoked_keys);
  EXPECT_EQ(back->quality, Full().quality);
  EXPECT_EQ(*FormatStatement(*back), *text);
}

TEST(ReleaseStatement, MustFitASignature) {
  ReleaseStatement s = Full();
  for (int i = 0; i < 400; ++i) s.quality["a rather long name " + std::to_string(i)] = i;
  EXPECT_EQ(FormatStatement(s).status().code(), ErrorCode::kTooLarge);
}

TEST(ReleaseStatement, OtherTrustedCommentsAreNone) {
  const std::string good = *FormatStatement(Full());
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    return text.replace(text.find(from), from.size(), to);
  };
  for (const std::string& text :
       {std::string(), std::string("timestamp:1700000000\tfile:manifest.json\thashed"),
        std::string("{}"), std::string("[]"), good.substr(1), with("bundle release 1", "release"),
        with("2027-01-15T08:00:00Z", "2027-02-31T08:00:00Z"), with("2027-01-15", "2037-01-15"),
        with("42", "\"42\""), with("0123456789ABCDEF", "0123456789abcdef"),
        with("0.925", "\"much\"")}) {
    EXPECT_EQ(ParseStatement(text, "m").status().code(), ErrorCode::kUntrusted) << text;
  }
}

}  // namespace
}  // namespace panofix
