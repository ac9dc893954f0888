#include "builder/validate/inspect.h"

#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

constexpr double kTolerance_m = 1e-4;

// A bundle after `change`, opened.
std::shared_ptr<const MapBundle> Opened(const TempFolder& folder,
                                        const std::function<void(CraftedBundle*)>& change = {}) {
  CraftedBundle crafted = SmallBundle();
  if (change) change(&crafted);
  crafted.Write(folder / "b");
  return ValueOrThrow(MapBundle::Open(folder / "b"));
}

TEST(RouteLength, EachLinkCountsOnce) {
  const TempFolder folder;
  EXPECT_NEAR(RouteLength_m(*Opened(folder)), 30, kTolerance_m);
}

TEST(RouteLength, ALinkOfOneSideCounts) {
  const TempFolder folder;
  // Only 3 names 0: a link backwards of 30 m.
  const auto bundle = Opened(folder, [](CraftedBundle* b) {
    b->links = {0};
    b->link_offsets = {0, 0, 0, 0, 1};
  });
  EXPECT_NEAR(RouteLength_m(*bundle), 30, kTolerance_m);
}

TEST(RouteLength, IsGroundLength) {
  const TempFolder folder;
  const auto bundle = Opened(folder, [](CraftedBundle* b) { b->scales.assign(4, 1.25); });
  EXPECT_NEAR(RouteLength_m(*bundle), 24, kTolerance_m);
}

TEST(RouteLength, WithoutLinksNeighboursAreJoined) {
  const TempFolder folder;
  const auto bundle = Opened(folder, [](CraftedBundle* b) {
    b->links.clear();
    b->link_offsets.assign(5, 0);
    // 0, 10 and 20 m up the street, and one 500 m away that belongs to no road of theirs.
    b->positions[3 * 3] = 500;
  });
  EXPECT_NEAR(RouteLength_m(*bundle), 20, kTolerance_m);
}

TEST(BundleBytes, IsTheSizeOfAllFiles) {
  const TempFolder folder;
  const auto bundle = Opened(folder);
  std::uint64_t bytes = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder / "b")) {
    if (entry.is_regular_file()) bytes += entry.file_size();
  }
  EXPECT_EQ(BundleBytes(*bundle), bytes);
}

TEST(InspectJson, HoldsTheManifestAndWhatItDoesNotSay) {
  const TempFolder folder;
  const auto bundle = Opened(folder);
  const auto json = nlohmann::json::parse(InspectJson(*bundle, {}));
  EXPECT_EQ(json["id"], bundle->id());
  EXPECT_EQ(json["manifest"]["name"], "small");
  EXPECT_EQ(json["coverage"]["panoramas_with_depth"], 3);
  EXPECT_NEAR(json["coverage"]["route_m"].get<double>(), 30, kTolerance_m);
  EXPECT_NEAR(json["coverage"]["south_deg"].get<double>(), 48.85, 1e-9);
  EXPECT_NEAR(json["coverage"]["north_deg"].get<double>(), 48.85 + 30 / 111000.0, 1e-5);
  EXPECT_EQ(json["num_bytes"], BundleBytes(*bundle));
  EXPECT_NEAR(json["mb_per_km"].get<double>(),
              static_cast<double>(BundleBytes(*bundle)) / 1e6 / 0.03, 0.01);
}

TEST(InspectText, NamesEveryPart) {
  const TempFolder folder;
  const auto bundle = Opened(folder);
  const std::string text = InspectText(*bundle, {});
  for (const char* word : {"small", "graph.h5", "vocabulary.h5", "tiles/0.h5", "tiles/1.h5",
                           "not stated", "4 (3 with depth, 0 set aside)", "30 m of route",
                           "4 SIFT, 2 MSER", "unsigned", "panofix 0.1.0 and later"}) {
    EXPECT_NE(text.find(word), std::string::npos) << word << "\n" << text;
  }
  EXPECT_NE(text.find(bundle->id()), std::string::npos);
}

TEST(InspectText, AMapOfOnePlaceHasNoLength) {
  const TempFolder folder;
  const auto bundle = Opened(folder, [](CraftedBundle* b) {
    b->links.clear();
    b->link_offsets.assign(5, 0);
    for (std::size_t p = 0; p < 4; ++p) b->positions[3 * p + 1] = 0;
  });
  EXPECT_EQ(RouteLength_m(*bundle), 0.0);
  EXPECT_NE(InspectText(*bundle, {}).find("0.0 MB per km"), std::string::npos);
  EXPECT_EQ(nlohmann::json::parse(InspectJson(*bundle, {}))["mb_per_km"], 0.0);
}

}  // namespace
}  // namespace panofix
