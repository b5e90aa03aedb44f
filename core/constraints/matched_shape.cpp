// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/matched_shape.h"

#include <Eigen/LU>

#include "core/constraints/fitted_projection.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

/// y_i = size * rest_i in the frame, where the shape at rest is about its mean.
class MatchedModel {
 public:
  static constexpr int rows = 3, sizes = 1;

  MatchedModel(std::span<const Vec3> rest, Match match) : match_(match) {
    const Eigen::Vector3d mean = spread({rest}).mean;
    for (const Vec3& p : rest) {
      rest_.push_back(to_eigen(p) - mean);
      square_ += rest_.back().squaredNorm();
    }
    for (int k = 0; k < motions + (match == Match::similar ? 1 : 0); ++k) active_.push_back(k);
  }

  std::string_view kind() const { return match_ == Match::rigid ? "rigid" : "feature_line"; }
  const std::vector<int>& active() const { return active_; }

  void residual(std::size_t i, const Eigen::Vector3d& y, const Eigen::Matrix<double, 1, 1>& size,
                LocalResidual<3, 1>& out) const {
    out.value = y - size[0] * rest_[i];
    out.gradient.leftCols<3>().setIdentity();
    out.gradient.col(3) = -rest_[i];
    out.curvature.setZero();
  }

  Fit<1> fitted(std::span<const Vec3> x, const Fit<1>*) const {
    const Eigen::Vector3d mean = spread({x}).mean;
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < x.size(); ++i) covariance.noalias() += (to_eigen(x[i]) - mean) * rest_[i].transpose();
    const auto [values, U, V] = svd(covariance);
    Eigen::Vector3d sign(1, 1, 1);
    // The least singular direction is mirrored rather than the shape.
    if ((U * V.transpose()).determinant() < 0) sign[2] = -1;
    Fit<1> fit;
    fit.mean = fit.frame.origin = mean;
    fit.frame.axes = U * sign.asDiagonal() * V.transpose();
    fit.size[0] = 1;
    if (match_ == Match::similar && square_ > 0) fit.size[0] = values.dot(sign) / square_;
    return fit;
  }

 private:
  Match match_;
  std::vector<Eigen::Vector3d> rest_;
  double square_ = 0;
  std::vector<int> active_;
};

}  // namespace

std::unique_ptr<const Projection> matched_projection(std::span<const Vec3> rest, Match match) {
  return std::make_unique<FittedProjection<MatchedModel>>(MatchedModel(rest, match), rest.size());
}

}  // namespace deform
