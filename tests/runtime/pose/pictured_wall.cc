#include "tests/runtime/pose/pictured_wall.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "common/geometry/attitude.h"
#include "tests/common/features/synthetic_image.h"

namespace panofix {
namespace {

// An images part of the same picture for every view.
std::string ImagesPart(const TempFolder& folder, GrayImage image, std::size_t num_views) {
  const cv::Mat mat(image.height_px, image.width_px, CV_8UC1, image.pixels.data());
  std::vector<std::uint8_t> jpeg, bytes;
  EXPECT_TRUE(cv::imencode(".jpg", mat, jpeg, {cv::IMWRITE_JPEG_QUALITY, 95}));
  std::vector<std::uint32_t> offsets{0};
  for (std::size_t v = 0; v < num_views; ++v) {
    bytes.insert(bytes.end(), jpeg.begin(), jpeg.end());
    offsets.push_back(static_cast<std::uint32_t>(bytes.size()));
  }
  Hdf5Writer file(folder / "images.h5");
  file.WriteStrings("panorama_ids", {"wall"});
  file.Write<std::uint32_t>("views/offsets", offsets);
  file.Write<std::uint8_t>("views/jpeg", bytes);
  file.Close();
  return ReadText(folder / "images.h5");
}

}  // namespace

PicturedWall::PicturedWall() : image_(BusyImage(320, 240, 1)) {
  const CraftedBundle small = SmallBundle();
  CraftedBundle crafted;
  crafted.manifest = small.manifest, crafted.vocabulary = small.vocabulary;
  crafted.manifest.camera = Camera::FromHorizontalFov(image_.width_px, image_.height_px, 70);
  crafted.manifest.features.root_sift = false;
  const Camera& camera = crafted.manifest.camera;
  crafted.directions = {0, 0, 90, 0, 180, 0};
  crafted.AddPanorama("wall", {Eigen::Quaterniond::Identity(), {0, 0, 2.5}}, {});
  crafted.similar_offsets.assign(4, 0);
  CraftedTile& tile = crafted.tiles.emplace_back();
  tile.path = "tiles/0.h5";
  tile.panorama_ids = {"wall"};
  frame_.sift = ExtractSift(image_, crafted.manifest.features);
  std::vector<std::uint32_t> shown;
  for (std::size_t i = 0; i < frame_.sift.size(); ++i) {
    const Keypoint& k = frame_.sift.keypoints[i];
    const Eigen::Vector2d n = camera.Normalize({double{k.x_px}, double{k.y_px}});
    frame_.bearings.push_back(n);
    MapLandmark landmark;
    // cam to pano of a level view ahead: right, forward, up.
    landmark.point_in_pano = kWallDistance_m * Eigen::Vector3d(n.x(), 1, -n.y());
    landmark.range_sigma_m = 0.2, landmark.point_sigma_m = 0.02;
    landmark.size_m = double{k.size_px} / camera.fx_px * landmark.point_in_pano.norm();
    landmark.angle_deg = double{k.angle_deg};
    shown.push_back(tile.AddLandmark(landmark, frame_.sift.descriptor(i)));
  }
  tile.EndAnchor("wall", {});
  tile.EndView(shown, {});
  tile.EndView({}, {});
  tile.EndView({}, {});
  crafted.extra_parts.emplace_back("images/0.h5", ImagesPart(folder_, image_, 3));
  crafted.Write(folder_ / "b");
  bundle_ = ValueOrThrow(MapBundle::Open(folder_ / "b"));
}

}  // namespace panofix
