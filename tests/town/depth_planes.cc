#include "tests/town/depth_planes.h"

#include <tbb/parallel_for.h>
#include <zlib.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <numbers>

#include "common/base/status.h"
#include "common/geometry/attitude.h"

namespace panofix::town {
namespace {

using Eigen::Vector3d;

void Append(std::string& bytes, std::uint32_t value, int count) {
  for (int i = 0; i < count; ++i) bytes.push_back(static_cast<char>((value >> (8 * i)) & 255u));
}

void AppendFloat(std::string& bytes, double value) {
  const auto single = static_cast<float>(value);
  std::uint32_t bits;
  std::memcpy(&bits, &single, sizeof(bits));
  Append(bytes, bits, 4);
}

std::string Base64(const std::string& bytes, bool url_safe, bool padded) {
  constexpr char kUrlSafe[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
  constexpr char kClassic[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  const char* alphabet = url_safe ? kUrlSafe : kClassic;
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      group = group << 8 | (k < count ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    }
    for (std::size_t k = 0; k <= count; ++k) text.push_back(alphabet[group >> (18 - 6 * k) & 63u]);
    if (padded) text.append(3 - count, '=');
  }
  return text;
}

std::string Deflate(const std::string& bytes) {
  uLongf size = compressBound(static_cast<uLong>(bytes.size()));
  std::string out(size, '\0');
  if (compress2(reinterpret_cast<Bytef*>(out.data()), &size,
                reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uLong>(bytes.size()),
                9) != Z_OK) {
    throw Error(ErrorCode::kInternal, "zlib: a depth map was not compressed; free some memory");
  }
  out.resize(size);
  return out;
}

struct Seen {
  int count = 0;
  Vector3d sum_in_pano = Vector3d::Zero();
};

}  // namespace

Vector3d DepthPixelRay(int column, int row) {
  const double azimuth = ((column + 0.5) / PlaneDepth::kWidth - 0.5) * 2 * std::numbers::pi;
  const double elevation = (0.5 - (row + 0.5) / PlaneDepth::kHeight) * std::numbers::pi;
  return {std::cos(elevation) * std::sin(azimuth), std::cos(elevation) * std::cos(azimuth),
          std::sin(elevation)};
}

PlaneDepth SeePlanes(const Town& town, const Rigid3& town_from_pano, Rng rng) {
  constexpr std::uint32_t kNone = ~std::uint32_t{0};
  std::vector<std::uint32_t> hits(PlaneDepth::kWidth * PlaneDepth::kHeight, kNone);
  std::vector<double> ranges_m(hits.size());
  tbb::parallel_for(0, PlaneDepth::kHeight, [&](int row) {
    for (int column = 0; column < PlaneDepth::kWidth; ++column) {
      const auto i = static_cast<std::size_t>(row * PlaneDepth::kWidth + column);
      const Vector3d ray = town_from_pano.rotation * DepthPixelRay(column, row);
      ranges_m[i] = town.PlaneRange(town_from_pano.translation, ray, &hits[i]).value_or(0);
    }
  });
  std::map<std::uint32_t, Seen> seen;
  for (std::size_t i = 0; i < hits.size(); ++i) {
    if (hits[i] == kNone) continue;
    Seen& entry = seen[hits[i]];
    ++entry.count;
    const int column = static_cast<int>(i) % PlaneDepth::kWidth,
              row = static_cast<int>(i) / PlaneDepth::kWidth;
    entry.sum_in_pano += ranges_m[i] * DepthPixelRay(column, row);
  }
  std::vector<std::pair<int, std::uint32_t>> order;
  for (const auto& [plane, entry] : seen) order.emplace_back(-entry.count, plane);
  std::sort(order.begin(), order.end());
  if (order.size() > PlaneDepth::kMaxPlanes) order.resize(PlaneDepth::kMaxPlanes);

  PlaneDepth depth;
  depth.planes.resize(1);
  std::map<std::uint32_t, std::uint8_t> index_of;
  const auto& planes = town.world(Day::kMap).planes;
  for (const auto& [negative_count, plane] : order) {
    index_of[plane] = static_cast<std::uint8_t>(depth.planes.size());
    const Eigen::Quaterniond pano_from_town = town_from_pano.rotation.conjugate();
    Vector3d normal = pano_from_town * planes[plane].normal;
    double d = planes[plane].d - planes[plane].normal.dot(town_from_pano.translation);
    // Normals point away from the panorama: d is positive.
    if (d < 0) normal = -normal, d = -d;
    const double share_error = town.options().depth_noise_share * rng.Normal();
    const double tilt_rad = town.options().normal_noise_deg * kRadPerDeg;
    const Vector3d tilt = tilt_rad * Vector3d(rng.Normal(), rng.Normal(), rng.Normal());
    const Vector3d centre = seen[plane].sum_in_pano / seen[plane].count;
    if (tilt.norm() > 0) {
      normal = ExpSo3(tilt) * normal;
      d = normal.dot(centre);
    }
    depth.planes.push_back({normal, d * (1 + share_error)});
  }
  depth.indices.reserve(hits.size());
  for (const std::uint32_t plane : hits) {
    const auto found = plane == kNone ? index_of.end() : index_of.find(plane);
    depth.indices.push_back(found == index_of.end() ? std::uint8_t{0} : found->second);
  }
  return depth;
}

std::string EncodeGsv(const PlaneDepth& depth, const GsvForm& form) {
  constexpr std::uint32_t kHeaderBytes = 8;
  std::string payload;
  Append(payload, kHeaderBytes, 1);
  Append(payload, static_cast<std::uint32_t>(depth.planes.size()), 2);
  Append(payload, PlaneDepth::kWidth, 2);
  Append(payload, PlaneDepth::kHeight, 2);
  Append(payload, kHeaderBytes, 1);
  for (const std::uint8_t index : depth.indices) payload.push_back(static_cast<char>(index));
  for (const PlaneDepth::Plane& plane : depth.planes) {
    for (int i = 0; i < 3; ++i) AppendFloat(payload, plane.normal[i]);
    AppendFloat(payload, plane.d);
  }
  return Base64(form.zlib ? Deflate(payload) : payload, form.url_safe, form.padded);
}

}  // namespace panofix::town
