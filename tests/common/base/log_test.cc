#include "common/base/log.h"

#include <gtest/gtest.h>

namespace panofix {
namespace {

TEST(Log, TakesItsLevelsByNameOnly) {
  for (const char* name : {"debug", "warning", "error", "off", "info"}) {
    EXPECT_TRUE(SetLogLevel(name)) << name;
  }
  for (const char* name : {"", "Info", "verbose", "warn"}) EXPECT_FALSE(SetLogLevel(name)) << name;
}

TEST(Log, LevelsBelowTheChosenOneAreSilent) {
  testing::internal::CaptureStderr();
  ASSERT_TRUE(SetLogLevel("warning"));
  LogInfo("quiet line");
  LogWarning("loud line {}");  // braces are text, not a format
  const std::string text = testing::internal::GetCapturedStderr();
  ASSERT_TRUE(SetLogLevel("info"));
  EXPECT_EQ(text.find("quiet line"), std::string::npos);
  EXPECT_NE(text.find("warning loud line {}"), std::string::npos);
}

TEST(Format, FollowsPrintf) {
  EXPECT_EQ(Format("%s %d %.2f", "a", 3, 0.125), "a 3 0.12");
  EXPECT_EQ(Format("%s", ""), "");
  const std::string text(5000, 'x');
  EXPECT_EQ(Format("%s", text.c_str()), text);
}

}  // namespace
}  // namespace panofix
