#include "tests/e2e/bad_input.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>
#include <sstream>

namespace panofix::e2e {
namespace {

std::unique_ptr<BadInputData> MakeData() {
  std::unique_ptr<BadInputData> made(new BadInputData{
      TownData({"--seed", "6", "--panoramas", std::to_string(kNumBadInputPanoramas), "--frames",
                std::to_string(kNumBadInputFrames), "--pano-width-px", "768", "--frame-width-px",
                "240", "--frame-height-px", "180", "--same-light"}),
      {}});
  made->bundle = made->data.root() / "good";
  const Outcome built = made->data.Build(made->data.panoramas(), made->bundle);
  EXPECT_EQ(built.exit_code, 0) << built.errors;
  return made;
}

}  // namespace

const BadInputData& SharedData() {
  static const std::unique_ptr<BadInputData> data = MakeData();
  return *data;
}

void ExpectRefused(const Outcome& outcome, int exit_code, const std::vector<std::string>& words) {
  EXPECT_EQ(outcome.exit_code, exit_code) << outcome.errors;
  static const std::regex progress(R"(^\w+ \d+/\d+ \w+.*)");
  std::vector<std::string> lines;
  std::istringstream stream(outcome.errors);
  for (std::string line; std::getline(stream, line);) {
    if (!std::regex_match(line, progress)) lines.push_back(line);
  }
  ASSERT_EQ(lines.size(), 1U) << outcome.errors;
  EXPECT_THAT(lines[0], testing::MatchesRegex("panofix-(builder|runtime): .*"));
  for (const std::string& word : words) EXPECT_THAT(lines[0], testing::HasSubstr(word));
}

}  // namespace panofix::e2e
