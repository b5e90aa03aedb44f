// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/sphere.h"

#include <cmath>

#include "core/constraints/fit_starts.h"
#include "core/constraints/fitted_projection.h"
#include "core/constraints/round.h"

namespace deform {

namespace {

/// Touching the origin of the frame with the normal x.
class SphereModel {
 public:
  static constexpr int rows = 1, sizes = 1;

  explicit SphereModel(std::optional<double> curvature) : kept_(curvature) {
    active_ = {along_x, about_y, about_z};
    if (!kept_) active_.push_back(motions);
  }

  std::string_view kind() const { return "spherical"; }
  const std::vector<int>& active() const { return active_; }

  void residual(std::size_t, const Eigen::Vector3d& y, const Eigen::Matrix<double, 1, 1>& size, LocalResidual<1, 1>& out) const {
    const RoundDistance d = round_distance(y, size[0], About::point);
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
    auto few = thinned(x, 1000);
    for (auto& p : few) p -= axes.mean;
    const AlgebraicSphere sphere = algebraic_sphere(few);
    if (sphere.radius > 1e-9 * size && sphere.radius < 1e6 * size) {
      const Eigen::Vector3d centre = axes.mean + sphere.centre;
      const bool around = sphere.centre.norm() < 0.1 * sphere.radius;
      const Eigen::Vector3d towards = around ? to_eigen(x[0]) : axes.mean;
      const Eigen::Vector3d z = (towards - centre).norm() > 0 ? any_normal_to((towards - centre).normalized()) : axes.axes.col(2);
      all.push_back(centred(centre, sphere.radius, z, towards));
    }
    all.push_back(touching(axes.mean, axes.axes.col(0), axes.axes.col(2), -0.5 * patch_curvature(x, axes).trace()));
    return all;
  }

  std::optional<double> kept_;
  std::vector<int> active_;
};

}  // namespace

std::unique_ptr<const Projection> sphere_projection(std::size_t points, std::optional<double> curvature) {
  return std::make_unique<FittedProjection<SphereModel>>(SphereModel(curvature), points);
}

double sphere_curvature(std::span<const Vec3> x) { return std::abs(SphereModel({}).fitted(x, nullptr).size[0]); }

}  // namespace deform
