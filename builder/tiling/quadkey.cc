#include "builder/tiling/quadkey.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/geometry/attitude.h"

namespace panofix {

std::string Quadkey(const Geodetic& point, int level) {
  constexpr double kMaxLatitude_deg = 85.05112878;
  const double lat_rad =
      std::clamp(point.lat_deg, -kMaxLatitude_deg, kMaxLatitude_deg) * kRadPerDeg;
  const double sine = std::sin(lat_rad);
  const double x = (point.lon_deg + 180.0) / 360.0;
  const double y = 0.5 - std::log((1 + sine) / (1 - sine)) / (4 * std::numbers::pi);
  const std::int64_t tiles = std::int64_t{1} << level;
  const auto column = std::clamp<std::int64_t>(
      static_cast<std::int64_t>(x * static_cast<double>(tiles)), 0, tiles - 1);
  const auto row = std::clamp<std::int64_t>(
      static_cast<std::int64_t>(y * static_cast<double>(tiles)), 0, tiles - 1);
  std::string key;
  for (int bit = level - 1; bit >= 0; --bit) {
    key += static_cast<char>('0' + ((column >> bit) & 1) + 2 * ((row >> bit) & 1));
  }
  return key;
}

}  // namespace panofix
