#pragma once
// The bundle's map frame: a Lambert conformal conic grid over WGS84, and what it does to angles.

#include <Eigen/Core>
#include <string>

#include "common/base/status.h"

namespace panofix {

// A position on the WGS84 ellipsoid.
struct Geodetic {
  double lat_deg = 0;   // [-90, 90]
  double lon_deg = 0;   // [-180, 180]
  double height_m = 0;  // ellipsoidal, or the data set's height datum passed through
};

// Parameters of a Lambert conformal conic (Snyder, "Map projections: a working manual", 1987,
// section 15). lat1 == lat2 is the tangent cone.
struct LambertParameters {
  double lat1_deg = 0, lat2_deg = 0;  // standard parallels
  double lat0_deg = 0, lon0_deg = 0;  // origin
  double scale = 1;                   // on the standard parallels
  double false_easting_m = 0, false_northing_m = 0;
};

// Immutable; copies are cheap enough to pass by value; thread-safe.
class MapFrame {
 public:
  // Throws std::invalid_argument where a parameter is not finite or the parallels make no cone.
  explicit MapFrame(const LambertParameters& parameters);
  // Tangent cone at `origin`, scale 1, false origin 0. Within 10 degrees of the equator or 1 degree
  // of a pole the parallel is moved to that bound: the cone degenerates there.
  [[nodiscard]] static MapFrame Tangent(const Geodetic& origin);
  // A known name ("EPSG:2154", "lambert93"), or kNotFound.
  [[nodiscard]] static Result<MapFrame> FromName(const std::string& name);

  [[nodiscard]] const LambertParameters& parameters() const { return parameters_; }
  // Easting, northing, height (metres).
  [[nodiscard]] Eigen::Vector3d ToMap(const Geodetic& point) const;
  [[nodiscard]] Geodetic ToGeodetic(const Eigen::Vector3d& point_in_map) const;
  // Meridian convergence: bearing of grid north clockwise from true north, radians.
  // grid bearing = true heading - convergence.
  [[nodiscard]] double ConvergenceRad(const Geodetic& point) const;
  // Point scale: grid distance / ground distance, horizontally.
  [[nodiscard]] double PointScale(const Geodetic& point) const;
  // Rotation from local east-north-up at `point` to the grid's axes: Rz(convergence).
  [[nodiscard]] Eigen::Matrix3d MapFromEnu(const Geodetic& point) const;

 private:
  LambertParameters parameters_;
  double origin_easting_m_ = 0, origin_northing_m_ = 0;
};

}  // namespace panofix
