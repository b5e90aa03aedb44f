// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/sphere.h"

#include <cmath>

#include "core/constraints/fit_starts.h"
#include "core/constraints/fitted_projection.h"
#include "core/constraints/round.h"

namespace deform {

namespace {

/// Touching the origin of the frame with the normal x.
class SphereModel : public RoundModel<SphereModel> {
 public:
  static constexpr int rows = 1;

  explicit SphereModel(std::optional<double> curvature) : RoundModel({along_x, about_y, about_z}, curvature) {}

  std::string_view kind() const { return "spherical"; }

  void residual(std::size_t, const Eigen::Vector3d& y, const Eigen::Matrix<double, 1, 1>& size, LocalResidual<1, 1>& out) const {
    round_residual(y, size[0], About::point, out);
  }

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
};

}  // namespace

std::unique_ptr<const Projection> sphere_projection(std::size_t points, std::optional<double> curvature) {
  return std::make_unique<FittedProjection<SphereModel>>(SphereModel(curvature), points);
}

double sphere_curvature(std::span<const Vec3> x) { return std::abs(SphereModel({}).fitted(x, nullptr).size[0]); }

}  // namespace deform
