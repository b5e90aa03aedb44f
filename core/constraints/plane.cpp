// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/plane.h"

#include "core/constraints/fit_starts.h"
#include "core/constraints/fitted_projection.h"

namespace deform {

namespace {

/// z = 0 of the frame.
class PlaneModel {
 public:
  static constexpr int rows = 1, sizes = 0;
  std::string_view kind() const { return "planar"; }
  const std::vector<int>& active() const { return active_; }

  void residual(std::size_t, const Eigen::Vector3d& y, const Eigen::Matrix<double, 0, 1>&, LocalResidual<1, 0>& out) const {
    out.value[0] = y[2];
    out.gradient << 0, 0, 1;
    out.curvature.setZero();
  }

  Fit<0> fitted(std::span<const Vec3> x, const Fit<0>*) const {
    const PrincipalAxes axes = principal_axes(x);
    Fit<0> fit;
    fit.mean = fit.frame.origin = axes.mean;
    fit.frame.axes = axes_from(axes.axes.col(0), axes.axes.col(2));
    return fit;
  }

 private:
  std::vector<int> active_{along_z, about_x, about_y};
};

/// The z axis of the frame.
class LineModel {
 public:
  static constexpr int rows = 2, sizes = 0;
  std::string_view kind() const { return "straight"; }
  const std::vector<int>& active() const { return active_; }

  void residual(std::size_t, const Eigen::Vector3d& y, const Eigen::Matrix<double, 0, 1>&, LocalResidual<2, 0>& out) const {
    out.value = y.head<2>();
    out.gradient << 1, 0, 0, 0, 1, 0;
    out.curvature.setZero();
  }

  Fit<0> fitted(std::span<const Vec3> x, const Fit<0>*) const {
    const PrincipalAxes axes = principal_axes(x);
    Fit<0> fit;
    fit.mean = fit.frame.origin = axes.mean;
    fit.frame.axes = axes_from(axes.axes.col(2), axes.axes.col(1));
    return fit;
  }

 private:
  std::vector<int> active_{along_x, along_y, about_x, about_y};
};

class FixedPlaneProjection final : public Projection {
 public:
  FixedPlaneProjection(const Vec3& point, const Vec3& normal, std::size_t points)
      : point_(to_eigen(point)), normal_(to_eigen(normal)), points_(points) {}

  std::string_view kind() const override { return "fixed_plane"; }
  std::size_t point_count() const override { return points_; }
  bool moves_with_its_points() const override { return false; }

  double project(std::span<const Vec3> x, std::span<Vec3> out, ShapeParameters& shape) const override {
    shape.clear();
    double energy = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const double away = height(x[i]);
      out[i] = to_vec3(to_eigen(x[i]) - away * normal_);
      energy += away * away;
    }
    return energy;
  }

  void derivative(std::span<const Vec3> x, const ShapeParameters&, std::span<const Vec3> dx, std::span<Vec3> out) const override {
    for (std::size_t i = 0; i < x.size(); ++i) {
      const Eigen::Vector3d d = to_eigen(dx[i]);
      out[i] = to_vec3(d - normal_.dot(d) * normal_);
    }
  }

  Linearization linearize(std::span<const Vec3> x, const ShapeParameters&) const override {
    Linearization result;
    result.normals.assign(x.size(), to_vec3(normal_));
    result.residual.resize(static_cast<Eigen::Index>(x.size()));
    for (std::size_t i = 0; i < x.size(); ++i) result.residual[static_cast<Eigen::Index>(i)] = height(x[i]);
    result.parameters.resize(result.residual.size(), 0);
    return result;
  }

 private:
  double height(const Vec3& x) const { return normal_.dot(to_eigen(x) - point_); }

  Eigen::Vector3d point_, normal_;
  std::size_t points_;
};

}  // namespace

std::unique_ptr<const Projection> plane_projection(std::size_t points) {
  return std::make_unique<FittedProjection<PlaneModel>>(PlaneModel{}, points);
}

std::unique_ptr<const Projection> line_projection(std::size_t points) {
  return std::make_unique<FittedProjection<LineModel>>(LineModel{}, points);
}

std::unique_ptr<const Projection> fixed_plane_projection(const Vec3& point, const Vec3& normal, std::size_t points) {
  return std::make_unique<FixedPlaneProjection>(point, normal, points);
}

}  // namespace deform
