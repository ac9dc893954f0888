// Derivatives against finite differences; planes against the ray that meets them.
#include <gtest/gtest.h>

#include "builder/landmarks/refinement_costs.h"
#include "common/base/rng.h"

namespace panofix {
namespace {

constexpr double kStep = 1e-6;
constexpr double kTolerance = 1e-5;  // relative; central differences of smooth functions at 1e-6

Eigen::VectorXd Random(Rng* rng, int n, double sigma) {
  Eigen::VectorXd v(n);
  for (int k = 0; k < n; ++k) v[k] = sigma * rng->Normal();
  return v;
}

void ExpectDerivatives(const ceres::CostFunction& cost, std::vector<Eigen::VectorXd> blocks) {
  const int rows = cost.num_residuals();
  std::vector<const double*> parameters;
  std::vector<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> analytic;
  std::vector<double*> jacobians;
  for (const auto& block : blocks) {
    parameters.push_back(block.data());
    analytic.emplace_back(rows, block.size());
  }
  for (auto& matrix : analytic) jacobians.push_back(matrix.data());
  Eigen::VectorXd residuals(rows), plus(rows), minus(rows);
  ASSERT_TRUE(cost.Evaluate(parameters.data(), residuals.data(), jacobians.data()));
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    for (int k = 0; k < blocks[b].size(); ++k) {
      const double at = blocks[b][k];
      blocks[b][k] = at + kStep;
      ASSERT_TRUE(cost.Evaluate(parameters.data(), plus.data(), nullptr));
      blocks[b][k] = at - kStep;
      ASSERT_TRUE(cost.Evaluate(parameters.data(), minus.data(), nullptr));
      blocks[b][k] = at;
      const Eigen::VectorXd numeric = (plus - minus) / (2 * kStep);
      const double scale = std::max(1.0, numeric.norm());
      EXPECT_LT((numeric - analytic[b].col(k)).norm(), kTolerance * scale) << b << ' ' << k;
    }
  }
}

class Costs : public ::testing::Test {
 protected:
  Rng rng_{1, "test/costs"};
  SightLine line_{Rigid3(ExpSo3({0.1, -0.2, 1.0}), {1, 2, 3}),
                  Rigid3(ExpSo3({0.3, 0.1, -2.0}), {8, 1, 2.5}),
                  {4, 9, -1}};
  PlaneModel Plane() const {
    LandmarkPanorama panorama;
    panorama.planes = {{}, {Eigen::Vector3f(0.2F, 0.9F, 0.1F), 7}};
    return *PlaneModel::Of(panorama, 1);
  }
  std::vector<Eigen::VectorXd> Blocks() {
    return {Random(&rng_, 6, 0.1), Random(&rng_, 6, 0.1), Eigen::VectorXd::Constant(1, 1.1)};
  }
};

TEST_F(Costs, Bearing) {
  auto blocks = Blocks();
  const Eigen::Vector3d seen = line_.PointInObserver(blocks[0], blocks[1], 1.0, nullptr);
  const BearingCost cost(line_, (seen + Eigen::Vector3d(0.1, -0.2, 0.1)).normalized(), 0.003);
  ExpectDerivatives(cost, blocks);
}

TEST_F(Costs, OffPlane) {
  const PlaneModel plane = Plane();
  const DepthPrior prior{plane.normal, plane.d_m, 0.2};
  ExpectDerivatives(OffPlaneCost(line_, prior, nullptr), Blocks());
  auto blocks = Blocks();
  blocks.push_back(Random(&rng_, 3, 0.02));
  ExpectDerivatives(OffPlaneCost(line_, prior, &plane), blocks);
}

TEST_F(Costs, AnchorPlane) {
  const PlaneModel plane = Plane();
  const DepthPrior prior{plane.normal, plane.d_m, 0.2};
  const Eigen::VectorXd range = Eigen::VectorXd::Constant(1, 0.97);
  ExpectDerivatives(AnchorPlaneCost({4, 9, -1}, prior, nullptr), {range});
  ExpectDerivatives(AnchorPlaneCost({4, 9, -1}, prior, &plane), {range, Random(&rng_, 3, 0.02)});
}

TEST_F(Costs, TheCorrectedPosesSeeThePointWhereTheLineSays) {
  const auto blocks = Blocks();
  const Vector6d anchor = blocks[0], observer = blocks[1];
  const Eigen::Vector3d local =
      Corrected(line_.local_from_anchor, anchor) * (1.1 * line_.point_in_anchor);
  const Eigen::Vector3d expected = Corrected(line_.local_from_observer, observer).Inverse() * local;
  EXPECT_LT((line_.PointInObserver(anchor, observer, 1.1, nullptr) - expected).norm(), 1e-12);
}

TEST_F(Costs, APointBehindIsFlatNotWrong) {
  auto blocks = Blocks();
  const Eigen::Vector3d seen = line_.PointInObserver(blocks[0], blocks[1], 1.1, nullptr);
  const BearingCost behind(line_, -seen.normalized(), 0.003);
  ExpectDerivatives(behind, blocks);
  Eigen::Vector2d residual;
  const double* parameters[] = {blocks[0].data(), blocks[1].data(), blocks[2].data()};
  ASSERT_TRUE(behind.Evaluate(parameters, residual.data(), nullptr));
  EXPECT_GT(residual.norm(), 100);  // beyond any loss
}

TEST_F(Costs, AMovedPointLiesOnTheRefinedPlane) {
  const PlaneModel plane = Plane();
  const Eigen::Vector3d ray = Eigen::Vector3d(0.5, 0.8, -0.1).normalized();
  const Eigen::Vector3d point = plane.d_m / plane.normal.dot(ray) * ray;
  const Eigen::Vector3d delta(0.02, 0.01, -0.015);
  const Eigen::Vector3d moved = plane.MovePoint(point, delta);
  const DepthPlane refined = plane.Refined(delta);
  EXPECT_LT(moved.cross(ray).norm(), 1e-12);  // on its ray
  EXPECT_NEAR(refined.normal_in_pano.cast<double>().dot(moved), double{refined.d_m},
              1e-5);  // floats
}

TEST(PlaneModel, WhatIsNoPlaneIsNone) {
  LandmarkPanorama panorama;
  panorama.planes = {{Eigen::Vector3f(0, 0, 1), 2}, {}, {Eigen::Vector3f(0, 0, -2), 5}};
  EXPECT_FALSE(PlaneModel::Of(panorama, 0));  // a raster's
  EXPECT_FALSE(PlaneModel::Of(panorama, 1));
  EXPECT_FALSE(PlaneModel::Of(panorama, 3));
  const auto plane = PlaneModel::Of(panorama, 2);
  ASSERT_TRUE(plane);
  EXPECT_DOUBLE_EQ(plane->d_m, 2.5);
}

}  // namespace
}  // namespace panofix
