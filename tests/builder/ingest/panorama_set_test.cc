#include "builder/ingest/panorama_set.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "builder/ingest/geojson_stream.h"
#include "common/base/rng.h"

namespace panofix {
namespace {

using testing::HasSubstr;

Result<PanoramaSet> Parse(const std::string& text) {
  std::istringstream stream(text);
  return ParsePanoramaSet(stream, "/data/town/panoramas.geojson");
}

std::string Feature(const std::string& id, const std::string& coordinates = "[2.35, 48.85, 40.5]",
                    const std::string& properties = R"("image": "p.jpg")") {
  return R"({"type": "Feature", "id": ")" + id +
         R"(", "geometry": {"type": "Point", "coordinates": )" + coordinates +
         R"(}, "properties": {)" + properties + "}}";
}

std::string Collection(const std::vector<std::string>& features, const std::string& members = "") {
  std::string text = R"({"type": "FeatureCollection",)" + members + "\n\"features\": [\n";
  for (std::size_t i = 0; i < features.size(); ++i) text += (i > 0 ? ",\n" : "") + features[i];
  return text + "\n]}\n";
}

// The one reason of a collection that holds `feature` beside a good one.
std::string ReasonFor(const std::string& feature) {
  const auto set = Parse(Collection({Feature("good"), feature}));
  if (!set.ok()) return "failed: " + set.status().message();
  if (set->set_aside.size() != 1) return "set aside: " + std::to_string(set->set_aside.size());
  return set->set_aside[0].id + ": " + set->set_aside[0].reason;
}

const std::string kFull =
    R"("image": "img/b.jpg", "depth": "b.gsv", "mask": "/masks/b.png", "heading": 176.5, "pitch": -1.25,
       "roll": 0.5, "depth_scale": 0.01, "links": ["a", "c"], "captured_at": "2014-06-16T12:31:34Z",
       "other": {"features": [{"x": "]}"}]})";

void ExpectFullRecord(const PanoramaRecord& record) {
  EXPECT_EQ(record.id, "b");
  EXPECT_EQ(record.position.lon_deg, 2.35);
  EXPECT_EQ(record.position.lat_deg, 48.85);
  EXPECT_EQ(record.position.height_m, 40.5);
  EXPECT_EQ(record.attitude.heading_deg, 176.5);
  EXPECT_EQ(record.attitude.pitch_deg, -1.25);
  EXPECT_EQ(record.attitude.roll_deg, 0.5);
  EXPECT_EQ(record.image, "/data/town/img/b.jpg");
  EXPECT_EQ(record.depth, "/data/town/b.gsv");
  EXPECT_EQ(record.mask, "/masks/b.png");
  EXPECT_EQ(record.depth_scale_m, 0.01);
  EXPECT_THAT(record.links, testing::ElementsAre("a", "c"));
  EXPECT_EQ(record.captured_at, "2014-06-16T12:31:34Z");
}

TEST(PanoramaSet, ReadsACollection) {
  const auto set = Parse(
      Collection({Feature("b", "[2.35, 48.85, 40.5]", kFull), Feature("a")},
                 R"("source": "survey [1] \"x\"", "licence": "CC0", "height_datum": "EGM96",)"));
  ASSERT_TRUE(set.ok()) << set.status().message();
  ASSERT_EQ(set->panoramas.size(), 2U);
  EXPECT_TRUE(set->set_aside.empty());
  EXPECT_EQ(set->source, "survey [1] \"x\"");
  EXPECT_EQ(set->licence, "CC0");
  EXPECT_EQ(set->height_datum, "EGM96");
  ExpectFullRecord(set->panoramas[1]);
  const PanoramaRecord& plain = set->panoramas[0];
  EXPECT_TRUE(plain.depth.empty() && plain.mask.empty() && plain.links.empty());
  EXPECT_EQ(plain.attitude.heading_deg, 0);
  EXPECT_EQ(plain.depth_scale_m, 0.001);
}

TEST(PanoramaSet, ReadsSequences) {
  const std::string header = R"({"source": "s", "licence": "l"})";
  std::string full = Feature("b", "[2.35, 48.85, 40.5]", kFull);
  const std::string spread = full;
  std::replace(full.begin(), full.end(), '\n', ' ');
  const std::string rs = "\x1E";
  for (const std::string& text :
       {header + "\n" + full + "\n" + Feature("a") + "\n", full + "\r\n\r\n" + Feature("a"),
        rs + header + "\n" + rs + spread + "\n" + rs + Feature("a") + "\n",
        R"({"type": "FeatureCollection", "source": "s"})" + ("\n" + full + "\n" + Feature("a"))}) {
    const auto set = Parse(text);
    ASSERT_TRUE(set.ok()) << set.status().message();
    ASSERT_EQ(set->panoramas.size(), 2U) << text;
    EXPECT_TRUE(set->set_aside.empty());
    ExpectFullRecord(set->panoramas[1]);
    EXPECT_EQ(set->height_datum, "ellipsoid");
    EXPECT_EQ(set->source, text.find("source") != std::string::npos ? "s" : "");
  }
}

TEST(PanoramaSet, ShapeOfTheTextDoesNotMatter) {
  std::string one_line = Collection({Feature("a"), Feature("b")});
  std::replace(one_line.begin(), one_line.end(), '\n', ' ');
  const std::string spread = "{\n \"type\"\n:\n\"FeatureCollection\",\n\"features\"\n:\n[\n" +
                             Feature("a") + "\n,\n" + Feature("b") + "\n]\n}";
  const std::string members_last = "{\"features\": [" + Feature("b") + "," + Feature("a") +
                                   "], \"type\": \"FeatureCollection\"}";
  for (const std::string& text : {one_line, spread, members_last, "\xEF\xBB\xBF" + one_line,
                                  "\n\n" + one_line, Collection({Feature("a"), Feature("b")})}) {
    const auto set = Parse(text);
    ASSERT_TRUE(set.ok()) << set.status().message() << "\n" << text;
    ASSERT_EQ(set->panoramas.size(), 2U) << text;
    EXPECT_EQ(set->panoramas[0].id, "a");
  }
  ASSERT_TRUE(Parse(Feature("alone")).ok());
  ASSERT_TRUE(
      Parse("{\"type\":\"FeatureCollection\",\"features\":[\n" + Feature("alone") + "\n]}").ok());
}

TEST(PanoramaSet, InputOrderChangesNothing) {
  const auto forward = Parse(Collection({Feature("a"), Feature("b"), Feature("c")}));
  const auto backward = Parse(Collection({Feature("c"), Feature("b"), Feature("a")}));
  ASSERT_TRUE(forward.ok() && backward.ok());
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(forward->panoramas[i].id, backward->panoramas[i].id);
}

TEST(PanoramaSet, BrokenRulesSetTheFeatureAside) {
  const auto with = [](const std::string& properties) {
    return Feature("x", "[1, 2, 3]", R"("image": "p.jpg", )" + properties);
  };
  EXPECT_THAT(ReasonFor(Feature("x", "[1, 91, 3]")), HasSubstr("x: latitude is 91"));
  EXPECT_THAT(ReasonFor(Feature("x", "[181, 1, 3]")), HasSubstr("longitude is 181"));
  EXPECT_THAT(ReasonFor(Feature("x", "[1, 2, 1e6]")), HasSubstr("height is 1e+06"));
  EXPECT_THAT(ReasonFor(Feature("x", "[1, 2]")), HasSubstr("give a Point with [lon, lat, height]"));
  EXPECT_THAT(ReasonFor(Feature("x", "[]")), HasSubstr("no coordinates"));
  EXPECT_THAT(ReasonFor(Feature("x", R"([1, "2", 3])")), HasSubstr("not numbers"));
  EXPECT_THAT(ReasonFor(Feature("x", "[1, null, 3]")), HasSubstr("not numbers"));
  EXPECT_THAT(ReasonFor(Feature("x", "[1, NaN, 3]")),
              HasSubstr("feature 2: a number is not finite"));
  EXPECT_THAT(ReasonFor(Feature("x", "[1, 1e999, 3]")),
              HasSubstr("feature 2: a number is not finite"));
  EXPECT_THAT(ReasonFor(with(R"("heading": -Infinity)")), HasSubstr("not finite"));
  EXPECT_THAT(ReasonFor(with(R"("heading": "12")")), HasSubstr("heading is not a number"));
  EXPECT_THAT(ReasonFor(with(R"("heading": 400)")), HasSubstr("heading is 400"));
  EXPECT_THAT(ReasonFor(with(R"("pitch": 91)")), HasSubstr("pitch is 91"));
  EXPECT_THAT(ReasonFor(with(R"("depth_scale": 0)")), HasSubstr("depth_scale is 0"));
  EXPECT_THAT(ReasonFor(with(R"("depth": 5)")), HasSubstr("depth is not text"));
  EXPECT_THAT(ReasonFor(with(R"("links": "a")")), HasSubstr("links is not a list"));
  EXPECT_THAT(ReasonFor(with(R"("links": [1])")), HasSubstr("links is not a list"));
  EXPECT_THAT(ReasonFor(Feature("x", "[1, 2, 3]", "")), HasSubstr("no image"));
  EXPECT_THAT(ReasonFor(Feature("x", "[1, 2, 3]", R"("image": "a\u0000b")")), HasSubstr("control"));
  EXPECT_THAT(ReasonFor(Feature("")), HasSubstr("feature 2: id is empty"));
  EXPECT_THAT(ReasonFor(Feature("a\\nb")), HasSubstr("control"));
  EXPECT_THAT(ReasonFor(Feature(std::string(257, 'x'))), HasSubstr("too long"));
  EXPECT_THAT(ReasonFor(R"({"type": "Feature"})"), HasSubstr("feature 2: no id"));
  EXPECT_THAT(ReasonFor(R"({"type": "Feature", "id": 7})"), HasSubstr("write it in quotes"));
  EXPECT_THAT(ReasonFor(R"({"type": "Feature", "id": "x"})"), HasSubstr("x: no geometry"));
  EXPECT_THAT(ReasonFor(R"({"id": "x"})"), HasSubstr("not a GeoJSON Feature"));
  EXPECT_THAT(ReasonFor("null"), HasSubstr("feature 2: not a GeoJSON Feature"));
}

TEST(PanoramaSet, NullsMeanMissing) {
  const auto set = Parse(Collection({Feature(
      "a", "[1, 2, 3]",
      R"("image": "p.jpg", "depth": null, "mask": null, "heading": null, "links": null)")}));
  ASSERT_TRUE(set.ok()) << set.status().message();
  EXPECT_TRUE(set->panoramas[0].depth.empty());
}

TEST(PanoramaSet, EveryCopyOfADuplicateIdIsSetAside) {
  const auto set = Parse(Collection(
      {Feature("a"), Feature("b"), Feature("a"), Feature("c"), Feature("c", "[1, 200, 3]")}));
  ASSERT_TRUE(set.ok());
  ASSERT_EQ(set->panoramas.size(), 1U);
  EXPECT_EQ(set->panoramas[0].id, "b");
  ASSERT_EQ(set->set_aside.size(), 4U);
  EXPECT_THAT(set->set_aside[0].reason, HasSubstr("more than once"));
}

TEST(PanoramaSet, BrokenLinesOfASequenceAreSetAside) {
  const std::string text = "{\"type\": \"Feature\", \"id\": \n" + Feature("a") +
                           "\nnot json\n\n[1]\n" + Feature("b") + "\n" + Feature("c").substr(0, 40);
  const auto set = Parse(text);
  ASSERT_TRUE(set.ok()) << set.status().message();
  EXPECT_EQ(set->panoramas.size(), 2U);
  std::vector<std::string> ids;
  for (const SetAside& aside : set->set_aside) ids.push_back(aside.id);
  EXPECT_THAT(ids, testing::ElementsAre("line 1", "line 3", "line 5", "line 7"));
}

TEST(PanoramaSet, OverlongFeatures) {
  const std::string long_text =
      R"("image": "p.jpg", "note": ")" + std::string(kMaxFeatureBytes, 'x') + '"';
  const std::string feature = Feature("long", "[1, 2, 3]", long_text);
  const auto sequence = Parse(Feature("a") + "\n" + feature + "\n" + Feature("b"));
  ASSERT_TRUE(sequence.ok());
  EXPECT_EQ(sequence->panoramas.size(), 2U);
  EXPECT_THAT(sequence->set_aside[0].reason, HasSubstr("longer than"));
  EXPECT_EQ(Parse(Collection({Feature("a"), feature})).status().code(), ErrorCode::kTooLarge);
}

TEST(PanoramaSet, FilesThatCannotBeReadFail) {
  const std::string good = Collection({Feature("a"), Feature("b")});
  const auto fault = [](const std::string& text) {
    const auto set = Parse(text);
    EXPECT_FALSE(set.ok()) << text;
    return set.ok() ? "" : set.status().message();
  };
  EXPECT_THAT(fault(""), HasSubstr("panoramas.geojson"));
  EXPECT_THAT(fault("id,image\n1,2\n"), HasSubstr("not valid JSON"));
  EXPECT_THAT(fault(Collection({})), HasSubstr("holds no panorama"));
  EXPECT_THAT(fault(Collection({Feature("")})), HasSubstr("none of its 1 panoramas"));
  EXPECT_THAT(fault(good + "x"), HasSubstr("line 6"));
  EXPECT_THAT(fault(Collection({Feature("a"), "{\"type\": \"Feature\" \"id\": 1}"})),
              HasSubstr("line 4, byte "));
  EXPECT_THAT(fault(Collection({Feature("a"), "{]}"})), HasSubstr("brackets do not match"));
  EXPECT_THAT(fault(Collection({Feature("a") + " " + Feature("b")})), HasSubstr("not valid JSON"));
  EXPECT_THAT(fault(R"({"type": "Topology", "features": []})"), HasSubstr("FeatureCollection"));
  EXPECT_THAT(fault(Collection({Feature("a")}, "\"source\": 5,")),
              HasSubstr("\"source\" is not text"));
  EXPECT_THAT(fault(std::string(100000, '[')), HasSubstr("line 1"));
  for (std::size_t length = 0; length + 2 < good.size(); ++length) {
    ASSERT_FALSE(Parse(good.substr(0, length)).ok()) << length;
  }
}

TEST(PanoramaSet, RandomDamageNeverCrashes) {
  const std::string collection = Collection({Feature("a"), Feature("b", "[1, 2, 3]", kFull)});
  const std::string sequence = Feature("a") + "\n" + Feature("b") + "\n";
  Rng rng(1, "panorama_set/damage");
  for (int round = 0; round < 2000; ++round) {
    std::string text = round % 2 == 0 ? collection : sequence;
    for (int i = 0; i < 3; ++i) text[rng.Below(text.size())] = "{}[]\",:0\\\n\x1E"[rng.Below(11)];
    const auto set = Parse(text);
    if (set.ok()) {
      ASSERT_FALSE(set->panoramas.empty());
    }
  }
}

class PanoramaFiles : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(testing::TempDir()) / "panofix_panorama_files";
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  void WriteImage(const char* name, int width_px, int height_px) const {
    cv::imwrite((folder_ / name).string(), cv::Mat(height_px, width_px, CV_8UC1, cv::Scalar(90)));
  }
  [[nodiscard]] Status Check(const char* image, const char* mask = nullptr) const {
    PanoramaRecord record;
    record.image = folder_ / image;
    if (mask != nullptr) record.mask = folder_ / mask;
    return CheckPanoramaFiles(record);
  }
  std::filesystem::path folder_;
};

TEST_F(PanoramaFiles, ChecksImageAndMask) {
  WriteImage("good.jpg", 64, 32);
  WriteImage("good.png", 64, 32);
  WriteImage("square.png", 64, 64);
  std::ofstream(folder_ / "text.jpg") << "not an image";
  EXPECT_TRUE(Check("good.jpg").ok());
  EXPECT_TRUE(Check("good.png", "square.png").ok());
  EXPECT_EQ(Check("none.jpg").code(), ErrorCode::kNotFound);
  EXPECT_EQ(Check("square.png").code(), ErrorCode::kBadData);
  EXPECT_EQ(Check("text.jpg").code(), ErrorCode::kBadData);
  EXPECT_EQ(Check("good.jpg", "none.png").code(), ErrorCode::kNotFound);
  EXPECT_EQ(Check("good.jpg", "text.jpg").code(), ErrorCode::kBadData);
}

// Metadata can push a JPEG's size past the first read.
TEST_F(PanoramaFiles, FindsTheSizeBehindLongMetadata) {
  WriteImage("plain.jpg", 64, 32);
  std::ifstream in(folder_ / "plain.jpg", std::ios::binary);
  const std::string plain((std::istreambuf_iterator<char>(in)), {});
  std::string segment = "\xFF\xE1\xFF\xFE" + std::string(0xFFFC, 'x');
  std::string text = plain.substr(0, 2);
  for (int i = 0; i < 12; ++i) text += segment;
  std::ofstream(folder_ / "long.jpg", std::ios::binary) << text + plain.substr(2);
  EXPECT_TRUE(Check("long.jpg").ok()) << Check("long.jpg").message();
}

TEST_F(PanoramaFiles, ReadPanoramaSetNamesMissingFiles) {
  const auto missing = ReadPanoramaSet(folder_ / "none.geojson");
  EXPECT_EQ(missing.status().code(), ErrorCode::kNotFound);
  EXPECT_EQ(ReadPanoramaSet(folder_).status().code(), ErrorCode::kIo);
  std::ofstream(folder_ / "p.geojson") << Collection({Feature("a")});
  const auto set = ReadPanoramaSet(folder_ / "p.geojson");
  ASSERT_TRUE(set.ok());
  EXPECT_EQ(set->panoramas[0].image, folder_ / "p.jpg");
}

TEST(PanoramaSet, ReadsTheEvaluationSet) {
  const auto path = std::filesystem::path(PANOFIX_EVALUATION_DATA) / "paris" / "panoramas.geojson";
  if (!std::filesystem::exists(path)) {
    GTEST_SKIP() << "no evaluation data at " << path << "; set PANOFIX_EVALUATION_DATA";
  }
  const auto set = ReadPanoramaSet(path);
  ASSERT_TRUE(set.ok()) << set.status().message();
  EXPECT_EQ(set->panoramas.size(), 27U);
  EXPECT_TRUE(set->set_aside.empty());
  EXPECT_FALSE(set->licence.empty());
  for (const PanoramaRecord& record : set->panoramas) {
    EXPECT_TRUE(CheckPanoramaFiles(record).ok()) << CheckPanoramaFiles(record).message();
  }
}

}  // namespace
}  // namespace panofix
