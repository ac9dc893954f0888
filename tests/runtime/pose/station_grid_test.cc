#include "runtime/pose/station_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "common/base/rng.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

// Grid coordinates of some million metres as doubles, stations as floats of some metres.
constexpr double kRounding_m = 1e-5;

// Panoramas all over 240 m, turned any way, with up to three virtual stations each, on a grid whose
// point scale is not one. The origin lies in the middle: negative coordinates too.
class StationGridTest : public testing::Test {
 protected:
  StationGridTest() {
    Rng rng(1, "tests/stations");
    CraftedBundle crafted;
    const CraftedBundle small = SmallBundle();
    crafted.manifest = small.manifest, crafted.vocabulary = small.vocabulary;
    crafted.manifest.map_frame.scale = 0.9;
    crafted.directions = {0, 0};
    CraftedTile& tile = crafted.tiles.emplace_back();
    tile.path = "tiles/0.h5";
    for (int p = 0; p < 60; ++p) {
      const Eigen::Quaterniond turn(
          Eigen::AngleAxisd(rng.Uniform(-3, 3), Eigen::Vector3d(0.1, -0.2, 1).normalized()));
      crafted.AddPanorama("p" + std::to_string(p),
                          {turn, {rng.Uniform(-120, 120), rng.Uniform(-120, 120), 30}}, {});
      for (std::uint64_t s = rng.Below(4); s > 0; --s) {
        const auto side = [&] { return static_cast<float>(rng.Uniform(-8, 8)); };
        crafted.AddStation({side(), side(), side()});
      }
    }
    // Two at one place.
    crafted.AddStation({1, 2, 3}), crafted.AddStation({1, 2, 3});
    tile.panorama_ids = crafted.ids;
    for (std::size_t s = 0; s < crafted.station_panoramas.size(); ++s) tile.EndView({}, {});
    crafted.similar_offsets.assign(crafted.ids.size() + 1, 0);
    crafted.Write(folder_ / "b");
    bundle_ = ValueOrThrow(MapBundle::Open(folder_ / "b"));
  }
  [[nodiscard]] Eigen::Vector3d PositionOf(std::uint32_t station_idx) const {
    const MapStation& station = bundle_->stations()[station_idx];
    const MapPanorama& panorama = bundle_->panoramas()[station.panorama_idx];
    Eigen::Vector3d d = panorama.map_from_pano.rotation * station.position_in_pano;
    d.head<2>() *= panorama.point_scale;
    return panorama.map_from_pano.translation + d;
  }
  TempFolder folder_;
  std::shared_ptr<const MapBundle> bundle_;
};

TEST_F(StationGridTest, PositionsAreOnTheGrid) {
  const StationGrid grid(*bundle_);
  ASSERT_LT(bundle_->panoramas()[0].point_scale, 0.95);
  for (std::uint32_t s = 0; s < bundle_->stations().size(); ++s)
    EXPECT_LE((grid.position_in_map(s) - PositionOf(s)).norm(), kRounding_m) << s;
}

TEST_F(StationGridTest, NearIsTheBruteForceAnswer) {
  const StationGrid grid(*bundle_);
  Rng rng(2, "tests/near");
  std::size_t num_found = 0;
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector3d at(rng.Uniform(-150, 150), rng.Uniform(-150, 150), rng.Uniform(-99, 99));
    const double radius_m = rng.Uniform(0, 70);
    const std::size_t most = rng.Below(12);
    std::vector<std::pair<double, std::uint32_t>> expected;
    for (std::uint32_t s = 0; s < bundle_->stations().size(); ++s) {
      const double distance_m = (grid.position_in_map(s) - at).head<2>().norm();
      if (distance_m <= radius_m) expected.emplace_back(distance_m, s);
    }
    std::sort(expected.begin(), expected.end());
    expected.resize(std::min(expected.size(), most));
    const std::vector<std::uint32_t> found = grid.Near(at, radius_m, most);
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t k = 0; k < found.size(); ++k) EXPECT_EQ(found[k], expected[k].second);
    num_found += found.size();
  }
  EXPECT_GT(num_found, 500U);
}

TEST_F(StationGridTest, EqualsComeByIndex) {
  const StationGrid grid(*bundle_);
  const auto last = static_cast<std::uint32_t>(bundle_->stations().size() - 1);
  ASSERT_EQ(grid.position_in_map(last), grid.position_in_map(last - 1));
  EXPECT_EQ(grid.Near(grid.position_in_map(last), 0, 5),
            (std::vector<std::uint32_t>{last - 1, last}));
  EXPECT_EQ(grid.Near(grid.position_in_map(last), 0, 1), (std::vector<std::uint32_t>{last - 1}));
}

TEST_F(StationGridTest, NowhereIsNear) {
  const StationGrid grid(*bundle_);
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN(),
                   kInf = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(grid.Near({5000, 0, 0}, 70, 5).empty());
  EXPECT_TRUE(grid.Near({kNan, 0, 0}, 70, 5).empty());
  EXPECT_TRUE(grid.Near({0, kInf, 0}, 70, 5).empty());
  EXPECT_TRUE(grid.Near({0, 0, 0}, 70, 0).empty());
}

}  // namespace
}  // namespace panofix
