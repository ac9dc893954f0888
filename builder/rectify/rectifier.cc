#include "builder/rectify/rectifier.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "common/base/log.h"
#include "common/geometry/attitude.h"

namespace panofix {
namespace {

// Where a view's pixel falls on the sphere, as shares of the panorama's width and height: 0..1 from
// the left edge and the top edge. Independent of the panorama's size.
struct SpherePoint {
  float across, down;
};
// Views of one pitch share a table; a yaw only adds to `across`.
struct PitchTable {
  double pitch_deg;
  std::vector<SpherePoint> points;
};

// Unnormalised ray of a view pixel in its cam frame, z = 1.
Eigen::Vector3d RayInCam(const Camera& camera, int x, int y) {
  return {(x - camera.cx_px) / camera.fx_px, (y - camera.cy_px) / camera.fy_px, 1};
}

// Paper, Eqs. (2)-(4): the view's pixels traced back to the unit sphere.
PitchTable MakeTable(const Camera& camera, double pitch_deg) {
  const Eigen::Matrix3d pano_from_cam = PanoFromCam({0, pitch_deg});
  PitchTable table{pitch_deg, {}};
  table.points.reserve(static_cast<std::size_t>(camera.width_px) *
                       static_cast<std::size_t>(camera.height_px));
  for (int y = 0; y < camera.height_px; ++y) {
    for (int x = 0; x < camera.width_px; ++x) {
      const Eigen::Vector3d ray = pano_from_cam * RayInCam(camera, x, y);
      const double azimuth = std::atan2(ray.x(), ray.y());
      const double elevation = std::atan2(ray.z(), ray.head<2>().norm());
      table.points.push_back({static_cast<float>(azimuth / (2 * std::numbers::pi) + 0.5),
                              static_cast<float>(0.5 - elevation / std::numbers::pi)});
    }
  }
  return table;
}

// `value` to [0, period), given that it is at most a period off.
double Wrap(double value, double period) {
  if (value < 0) value += period;  // may round up to the period itself
  return value >= period ? value - period : value;
}

GrayImage EmptyView(const Camera& camera) {
  GrayImage view{camera.width_px, camera.height_px, {}};
  view.pixels.resize(static_cast<std::size_t>(camera.width_px) *
                     static_cast<std::size_t>(camera.height_px));
  return view;
}

std::uint8_t Bilinear(const GrayImage& image, double column, double row) {
  const double top = std::floor(row), left = std::floor(column);
  const double fy = row - top, fx = column - left;
  const auto x0 = static_cast<std::size_t>(left), y0 = static_cast<std::size_t>(top);
  const auto width = static_cast<std::size_t>(image.width_px);
  const std::size_t x1 = x0 + 1 == width ? 0 : x0 + 1;
  const std::size_t y1 = std::min(y0 + 1, static_cast<std::size_t>(image.height_px) - 1);
  const std::uint8_t* above = image.pixels.data() + y0 * width;
  const std::uint8_t* below = image.pixels.data() + y1 * width;
  const double upper = above[x0] + fx * (above[x1] - above[x0]);
  const double lower = below[x0] + fx * (below[x1] - below[x0]);
  return static_cast<std::uint8_t>(upper + fy * (lower - upper) + 0.5);
}

}  // namespace

struct Rectifier::Impl {
  Camera camera;
  std::vector<ViewDirection> directions;
  std::vector<PitchTable> tables;
  std::vector<std::size_t> table_of_view;

  // Calls visit(pixel index, column, row) with continuous panorama coordinates, pixel edges at
  // whole numbers: column in [0, width), row in [0, height].
  template <typename Visit>
  void ForEachPixel(int view_idx, const ImageSize& size, const Visit& visit) const {
    const auto view = static_cast<std::size_t>(view_idx);
    const double yaw_share = std::remainder(directions.at(view).yaw_deg, 360.0) / 360;
    const std::vector<SpherePoint>& points = tables[table_of_view[view]].points;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double across = Wrap(points[i].across + yaw_share, 1);
      visit(i, across * size.width_px, static_cast<double>(points[i].down) * size.height_px);
    }
  }
};

std::vector<ViewDirection> RingOfViews(int count, double pitch_deg, double first_yaw_deg) {
  if (count < 1) throw std::invalid_argument(Format("num_views %d; must be at least 1", count));
  std::vector<ViewDirection> directions;
  for (int i = 0; i < count; ++i)
    directions.push_back({first_yaw_deg + 360.0 * i / count, pitch_deg});
  return directions;
}

Eigen::Matrix3d PanoFromCam(const ViewDirection& direction) {
  // The pano frame is a body's; a yaw clockwise from its centre column is a heading there.
  return EnuFromBody({direction.yaw_deg, direction.pitch_deg, 0}) * BodyFromCam();
}

Rectifier::Rectifier(const Camera& view_camera, std::vector<ViewDirection> directions)
    : impl_(std::make_unique<Impl>()) {
  if (const Status status = view_camera.Check(); !status.ok()) {
    throw std::invalid_argument("view camera: " + status.message());
  }
  if (view_camera.HasDistortion()) {
    throw std::invalid_argument("view camera has distortion; use Camera::WithoutDistortion()");
  }
  for (const ViewDirection& direction : directions) {
    if (!std::isfinite(direction.yaw_deg) || !(std::abs(direction.pitch_deg) <= 90)) {
      throw std::invalid_argument(
          Format("view direction yaw %g, pitch %g; yaw must be finite, pitch in "
                 "-90..90 degrees",
                 direction.yaw_deg, direction.pitch_deg));
    }
    std::size_t table = 0;
    while (table < impl_->tables.size() && impl_->tables[table].pitch_deg != direction.pitch_deg)
      ++table;
    if (table == impl_->tables.size()) {
      impl_->tables.push_back(MakeTable(view_camera, direction.pitch_deg));
    }
    impl_->table_of_view.push_back(table);
  }
  impl_->camera = view_camera;
  impl_->directions = std::move(directions);
}

Rectifier::~Rectifier() = default;

const Camera& Rectifier::camera() const { return impl_->camera; }
const std::vector<ViewDirection>& Rectifier::directions() const { return impl_->directions; }

GrayImage Rectifier::Cut(const GrayImage& panorama, int view_idx) const {
  if (panorama.empty()) throw std::invalid_argument("panorama is empty");
  GrayImage view = EmptyView(impl_->camera);
  impl_->ForEachPixel(view_idx, {panorama.width_px, panorama.height_px},
                      [&](std::size_t i, double column, double row) {
                        // Pixel centres lie at halves; across the seam columns wrap, over the poles
                        // rows stay.
                        view.pixels[i] =
                            Bilinear(panorama, Wrap(column - 0.5, panorama.width_px),
                                     std::clamp(row - 0.5, 0.0, panorama.height_px - 1.0));
                      });
  return view;
}

GrayImage Rectifier::CutMask(const GrayImage& mask, int view_idx) const {
  if (mask.empty()) throw std::invalid_argument("mask is empty");
  GrayImage view = EmptyView(impl_->camera);
  impl_->ForEachPixel(
      view_idx, {mask.width_px, mask.height_px}, [&](std::size_t i, double column, double row) {
        const auto x =
            std::min(static_cast<std::size_t>(column), static_cast<std::size_t>(mask.width_px) - 1);
        const auto y =
            std::min(static_cast<std::size_t>(row), static_cast<std::size_t>(mask.height_px) - 1);
        view.pixels[i] = mask.pixels[y * static_cast<std::size_t>(mask.width_px) + x];
      });
  return view;
}

std::vector<float> Rectifier::CutDepth(const DepthMap& depth, int view_idx) const {
  const Camera& camera = impl_->camera;
  const Eigen::Matrix3d pano_from_cam =
      PanoFromCam(impl_->directions.at(static_cast<std::size_t>(view_idx)));
  const auto width = static_cast<std::size_t>(camera.width_px);
  std::vector<float> z_m(width * static_cast<std::size_t>(camera.height_px), 0.0F);
  const ImageSize size{depth.width(), depth.height()};
  impl_->ForEachPixel(view_idx, size, [&](std::size_t i, double column, double row) {
    const Eigen::Vector3d ray_in_cam =
        RayInCam(camera, static_cast<int>(i % width), static_cast<int>(i / width));
    const double length = ray_in_cam.norm();
    const auto hit = depth.CastAt(column - 0.5, row - 0.5, pano_from_cam * (ray_in_cam / length));
    if (hit) z_m[i] = static_cast<float>(hit->range_m / length);
  });
  return z_m;
}

}  // namespace panofix
