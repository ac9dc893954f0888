#include "common/geo/map_frame.h"

#include <Eigen/Geometry>
#include <GeographicLib/LambertConformalConic.hpp>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "common/geometry/attitude.h"

namespace panofix {
namespace {

using GeographicLib::LambertConformalConic;

LambertConformalConic Cone(const LambertParameters& p) {
  return LambertConformalConic(GeographicLib::Constants::WGS84_a(),
                               GeographicLib::Constants::WGS84_f(), p.lat1_deg, p.lat2_deg,
                               p.scale);
}

struct Forward {
  double x, y, convergence_deg, scale;
};

// Construction of the cone costs a microsecond; keeping no GeographicLib type in the header is
// worth it.
Forward Project(const LambertParameters& p, const Geodetic& point) {
  Forward f{};
  Cone(p).Forward(p.lon0_deg, point.lat_deg, point.lon_deg, f.x, f.y, f.convergence_deg, f.scale);
  return f;
}

}  // namespace

MapFrame::MapFrame(const LambertParameters& parameters) : parameters_(parameters) {
  for (const double value :
       {parameters.lat1_deg, parameters.lat2_deg, parameters.lat0_deg, parameters.lon0_deg,
        parameters.scale, parameters.false_easting_m, parameters.false_northing_m}) {
    if (!std::isfinite(value)) throw std::invalid_argument("Lambert parameter is not finite");
  }
  try {
    const Forward origin = Project(parameters, {parameters.lat0_deg, parameters.lon0_deg, 0});
    origin_easting_m_ = origin.x;
    origin_northing_m_ = origin.y;
    if (!std::isfinite(origin.x) || !std::isfinite(origin.y)) {
      throw std::invalid_argument("Lambert parameters: the origin lies outside the projection");
    }
  } catch (const GeographicLib::GeographicErr& error) {
    throw std::invalid_argument(std::string("Lambert parameters: ") + error.what());
  }
}

MapFrame MapFrame::Tangent(const Geodetic& origin) {
  const double magnitude = std::clamp(std::abs(origin.lat_deg), 10.0, 89.0);
  const double lat_deg = origin.lat_deg < 0 ? -magnitude : magnitude;
  LambertParameters p;
  p.lat1_deg = p.lat2_deg = lat_deg;
  p.lat0_deg = origin.lat_deg;
  p.lon0_deg = origin.lon_deg;
  return MapFrame(p);
}

Result<MapFrame> MapFrame::FromName(const std::string& name) {
  if (name == "EPSG:2154" || name == "lambert93") {
    return MapFrame({49.0, 44.0, 46.5, 3.0, 1.0, 700000.0, 6600000.0});
  }
  return Status(ErrorCode::kNotFound,
                "map frame '" + name + "' is not known; use 'tangent' or 'EPSG:2154' (Lambert-93)");
}

Eigen::Vector3d MapFrame::ToMap(const Geodetic& point) const {
  const Forward f = Project(parameters_, point);
  return {f.x - origin_easting_m_ + parameters_.false_easting_m,
          f.y - origin_northing_m_ + parameters_.false_northing_m, point.height_m};
}

Geodetic MapFrame::ToGeodetic(const Eigen::Vector3d& point_in_map) const {
  Geodetic point;
  Cone(parameters_)
      .Reverse(parameters_.lon0_deg,
               point_in_map.x() + origin_easting_m_ - parameters_.false_easting_m,
               point_in_map.y() + origin_northing_m_ - parameters_.false_northing_m, point.lat_deg,
               point.lon_deg);
  point.height_m = point_in_map.z();
  return point;
}

double MapFrame::ConvergenceRad(const Geodetic& point) const {
  return Project(parameters_, point).convergence_deg * kRadPerDeg;
}

double MapFrame::PointScale(const Geodetic& point) const {
  return Project(parameters_, point).scale;
}

Eigen::Matrix3d MapFrame::MapFromEnu(const Geodetic& point) const {
  return Eigen::AngleAxisd(ConvergenceRad(point), Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

}  // namespace panofix
