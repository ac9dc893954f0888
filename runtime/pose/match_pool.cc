#include "runtime/pose/match_pool.h"

#include <map>
#include <set>

#include "common/geometry/attitude.h"

namespace panofix {
namespace {

constexpr double kInlierChi2 = 9.21;  // 99 % of a 2-D whitened residual
// Never accept a residual beyond this, however uncertain the point is.
constexpr double kMaxReprojError_px = 12.0;

}  // namespace

std::vector<PanoramaPrior> PriorsOf(const MatchPool& pool, const MapErrors& errors) {
  std::set<int> panoramas;
  for (const Correspondence& match : pool.matches) panoramas.insert(match.panorama_idx);
  std::vector<PanoramaPrior> priors;
  for (const int panorama : panoramas) {
    const double heading_rad = std::max(1e-4, errors.panorama_heading_sigma_deg * kRadPerDeg);
    priors.push_back(
        {panorama, std::max(1e-3, errors.panorama_position_sigma_m), heading_rad, heading_rad});
  }
  return priors;
}

void MatchPool::Append(const ViewMatches& view) {
  matches.insert(matches.end(), view.correspondences.begin(), view.correspondences.end());
  keypoint_idx.insert(keypoint_idx.end(), view.keypoint_idx.begin(), view.keypoint_idx.end());
}

bool Agrees(const Correspondence& match, const Rigid3& cam_from_local, double focal_px,
            double* chi2) {
  Eigen::Vector2d residual;
  if (!BearingResidual(match, cam_from_local, &residual)) return false;
  if (residual.norm() * focal_px > kMaxReprojError_px) return false;
  *chi2 = residual.dot(ResidualCovariance(match, cam_from_local).ldlt().solve(residual));
  return *chi2 < kInlierChi2;
}

MatchPool Agreeing(const MatchPool& pool, const Rigid3& cam_from_local, double focal_px) {
  MatchPool agreed;
  for (std::size_t i = 0; i < pool.matches.size(); ++i) {
    double chi2;
    if (!Agrees(pool.matches[i], cam_from_local, focal_px, &chi2)) continue;
    agreed.matches.push_back(pool.matches[i]);
    agreed.keypoint_idx.push_back(pool.keypoint_idx[i]);
  }
  return agreed;
}

int CountKeypoints(const MatchPool& pool, const Rigid3& cam_from_local, double focal_px) {
  std::set<int> keypoints;
  for (std::size_t i = 0; i < pool.matches.size(); ++i) {
    double chi2;
    if (Agrees(pool.matches[i], cam_from_local, focal_px, &chi2))
      keypoints.insert(pool.keypoint_idx[i]);
  }
  return static_cast<int>(keypoints.size());
}

MatchPool WithoutRepeats(const MatchPool& pool, const Rigid3& cam_from_local, double focal_px) {
  std::map<std::pair<int, int>, std::pair<double, std::size_t>> best;
  for (std::size_t i = 0; i < pool.matches.size(); ++i) {
    double chi2 = 0;
    if (!Agrees(pool.matches[i], cam_from_local, focal_px, &chi2)) chi2 = 1e9;
    const auto key = std::make_pair(pool.keypoint_idx[i], pool.matches[i].panorama_idx);
    const auto [entry, is_new] = best.try_emplace(key, chi2, i);
    if (!is_new && chi2 < entry->second.first) entry->second = {chi2, i};
  }
  MatchPool kept;
  for (const auto& [key, value] : best) {
    kept.matches.push_back(pool.matches[value.second]);
    kept.keypoint_idx.push_back(pool.keypoint_idx[value.second]);
  }
  return kept;
}

}  // namespace panofix
