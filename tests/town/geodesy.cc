#include "tests/town/geodesy.h"

#include <Eigen/Geometry>
#include <GeographicLib/LocalCartesian.hpp>
#include <vector>

namespace panofix::town {

struct TownGeodesy::Impl {
  GeographicLib::LocalCartesian local;
  Eigen::Matrix3d origin_enu_from_town;
};

TownGeodesy::TownGeodesy(const Geodetic& origin, double yaw_deg)
    : impl_(std::make_unique<Impl>(Impl{
          GeographicLib::LocalCartesian(origin.lat_deg, origin.lon_deg, origin.height_m),
          Eigen::AngleAxisd(yaw_deg * kRadPerDeg, Eigen::Vector3d::UnitZ()).toRotationMatrix()})) {}
TownGeodesy::~TownGeodesy() = default;
TownGeodesy::TownGeodesy(TownGeodesy&&) noexcept = default;

Geodetic TownGeodesy::ToGeodetic(const Eigen::Vector3d& x_in_town) const {
  const Eigen::Vector3d enu = impl_->origin_enu_from_town * x_in_town;
  Geodetic point;
  impl_->local.Reverse(enu.x(), enu.y(), enu.z(), point.lat_deg, point.lon_deg, point.height_m);
  return point;
}

Eigen::Vector3d TownGeodesy::ToTown(const Geodetic& point) const {
  Eigen::Vector3d enu;
  impl_->local.Forward(point.lat_deg, point.lon_deg, point.height_m, enu.x(), enu.y(), enu.z());
  return impl_->origin_enu_from_town.transpose() * enu;
}

Eigen::Matrix3d TownGeodesy::EnuFromTown(const Geodetic& point) const {
  // GeographicLib's M takes east-north-up at the point to the axes of the origin (row-major).
  std::vector<double> m(9);
  double x, y, z;
  impl_->local.Forward(point.lat_deg, point.lon_deg, point.height_m, x, y, z, m);
  const Eigen::Matrix3d origin_from_enu =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(m.data());
  return origin_from_enu.transpose() * impl_->origin_enu_from_town;
}

Attitude TownGeodesy::ToAttitude(const Eigen::Vector3d& x_in_town,
                                 const Eigen::Matrix3d& town_from_body) const {
  return AttitudeFromEnu(EnuFromTown(ToGeodetic(x_in_town)) * town_from_body);
}

Eigen::Matrix3d TownGeodesy::TownFromBody(const Geodetic& point, const Attitude& attitude) const {
  return EnuFromTown(point).transpose() * EnuFromBody(attitude);
}

}  // namespace panofix::town
