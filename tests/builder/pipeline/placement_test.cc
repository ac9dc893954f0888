#include "builder/pipeline/placement.h"

#include <gtest/gtest.h>

namespace panofix {
namespace {

constexpr double kPosition_m = 1e-6;  // of a round trip through the projection

PanoramaRecord Record(const std::string& id, double lat_deg, double lon_deg,
                      std::vector<std::string> links = {}) {
  PanoramaRecord record;
  record.id = id;
  record.position = {lat_deg, lon_deg, 50};
  record.attitude = {120, 2, -1};
  record.links = std::move(links);
  return record;
}

TEST(ChooseFrame, TangentConeStandsAtTheCentroid) {
  const MapFrame frame = ChooseFrame("tangent", {Record("a", 48.0, 2.0), Record("b", 48.2, 2.4)});
  EXPECT_NEAR(frame.parameters().lat0_deg, 48.1, 1e-12);
  EXPECT_NEAR(frame.parameters().lon0_deg, 2.2, 1e-12);
}

TEST(ChooseFrame, ASetAcrossTheDateLineStaysTogether) {
  const MapFrame frame = ChooseFrame("tangent", {Record("a", 50, 179.9), Record("b", 50, -179.7)});
  EXPECT_NEAR(frame.parameters().lon0_deg, -179.9, 1e-9);
}

TEST(ChooseFrame, UnknownGridsAreRefused) {
  EXPECT_THROW((void)ChooseFrame("EPSG:4326", {Record("a", 48, 2)}), Error);
}

TEST(PlacePanoramas, PosesGoThroughTheFrameAndBack) {
  const std::vector<PanoramaRecord> records = {Record("a", 48.85, 2.33), Record("b", 48.851, 2.34)};
  for (const char* name : {"tangent", "EPSG:2154"}) {
    const MapFrame frame = ChooseFrame(name, records);
    for (const MapPanorama& p : PlacePanoramas(records, frame)) {
      const Geodetic back = frame.ToGeodetic(p.map_from_pano.translation);
      EXPECT_NEAR(back.lat_deg, p.position.lat_deg, 1e-9);
      EXPECT_NEAR(back.lon_deg, p.position.lon_deg, 1e-9);
      const Attitude attitude = AttitudeFromEnu(frame.MapFromEnu(p.position).transpose() *
                                                p.map_from_pano.rotation.toRotationMatrix());
      EXPECT_NEAR(attitude.heading_deg, 120, 1e-9);
      EXPECT_NEAR(attitude.pitch_deg, 2, 1e-9);
      EXPECT_NEAR(attitude.roll_deg, -1, 1e-9);
      EXPECT_NEAR(p.map_from_pano.translation.z(), 50, kPosition_m);
    }
  }
}

TEST(PlacePanoramas, LinksHoldBothWaysAndUnknownOnesFall) {
  const std::vector<PanoramaRecord> records = {Record("a", 48, 2, {"b", "b", "a", "gone"}),
                                               Record("b", 48, 2.001),
                                               Record("c", 48, 2.002, {"b"})};
  const auto placed = PlacePanoramas(records, ChooseFrame("tangent", records));
  EXPECT_EQ(placed[0].links, std::vector<std::uint32_t>{1});
  EXPECT_EQ(placed[1].links, (std::vector<std::uint32_t>{0, 2}));
  EXPECT_EQ(placed[2].links, std::vector<std::uint32_t>{1});
}

}  // namespace
}  // namespace panofix
