// P3P: Grunert's quartic for the ratio of two distances, its roots bracketed by those of its
// derivatives, then Newton on the three distance equations themselves, which undoes the quartic's
// loss of digits.

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "common/estimate/pnp.h"

namespace panofix {
namespace {

constexpr double kMinTriangleShape = 1e-6;  // twice the area over the longest side squared
constexpr double kMinRaySine = 1e-8;        // rays closer than this are one ray
constexpr double kTouchingRoot = 1e-9;      // of the coefficients' sum: a double root, perhaps
constexpr double kDistanceResidual =
    1e-10;                              // of the longest side squared: accepted after polishing
constexpr double kSameSolution = 1e-7;  // of the distances

using Poly = std::array<double, 5>;  // ascending powers

double Value(const Poly& p, int degree, double x) {
  double value = p[static_cast<std::size_t>(degree)];
  for (int i = degree - 1; i >= 0; --i) value = value * x + p[static_cast<std::size_t>(i)];
  return value;
}

// Root in [low, high] whose ends differ in sign: Newton, with bisection where it leaves the
// bracket.
double BracketedRoot(const Poly& p, const Poly& derivative, int degree, double low, double high) {
  const bool rising = Value(p, degree, low) < 0;
  double x = 0.5 * (low + high);
  for (int i = 0; i < 60; ++i) {
    const double value = Value(p, degree, x);
    if (value == 0) return x;
    ((value < 0) == rising ? low : high) = x;
    double next = x - value / Value(derivative, degree - 1, x);
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    if (std::abs(next - x) < 1e-15) return next;
    x = next;
  }
  return x;
}

struct Roots {
  std::array<double, 16> x{};
  int size = 0;
  void Add(double value) {
    if (size < 16) x[static_cast<std::size_t>(size++)] = value;
  }
};

// Real roots in [0, 1], ascending; where the polynomial nearly touches zero the turning point
// counts.
Roots RootsInUnit(const Poly& p, int degree) {
  Roots roots;
  if (degree == 1) {
    const double x = -p[0] / p[1];
    if (x >= 0 && x <= 1) roots.Add(x);
    return roots;
  }
  Poly derivative{};
  double scale = std::abs(p[0]);
  for (std::size_t i = 1; i <= static_cast<std::size_t>(degree); ++i) {
    derivative[i - 1] = static_cast<double>(i) * p[i];
    scale += std::abs(p[i]);
  }
  const Roots turns = RootsInUnit(derivative, degree - 1);
  double low = 0, low_value = p[0];
  for (int i = 0; i <= turns.size; ++i) {
    const bool at_turn = i < turns.size;
    const double high = at_turn ? turns.x[static_cast<std::size_t>(i)] : 1.0;
    const double high_value = Value(p, degree, high);
    if ((low_value < 0) != (high_value < 0)) {
      roots.Add(BracketedRoot(p, derivative, degree, low, high));
    }
    if (at_turn && std::abs(high_value) < kTouchingRoot * scale) roots.Add(high);
    low = high, low_value = high_value;
  }
  return roots;
}

// The triangle with its longest side scaled to 1, in the notation of Haralick et al.
struct Triangle {
  double a2 = 0, b2 = 0, c2 = 0;           // squared sides opposite to points 1, 2, 3
  double cos_a = 0, cos_b = 0, cos_c = 0;  // of the angles between rays 2-3, 1-3, 1-2
};

// Haralick et al., Eq. (9): quartic in v = s3 / s1.
Poly GrunertQuartic(const Triangle& t) {
  const double q = (t.a2 - t.c2) / t.b2, r = (t.a2 + t.c2) / t.b2;
  const double c2b2 = t.c2 / t.b2, a2b2 = t.a2 / t.b2;
  const double aa = t.cos_a * t.cos_a, bb = t.cos_b * t.cos_b, cc = t.cos_c * t.cos_c;
  Poly p;
  p[4] = (q - 1) * (q - 1) - 4 * c2b2 * aa;
  p[3] = 4 * (q * (1 - q) * t.cos_b - (1 - r) * t.cos_a * t.cos_c + 2 * c2b2 * aa * t.cos_b);
  p[2] = 2 * (q * q - 1 + 2 * q * q * bb + 2 * (1 - c2b2) * aa -
              4 * r * t.cos_a * t.cos_b * t.cos_c + 2 * (1 - a2b2) * cc);
  p[1] = 4 * (-q * (1 + q) * t.cos_b + 2 * a2b2 * cc * t.cos_b - (1 - r) * t.cos_a * t.cos_c);
  p[0] = (1 + q) * (1 + q) - 4 * a2b2 * cc;
  return p;
}

Eigen::Vector3d DistanceResiduals(const Triangle& t, const Eigen::Vector3d& s) {
  return {s[0] * s[0] + s[1] * s[1] - 2 * s[0] * s[1] * t.cos_c - t.c2,
          s[0] * s[0] + s[2] * s[2] - 2 * s[0] * s[2] * t.cos_b - t.b2,
          s[1] * s[1] + s[2] * s[2] - 2 * s[1] * s[2] * t.cos_a - t.a2};
}

// Newton on the distances; false where it does not end on a solution in front of the camera.
bool PolishDistances(const Triangle& t, Eigen::Vector3d* distances) {
  Eigen::Vector3d s = *distances, residuals = DistanceResiduals(t, s);
  double error = residuals.cwiseAbs().maxCoeff();
  for (int i = 0; i < 12 && error > 1e-15; ++i) {
    Eigen::Matrix3d jacobian;
    jacobian << s[0] - s[1] * t.cos_c, s[1] - s[0] * t.cos_c, 0,  //
        s[0] - s[2] * t.cos_b, 0, s[2] - s[0] * t.cos_b,          //
        0, s[1] - s[2] * t.cos_a, s[2] - s[1] * t.cos_a;
    const Eigen::Vector3d next = s - 0.5 * (jacobian.inverse() * residuals);
    const Eigen::Vector3d next_residuals = DistanceResiduals(t, next);
    const double next_error = next_residuals.cwiseAbs().maxCoeff();
    if (!(next_error < error)) break;  // also a NaN from a singular Jacobian
    s = next, residuals = next_residuals, error = next_error;
  }
  *distances = s;
  return error < kDistanceResidual && s.minCoeff() > 0;
}

// Orthonormal axes of a triangle.
Eigen::Matrix3d Axes(const Eigen::Vector3d& p0, const Eigen::Vector3d& p1,
                     const Eigen::Vector3d& p2) {
  Eigen::Matrix3d axes;
  axes.col(0) = (p1 - p0).normalized();
  axes.col(2) = axes.col(0).cross(p2 - p0).normalized();
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return axes;
}

// Adds the polished distances for one root v = s3 / s1, once each.
void AddDistances(const Triangle& t, double v, std::vector<Eigen::Vector3d>* solutions) {
  const double s1_squared = t.b2 / (1 + v * v - 2 * v * t.cos_b);
  if (!(s1_squared > 0) || !std::isfinite(s1_squared)) return;
  const double s1 = std::sqrt(s1_squared);
  // Eq. (8) gives u = s2 / s1; where its denominator vanishes, the law of cosines on side c gives
  // two.
  const double q = (t.a2 - t.c2) / t.b2, denominator = 2 * (t.cos_c - v * t.cos_a);
  std::array<double, 2> candidates{-1, -1};
  if (std::abs(denominator) > 1e-5 * (1 + v)) {
    candidates[0] = ((q - 1) * v * v - 2 * q * t.cos_b * v + 1 + q) / denominator;
  } else {
    const double root = std::sqrt(std::max(0.0, t.cos_c * t.cos_c - 1 + t.c2 / s1_squared));
    candidates = {t.cos_c + root, t.cos_c - root};
  }
  for (const double u : candidates) {
    Eigen::Vector3d s(s1, u * s1, v * s1);
    if (!(u > 0) || !PolishDistances(t, &s)) continue;
    const bool known = std::any_of(solutions->begin(), solutions->end(), [&](const auto& other) {
      return (other - s).cwiseAbs().maxCoeff() < kSameSolution * s.maxCoeff();
    });
    if (!known && solutions->size() < 4) solutions->push_back(s);
  }
}

}  // namespace

std::vector<Rigid3> SolveP3p(const std::array<Eigen::Vector3d, 3>& rays_in_cam,
                             const std::array<Eigen::Vector3d, 3>& points_in_map) {
  std::vector<Rigid3> poses;
  const auto& [r0, r1, r2] = rays_in_cam;
  const auto& [p0, p1, p2] = points_in_map;
  const double longest = std::max({(p1 - p2).norm(), (p0 - p2).norm(), (p0 - p1).norm()});
  const double shape = (p1 - p0).cross(p2 - p0).norm() / (longest * longest);
  const double sine = std::min({r1.cross(r2).norm(), r0.cross(r2).norm(), r0.cross(r1).norm()});
  if (!std::isfinite(longest) || !(shape > kMinTriangleShape) || !(sine > kMinRaySine))
    return poses;

  const double scale = 1 / longest;
  Triangle t;
  t.a2 = ((p1 - p2) * scale).squaredNorm(), t.cos_a = r1.dot(r2);
  t.b2 = ((p0 - p2) * scale).squaredNorm(), t.cos_b = r0.dot(r2);
  t.c2 = ((p0 - p1) * scale).squaredNorm(), t.cos_c = r0.dot(r1);
  const Poly quartic = GrunertQuartic(t);
  Poly reversed = quartic;
  std::reverse(reversed.begin(), reversed.end());
  std::vector<Eigen::Vector3d> solutions;
  solutions.reserve(4);
  // v in (0, 1], then 1/v in [0, 1): no bound on the roots is needed.
  const Roots small = RootsInUnit(quartic, 4), large = RootsInUnit(reversed, 4);
  for (int i = 0; i < small.size; ++i)
    AddDistances(t, small.x[static_cast<std::size_t>(i)], &solutions);
  for (int i = 0; i < large.size; ++i) {
    AddDistances(t, 1 / large.x[static_cast<std::size_t>(i)], &solutions);
  }
  const Eigen::Matrix3d map_axes = Axes(p0, p1, p2);
  for (const Eigen::Vector3d& s : solutions) {
    const Eigen::Vector3d q0 = r0 * (s[0] * longest), q1 = r1 * (s[1] * longest),
                          q2 = r2 * (s[2] * longest);
    const Eigen::Quaterniond rotation =
        Eigen::Quaterniond(Eigen::Matrix3d(Axes(q0, q1, q2) * map_axes.transpose())).normalized();
    poses.emplace_back(rotation, (q0 + q1 + q2) / 3 - rotation * ((p0 + p1 + p2) / 3));
  }
  return poses;
}

}  // namespace panofix
