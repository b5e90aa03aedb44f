// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/circle.h"

#include <cmath>

#include "core/constraints/fit_starts.h"
#include "core/constraints/fitted_projection.h"
#include "core/constraints/round.h"
#include "core/constraints/sections.h"

namespace deform {

namespace {

/// In the plane z = 0 of the frame, touching its origin with the normal x.
class CircleModel : public RoundModel<CircleModel> {
 public:
  static constexpr int rows = 2;

  explicit CircleModel(std::optional<double> curvature) : RoundModel({along_x, along_z, about_x, about_y, about_z}, curvature) {}

  std::string_view kind() const { return "circular"; }

  void residual(std::size_t, const Eigen::Vector3d& y, const Eigen::Matrix<double, 1, 1>& size, LocalResidual<2, 1>& out) const {
    const RoundDistance d = round_distance(y, size[0], About::z_axis);
    out.value << y[2], d.value;
    out.gradient << 0, 0, 1, 0, d.normal.transpose(), d.by_curvature;
    out.curvature << d.value * d.hessian, d.value * d.normal_by_curvature, d.value * d.normal_by_curvature.transpose(),
        d.value * d.by_curvature_twice;
  }

  static std::vector<Fit<1>> starts(std::span<const Vec3> x) {
    const PrincipalAxes axes = principal_axes(x);
    const double radius = std::sqrt(axes.moments[2] / static_cast<double>(x.size()));
    std::vector<Fit<1>> all;
    // In the planes across the two smaller axes: those of a noisy short arc may have changed places.
    for (const int normal : {0, 1}) {
      const Eigen::Vector3d z = axes.axes.col(normal), across = axes.axes.col(1 - normal), along = axes.axes.col(2);
      std::vector<Eigen::Vector2d> flat;
      for (const Eigen::Vector3d& p : thinned(x, 1000)) flat.emplace_back(across.dot(p - axes.mean), along.dot(p - axes.mean));
      const PlaneCircle circle = algebraic_circle(flat);
      const Eigen::Vector3d centre = axes.mean + circle.centre[0] * across + circle.centre[1] * along;
      if (circle.radius > 1e-9 * radius && circle.radius < 1e6 * radius) {
        const bool around = (centre - axes.mean).norm() < 0.1 * circle.radius;
        all.push_back(centred(centre, circle.radius, z, around ? centre + along : axes.mean));
      }
      // The parabola over the longest axis, for short arcs, on which the algebraic radius is too small.
      PrincipalAxes parabola = axes;
      parabola.axes.col(0) = across;
      parabola.axes.col(1) = z;
      all.push_back(touching(axes.mean, across, z, -patch_curvature(x, parabola)(0, 0)));
    }
    return all;
  }
};

class CircleProjection final : public FittedProjection<CircleModel>, public IsSection {
 public:
  CircleProjection(std::optional<double> curvature, std::size_t points)
      : FittedProjection(CircleModel(curvature), points), kept_(curvature) {}
  std::optional<double> kept_curvature() const override { return kept_; }

 private:
  std::optional<double> kept_;
};

}  // namespace

std::unique_ptr<const Projection> circle_projection(std::size_t points, std::optional<double> curvature) {
  return std::make_unique<CircleProjection>(curvature, points);
}

double circle_curvature(std::span<const Vec3> x) { return std::abs(CircleModel({}).fitted(x, nullptr).size[0]); }

}  // namespace deform
