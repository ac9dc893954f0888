#include "builder/augment/station_planner.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace panofix {
namespace {

// Stations closer than this share of the spacing show the same.
constexpr double kMinSpacingShare = 0.3;

void Require(bool ok, const char* field, double value, const char* rule) {
  if (!ok) {
    throw std::invalid_argument("StationOptions." + std::string(field) + " = " +
                                std::to_string(value) + ": must be " + rule);
  }
}

// The way between two linked panoramas, the same seen from either end: from the lower id on.
class Link {
 public:
  Link(const MapPanorama& low, const MapPanorama& high)
      : start_in_map_(low.map_from_pano.translation),
        step_in_map_(high.map_from_pano.translation - start_in_map_),
        scale_((low.point_scale + high.point_scale) / 2) {}

  [[nodiscard]] double length_m() const {
    return Eigen::Vector3d(step_in_map_.x() / scale_, step_in_map_.y() / scale_, step_in_map_.z())
        .norm();
  }
  // A link straight up has no right-hand side.
  [[nodiscard]] bool has_side() const { return step_in_map_.head<2>().norm() > 0; }
  // The point at a share of the way, `right_m` beside it.
  [[nodiscard]] Eigen::Vector3d PointInMap(double share, double right_m) const {
    Eigen::Vector3d point = start_in_map_ + share * step_in_map_;
    if (right_m != 0) {
      point.head<2>() += right_m * scale_ * Eigen::Vector2d(step_in_map_.y(), -step_in_map_.x()) /
                         step_in_map_.head<2>().norm();
    }
    return point;
  }

 private:
  Eigen::Vector3d start_in_map_, step_in_map_;
  double scale_;
};

Eigen::Vector3d PositionInPano(const MapPanorama& owner, const Eigen::Vector3d& point_in_map) {
  Eigen::Vector3d offset = point_in_map - owner.map_from_pano.translation;
  offset.head<2>() /= owner.point_scale;  // grid lengths to true ones
  return owner.map_from_pano.rotation.conjugate() * offset;
}

// Adds a station unless one is there already.
void Add(const Eigen::Vector3d& position, std::uint32_t owner_idx, const StationOptions& options,
         std::vector<Station>& stations) {
  const bool is_new = std::none_of(stations.begin(), stations.end(), [&](const Station& station) {
    return (station.position_in_pano - position).norm() < kMinSpacingShare * options.spacing_m;
  });
  if (is_new) stations.push_back({owner_idx, position});
}

// Adds stations beyond a panorama that the road goes on from, though the map does not.
void PlanEnd(const Link& link, bool owner_is_low, const MapPanorama& owner,
             const StationOptions& options, std::uint32_t owner_idx,
             std::vector<Station>& stations) {
  const double length_m = link.length_m();
  if (!(length_m > 0) || length_m > options.max_link_m) return;
  const int count = static_cast<int>(options.beyond_m / options.spacing_m + 1e-9);
  for (const double lane_m : options.lanes_m) {
    if (lane_m != 0 && !link.has_side()) continue;
    for (int i = 1; i <= count; ++i) {
      const double share = i * options.spacing_m / length_m;
      Add(PositionInPano(owner, link.PointInMap(owner_is_low ? -share : 1 + share, lane_m)),
          owner_idx, options, stations);
    }
  }
}

// Adds the owner's stations along one of its links.
void PlanLink(const Link& link, bool owner_is_low, const MapPanorama& owner,
              const StationOptions& options, std::uint32_t owner_idx,
              std::vector<Station>& stations) {
  const double length_m = link.length_m();
  if (!(length_m > 0) || length_m > options.max_link_m) return;
  const int parts = std::max(1, static_cast<int>(std::lround(length_m / options.spacing_m)));
  for (const double lane_m : options.lanes_m) {
    if (lane_m != 0 && !link.has_side()) continue;
    for (int i = 0; i <= parts; ++i) {
      if (lane_m == 0 && (i == 0 || i == parts)) continue;  // the panoramas themselves
      if ((2 * i <= parts) != owner_is_low) continue;       // half-way goes to the lower id
      Add(PositionInPano(owner, link.PointInMap(static_cast<double>(i) / parts, lane_m)), owner_idx,
          options, stations);
    }
  }
}

}  // namespace

void StationOptions::Check() const {
  Require(std::isfinite(spacing_m) && (spacing_m == 0 || spacing_m >= 0.1), "spacing_m", spacing_m,
          "0 or at least 0.1");
  for (const double lane_m : lanes_m) {
    Require(std::abs(lane_m) <= 50, "lanes_m", lane_m, "within -50..50");
  }
  Require(beyond_m >= 0 && beyond_m <= 50, "beyond_m", beyond_m, "within 0..50");
  Require(max_link_m > 0 && max_link_m <= 1000, "max_link_m", max_link_m, "above 0, at most 1000");
}

std::vector<std::vector<Station>> PlanStations(const std::vector<MapPanorama>& panoramas,
                                               const StationOptions& options) {
  options.Check();
  std::vector<std::vector<Station>> plan(panoramas.size());
  for (std::uint32_t p = 0; p < panoramas.size(); ++p) {
    plan[p].push_back({p, Eigen::Vector3d::Zero()});
    if (options.spacing_m == 0) continue;
    // By id, not by index: a shard numbers its panoramas differently.
    std::vector<std::uint32_t> neighbours = panoramas[p].links;
    std::sort(neighbours.begin(), neighbours.end(), [&](std::uint32_t a, std::uint32_t b) {
      return panoramas.at(a).id < panoramas.at(b).id;
    });
    for (const std::uint32_t q : neighbours) {
      const bool owner_is_low = panoramas[p].id < panoramas.at(q).id;
      const std::uint32_t low = owner_is_low ? p : q, high = owner_is_low ? q : p;
      if (low == high) continue;
      const Link link(panoramas[low], panoramas[high]);
      PlanLink(link, owner_is_low, panoramas[p], options, p, plan[p]);
      if (neighbours.size() == 1) PlanEnd(link, owner_is_low, panoramas[p], options, p, plan[p]);
    }
  }
  return plan;
}

}  // namespace panofix
