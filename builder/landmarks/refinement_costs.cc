#include "builder/landmarks/refinement_costs.h"

#include "common/estimate/bundle_residual.h"

namespace panofix {
namespace {

constexpr double kBehind = 1e3;  // sigmas: on the flat part of any loss

template <int Rows, int Cols>
void Write(double* block, const Eigen::Matrix<double, Rows, Cols>& value) {
  constexpr int kOrder = Cols == 1 ? Eigen::ColMajor : Eigen::RowMajor;
  if (block != nullptr) Eigen::Map<Eigen::Matrix<double, Rows, Cols, kOrder>>{block} = value;
}

Eigen::Vector3d PlaneDelta(const std::optional<PlaneModel>& plane, const double* block) {
  return plane ? Eigen::Vector3d(Eigen::Map<const Eigen::Vector3d>(block))
               : Eigen::Vector3d::Zero();
}

struct PlaneAt {
  Eigen::Vector3d normal;
  double d_m;
  PlaneAt(const DepthPrior& prior, const std::optional<PlaneModel>& plane,
          const Eigen::Vector3d& delta)
      : normal(plane ? plane->Normal(delta) : prior.normal),
        d_m(plane ? plane->Distance(delta) : prior.d_m) {}
};

}  // namespace

Rigid3 Corrected(const Rigid3& local_from_pano, const Vector6d& correction) {
  return {(ExpSo3(correction.tail<3>()) * local_from_pano.rotation).normalized(),
          local_from_pano.translation + correction.head<3>()};
}

Eigen::Vector3d SightLine::PointInObserver(const Vector6d& anchor, const Vector6d& observer,
                                           double range, Jacobians* jacobians) const {
  const Eigen::Vector3d turned =
      ExpSo3(anchor.tail<3>()) * (local_from_anchor.rotation * point_in_anchor);
  const Eigen::Vector3d lever = local_from_anchor.translation + anchor.head<3>() + range * turned -
                                local_from_observer.translation - observer.head<3>();
  const Eigen::Matrix3d observer_from_local =
      (ExpSo3(observer.tail<3>()) * local_from_observer.rotation).conjugate().toRotationMatrix();
  if (jacobians != nullptr) {
    jacobians->anchor.leftCols<3>() = observer_from_local;
    jacobians->anchor.rightCols<3>() =
        -observer_from_local * Skew(range * turned) * LeftJacobianSo3(anchor.tail<3>());
    jacobians->observer.leftCols<3>() = -observer_from_local;
    jacobians->observer.rightCols<3>() =
        observer_from_local * Skew(lever) * LeftJacobianSo3(observer.tail<3>());
    jacobians->range = observer_from_local * turned;
  }
  return observer_from_local * lever;
}

bool BearingOffset(const Eigen::Vector3d& observed_ray, const Eigen::Vector3d& point,
                   Eigen::Vector2d* offset, Matrix23d* jacobian) {
  Eigen::Matrix3d frame;
  frame.row(2) = observed_ray.transpose();
  frame.row(0) = observed_ray.unitOrthogonal().transpose();
  frame.row(1) = observed_ray.cross(frame.row(0).transpose()).transpose();
  const Eigen::Vector3d x = frame * point;
  if (!(x.z() >= kMinDepth_m)) return false;
  *offset = x.head<2>() / x.z();
  if (jacobian != nullptr) *jacobian = ProjectionJacobian(x) * frame;
  return true;
}

bool BearingCost::Evaluate(const double* const* parameters, double* residuals,
                           double** jacobians) const {
  SightLine::Jacobians by;
  const Eigen::Vector3d point =
      line_.PointInObserver(Eigen::Map<const Vector6d>(parameters[0]),
                            Eigen::Map<const Vector6d>(parameters[1]), *parameters[2], &by);
  Eigen::Vector2d offset;
  Matrix23d by_point;
  if (!BearingOffset(observed_ray_, point, &offset, &by_point)) {
    offset.setConstant(kBehind * sigma_rad_);
    by_point.setZero();
  }
  Eigen::Map<Eigen::Vector2d>{residuals} = offset / sigma_rad_;
  if (jacobians == nullptr) return true;
  by_point /= sigma_rad_;
  Write<2, 6>(jacobians[0], by_point * by.anchor);
  Write<2, 6>(jacobians[1], by_point * by.observer);
  Write<2, 1>(jacobians[2], by_point * by.range);
  return true;
}

OffPlaneCost::OffPlaneCost(const SightLine& line, const DepthPrior& prior, const PlaneModel* plane)
    : line_(line), prior_(prior), plane_(plane ? std::optional(*plane) : std::nullopt) {
  set_num_residuals(1);
  *mutable_parameter_block_sizes() = {6, 6, 1};
  if (plane_) mutable_parameter_block_sizes()->push_back(3);
}

bool OffPlaneCost::Evaluate(const double* const* parameters, double* residuals,
                            double** jacobians) const {
  const PlaneAt at(prior_, plane_, PlaneDelta(plane_, plane_ ? parameters[3] : nullptr));
  SightLine::Jacobians by;
  const Eigen::Vector3d point =
      line_.PointInObserver(Eigen::Map<const Vector6d>(parameters[0]),
                            Eigen::Map<const Vector6d>(parameters[1]), *parameters[2], &by);
  *residuals = (at.normal.dot(point) - at.d_m) / prior_.sigma_m;
  if (jacobians == nullptr) return true;
  const Eigen::RowVector3d by_point = at.normal.transpose() / prior_.sigma_m;
  Write<1, 6>(jacobians[0], by_point * by.anchor);
  Write<1, 6>(jacobians[1], by_point * by.observer);
  if (jacobians[2] != nullptr) *jacobians[2] = by_point * by.range;
  if (plane_) Write<1, 3>(jacobians[3], plane_->Row(point) / prior_.sigma_m);
  return true;
}

AnchorPlaneCost::AnchorPlaneCost(const Eigen::Vector3d& point, const DepthPrior& prior,
                                 const PlaneModel* plane)
    : point_(point), prior_(prior), plane_(plane ? std::optional(*plane) : std::nullopt) {
  set_num_residuals(1);
  *mutable_parameter_block_sizes() = {1};
  if (plane_) mutable_parameter_block_sizes()->push_back(3);
}

bool AnchorPlaneCost::Evaluate(const double* const* parameters, double* residuals,
                               double** jacobians) const {
  const PlaneAt at(prior_, plane_, PlaneDelta(plane_, plane_ ? parameters[1] : nullptr));
  const Eigen::Vector3d point = *parameters[0] * point_;
  *residuals = (at.normal.dot(point) - at.d_m) / prior_.sigma_m;
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr) *jacobians[0] = at.normal.dot(point_) / prior_.sigma_m;
  if (plane_) Write<1, 3>(jacobians[1], plane_->Row(point) / prior_.sigma_m);
  return true;
}

}  // namespace panofix
