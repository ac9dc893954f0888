#include "tests/town/town.h"

#include <numbers>

#include "common/base/rng.h"

namespace panofix::town {
namespace {

double StreetYawDeg(const TownOptions& options) {
  return Rng(options.seed, "town/yaw").Uniform(12, 33);
}

}  // namespace

Light DrawLight(const TownOptions& options, Day day) {
  Rng rng(options.seed, "town/light");
  const bool map = day == Day::kMap || options.same_light;
  // The second half of the draw belongs to the drive: the sun has moved on by a third of the sky.
  const double map_azimuth = rng.Uniform(0, 2 * std::numbers::pi);
  const double shift = rng.Uniform(1.7, 3.6);
  const double azimuth = map ? map_azimuth : map_azimuth + shift;
  const double elevation = map ? rng.Uniform(0.75, 1.0) : rng.Uniform(0.45, 0.7);
  const double clouds = map ? rng.Uniform(0.2, 0.5) : rng.Uniform(0.3, 0.6);
  Light light;
  light.to_sun = {static_cast<float>(std::cos(elevation) * std::cos(azimuth)),
                  static_cast<float>(std::cos(elevation) * std::sin(azimuth)),
                  static_cast<float>(std::sin(elevation))};
  light.cloud_cover = static_cast<float>(clouds);
  light.cloud_seed = static_cast<std::uint32_t>(rng()) + (map ? 0u : 77u);
  if (map) {
    light.sun = {0.95f, 0.9f, 0.82f};
    light.sky = {0.55f, 0.58f, 0.64f};
    light.exposure = 1.25f;
  } else {
    light.sun = {1.15f, 0.96f, 0.7f};
    light.sky = {0.42f, 0.47f, 0.58f};
    light.white_balance = {1.05f, 1.0f, 0.9f};
  }
  return light;
}

Town::Town(const TownOptions& options, Layout layout)
    : options_(options),
      layout_(std::move(layout)),
      geodesy_(options.origin, StreetYawDeg(options)) {
  map_world_ = std::make_unique<World>(GenerateWorld(options_, layout_.grid, Day::kMap));
  drive_world_ = std::make_unique<World>(GenerateWorld(options_, layout_.grid, Day::kDrive));
  const int samples = options_.samples_per_pixel;
  map_ = std::make_unique<Renderer>(*map_world_, DrawLight(options_, Day::kMap), samples);
  drive_ = std::make_unique<Renderer>(*drive_world_, DrawLight(options_, Day::kDrive), samples);
  planes_ = std::make_unique<Scene>(map_world_->planes);
}

Town Town::Generate(const TownOptions& options) {
  options.Check();
  return Town(options, PlanLayout(options));
}

Camera Town::camera() const {
  Camera camera = Camera::FromHorizontalFov(options_.frame_width_px, options_.frame_height_px,
                                            options_.hfov_deg);
  for (std::size_t i = 0; i < options_.distortion.size(); ++i)
    camera.distortion[i] = options_.distortion[i];
  return camera;
}

std::optional<double> Town::Range(Day day, const Eigen::Vector3d& origin,
                                  const Eigen::Vector3d& unit_ray) const {
  const auto hit = renderer(day).scene().Cast(origin, unit_ray);
  if (!hit) return std::nullopt;
  return hit->range_m;
}

std::optional<double> Town::PlaneRange(const Eigen::Vector3d& origin,
                                       const Eigen::Vector3d& unit_ray,
                                       std::uint32_t* plane) const {
  const auto hit = planes_->Cast(origin, unit_ray);
  if (!hit) return std::nullopt;
  if (plane != nullptr) *plane = hit->quad;
  return hit->range_m;
}

}  // namespace panofix::town
