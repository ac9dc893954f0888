#include "tests/town/world.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace panofix::town {
namespace {

using Eigen::Vector3d;

// Normal from the longer diagonal pair: right for triangles too.
Vector3d NormalOf(const Vector3d& p0, const Vector3d& p1, const Vector3d& p2, const Vector3d& p3) {
  return (p2 - p0).cross(p3 - p1).normalized();
}

}  // namespace

std::uint32_t World::AddMaterial(const Material& material) {
  materials.push_back(material);
  return static_cast<std::uint32_t>(materials.size() - 1);
}

void World::AddQuad(const Vector3d& p0, const Vector3d& p1, const Vector3d& p2, const Vector3d& p3,
                    std::uint32_t material, double u0, double v0) {
  constexpr double kLeastArea_m2 = 1e-8;
  if ((p2 - p0).cross(p3 - p1).norm() < kLeastArea_m2) return;
  Quad quad;
  const Vector3d* corners[4] = {&p0, &p1, &p2, &p3};
  for (int i = 0; i < 4; ++i) quad.corners[i] = corners[i]->cast<float>();
  quad.normal = NormalOf(p0, p1, p2, p3);
  quad.d = quad.normal.dot(p0);
  const Vector3d u_axis = (p1 - p0).normalized();
  quad.origin = p0.cast<float>();
  quad.u_axis = u_axis.cast<float>();
  quad.v_axis = quad.normal.cross(u_axis).cast<float>();
  quad.u0 = static_cast<float>(u0);
  quad.v0 = static_cast<float>(v0);
  quad.material = material;
  quads.push_back(quad);
}

void World::AddBox(const Vector3d& c, const Vector3d& x, const Vector3d& y, const Vector3d& z,
                   std::uint32_t material) {
  AddQuad(c, c + x, c + x + z, c + z, material);                  // -y
  AddQuad(c + x, c + x + y, c + x + y + z, c + x + z, material);  // +x
  AddQuad(c + x + y, c + y, c + y + z, c + x + y + z, material);  // +y
  AddQuad(c + y, c, c + z, c + y + z, material);                  // -x
  AddQuad(c + z, c + x + z, c + x + y + z, c + y + z, material);  // +z
}

void World::AddPrism(const Vector3d& base, double radius_m, double top_radius_m, double height_m,
                     int sides, std::uint32_t material) {
  const auto at = [&](int i, double radius, double z) {
    const double angle = 2 * std::numbers::pi * i / sides;
    return Vector3d(base + Vector3d(radius * std::cos(angle), radius * std::sin(angle), z));
  };
  const double step_m = 2 * std::numbers::pi * radius_m / sides;
  const Vector3d top = base + Vector3d(0, 0, height_m);
  for (int i = 0; i < sides; ++i) {
    AddQuad(at(i, radius_m, 0), at(i + 1, radius_m, 0), at(i + 1, top_radius_m, height_m),
            at(i, top_radius_m, height_m), material, i * step_m, 0);
    AddQuad(top, at(i, top_radius_m, height_m), at(i + 1, top_radius_m, height_m),
            at(i + 1, top_radius_m, height_m), material);
  }
}

void World::AddPlane(const Vector3d& p0, const Vector3d& p1, const Vector3d& p2,
                     const Vector3d& p3) {
  PlaneQuad plane;
  const Vector3d* corners[4] = {&p0, &p1, &p2, &p3};
  for (int i = 0; i < 4; ++i) plane.corners[i] = corners[i]->cast<float>();
  plane.normal = NormalOf(p0, p1, p2, p3);
  plane.d = plane.normal.dot(p0);
  planes.push_back(plane);
}

}  // namespace panofix::town
