#include "common/map/manifest.h"

#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>

namespace panofix {
namespace {

using Json = nlohmann::ordered_json;

const std::string kHash(64, 'a');

Manifest Full() {
  Manifest m;
  m.name = "quartier \"latin\" é";
  m.build = 20260719;
  m.generator = "panofix-builder 0.1.0";
  m.map_frame = {49, 44, 46.5, 3, 1, 7e5, 66e5};
  m.camera = Camera::FromHorizontalFov(640, 480, 66.6);
  m.camera.distortion_model = DistortionModel::kRationalPolynomial;
  m.camera.distortion = {0.1, -1.0 / 3, 0, 0, 1e-17, 0, 0, 0.25};
  m.features = {Equalization::kGlobal, 3.5, 4, 1234, 0.01, 56, false};
  m.errors = {0.031, 0.7, 0.21, 0.07, 0.3};
  m.provenance = {"own captures", "CC-BY-4.0", "EGM96", kHash, "{\"b\":1,\"a\":[2.5,\"x\"]}"};
  m.runtime_min = "0.0.7", m.runtime_before = "77.0.0", m.vocabulary_release = "city 3";
  m.num_panoramas = 2, m.num_stations = 5, m.num_views = 40, m.num_landmarks = 3000;
  m.num_set_aside = 1;
  m.views_per_station = 8;
  m.parts = {{"graph.h5", 10, kHash}, {"tiles/1.h5", 1ULL << 40, std::string(64, '0')}};
  return m;
}

Json Parsed() { return Json::parse(ToJson(Full())); }

ErrorCode CodeOf(const Json& json) { return ParseManifest(json.dump(), "m.json").status().code(); }

TEST(Manifest, RoundTripKeepsEveryField) {
  const Manifest m = Full();
  const auto back = ParseManifest(ToJson(m), "m.json");
  ASSERT_TRUE(back.ok()) << back.status().message();
  EXPECT_EQ(ToJson(*back), ToJson(m));
  EXPECT_EQ(back->name, m.name);
  EXPECT_EQ(back->build, m.build);
  EXPECT_EQ(back->map_frame.lat1_deg, 49.0);
  EXPECT_EQ(back->map_frame.false_northing_m, 66e5);
  EXPECT_EQ(back->camera.fx_px, m.camera.fx_px);
  EXPECT_EQ(back->camera.distortion, m.camera.distortion);
  EXPECT_EQ(back->camera.distortion_model, DistortionModel::kRationalPolynomial);
  EXPECT_EQ(back->features.equalization, Equalization::kGlobal);
  EXPECT_EQ(back->features.max_sift, 1234);
  EXPECT_FALSE(back->features.root_sift);
  EXPECT_EQ(back->errors.panorama_heading_sigma_deg, 0.3);
  EXPECT_EQ(back->provenance.height_datum, "EGM96");
  EXPECT_EQ(back->provenance.options, m.provenance.options);
  EXPECT_EQ(back->num_set_aside, 1);
  EXPECT_EQ(back->runtime_min, "0.0.7");
  EXPECT_EQ(back->runtime_before, "77.0.0");
  EXPECT_EQ(back->vocabulary_release, "city 3");
  EXPECT_EQ(back->num_panoramas, 2);
  EXPECT_EQ(back->num_stations, 5);
  EXPECT_EQ(back->num_views, 40);
  EXPECT_EQ(back->num_landmarks, 3000);
  EXPECT_EQ(back->views_per_station, 8);
  ASSERT_EQ(back->parts.size(), 2U);
  EXPECT_EQ(back->parts[1].path, "tiles/1.h5");
  EXPECT_EQ(back->parts[1].num_bytes, 1ULL << 40);
}

TEST(Manifest, OnlyTheSameMajorIsRead) {
  for (const int major : {0, kBundleMajor - 1, kBundleMajor + 1, 99}) {
    Json json = Parsed();
    json["format"]["major"] = major;
    // Even where nothing else of it is understood.
    EXPECT_EQ(CodeOf(json), ErrorCode::kUnsupportedVersion) << major;
    EXPECT_EQ(CodeOf({{"format", json["format"]}}), ErrorCode::kUnsupportedVersion) << major;
  }
  Json newer = Parsed();
  newer["format"]["major"] = kBundleMajor + 1;
  const Status status = ParseManifest(newer.dump(), "m.json").status();
  EXPECT_NE(status.message().find("m.json"), std::string::npos);
  EXPECT_NE(status.message().find("update panofix"), std::string::npos);
}

TEST(Manifest, ANewerMinorWithMoreFieldsIsRead) {
  Json json = Parsed();
  json["format"]["minor"] = kBundleMinor + 7;
  json["expires"] = "2030-01-01";
  json["camera"]["vignetting"] = 0.1;
  const auto manifest = ParseManifest(json.dump(), "m.json");
  ASSERT_TRUE(manifest.ok()) << manifest.status().message();
  EXPECT_EQ(manifest->minor, kBundleMinor + 7);
}

TEST(Manifest, StatesWhichReleasesReadIt) {
  const auto code_with = [](const char* min, const char* before) {
    Json json = Parsed();
    json["runtime"] = {{"min", min}, {"before", before}};
    return CodeOf(json);
  };
  EXPECT_EQ(code_with("0.0.9", ""), ErrorCode::kOk);
  EXPECT_EQ(code_with(kOldestRuntime, "900.0.0"), ErrorCode::kOk);
  EXPECT_EQ(code_with("900.0.0", ""), ErrorCode::kUnsupportedVersion);
  EXPECT_EQ(code_with("0.0.1", "0.0.2"), ErrorCode::kUnsupportedVersion);
  for (const char* bad : {"", "1", "1.2", "a.b.c", "1.2.3.4", "-1.2.3", "1.2.3 "})
    EXPECT_EQ(code_with(bad, ""), ErrorCode::kBadData) << bad;
}

TEST(Manifest, FormatTwoZeroSaidLess) {
  Manifest m = Full();
  m.minor = 0;
  const Json json = Json::parse(ToJson(m));
  EXPECT_FALSE(json.contains("runtime"));
  EXPECT_FALSE(json.contains("vocabulary_release"));
  EXPECT_EQ(CodeOf(json), ErrorCode::kOk);
}

TEST(Manifest, PathsStayInsideTheBundle) {
  const std::string long_path(257, 'x');
  for (const std::string path : {"", "/etc/passwd", "..", "../x.h5", "tiles/../../x", "tiles/..",
                                 "./x", "a//b", "a/", "a\\b", ".", "a/./b", long_path.c_str()}) {
    Json json = Parsed();
    json["parts"][0]["path"] = path;
    EXPECT_EQ(CodeOf(json), ErrorCode::kBadData) << path;
  }
  Json json = Parsed();
  json["parts"][0]["path"] = std::string("a\0b", 3);
  EXPECT_EQ(CodeOf(json), ErrorCode::kBadData);
  for (const std::string path : {"graph.h5", "a/b/c.h5", "..x", "x..y/.z"}) {
    json["parts"][0]["path"] = path;
    EXPECT_EQ(CodeOf(json), ErrorCode::kOk) << path;
  }
}

TEST(Manifest, PartsAreNamedOnceAndHashed) {
  Json json = Parsed();
  json["parts"][1]["path"] = "graph.h5";
  EXPECT_EQ(CodeOf(json), ErrorCode::kBadData);
  for (const std::string& hash : {std::string(), std::string(63, 'a'), std::string(65, 'a'),
                                  std::string(64, 'A'), std::string(64, 'g')}) {
    json = Parsed();
    json["parts"][0]["sha256"] = hash;
    EXPECT_EQ(CodeOf(json), ErrorCode::kBadData) << hash;
  }
}

TEST(Manifest, EveryFieldIsNeeded) {
  // Removes each key of each object in turn.
  const Json full = Parsed();
  const std::function<void(const Json&, const Json::json_pointer&)> each =
      [&](const Json& node, const Json::json_pointer& at) {
        if (!node.is_object() || at.to_string() == "/provenance/options") return;
        for (const auto& [key, value] : node.items()) {
          // What describes the map frame in words decides nothing.
          if (key == "projection" || key == "ellipsoid") continue;
          Json without = full;
          without[at].erase(key);
          EXPECT_EQ(CodeOf(without), ErrorCode::kBadData) << at.to_string() << "/" << key;
          each(value, at / key);
        }
      };
  each(full, Json::json_pointer());
}

TEST(Manifest, ValuesOutOfRangeAreRefused) {
  const auto refused = [](const char* pointer, const Json& value) {
    Json json = Parsed();
    json[Json::json_pointer(pointer)] = value;
    EXPECT_EQ(CodeOf(json), ErrorCode::kBadData) << pointer << " " << value;
  };
  refused("/format/name", "other-bundle");
  refused("/format/major", "one");
  refused("/camera/fx_px", 0);
  refused("/camera/width_px", -640);
  refused("/camera/distortion_coefficients", Json::array({1, 2}));
  refused("/camera/distortion_model", "fisheye");
  refused("/preprocessing/max_sift", -1);
  refused("/preprocessing/equalization", "magic");
  refused("/map_frame/scale", 0);
  refused("/map_frame/lat0_deg", 123);
  refused("/parts", "graph.h5");
  refused("/parts/0", 3);
  refused("/counts", Json::array());
}

TEST(Manifest, TextThatIsNoManifest) {
  for (const std::string text : {"", "{", "[]", "null", "3", "{}", "\xff\xfe", "{\"format\": 1}"}) {
    const auto manifest = ParseManifest(text, "m.json");
    EXPECT_EQ(manifest.status().code(), ErrorCode::kBadData) << text;
    EXPECT_EQ(manifest.status().message().rfind("m.json: ", 0), 0U);
  }
  EXPECT_EQ(ParseManifest(std::string(1 << 20, '['), "m.json").status().code(),
            ErrorCode::kBadData);
  EXPECT_EQ(ParseManifest(std::string((std::size_t{64} << 20) + 1, ' '), "m.json").status().code(),
            ErrorCode::kTooLarge);
}

}  // namespace
}  // namespace panofix
