#include "tests/runtime/pose/synthetic_street.h"

#include <cmath>

#include "common/geometry/attitude.h"
#include "common/map/landmark_codes.h"
#include "tests/common/features/random_descriptors.h"

namespace panofix {
namespace {

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
    const bool two = shape == StreetShape::kTwoWalls || shape == StreetShape::kTwins;
    const bool left = two && rng.Below(2) == 0;
    l.position = {left ? -kWall_m : kWall_m, rng.Uniform(-20, 70), rng.Uniform(0, 9)};
    if (shape == StreetShape::kTwins) l.position.y() = rng.Uniform(-20, -20 + kTwinPeriod_m);
    if (shape == StreetShape::kLine) l.position.z() = 3;
    l.surface_idx = left ? 2 : 1;
    l.size_m = rng.Uniform(0.1, 0.5);
    l.angle_deg = static_cast<float>(rng.Uniform(0, 360));
    l.descriptor = RandomRootSift(&rng);
    landmarks.push_back(l);
    if (shape != StreetShape::kTwins) continue;
    for (int twin = 0; twin < 2; ++twin) {
      l.position.y() += kTwinPeriod_m;
      landmarks.push_back(l);
    }
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

// Panoramas look anywhere.
double HeadingOf_deg(std::uint32_t panorama) { return 25.0 * panorama; }
Rigid3 StreetFromPano(std::uint32_t panorama) {
  return {Eigen::Matrix3d(EnuFromBody({HeadingOf_deg(panorama), 0, 0})),
          Eigen::Vector3d(0, kSpacing_m * panorama, kCameraHeight_m)};
}
const Eigen::Vector3d kVirtualInStreet(0, 0.5 * kSpacing_m, 0);  // from its panorama

std::uint32_t AnchorOf(const StreetLandmark& landmark) {
  const long nearest = std::lround(landmark.position.y() / kSpacing_m);
  return static_cast<std::uint32_t>(std::clamp(nearest, 0L, long{kStreetPanoramas - 1}));
}

// Sorts the landmarks by anchor: their numbers in the tile.
void AddAnchors(std::vector<StreetLandmark>* landmarks, const std::vector<std::string>& ids,
                CraftedTile* tile) {
  std::stable_sort(landmarks->begin(), landmarks->end(),
                   [](const auto& a, const auto& b) { return AnchorOf(a) < AnchorOf(b); });
  auto next = landmarks->begin();
  for (std::uint32_t p = 0; p < kStreetPanoramas; ++p) {
    const Rigid3 pano_from_street = StreetFromPano(p).Inverse();
    for (; next != landmarks->end() && AnchorOf(*next) == p; ++next) {
      MapLandmark landmark;
      landmark.point_in_pano = pano_from_street * next->position;
      landmark.range_sigma_m = 0.02 * landmark.point_in_pano.norm();
      landmark.point_sigma_m = kStreetPointSigma_m;
      landmark.surface_idx = next->surface_idx;
      landmark.size_m = next->size_m, landmark.angle_deg = double{next->angle_deg};
      std::array<std::uint8_t, kPackedDescriptorSize> packed;
      PackDescriptor(
          std::span<const std::uint8_t, kDescriptorSize>(next->descriptor.data(), kDescriptorSize),
          packed.data());
      tile->AddLandmark(landmark, packed);
    }
    const Eigen::Vector3d right = pano_from_street.rotation * Eigen::Vector3d::UnitX();
    tile->EndAnchor(ids[p], {{},
                             {right, kStreetShareSigma, kStreetNormalSigma_rad},
                             {-right, kStreetShareSigma, kStreetNormalSigma_rad}});
  }
}

// The views of a station of panorama p.
void AddViews(const std::vector<StreetLandmark>& landmarks, const Camera& camera, std::uint32_t p,
              const Eigen::Vector3d& station_in_street, CraftedTile* tile) {
  for (std::uint32_t v = 0; v < kStreetViews; ++v) {
    const Rigid3 cam_from_street =
        StreetFromCam(station_in_street, HeadingOf_deg(p) + 45.0 * v).Inverse();
    std::vector<std::uint32_t> shown;
    for (std::uint32_t i = 0; i < landmarks.size(); ++i) {
      if (See(camera, cam_from_street, landmarks[i], kPanoramaRange_m)) shown.push_back(i);
    }
    tile->EndView(shown, {});
  }
}

}  // namespace

SyntheticStreet::SyntheticStreet(StreetShape shape, int num_landmarks,
                                 const std::function<void(CraftedBundle*)>& change)
    : landmarks_(MakeLandmarks(shape, num_landmarks)) {
  const CraftedBundle small = SmallBundle();
  CraftedBundle crafted;
  crafted.manifest = small.manifest, crafted.vocabulary = small.vocabulary;
  const MapFrame lambert93 = *MapFrame::FromName("EPSG:2154");
  crafted.manifest.map_frame = lambert93.parameters();
  for (std::uint32_t v = 0; v < kStreetViews; ++v)
    crafted.directions.insert(crafted.directions.end(), {45.0 * v, 0});
  const LocalFrame map_of_street{lambert93.ToMap({46.5, 3.2, 0}),
                                 lambert93.PointScale({46.5, 3.2, 0})};
  for (std::uint32_t p = 0; p < kStreetPanoramas; ++p) {
    const Rigid3 street_from_pano = StreetFromPano(p);
    crafted.AddPanorama(
        "p" + std::to_string(p),
        {street_from_pano.rotation, map_of_street.ToMap(street_from_pano.translation)}, {});
    crafted.AddStation((street_from_pano.rotation.conjugate() * kVirtualInStreet).cast<float>());
  }
  CraftedTile& tile = crafted.tiles.emplace_back();
  tile.path = "tiles/0.h5";
  tile.panorama_ids = crafted.ids;
  AddAnchors(&landmarks_, crafted.ids, &tile);
  for (std::uint32_t p = 0; p < kStreetPanoramas; ++p) {
    const Eigen::Vector3d centre = StreetFromPano(p).translation;
    AddViews(landmarks_, crafted.manifest.camera, p, centre, &tile);
    AddViews(landmarks_, crafted.manifest.camera, p, centre + kVirtualInStreet, &tile);
  }
  crafted.similar_offsets.assign(crafted.ids.size() * kStreetViews + 1, 0);
  if (change) change(&crafted);
  crafted.Write(folder_ / "b");
  bundle_ = ValueOrThrow(MapBundle::Open(folder_ / "b"));
  stations_ = std::make_unique<const StationGrid>(*bundle_);
  local_ = LocalFrame::At(bundle_->panoramas()[0]);
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
  const std::uint32_t begin = bundle_->first_station(first) * kStreetViews,
                      end = bundle_->first_station(last + 1) * kStreetViews;
  for (std::uint32_t view = begin; view < end; ++view) {
    ViewMatches matches = MatchView(frame, camera(), *bundle_, view, local_, {});
    if (!matches.correspondences.empty()) views.push_back(std::move(matches));
  }
  return views;
}

const SyntheticStreet& Street() {
  static const SyntheticStreet street(StreetShape::kTwoWalls);
  return street;
}

}  // namespace panofix
