#pragma once
// Ray casting: the world's quads, or its dominant planes alone, in an Embree scene.

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "tests/town/world.h"

namespace panofix::town {

inline constexpr std::uint32_t kNoQuad = ~std::uint32_t{0};

// Sixteen rays from one origin, or towards one light.
struct RayPacket {
  static constexpr int kSize = 16;
  alignas(64) float ox[kSize], oy[kSize], oz[kSize];
  alignas(64) float dx[kSize], dy[kSize], dz[kSize];
  alignas(64) int active[kSize];  // -1 or 0
  alignas(64) float range[kSize];
  alignas(64) std::uint32_t quad[kSize];
};

// Immutable after construction; thread-safe. Casting runs in single precision, answers that leave
// the renderer are recomputed from the quad's plane in double precision.
class Scene {
 public:
  explicit Scene(const std::vector<Quad>& quads) : Scene(Gather(quads)) {}
  explicit Scene(const std::vector<PlaneQuad>& planes) : Scene(Gather(planes)) {}
  ~Scene();
  Scene(Scene&&) noexcept;

  struct Hit {
    std::uint32_t quad = kNoQuad;
    double range_m = 0;  // along the unit ray, exact
  };
  [[nodiscard]] std::optional<Hit> Cast(const Eigen::Vector3d& origin,
                                        const Eigen::Vector3d& unit_ray) const;
  // Fills quad (kNoQuad: sky) and range.
  void Cast(RayPacket& packet) const;
  // Sets quad to kNoQuad where nothing blocks the way, 0 where something does.
  void Block(RayPacket& packet) const;

 private:
  struct Face {
    Eigen::Vector3f corners[4];
    Eigen::Vector3d normal;
    double d;
  };
  template <typename Quads>
  static std::vector<Face> Gather(const Quads& quads) {
    std::vector<Face> faces;
    faces.reserve(quads.size());
    for (const auto& q : quads) {
      faces.push_back({{q.corners[0], q.corners[1], q.corners[2], q.corners[3]}, q.normal, q.d});
    }
    return faces;
  }
  explicit Scene(const std::vector<Face>& faces);
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace panofix::town
