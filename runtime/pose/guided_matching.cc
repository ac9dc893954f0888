#include "runtime/pose/guided_matching.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "common/features/matcher.h"
#include "common/geometry/attitude.h"

namespace panofix {
namespace {

// What is asked of the landmarks.
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
  search.grid.Within(px, radius_px, ShapeLike(size_px, angle_deg, search.options), &candidates);
  int best = -1;
  double best_sq = search.options.max_descriptor_distance * search.options.max_descriptor_distance;
  for (const int k : candidates) {
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

// Where a pose puts a landmark in the picture, and how it looks there.
struct Prediction {
  Eigen::Vector2d px;
  double size_px = 0, angle_deg = 0;
};
std::optional<Prediction> Predict(const ReadyLandmark& landmark, const Camera& camera,
                                  const Rigid3& cam_from_local, double smallest_px) {
  const Eigen::Vector3d x_in_cam = cam_from_local * landmark.match.point_in_map;
  if (x_in_cam.z() < 0.5) return std::nullopt;
  const auto px = camera.Project(x_in_cam);
  if (!px || px->x() < 0 || px->y() < 0 || px->x() > camera.width_px - 1 ||
      px->y() > camera.height_px - 1) {
    return std::nullopt;
  }
  const double size_px = double{landmark.size_m} / x_in_cam.norm() * camera.fx_px;
  if (size_px < smallest_px) return std::nullopt;
  // Roll between the camera and the landmark's level view turns orientations.
  const Eigen::Vector3d up = cam_from_local.rotation * landmark.up_in_local.cast<double>();
  const double roll_deg = std::atan2(up.x(), -up.y()) / kRadPerDeg;
  return Prediction{*px, size_px, double{landmark.angle_deg} + roll_deg};
}

void Append(const FrameFeatures& frame, const Camera& camera, const ReadyLandmark& landmark, int k,
            ViewMatches* matches) {
  const auto found = static_cast<std::size_t>(k);
  Correspondence c = landmark.match;
  c.bearing_in_cam = frame.bearings[found];
  c.keypoint_sigma = KeypointSigma_px(frame.sift.keypoints[found].size_px) / camera.fx_px;
  matches->correspondences.push_back(c);
  matches->keypoint_idx.push_back(k);
  matches->landmark_ids.push_back(landmark.id);
}

std::size_t CellOf(const Eigen::Vector2d& px, const Camera& camera) {
  const auto cell = [](double x, int size_px, int count) {
    return std::clamp(static_cast<int>(x * count / size_px), 0, count - 1);
  };
  const int column = cell(px.x(), camera.width_px, GuidedMatches::kCellColumns);
  const int row = cell(px.y(), camera.height_px, GuidedMatches::kCellRows);
  return static_cast<std::size_t>(row * GuidedMatches::kCellColumns + column);
}

void SearchLandmark(const Search& search, const ReadyLandmark& landmark, GuidedMatches* result) {
  const auto at = Predict(landmark, search.camera, search.cam_from_local, search.frame.smallest_px);
  if (!at) return;
  ++result->num_visible;
  GuidedMatches::Cell& cell = result->cells[CellOf(at->px, search.camera)];
  ++cell.num_visible;
  Correspondence c = landmark.match;
  c.keypoint_sigma = KeypointSigma_px(static_cast<float>(at->size_px)) / search.camera.fx_px;
  const double radius_px = SearchRadius_px(search, c);
  const std::uint8_t* descriptor = landmark.descriptor.data();
  const Eigen::Vector2d decoy = DecoyOf(search, at->px, landmark.id);
  if (FindKeypoint(search, decoy, radius_px, at->size_px, at->angle_deg, descriptor) >= 0)
    ++result->num_decoys, ++cell.num_decoys;
  const int k = FindKeypoint(search, at->px, radius_px, at->size_px, at->angle_deg, descriptor);
  if (k < 0) return;
  ++result->num_found, ++cell.num_found;
  Append(search.frame, search.camera, landmark, k, &result->matches);
}

}  // namespace

KeypointShape ShapeLike(double size_px, double angle_deg, const GuidedOptions& options) {
  return {size_px / options.max_scale_ratio, size_px * options.max_scale_ratio, angle_deg,
          options.max_turn_deg};
}

int BestOfWindow(const FrameFeatures& frame, const std::vector<int>& candidates,
                 const std::uint8_t* descriptor, const GuidedOptions& options) {
  constexpr float kSamePlace_px = 4;  // keypoints so near are one structure at two scales
  const double limit_sq = options.max_descriptor_distance * options.max_descriptor_distance;
  thread_local std::vector<std::pair<int, int>> near;  // squared distance, keypoint
  near.clear();
  for (const int k : candidates) {
    const int distance_sq =
        DescriptorDistanceSq(descriptor, frame.sift.descriptor(static_cast<std::size_t>(k)).data());
    near.emplace_back(distance_sq, k);
  }
  if (near.empty()) return -1;
  const auto best = *std::min_element(near.begin(), near.end());
  if (best.first > limit_sq) return -1;
  const Keypoint& chosen = frame.sift.keypoints[static_cast<std::size_t>(best.second)];
  const double ratio_sq = options.max_ratio * options.max_ratio;
  for (const auto& [distance_sq, k] : near) {
    if (best.first <= ratio_sq * distance_sq) continue;
    const Keypoint& other = frame.sift.keypoints[static_cast<std::size_t>(k)];
    if (std::hypot(other.x_px - chosen.x_px, other.y_px - chosen.y_px) > kSamePlace_px) return -1;
  }
  return best.second;
}

GuidedMatches MatchGuided(const FrameFeatures& frame, const KeypointGrid& grid,
                          const Camera& camera, const std::vector<ReadyLandmark>& landmarks,
                          const Rigid3& cam_from_local, const Matrix6d& covariance,
                          const GuidedOptions& options) {
  const Search search{frame, grid, camera, options, cam_from_local, covariance};
  // Parts folded in order: the same matches for any number of threads.
  constexpr std::size_t kPart = 512;
  std::vector<GuidedMatches> parts((landmarks.size() + kPart - 1) / kPart);
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t part) {
    for (std::size_t i = part * kPart; i < std::min(landmarks.size(), (part + 1) * kPart); ++i)
      SearchLandmark(search, landmarks[i], &parts[part]);
  });
  GuidedMatches result;
  for (const GuidedMatches& part : parts) {
    result.num_visible += part.num_visible;
    result.num_found += part.num_found;
    result.num_decoys += part.num_decoys;
    result.matches.Append(part.matches);
    for (std::size_t c = 0; c < part.cells.size(); ++c) {
      result.cells[c].num_visible += part.cells[c].num_visible;
      result.cells[c].num_found += part.cells[c].num_found;
      result.cells[c].num_decoys += part.cells[c].num_decoys;
    }
  }
  return result;
}

double SupportedShare(const GuidedMatches& matches) {
  constexpr int kFewestVisible = 6;       // fewer tell nothing of a cell
  constexpr double kLeastSupport = 0.08;  // of a cell's landmarks
  int num_visible = 0, num_supported = 0;
  for (const GuidedMatches::Cell& cell : matches.cells) {
    if (cell.num_visible < kFewestVisible) continue;
    num_visible += cell.num_visible;
    const int beyond = cell.num_found - cell.num_decoys;
    if (beyond >= 2 && beyond >= kLeastSupport * cell.num_visible)
      num_supported += cell.num_visible;
  }
  return num_visible > 0 ? double(num_supported) / num_visible : 0;
}

ViewMatches MatchAround(const FrameFeatures& frame, const KeypointGrid& grid, const Camera& camera,
                        const std::vector<ReadyLandmark>& landmarks, const Rigid3& cam_from_local,
                        double radius_px, const GuidedOptions& options) {
  constexpr std::size_t kPart = 128;
  std::vector<ViewMatches> parts((landmarks.size() + kPart - 1) / kPart);
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t part) {
    std::vector<int> candidates;
    for (std::size_t i = part * kPart; i < std::min(landmarks.size(), (part + 1) * kPart); ++i) {
      const auto at = Predict(landmarks[i], camera, cam_from_local, frame.smallest_px);
      if (!at) continue;
      grid.Within(at->px, radius_px, ShapeLike(at->size_px, at->angle_deg, options), &candidates);
      const int k = BestOfWindow(frame, candidates, landmarks[i].descriptor.data(), options);
      if (k >= 0) Append(frame, camera, landmarks[i], k, &parts[part]);
    }
  });
  ViewMatches result;
  for (const ViewMatches& part : parts) result.Append(part);
  return result;
}

}  // namespace panofix
