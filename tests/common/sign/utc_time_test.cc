#include "common/sign/utc_time.h"

#include <gtest/gtest.h>

namespace panofix {
namespace {

TEST(UtcTime, RoundTrip) {
  EXPECT_EQ(FormatUtc(0), "1970-01-01T00:00:00Z");
  EXPECT_EQ(FormatUtc(1402922358), "2014-06-16T12:39:18Z");
  for (const std::int64_t time_s : {0L, 951782400L, 1709164800L, 4102444799L, 253402300799L})
    EXPECT_EQ(ParseUtc(FormatUtc(time_s)), time_s);
}

TEST(UtcTime, OnlyRealTimesInThisForm) {
  for (const char* text :
       {"", "2026-11-22", "2026-11-22T09:30:00", "2026-11-22T09:30:00+01:00",
        "2026-11-22 09:30:00Z", "2026-02-29T00:00:00Z", "2026-13-01T00:00:00Z",
        "2026-11-22T24:00:00Z", "2026-11-22T09:60:00Z", "1969-12-31T23:59:59Z",
        "2026-11-22T09:30:0 Z", "2026-11-22T09:30:00z", "-026-11-22T09:30:00Z"}) {
    EXPECT_FALSE(ParseUtc(text)) << text;
  }
}

TEST(UtcTime, TimesOutOfRangeAreClamped) {
  EXPECT_EQ(FormatUtc(-5), "1970-01-01T00:00:00Z");
  EXPECT_EQ(FormatUtc(std::int64_t{1} << 60), "9999-12-31T23:59:59Z");
}

}  // namespace
}  // namespace panofix
