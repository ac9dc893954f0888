#include "tests/runtime/pose/synthetic_street.h"

#include <cmath>

#include "common/geometry/attitude.h"
#include "tests/common/features/random_descriptors.h"

namespace panofix {
namespace {

constexpr int kPanoramas = 6, kViewsAPanorama = 8;
constexpr double kSpacing_m = 8, kCameraHeight_m = 2.5, kWall_m = 7;
// A camera sees all that panoramas near it show.
constexpr double kPanoramaRange_m = 30, kCameraRange_m = 100;

// RootSIFT-like: 512 long, few large entries, so that strangers lie far apart.
std::vector<std::uint8_t> RandomRootSift(Rng* rng) {
  std::vector<double> values;
  double sum_sq = 0;
  for (int i = 0; i < kDescriptorSize; ++i) {
    values.push_back(std::pow(rng->Uniform(), 4));
    sum_sq += values.back() * values.back();
  }
  std::vector<std::uint8_t> bytes;
  for (const double v : values) {
    bytes.push_back(
        static_cast<std::uint8_t>(std::min(255L, std::lround(512 * v / std::sqrt(sum_sq)))));
  }
  return bytes;
}

std::vector<StreetLandmark> MakeLandmarks(StreetShape shape, int count) {
  Rng rng(1, "tests/street");
  std::vector<StreetLandmark> landmarks;
  for (int i = 0; i < count; ++i) {
    StreetLandmark l;
    const bool left = shape == StreetShape::kTwoWalls && rng.Below(2) == 0;
    l.position = {left ? -kWall_m : kWall_m, rng.Uniform(-20, 70), rng.Uniform(0, 9)};
    if (shape == StreetShape::kLine) l.position.z() = 3;
    l.surface_idx = left ? 2 : 1;
    l.size_m = rng.Uniform(0.1, 0.5);
    l.angle_deg = static_cast<float>(rng.Uniform(0, 360));
    l.descriptor = RandomRootSift(&rng);
    landmarks.push_back(l);
  }
  return landmarks;
}

// The keypoint that a landmark makes in a picture, if it lies in it.
std::optional<Keypoint> See(const Camera& camera, const Rigid3& cam_from_street,
                            const StreetLandmark& landmark, double max_range_m) {
  const Eigen::Vector3d x_in_cam = cam_from_street * landmark.position;
  const auto px = camera.Project(x_in_cam);
  if (!px || x_in_cam.norm() > max_range_m) return std::nullopt;
  if (px->x() < 0 || px->y() < 0 || px->x() > camera.width_px - 1 || px->y() > camera.height_px - 1)
    return std::nullopt;
  const double size_px = camera.fx_px * landmark.size_m / x_in_cam.norm();
  return Keypoint{static_cast<float>(px->x()), static_cast<float>(px->y()),
                  static_cast<float>(size_px), landmark.angle_deg, 1};
}

Rigid3 StreetFromCam(const Eigen::Vector3d& position, double heading_deg) {
  return {Eigen::Matrix3d(EnuFromBody({heading_deg, 0, 0}) * BodyFromCam()), position};
}

}  // namespace

SyntheticStreet::SyntheticStreet(StreetShape shape, int num_landmarks)
    : landmarks_(MakeLandmarks(shape, num_landmarks)) {
  CraftedBundle crafted = SmallBundle();
  Manifest manifest = crafted.manifest;
  const MapFrame lambert93 = *MapFrame::FromName("EPSG:2154");
  manifest.map_frame = lambert93.parameters();
  const Vocabulary vocabulary = crafted.vocabulary;
  crafted = {};
  crafted.manifest = manifest, crafted.vocabulary = vocabulary;
  for (int v = 0; v < kViewsAPanorama; ++v)
    crafted.directions.insert(crafted.directions.end(), {45.0 * v, 0});
  const Eigen::Vector3d origin_in_map = lambert93.ToMap({46.5, 3.2, 0});
  const double scale = lambert93.PointScale({46.5, 3.2, 0});
  CraftedTile& tile = crafted.tiles.emplace_back();
  tile.path = "tiles/0.h5";
  for (int p = 0; p < kPanoramas; ++p) {
    const Eigen::Vector3d centre(0, kSpacing_m * p, kCameraHeight_m);
    const double heading_deg = 25.0 * p;  // panoramas look anywhere
    const Eigen::Matrix3d street_from_pano = EnuFromBody({heading_deg, 0, 0});
    crafted.AddPanorama(
        "p" + std::to_string(p),
        Rigid3(street_from_pano,
               origin_in_map + Eigen::Vector3d(scale * centre.x(), scale * centre.y(), centre.z())),
        {});
    tile.panorama_ids.push_back(crafted.ids.back());
    for (int v = 0; v < kViewsAPanorama; ++v) {
      const Rigid3 cam_from_street = StreetFromCam(centre, heading_deg + 45.0 * v).Inverse();
      for (const StreetLandmark& landmark : landmarks_) {
        const auto keypoint = See(manifest.camera, cam_from_street, landmark, kPanoramaRange_m);
        if (!keypoint) continue;
        const Eigen::Vector3d point_in_pano =
            street_from_pano.transpose() * (landmark.position - centre);
        tile.AddFeature(*keypoint, point_in_pano, 0.02 * point_in_pano.norm(), landmark.descriptor,
                        landmark.surface_idx);
      }
      tile.EndView({});
    }
    const auto plane = [&](const Eigen::Vector3d& n) {
      const Eigen::Vector3d n_in_pano = street_from_pano.transpose() * n;
      return Eigen::Vector4d(n_in_pano.x(), n_in_pano.y(), n_in_pano.z(), kWall_m);
    };
    tile.EndPanorama({Eigen::Vector4d::Zero(), plane(Eigen::Vector3d::UnitX()),
                      plane(-Eigen::Vector3d::UnitX())});
  }
  crafted.similar_offsets.assign(crafted.ids.size() * kViewsAPanorama + 1, 0);
  crafted.Write(folder_ / "b");
  bundle_ = ValueOrThrow(MapBundle::Open(folder_ / "b"));
}

Rigid3 SyntheticStreet::LocalFromStreet() const {
  return {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, -kCameraHeight_m)};
}

Rigid3 SyntheticStreet::CamFromLocal(const Eigen::Vector3d& position_in_street,
                                     double heading_deg) const {
  return (LocalFromStreet() * StreetFromCam(position_in_street, heading_deg)).Inverse();
}

FrameFeatures SyntheticStreet::Frame(const Rigid3& cam_from_local, double pixel_sigma,
                                     int num_clutter) const {
  Rng rng(2, "tests/frame");
  FrameFeatures frame;
  const auto add = [&](Keypoint k, const std::vector<std::uint8_t>& descriptor) {
    k.x_px += static_cast<float>(pixel_sigma * rng.Normal());
    k.y_px += static_cast<float>(pixel_sigma * rng.Normal());
    frame.sift.keypoints.push_back(k);
    frame.sift.descriptors.insert(frame.sift.descriptors.end(), descriptor.begin(),
                                  descriptor.end());
    frame.bearings.push_back(camera().Normalize({double{k.x_px}, double{k.y_px}}));
  };
  for (const StreetLandmark& landmark : landmarks_) {
    const auto keypoint =
        See(camera(), cam_from_local * LocalFromStreet(), landmark, kCameraRange_m);
    if (keypoint) add(*keypoint, Disturbed(landmark.descriptor, 8, &rng));
  }
  for (int i = 0; i < num_clutter; ++i) {
    const auto side = [&](int size_px) { return static_cast<float>(rng.Uniform(0, size_px - 1)); };
    add({side(camera().width_px), side(camera().height_px), 12, 0, 1}, RandomRootSift(&rng));
  }
  return frame;
}

std::vector<ViewMatches> SyntheticStreet::Match(const FrameFeatures& frame, std::uint32_t first,
                                                std::uint32_t last) const {
  std::vector<ViewMatches> views;
  for (std::uint32_t view = first * kViewsAPanorama; view < (last + 1) * kViewsAPanorama; ++view) {
    ViewMatches matches = MatchView(frame, camera(), *bundle_, view, local(), {});
    if (!matches.correspondences.empty()) views.push_back(std::move(matches));
  }
  return views;
}

}  // namespace panofix
