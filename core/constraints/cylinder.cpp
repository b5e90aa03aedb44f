// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/cylinder.h"

#include <Eigen/Eigenvalues>
#include <cmath>

#include "core/constraints/fit_starts.h"
#include "core/constraints/fitted_projection.h"
#include "core/constraints/round.h"

namespace deform {

namespace {

/// Along z of the frame, touching its origin with the normal x.
class CylinderModel {
 public:
  static constexpr int rows = 1, sizes = 1;

  explicit CylinderModel(std::optional<double> curvature) : kept_(curvature) {
    active_ = {along_x, about_x, about_y, about_z};
    if (!kept_) active_.push_back(motions);
  }

  std::string_view kind() const { return "cylindrical"; }
  const std::vector<int>& active() const { return active_; }

  void residual(std::size_t, const Eigen::Vector3d& y, const Eigen::Matrix<double, 1, 1>& size, LocalResidual<1, 1>& out) const {
    const RoundDistance d = round_distance(y, size[0], About::z_axis);
    out.value[0] = d.value;
    out.gradient << d.normal.transpose(), d.by_curvature;
    out.curvature << d.value * d.hessian, d.value * d.normal_by_curvature, d.value * d.normal_by_curvature.transpose(),
        d.value * d.by_curvature_twice;
  }

  Fit<1> fitted(std::span<const Vec3> x, const Fit<1>* last) const {
    if (last != nullptr) return refitted(*this, x, *last);
    const auto free = starts(x);
    return best_minimum(*this, x, kept_ ? with_curvature(free, *kept_) : free);
  }

 private:
  static std::vector<Fit<1>> starts(std::span<const Vec3> x) {
    const PrincipalAxes axes = principal_axes(x);
    const double size = std::sqrt(axes.moments.sum() / static_cast<double>(x.size()));
    std::vector<Fit<1>> all;
    for (const AxisCandidate& c : axis_candidates(x, Profile::cylinder, 4)) {
      if (!(c.radius > 1e-9 * size) || c.radius > 1e6 * size) continue;
      const bool around = (c.point - axes.mean).norm() < 0.1 * c.radius;
      all.push_back(centred(c.point, c.radius, c.direction, around ? to_eigen(x[0]) : axes.mean));
    }
    // The principal curvatures of the patch, for short arcs, on which algebraic radii are too small.
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> bent(patch_curvature(x, axes));
    for (const int k : {0, 1}) {
      const Eigen::Vector2d straight = bent.eigenvectors().col(1 - k);
      const Eigen::Vector3d z = straight[0] * axes.axes.col(2) + straight[1] * axes.axes.col(1);
      all.push_back(touching(axes.mean, axes.axes.col(0), z, -bent.eigenvalues()[k]));
    }
    return all;
  }

  std::optional<double> kept_;
  std::vector<int> active_;
};

}  // namespace

std::unique_ptr<const Projection> cylinder_projection(std::size_t points, std::optional<double> curvature) {
  return std::make_unique<FittedProjection<CylinderModel>>(CylinderModel(curvature), points);
}

double cylinder_curvature(std::span<const Vec3> x) { return std::abs(CylinderModel({}).fitted(x, nullptr).size[0]); }

}  // namespace deform
