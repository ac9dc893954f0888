#pragma once
// The town's place on the ellipsoid: a tangent frame, turned about its vertical, exact to rounding.

#include <Eigen/Core>
#include <memory>

#include "common/geo/map_frame.h"
#include "common/geometry/attitude.h"

namespace panofix::town {

// town: metres; x along the main street, y to its left, z up at the origin. The streets of the town
// are turned by `yaw_deg` (counter-clockwise) from east so that no facade faces a cardinal point.
// Immutable and thread-safe.
class TownGeodesy {
 public:
  TownGeodesy(const Geodetic& origin, double yaw_deg);
  ~TownGeodesy();
  TownGeodesy(TownGeodesy&&) noexcept;

  [[nodiscard]] Geodetic ToGeodetic(const Eigen::Vector3d& x_in_town) const;
  [[nodiscard]] Eigen::Vector3d ToTown(const Geodetic& point) const;
  // Rotation to the east-north-up axes at the point itself: over a kilometre the vertical turns by
  // half an arc minute.
  [[nodiscard]] Eigen::Matrix3d EnuFromTown(const Geodetic& point) const;
  // Attitude at `x_in_town` of a body whose axes (right, forward, up) are the columns.
  [[nodiscard]] Attitude ToAttitude(const Eigen::Vector3d& x_in_town,
                                    const Eigen::Matrix3d& town_from_body) const;
  [[nodiscard]] Eigen::Matrix3d TownFromBody(const Geodetic& point, const Attitude& attitude) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace panofix::town
