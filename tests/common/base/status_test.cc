#include "common/base/status.h"

#include <gtest/gtest.h>

#include <memory>
#include <set>

namespace panofix {
namespace {

constexpr ErrorCode kAllCodes[] = {ErrorCode::kOk,
                                   ErrorCode::kInvalidArgument,
                                   ErrorCode::kNotFound,
                                   ErrorCode::kIo,
                                   ErrorCode::kBadData,
                                   ErrorCode::kTooLarge,
                                   ErrorCode::kUnsupportedVersion,
                                   ErrorCode::kChecksumMismatch,
                                   ErrorCode::kNoSpace,
                                   ErrorCode::kCancelled,
                                   ErrorCode::kInternal,
                                   ErrorCode::kTryAgain,
                                   ErrorCode::kUntrusted,
                                   ErrorCode::kKeyRevoked,
                                   ErrorCode::kDowngrade,
                                   ErrorCode::kExpired,
                                   ErrorCode::kMixedParts,
                                   ErrorCode::kEndlessData,
                                   ErrorCode::kIncomplete,
                                   ErrorCode::kWrongCamera,
                                   ErrorCode::kWrongMap,
                                   ErrorCode::kUnhealthy};

TEST(Status, DefaultIsOk) {
  const Status status;
  EXPECT_TRUE(status.ok());
  EXPECT_EQ(status.code(), ErrorCode::kOk);
  EXPECT_TRUE(status.message().empty());
}

TEST(Status, KeepsCodeAndMessage) {
  const Status status(ErrorCode::kBadData, "a.gsv: 3 bytes; export it again");
  EXPECT_FALSE(status.ok());
  EXPECT_EQ(status.code(), ErrorCode::kBadData);
  EXPECT_EQ(status.message(), "a.gsv: 3 bytes; export it again");
}

TEST(ErrorCode, EveryCodeHasANameOfItsOwn) {
  std::set<std::string> names;
  for (const ErrorCode code : kAllCodes) names.insert(ErrorCodeName(code));
  EXPECT_EQ(names.size(), std::size(kAllCodes));
  EXPECT_EQ(names.count("unknown"), 0U);
}

TEST(ErrorCode, ExitCodesFollowSysexits) {
  EXPECT_EQ(ExitCode(ErrorCode::kOk), 0);
  EXPECT_EQ(ExitCode(ErrorCode::kInvalidArgument), 64);
  EXPECT_EQ(ExitCode(ErrorCode::kBadData), 65);
  EXPECT_EQ(ExitCode(ErrorCode::kTooLarge), 65);
  EXPECT_EQ(ExitCode(ErrorCode::kChecksumMismatch), 65);
  EXPECT_EQ(ExitCode(ErrorCode::kNotFound), 66);
  EXPECT_EQ(ExitCode(ErrorCode::kInternal), 70);
  EXPECT_EQ(ExitCode(ErrorCode::kIo), 74);
  EXPECT_EQ(ExitCode(ErrorCode::kNoSpace), 74);
  EXPECT_EQ(ExitCode(ErrorCode::kTryAgain), 75);
  EXPECT_EQ(ExitCode(ErrorCode::kUnsupportedVersion), 76);
  EXPECT_EQ(ExitCode(ErrorCode::kCancelled), 130);
}

TEST(ErrorCode, EveryRefusalOfAMapHasAnExitCodeOfItsOwn) {
  std::set<int> codes;
  for (const ErrorCode code :
       {ErrorCode::kUntrusted, ErrorCode::kKeyRevoked, ErrorCode::kDowngrade, ErrorCode::kExpired,
        ErrorCode::kMixedParts, ErrorCode::kEndlessData, ErrorCode::kIncomplete,
        ErrorCode::kWrongCamera, ErrorCode::kWrongMap, ErrorCode::kUnhealthy,
        ErrorCode::kUnsupportedVersion}) {
    EXPECT_TRUE(codes.insert(ExitCode(code)).second) << ErrorCodeName(code);
  }
}

TEST(ErrorCode, OnlyOkExitsWithZero) {
  for (const ErrorCode code : kAllCodes) {
    EXPECT_EQ(ExitCode(code) == 0, code == ErrorCode::kOk) << ErrorCodeName(code);
  }
}

TEST(Result, HoldsAValue) {
  Result<std::string> result(std::string("abc"));
  ASSERT_TRUE(result.ok());
  EXPECT_TRUE(result.status().ok());
  EXPECT_EQ(*result, "abc");
  EXPECT_EQ(result->size(), 3U);
  result.value() += "d";
  EXPECT_EQ(result.value(), "abcd");
}

TEST(Result, MovesAValueThatCannotBeCopied) {
  Result<std::unique_ptr<int>> result(std::make_unique<int>(7));
  const std::unique_ptr<int> value = std::move(result).value();
  EXPECT_EQ(*value, 7);
}

TEST(Result, HoldsAFailure) {
  const Result<int> result(Status(ErrorCode::kNotFound, "x: not there"));
  EXPECT_FALSE(result.ok());
  EXPECT_EQ(result.status().code(), ErrorCode::kNotFound);
  EXPECT_EQ(result.status().message(), "x: not there");
}

TEST(Result, ReadingTheValueOfAFailureIsABug) {
  Result<int> result(Status(ErrorCode::kIo, "x"));
  EXPECT_THROW((void)result.value(), std::logic_error);
  EXPECT_THROW((void)*result, std::logic_error);
  EXPECT_THROW((void)std::move(result).value(), std::logic_error);
}

TEST(Result, AnOkStatusIsNoFailure) { EXPECT_THROW((void)Result<int>(Status()), std::logic_error); }

TEST(ValueOrThrow, GivesTheValueOrThrowsItsCode) {
  EXPECT_EQ(ValueOrThrow(Result<int>(5)), 5);
  try {
    (void)ValueOrThrow(Result<int>(Status(ErrorCode::kNoSpace, "disk: full")));
    FAIL() << "nothing was thrown";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kNoSpace);
    EXPECT_STREQ(error.what(), "disk: full");
  }
}

TEST(ThrowIfError, ThrowsOnFailuresOnly) {
  EXPECT_NO_THROW(ThrowIfError(Status()));
  EXPECT_THROW(ThrowIfError(Status(ErrorCode::kIo, "x")), Error);
}

}  // namespace
}  // namespace panofix
