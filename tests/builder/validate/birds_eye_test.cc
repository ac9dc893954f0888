#include "builder/validate/birds_eye.h"

#include <gtest/gtest.h>

#include <regex>

#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

// The fault that keeps `text` from being well-formed XML, or "": tags close in order, attributes
// are quoted, no stray angle bracket.
std::string XmlFault(const std::string& text) {
  static const std::regex tag(R"(<(/?)([a-zA-Z]+)((?:\s+[a-zA-Z0-9-]+='[^'<]*')*)\s*(/?)>)");
  std::vector<std::string> open;
  std::string rest = text;
  std::smatch match;
  while (std::regex_search(rest, match, tag)) {
    const std::string before = match.prefix();
    if (before.find_first_of("<&") != std::string::npos)
      return "stray markup: " + before.substr(0, 80);
    if (match[1].length() > 0) {
      if (open.empty() || open.back() != match[2])
        return "closes what is not open: " + match[2].str();
      open.pop_back();
      if (open.empty() && match.suffix().str().find_first_not_of(" \n") != std::string::npos)
        return "text after the end";
    } else if (match[4].length() == 0) {
      open.push_back(match[2]);
    }
    rest = match.suffix();
  }
  return open.empty() ? "" : "never closed: " + open.back();
}

int Count(const std::string& text, const std::string& piece) {
  int count = 0;
  for (std::size_t at = text.find(piece); at != std::string::npos; at = text.find(piece, at + 1))
    ++count;
  return count;
}

class BirdsEyeTest : public testing::Test {
 protected:
  void SetUp() override {
    SmallBundle().Write(folder_ / "b");
    bundle_ = ValueOrThrow(MapBundle::Open(folder_ / "b"));
  }
  // A frame with truth `north_m` up the street, and its fix `off_m` east of it.
  void AddFrame(double north_m, std::optional<double> off_m, bool with_truth = true) {
    const auto time = static_cast<std::int64_t>(drive_.frames.size());
    drive_.frames.push_back({time, ""});
    const auto at = [&](double east_m) {
      return bundle_->frame().ToGeodetic({east_m, north_m, 2});
    };
    if (with_truth) drive_.truth.push_back({time, at(0), {}});
    PoseRow row;
    row.timestamp_ns = time;
    if (off_m) {
      row.status = FixStatus::kFix;
      row.pose.emplace();
      row.pose->position = at(*off_m);
    }
    rows_.push_back(row);
  }
  [[nodiscard]] std::string Svg() const { return BirdsEyeSvg(*bundle_, drive_, rows_); }
  TempFolder folder_;
  std::shared_ptr<const MapBundle> bundle_;
  Drive drive_;
  std::vector<PoseRow> rows_;
};

TEST_F(BirdsEyeTest, IsWellFormedAndShowsEveryFrame) {
  AddFrame(5, 0.0);
  AddFrame(10, 0.5);
  AddFrame(15, 30.0);        // false fix
  AddFrame(20, {});          // no fix
  AddFrame(25, 0.2, false);  // no truth
  const std::string svg = Svg();
  EXPECT_EQ(XmlFault(svg), "");
  const std::string empty_svg = [&] {
    Drive no_drive;
    return BirdsEyeSvg(*bundle_, no_drive, {});
  }();
  // Beyond the legend's own marks.
  const auto more = [&](const std::string& piece) {
    return Count(svg, piece) - Count(empty_svg, piece);
  };
  EXPECT_EQ(more("stroke='#333'"), 4);
  EXPECT_EQ(more("fill='#d0d'"), 1);
  EXPECT_EQ(more("fill='#1a6fd0'"), 1);
  EXPECT_EQ(more("fill='white' stroke='#1a6fd0'"), 1);
  EXPECT_EQ(more("fill='hsl(120,85%,42%)'"), 1);
  EXPECT_EQ(more("fill='hsl(60,85%,42%)'"), 1);
  EXPECT_EQ(more("stroke='#1a6fd0' stroke-width='2'"), 3);  // the truth of four frames
  EXPECT_EQ(Count(svg, "stroke='#ccc'"), 6);                // three links, from both sides
}

TEST_F(BirdsEyeTest, NorthIsUp) {
  const std::string svg = Svg();
  // The panoramas run north: their circles climb.
  static const std::regex circle("<circle cx='([0-9.]+)' cy='([0-9.]+)' r='4.0' fill='#999'/>");
  std::vector<double> heights;
  for (auto it = std::sregex_iterator(svg.begin(), svg.end(), circle); it != std::sregex_iterator();
       ++it) {
    heights.push_back(std::stod((*it)[2]));
  }
  ASSERT_GE(heights.size(), 4U);
  for (std::size_t i = 1; i < 4; ++i) EXPECT_LT(heights[i], heights[i - 1]);
}

TEST_F(BirdsEyeTest, AFalseFixFarAwayDoesNotShrinkThePicture) {
  AddFrame(5, 0.1);
  const std::string before = Svg();
  AddFrame(10, 1e6);
  EXPECT_EQ(XmlFault(Svg()), "");
  EXPECT_EQ(Svg().substr(0, 120), before.substr(0, 120));
}

TEST_F(BirdsEyeTest, ADriveWithoutTruthOrFixes) {
  EXPECT_EQ(XmlFault(Svg()), "");
  AddFrame(5, {}, false);
  EXPECT_EQ(XmlFault(Svg()), "");
}

TEST(XmlFault, FindsFaults) {
  EXPECT_EQ(XmlFault("<a x='1'><b/>text</a>\n"), "");
  EXPECT_NE(XmlFault("<a><b></a></b>"), "");
  EXPECT_NE(XmlFault("<a>"), "");
  EXPECT_NE(XmlFault("<a>x < y</a>"), "");
  EXPECT_NE(XmlFault("<a x=1></a>"), "");
}

}  // namespace
}  // namespace panofix
