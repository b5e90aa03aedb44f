// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/cone.h"

#include <cmath>

#include "core/constraints/fit_starts.h"
#include "core/constraints/fitted_projection.h"
#include "core/constraints/round.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

/// About an axis along z of the frame; the cross-section at its origin is the circle of curvature size 0 that touches the origin
/// with the normal x. Size 1 is the angle between that normal and the cone's, so that the distance is
/// cos(angle) * (distance from the cylinder of that curvature) + sin(angle) * z.
class ConeModel {
 public:
  static constexpr int rows = 1, sizes = 2;
  using Sizes = Eigen::Vector2d;
  using Local = LocalResidual<1, 2>;

  explicit ConeModel(std::optional<double> angle) : kept_(angle) {
    active_ = {along_x, about_x, about_y, about_z, motions};
    if (!kept_) active_.push_back(motions + 1);
  }

  std::string_view kind() const { return "conical"; }
  const std::vector<int>& active() const { return active_; }

  void residual(std::size_t, const Eigen::Vector3d& y, const Sizes& size, Local& out) const {
    const RoundDistance d = round_distance(y, size[0], About::z_axis);
    const double c = std::cos(size[1]), s = std::sin(size[1]);
    const double value = c * d.value + s * y[2];
    if (d.ratio - size[0] * c * value < 0) {
      from_apex(y, size, out);
      return;
    }
    const Eigen::Vector3d z = Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d turned = c * z - s * d.normal;
    out.value[0] = value;
    out.gradient << (c * d.normal + s * z).transpose(), c * d.by_curvature, c * y[2] - s * d.value;
    out.curvature.topLeftCorner<3, 3>() = c * d.hessian;
    out.curvature.block<3, 1>(0, 3) = c * d.normal_by_curvature;
    out.curvature.block<3, 1>(0, 4) = turned;
    out.curvature(3, 3) = c * d.by_curvature_twice;
    out.curvature(3, 4) = -s * d.by_curvature;
    out.curvature(4, 4) = -value;
    complete(out);
  }

  Fit<2> fitted(std::span<const Vec3> x, const Fit<2>* last) const {
    if (last != nullptr) return refitted(*this, x, *last);
    std::vector<Fit<2>> all = starts(x);
    if (!kept_) return best_minimum(*this, x, all);
    std::vector<Fit<2>> both;
    for (Fit<2>& start : all) {
      for (const double sign : {1.0, -1.0}) {
        start.size[1] = sign * *kept_;
        both.push_back(start);
      }
    }
    return best_minimum(*this, x, both);
  }

 private:
  /// Curvature holds the upper triangle of the second derivatives: times the value, both triangles.
  static void complete(Local& out) {
    out.curvature *= out.value[0];
    out.curvature.triangularView<Eigen::StrictlyLower>() = out.curvature.transpose();
  }

  static void from_apex(const Eigen::Vector3d& y, const Sizes& size, Local& out) {
    const double k = size[0], c = std::cos(size[1]), s = std::sin(size[1]);
    const Eigen::Vector3d apex(-1 / k, 0, c / (s * k));
    Eigen::Matrix<double, 3, 2> by_size;
    by_size << 1 / (k * k), 0, 0, 0, -c / (s * k * k), -1 / (s * s * k);
    const Eigen::Vector3d away = y - apex;
    const double length = std::max(away.norm(), 1e-12);
    const Eigen::Vector3d n = away.norm() > 1e-12 ? Eigen::Vector3d(away / length) : Eigen::Vector3d::UnitZ();
    const Eigen::Matrix3d H = (Eigen::Matrix3d::Identity() - n * n.transpose()) / length;
    out.value[0] = away.norm();
    out.gradient << n.transpose(), -n.transpose() * by_size;
    out.curvature.topLeftCorner<3, 3>() = H;
    out.curvature.topRightCorner<3, 2>() = -H * by_size;
    out.curvature.bottomRightCorner<2, 2>() = by_size.transpose() * H * by_size;
    out.curvature(3, 3) += 2 * n[0] / (k * k * k) - 2 * n[2] * c / (s * k * k * k);
    out.curvature(3, 4) -= n[2] / (s * s * k * k);
    out.curvature(4, 4) -= 2 * n[2] * c / (s * s * s * k);
    complete(out);
  }

  static Fit<2> sloped(const Fit<1>& round, double angle) {
    Fit<2> fit;
    fit.frame = round.frame;
    fit.size << round.size[0], angle;
    return fit;
  }

  static std::vector<Fit<2>> starts(std::span<const Vec3> x) {
    const PrincipalAxes axes = principal_axes(x);
    const double size = std::sqrt(axes.moments.sum() / static_cast<double>(x.size()));
    std::vector<Fit<2>> all;
    const auto add = [&](const AxisCandidate& c) {
      if (!(c.radius > 1e-9 * size) || c.radius > 1e6 * size) return;
      const bool around = (c.point - axes.mean).norm() < 0.1 * c.radius;
      const Eigen::Vector3d towards = around ? to_eigen(x[0]) : axes.mean;
      all.push_back(sloped(centred(c.point, c.radius, c.direction, towards), -std::atan(c.slope)));
    };
    for (const AxisCandidate& c : axis_candidates(x, Profile::cone, 4)) add(c);
    for (const AxisCandidate& c : axis_candidates(x, Profile::cylinder, 2)) add(c);
    const SymmetricEigen<2> bent = symmetric_eigen(patch_curvature(x, axes));
    for (const int k : {0, 1}) {
      const Eigen::Vector2d straight = bent.vectors.col(1 - k);
      const Eigen::Vector3d z = straight[0] * axes.axes.col(2) + straight[1] * axes.axes.col(1);
      all.push_back(sloped(touching(axes.mean, axes.axes.col(0), z, -bent.values[k]), 0));
    }
    return all;
  }

  std::optional<double> kept_;
  std::vector<int> active_;
};

}  // namespace

std::unique_ptr<const Projection> cone_projection(std::size_t points, std::optional<double> angle) {
  return std::make_unique<FittedProjection<ConeModel>>(ConeModel(angle), points);
}

double cone_angle(std::span<const Vec3> x) { return std::abs(ConeModel({}).fitted(x, nullptr).size[1]); }

}  // namespace deform
