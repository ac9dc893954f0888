#include "runtime/pose/guided_matching.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/geometry/attitude.h"

namespace panofix {
namespace {

// Panoramas with depth within reach of the camera, nearest first.
std::vector<std::uint32_t> NearPanoramas(const MapBundle& bundle, const LocalFrame& local,
                                         const Eigen::Vector3d& camera_in_local,
                                         const GuidedOptions& options) {
  std::vector<std::pair<double, std::uint32_t>> near;
  for (std::uint32_t i = 0; i < bundle.panoramas().size(); ++i) {
    if (!bundle.panoramas()[i].has_depth) continue;
    const double distance_m =
        (local.FromMap(bundle.panoramas()[i].map_from_pano.translation) - camera_in_local).norm();
    if (distance_m <= options.max_distance_m) near.emplace_back(distance_m, i);
  }
  std::sort(near.begin(), near.end());
  if (near.size() > static_cast<std::size_t>(options.num_panoramas)) {
    near.resize(static_cast<std::size_t>(options.num_panoramas));
  }
  std::vector<std::uint32_t> indices;
  for (const auto& [distance_m, i] : near) indices.push_back(i);
  return indices;
}

Rigid3 PanoFromView(const MapView& view) {
  return {EnuFromBody({view.yaw_deg, view.pitch_deg, 0}) * BodyFromCam(), Eigen::Vector3d::Zero()};
}

// What is asked of one view's landmarks.
struct Search {
  const FrameFeatures& frame;
  const KeypointGrid& grid;
  const Camera& camera;
  const GuidedOptions& options;
  const Rigid3& cam_from_local;
  const Matrix6d& covariance;
};

// 3-sigma radius of a predicted pixel: keypoint, landmark and pose errors.
double SearchRadius_px(const Search& search, const Correspondence& landmark) {
  const Eigen::Matrix<double, 2, 6> J = BearingJacobian(landmark, search.cam_from_local);
  const Eigen::Matrix2d S =
      ResidualCovariance(landmark, search.cam_from_local) + J * search.covariance * J.transpose();
  const double radius_px = 3 * std::sqrt(S.trace() / 2) * search.camera.fx_px;
  return std::clamp(radius_px, search.options.min_radius_px, search.options.max_radius_px);
}

// Index of the frame keypoint that shows the landmark, or -1.
int FindKeypoint(const Search& search, const Eigen::Vector2d& px, double radius_px, double size_px,
                 double angle_deg, const std::uint8_t* descriptor) {
  thread_local std::vector<int> candidates;
  candidates.clear();
  search.grid.Within(px, radius_px, &candidates);
  int best = -1;
  double best_sq = search.options.max_descriptor_distance * search.options.max_descriptor_distance;
  for (const int k : candidates) {
    const Keypoint& keypoint = search.frame.sift.keypoints[static_cast<std::size_t>(k)];
    const double ratio = double{keypoint.size_px} / size_px;
    if (ratio > search.options.max_scale_ratio || ratio * search.options.max_scale_ratio < 1)
      continue;
    if (std::abs(AngleDifferenceDeg(double{keypoint.angle_deg}, angle_deg)) >
        search.options.max_turn_deg)
      continue;
    const double distance_sq = DescriptorDistanceSq(
        descriptor, search.frame.sift.descriptor(static_cast<std::size_t>(k)).data());
    if (distance_sq < best_sq) best_sq = distance_sq, best = k;
  }
  return best;
}

// A place at the decoy offset, in a direction that changes from landmark to landmark, inside the
// picture.
Eigen::Vector2d DecoyOf(const Search& search, const Eigen::Vector2d& px, std::size_t landmark_idx) {
  constexpr double kDirections[4][2] = {{1, 0}, {-1, 0}, {0.6, 0.8}, {-0.6, -0.8}};
  const double offset_px = search.options.decoy_offset_px;
  for (std::size_t turn = 0; turn < 4; ++turn) {
    const double* d = kDirections[(landmark_idx + turn) % 4];
    const Eigen::Vector2d decoy = px + offset_px * Eigen::Vector2d(d[0], d[1]);
    if (decoy.x() >= 0 && decoy.y() >= 0 && decoy.x() < search.camera.width_px &&
        decoy.y() < search.camera.height_px) {
      return decoy;
    }
  }
  return px + Eigen::Vector2d(0, px.y() > offset_px ? -offset_px : offset_px);
}

void SearchView(const Search& search, const MapBundle& bundle, std::uint32_t view_idx,
                const LocalFrame& local, GuidedMatches* result) {
  const MapView& view = bundle.views()[view_idx];
  const MapPanorama& panorama = bundle.panoramas()[view.panorama_idx];
  const Rigid3 local_from_pano = local.LocalFromPano(panorama);
  const Rigid3 local_from_view = local_from_pano * PanoFromView(view);
  // A camera that looks away from a view by more than both half fields of view shares nothing with
  // it.
  const Eigen::Vector3d axis =
      search.cam_from_local.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  const double half_fov = std::atan(0.5 * search.camera.width_px / search.camera.fx_px);
  if (axis.dot(local_from_view.rotation * Eigen::Vector3d::UnitZ()) <
      std::cos(std::min(3.1, 2.2 * half_fov)))
    return;
  const Eigen::Vector3d camera_in_local = search.cam_from_local.Inverse().translation;
  // Roll between the two cameras turns orientations.
  const Eigen::Matrix3d cam_from_view =
      (search.cam_from_local.rotation * local_from_view.rotation).toRotationMatrix();
  const double roll_deg = std::atan2(cam_from_view(1, 0), cam_from_view(0, 0)) / kRadPerDeg;

  const ViewFeatures features = bundle.Features(view_idx);
  const double min_cosine = std::cos(search.options.max_viewing_deg * kRadPerDeg);
  ViewMatches matches;
  matches.view_idx = view_idx;
  for (std::size_t i = 0; i < features.size(); ++i) {
    Correspondence c = MakeLandmark(bundle, view_idx, features, i, local_from_pano);
    const Eigen::Vector3d x_in_cam = search.cam_from_local * c.point_in_map;
    if (x_in_cam.z() < 0.5) continue;
    const auto px = search.camera.Project(x_in_cam);
    if (!px || px->x() < 0 || px->y() < 0 || px->x() > search.camera.width_px - 1 ||
        px->y() > search.camera.height_px - 1) {
      continue;
    }
    const Eigen::Vector3d sight = c.point_in_map - camera_in_local;
    if (sight.normalized().dot(c.lever_in_map.normalized()) < min_cosine) continue;
    const double size_px =
        double{features.keypoints[4 * i + 2]} * c.lever_in_map.norm() / sight.norm();
    constexpr double kSmallestSize_px = 2.0;  // smaller ones are below the frame's resolution
    if (size_px < kSmallestSize_px) continue;
    ++result->num_visible;
    c.keypoint_sigma = KeypointSigma_px(static_cast<float>(size_px)) / search.camera.fx_px;
    const double radius_px = SearchRadius_px(search, c);
    const double angle_deg = double{features.keypoints[4 * i + 3]} + roll_deg;
    const std::uint8_t* descriptor = features.descriptors.data() + i * kDescriptorSize;
    const Eigen::Vector2d decoy = DecoyOf(search, *px, i);
    if (FindKeypoint(search, decoy, radius_px, size_px, angle_deg, descriptor) >= 0)
      ++result->num_decoys;
    const int k = FindKeypoint(search, *px, radius_px, size_px, angle_deg, descriptor);
    if (k < 0) continue;
    ++result->num_found;
    const auto found = static_cast<std::size_t>(k);
    c.bearing_in_cam = search.frame.bearings[found];
    c.keypoint_sigma =
        KeypointSigma_px(search.frame.sift.keypoints[found].size_px) / search.camera.fx_px;
    matches.correspondences.push_back(c);
    matches.keypoint_idx.push_back(k);
  }
  if (!matches.correspondences.empty()) result->views.push_back(std::move(matches));
}

}  // namespace

KeypointGrid::KeypointGrid(const FrameFeatures& frame, const Camera& camera)
    : frame_(frame),
      columns_(camera.width_px / kCell_px + 1),
      rows_(camera.height_px / kCell_px + 1),
      offsets_(static_cast<std::size_t>(columns_ * rows_) + 1, 0) {
  const auto cell_of = [&](const Keypoint& k) {
    const int x = std::clamp(static_cast<int>(k.x_px) / kCell_px, 0, columns_ - 1);
    const int y = std::clamp(static_cast<int>(k.y_px) / kCell_px, 0, rows_ - 1);
    return static_cast<std::size_t>(y * columns_ + x);
  };
  for (const Keypoint& k : frame.sift.keypoints) ++offsets_[cell_of(k) + 1];
  for (std::size_t i = 1; i < offsets_.size(); ++i) offsets_[i] += offsets_[i - 1];
  keypoints_.resize(frame.sift.size());
  std::vector<std::uint32_t> next(offsets_.begin(), offsets_.end() - 1);
  for (std::size_t i = 0; i < frame.sift.size(); ++i) {
    keypoints_[next[cell_of(frame.sift.keypoints[i])]++] = static_cast<int>(i);
  }
}

void KeypointGrid::Within(const Eigen::Vector2d& px, double radius_px,
                          std::vector<int>* found) const {
  const auto cell = [](double v, int count) {
    return std::clamp(static_cast<int>(v) / kCell_px, 0, count - 1);
  };
  const int x0 = cell(px.x() - radius_px, columns_), x1 = cell(px.x() + radius_px, columns_);
  const int y0 = cell(px.y() - radius_px, rows_), y1 = cell(px.y() + radius_px, rows_);
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      const auto c = static_cast<std::size_t>(y * columns_ + x);
      for (std::uint32_t slot = offsets_[c]; slot < offsets_[c + 1]; ++slot) {
        const Keypoint& k = frame_.sift.keypoints[static_cast<std::size_t>(keypoints_[slot])];
        const double dx = double{k.x_px} - px.x(), dy = double{k.y_px} - px.y();
        if (dx * dx + dy * dy <= radius_px * radius_px) found->push_back(keypoints_[slot]);
      }
    }
  }
}

GuidedMatches MatchGuided(const FrameFeatures& frame, const KeypointGrid& grid,
                          const Camera& camera, const MapBundle& bundle, const LocalFrame& local,
                          const Rigid3& cam_from_local, const Matrix6d& covariance,
                          const GuidedOptions& options) {
  GuidedMatches result;
  const Search search{frame, grid, camera, options, cam_from_local, covariance};
  const auto per_panorama =
      static_cast<std::uint32_t>(bundle.views().size() / bundle.panoramas().size());
  std::vector<std::uint32_t> views;
  for (const std::uint32_t p :
       NearPanoramas(bundle, local, cam_from_local.Inverse().translation, options)) {
    for (std::uint32_t v = 0; v < per_panorama; ++v) views.push_back(p * per_panorama + v);
  }
  // A slot a view, folded in order: the same matches for any number of threads.
  std::vector<GuidedMatches> parts(views.size());
  tbb::parallel_for(std::size_t{0}, views.size(),
                    [&](std::size_t i) { SearchView(search, bundle, views[i], local, &parts[i]); });
  for (GuidedMatches& part : parts) {
    result.num_visible += part.num_visible;
    result.num_found += part.num_found;
    result.num_decoys += part.num_decoys;
    for (ViewMatches& view : part.views) result.views.push_back(std::move(view));
  }
  return result;
}

}  // namespace panofix
