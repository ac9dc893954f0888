#pragma once
// The test town: one world on two days, the poses in it, and exact answers about it.

#include <memory>
#include <optional>

#include "tests/town/generate.h"
#include "tests/town/geodesy.h"
#include "tests/town/renderer.h"

namespace panofix::town {

// Immutable; thread-safe. Two towns of equal options are equal.
class Town {
 public:
  // Throws std::invalid_argument where the options break their rules.
  [[nodiscard]] static Town Generate(const TownOptions& options);

  [[nodiscard]] const TownOptions& options() const { return options_; }
  [[nodiscard]] const Layout& layout() const { return layout_; }
  [[nodiscard]] const TownGeodesy& geodesy() const { return geodesy_; }
  [[nodiscard]] const Renderer& renderer(Day day) const {
    return day == Day::kMap ? *map_ : *drive_;
  }
  [[nodiscard]] const World& world(Day day) const { return renderer(day).world(); }
  [[nodiscard]] Camera camera() const;

  // Range along a unit ray to what stands there on that day, metres; nullopt for the sky.
  [[nodiscard]] std::optional<double> Range(Day day, const Eigen::Vector3d& origin,
                                            const Eigen::Vector3d& unit_ray) const;
  // The same to the dominant planes alone: what an exact depth map would say. `plane` may be null.
  [[nodiscard]] std::optional<double> PlaneRange(const Eigen::Vector3d& origin,
                                                 const Eigen::Vector3d& unit_ray,
                                                 std::uint32_t* plane = nullptr) const;

 private:
  Town(const TownOptions& options, Layout layout);
  TownOptions options_;
  Layout layout_;
  TownGeodesy geodesy_;
  std::unique_ptr<World> map_world_, drive_world_;
  std::unique_ptr<Renderer> map_, drive_;
  std::unique_ptr<Scene> planes_;
};

// Light of a day, drawn from the seed.
[[nodiscard]] Light DrawLight(const TownOptions& options, Day day);

}  // namespace panofix::town
