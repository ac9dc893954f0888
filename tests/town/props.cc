#include "tests/town/props.h"

#include <Eigen/Geometry>
#include <numbers>

#include "tests/town/building.h"

namespace panofix::town {
namespace {

using Eigen::Vector3d;

Material Make(MaterialKind kind, Rng& rng, const Rgb& a, const Rgb& b, double width_m = 1,
              double height_m = 1) {
  Material material;
  material.kind = kind;
  material.seed = static_cast<std::uint32_t>(rng());
  material.a = a;
  material.b = b;
  material.c = DrawColour(rng, 0.8, 0.3, 0.9);
  material.width_m = static_cast<float>(width_m);
  material.height_m = static_cast<float>(height_m);
  material.style = static_cast<int>(rng.Below(4));
  return material;
}

// Axes of a stand: x forward, y left, z up.
struct Axes {
  Vector3d o, x, y, z;
  explicit Axes(const Stand& stand)
      : o(stand.base),
        x(stand.forward),
        y(Vector3d::UnitZ().cross(stand.forward).normalized()),
        z(x.cross(y)) {}
  [[nodiscard]] Vector3d At(double u, double v, double w) const {
    return o + u * x + v * y + w * z;
  }
};

// A ring of a car's body: length from u0 to u1, half width, height.
struct Ring {
  double u0, u1, half, z;
};

void AddRings(World& world, const Axes& axes, const Ring& low, const Ring& high, std::uint32_t side,
              std::uint32_t ends) {
  const auto quad = [&](const Vector3d& a, const Vector3d& b, const Vector3d& c, const Vector3d& d,
                        std::uint32_t m, double u0) { world.AddQuad(a, b, c, d, m, u0, low.z); };
  const auto at = [&](const Ring& r, double u, double s) { return axes.At(u, s * r.half, r.z); };
  quad(at(low, low.u0, -1), at(low, low.u1, -1), at(high, high.u1, -1), at(high, high.u0, -1), side,
       0);
  quad(at(low, low.u1, 1), at(low, low.u0, 1), at(high, high.u0, 1), at(high, high.u1, 1), side, 7);
  quad(at(low, low.u1, -1), at(low, low.u1, 1), at(high, high.u1, 1), at(high, high.u1, -1), ends,
       14);
  quad(at(low, low.u0, 1), at(low, low.u0, -1), at(high, high.u0, -1), at(high, high.u0, 1), ends,
       21);
}

void AddWheel(World& world, const Axes& axes, double u, double v, double radius_m,
              std::uint32_t tyre) {
  constexpr int kSides = 14;
  const double out = v > 0 ? 1 : -1;
  const Vector3d hub = axes.At(u, v + 0.02 * out, radius_m);
  for (int i = 0; i < kSides; ++i) {
    const auto rim = [&](int k) {
      const double angle = 2 * std::numbers::pi * k / kSides * -out;
      return Vector3d(hub + radius_m * (std::cos(angle) * axes.x + std::sin(angle) * axes.z));
    };
    const Vector3d in = -0.2 * out * axes.y;
    world.AddQuad(hub, rim(i), rim(i + 1), rim(i + 1), tyre, 0, 0);
    world.AddQuad(rim(i + 1), rim(i), rim(i) + in, rim(i + 1) + in, tyre, radius_m, 0);
  }
}

Rgb CarColour(Rng& rng) {
  const double pick = rng.Uniform();
  if (pick < 0.25) return Rgb{1, 1, 1} * static_cast<float>(rng.Uniform(0.55, 0.75));
  if (pick < 0.6) return Rgb{1, 1, 1.03f} * static_cast<float>(rng.Uniform(0.02, 0.3));
  return DrawColour(rng, 0.85, 0.05, 0.3);
}

void AddLeaves(World& world, const Vector3d& centre, double radius_m, int count, std::uint32_t leaf,
               Rng& rng) {
  for (int i = 0; i < count; ++i) {
    Vector3d p(rng.Normal(), rng.Normal(), 0.8 * rng.Normal());
    p = centre + p.normalized() * radius_m * std::cbrt(rng.Uniform());
    const Vector3d x = Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
    const Vector3d y = x.cross(Vector3d(rng.Normal(), rng.Normal(), rng.Normal())).normalized();
    const double a = rng.Uniform(0.12, 0.34), b = a * rng.Uniform(0.6, 1.0);
    const double u0 = rng.Uniform(0, 400);
    world.AddQuad(p - a * x, p - b * y, p + a * x, p + 0.7 * b * y, leaf, u0, 0);
    world.AddQuad(p - a * x, p + 0.7 * b * y, p + a * x, p - b * y, leaf, u0, 9);
  }
}

}  // namespace

void AddCar(World& world, const Stand& stand, Rng rng) {
  const Axes axes(stand);
  const double length = rng.Uniform(3.6, 4.8), half = rng.Uniform(0.82, 0.93), l = 0.5 * length;
  const bool van = rng.Uniform() < 0.18;
  const double waist = van ? rng.Uniform(1.0, 1.2) : rng.Uniform(0.82, 0.98);
  const double roof = van ? rng.Uniform(1.8, 2.2) : rng.Uniform(1.4, 1.62);
  const Rgb colour = CarColour(rng);
  const auto body =
      world.AddMaterial(Make(MaterialKind::kCarBody, rng, colour, colour * 0.4f, length, waist));
  const auto glass = world.AddMaterial(
      Make(MaterialKind::kCarGlass, rng, colour, {0.02f, 0.02f, 0.03f}, length, roof - waist));
  const auto tyre = world.AddMaterial(
      Make(MaterialKind::kWheel, rng, {0.02f, 0.02f, 0.02f}, {0.4f, 0.4f, 0.42f}, 0.62, 0.62));
  const double hood = van ? 0.6 : rng.Uniform(0.8, 1.15),
               boot = van ? 0.02 : rng.Uniform(0.05, 0.8);
  const Ring bottom{-l, l, half, 0.2}, middle{-l, l, half, 0.62},
      belt{-l + 0.05, l - 0.15, half - 0.04, waist};
  const Ring sill{-l + boot, l - hood, half - 0.05, waist};
  const Ring top{-l + boot + rng.Uniform(0.1, 0.5), l - hood - rng.Uniform(0.4, 0.8), half - 0.2,
                 roof};
  AddRings(world, axes, bottom, middle, body, body);
  AddRings(world, axes, middle, belt, body, body);
  AddRings(world, axes, sill, top, glass, glass);
  const auto lid = [&](const Ring& r, std::uint32_t m) {
    world.AddQuad(axes.At(r.u0, -r.half, r.z), axes.At(r.u1, -r.half, r.z),
                  axes.At(r.u1, r.half, r.z), axes.At(r.u0, r.half, r.z), m, 30, 0);
  };
  lid(belt, body);
  lid(top, body);
  for (const double u : {-l + 0.75, l - 0.8}) {
    for (const double v : {-half, half}) AddWheel(world, axes, u, v, 0.31, tyre);
  }
  ++world.num_cars;
}

void AddPerson(World& world, const Stand& stand, Rng rng) {
  const double height = rng.Uniform(1.5, 1.9), step = rng.Uniform(0.05, 0.3);
  const auto cloth = [&](double low, double high) {
    return world.AddMaterial(Make(MaterialKind::kCloth, rng, DrawColour(rng, 0.9, low, high),
                                  DrawColour(rng, 0.9, low, high)));
  };
  const auto legs = cloth(0.03, 0.35), coat = cloth(0.03, 0.7);
  const auto skin = world.AddMaterial(
      Make(MaterialKind::kPlain, rng,
           Rgb{0.45f, 0.3f, 0.22f} * static_cast<float>(rng.Uniform(0.3, 1.2)), {}));
  const Axes axes(stand);
  const double hip = 0.48 * height, shoulder = 0.83 * height;
  world.AddPrism(axes.At(step, 0.09, 0), 0.07, 0.1, hip, 7, legs);
  world.AddPrism(axes.At(-step, -0.09, 0), 0.07, 0.1, hip, 7, legs);
  world.AddPrism(axes.At(0, 0, hip - 0.08), 0.19, 0.23, shoulder - hip + 0.08, 10, coat);
  for (const double side : {-0.26, 0.26}) {
    world.AddPrism(axes.At(0.5 * step * side, side, hip - 0.05), 0.05, 0.06, shoulder - hip, 6,
                   coat);
  }
  world.AddPrism(axes.At(0.02, 0, shoulder), 0.08, 0.11, 0.12 * height, 8, skin);
  world.AddPrism(axes.At(0.0, 0, shoulder + 0.11 * height), 0.115, 0.07, 0.06 * height, 8, legs);
  ++world.num_people;
}

void AddTree(World& world, const Stand& stand, Rng shape, Rng leaves) {
  const double trunk = shape.Uniform(2.2, 3.4), radius = shape.Uniform(0.1, 0.2);
  const auto bark =
      world.AddMaterial(Make(MaterialKind::kBark, shape,
                             Rgb{0.2f, 0.16f, 0.12f} * static_cast<float>(shape.Uniform(0.5, 1.4)),
                             {0.05f, 0.04f, 0.03f}));
  world.AddPrism(stand.base, radius * 1.25, radius, trunk + 0.8, 9, bark);
  Material leaf = Make(MaterialKind::kLeaf, leaves, {0.06f, 0.14f, 0.03f}, {0.25f, 0.34f, 0.08f});
  leaf.a = {static_cast<float>(leaves.Uniform(0.03, 0.14)),
            static_cast<float>(leaves.Uniform(0.1, 0.17)), 0.03f};
  const auto leaf_idx = world.AddMaterial(leaf);
  const int blobs = 4 + static_cast<int>(shape.Below(4));
  for (int i = 0; i < blobs; ++i) {
    const double blob = shape.Uniform(0.7, 1.25);
    const Vector3d at = stand.base + Vector3d(0.75 * shape.Normal(), 0.75 * shape.Normal(),
                                              trunk + shape.Uniform(0.4, 2.6));
    const int count = static_cast<int>(160 * blob * leaves.Uniform(0.7, 1.1));
    AddLeaves(world, at, blob, count, leaf_idx, leaves);
  }
  ++world.num_trees;
}

void AddLampPost(World& world, const Stand& stand, Rng rng) {
  const auto metal = world.AddMaterial(
      Make(MaterialKind::kPlain, rng,
           Rgb{0.1f, 0.13f, 0.12f} * static_cast<float>(rng.Uniform(0.5, 2.5)), {}));
  const double height = rng.Uniform(4.5, 6.5);
  world.AddPrism(stand.base, 0.11, 0.1, 0.9, 8, metal);
  world.AddPrism(stand.base, 0.07, 0.045, height, 8, metal);
  const Axes axes(stand);
  world.AddBox(axes.At(-0.1, -0.15, height), axes.x * 0.9, axes.y * 0.3, axes.z * 0.14, metal);
}

void AddBollard(World& world, const Stand& stand, Rng rng) {
  const auto metal = world.AddMaterial(Make(MaterialKind::kPlain, rng, {0.06f, 0.05f, 0.05f}, {}));
  world.AddPrism(stand.base, 0.06, 0.05, 0.85, 8, metal);
  world.AddPrism(stand.base + Vector3d(0, 0, 0.85), 0.075, 0.04, 0.09, 8, metal);
}

void AddStreetSign(World& world, const Stand& stand, Rng rng) {
  const auto metal = world.AddMaterial(Make(MaterialKind::kPlain, rng, {0.35f, 0.36f, 0.36f}, {}));
  world.AddPrism(stand.base, 0.03, 0.03, 2.8, 6, metal);
  const double w = rng.Uniform(0.4, 0.75), h = rng.Uniform(0.35, 0.7);
  const auto face = world.AddMaterial(Make(MaterialKind::kSign, rng, DrawColour(rng, 1, 0.2, 0.9),
                                           DrawColour(rng, 0.6, 0.02, 0.9), w, h));
  const Axes axes(stand);
  const auto at = [&](double u, double v, double z) { return axes.At(u, v, 2.75 - h + z); };
  world.AddQuad(at(-0.04, 0.5 * w, 0), at(-0.04, -0.5 * w, 0), at(-0.04, -0.5 * w, h),
                at(-0.04, 0.5 * w, h), face);
  world.AddQuad(at(0.04, -0.5 * w, 0), at(0.04, 0.5 * w, 0), at(0.04, 0.5 * w, h),
                at(0.04, -0.5 * w, h), metal);
}

void AddBin(World& world, const Stand& stand, Rng rng) {
  const auto plastic = world.AddMaterial(
      Make(MaterialKind::kDoor, rng, DrawColour(rng, 0.8, 0.05, 0.3), {0.3f, 0.3f, 0.3f}, 0.6, 1));
  const Axes axes(stand);
  world.AddBox(axes.At(-0.3, -0.28, 0.05), axes.x * 0.6, axes.y * 0.56,
               axes.z * rng.Uniform(0.8, 1.15), plastic);
}

void AddPosterColumn(World& world, const Stand& stand, Rng shape, Rng daily) {
  const double radius = shape.Uniform(0.45, 0.6), height = shape.Uniform(2.4, 3.0);
  const auto cap = world.AddMaterial(Make(MaterialKind::kPlain, shape, {0.04f, 0.1f, 0.07f}, {}));
  const auto posters =
      world.AddMaterial(Make(MaterialKind::kPoster, daily, DrawColour(daily, 0.9, 0.3, 0.9),
                             DrawColour(daily, 0.9, 0.05, 0.5), 1.1, 1.5));
  world.AddPrism(stand.base, radius + 0.05, radius + 0.05, 0.35, 16, cap);
  world.AddPrism(stand.base + Vector3d(0, 0, 0.35), radius, radius, height, 16, posters);
  world.AddPrism(stand.base + Vector3d(0, 0, 0.35 + height), radius + 0.12, 0.1, 0.6, 16, cap);
}

}  // namespace panofix::town
