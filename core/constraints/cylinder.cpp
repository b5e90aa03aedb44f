// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/cylinder.h"

#include <cmath>

#include "core/constraints/fit_starts.h"
#include "core/constraints/fitted_projection.h"
#include "core/constraints/round.h"
#include "core/constraints/sections.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

/// Along z of the frame, touching its origin with the normal x.
class CylinderModel : public RoundModel<CylinderModel> {
 public:
  static constexpr int rows = 1;

  explicit CylinderModel(std::optional<double> curvature) : RoundModel({along_x, about_x, about_y, about_z}, curvature) {}

  std::string_view kind() const { return "cylindrical"; }

  void residual(std::size_t, const Eigen::Vector3d& y, const Eigen::Matrix<double, 1, 1>& size, LocalResidual<1, 1>& out) const {
    round_residual(y, size[0], About::z_axis, out);
  }

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
    const SymmetricEigen<2> bent = symmetric_eigen(patch_curvature(x, axes));
    for (const int k : {0, 1}) {
      const Eigen::Vector2d straight = bent.vectors.col(1 - k);
      const Eigen::Vector3d z = straight[0] * axes.axes.col(2) + straight[1] * axes.axes.col(1);
      all.push_back(touching(axes.mean, axes.axes.col(0), z, -bent.values[k]));
    }
    return all;
  }
};

/// A cylinder with sections: to the squared distances from it are added those of the points of each section from a plane across
/// the axis, which goes through their mean.
class SectionedModel {
 public:
  static constexpr int rows = 1, sizes = 1;
  /// `curvature` is the one that the cylinder keeps, if any.
  SectionedModel(std::optional<double> curvature, std::vector<Section> sections)
      : cylinder_(curvature), kept_(curvature), sections_(std::move(sections)) {}

  const CylinderModel& cylinder() const { return cylinder_; }
  const std::vector<int>& active() const { return cylinder_.active(); }
  const std::vector<Section>& sections() const { return sections_; }

  /// A fit from which another one may start, with the curvature that is kept.
  Fit<1> start(Fit<1> fit) const {
    if (kept_) fit.size[0] = std::copysign(*kept_, fit.size[0]);
    return fit;
  }

  /// Calls use(point, place about the mean of its section, in the frame; section).
  template <typename Use>
  void for_each(std::span<const Vec3> x, const Fit<1>& fit, const Use& use) const {
    for (std::size_t s = 0; s < sections_.size(); ++s) {
      Eigen::Vector3d mean = Eigen::Vector3d::Zero();
      for (const std::uint32_t i : sections_[s]) mean += fit.frame.local(x[i]);
      mean /= static_cast<double>(sections_[s].size());
      for (const std::uint32_t i : sections_[s]) use(i, Eigen::Vector3d(fit.frame.local(x[i]) - mean), s);
    }
  }

  static LocalResidual<1, 1> height(const Eigen::Vector3d& y) {
    LocalResidual<1, 1> local;
    local.value[0] = y[2];
    local.gradient << 0, 0, 1, 0;
    local.curvature.setZero();
    return local;
  }

 private:
  CylinderModel cylinder_;
  std::optional<double> kept_;
  std::vector<Section> sections_;
};

/// Moving the frame moves means along: only turning it changes the distances from the sections, whose sum over a section is 0. Of
/// all points.
FitDerivatives<1> fit_derivatives(const SectionedModel& model, const PointSample& sample, const Fit<1>& fit) {
  FitDerivatives<1> total = fit_derivatives(model.cylinder(), sample, fit), sections;
  model.for_each(sample.x, fit, [&](std::uint32_t, const Eigen::Vector3d& y, std::size_t) {
    add_point(SectionedModel::height(y), y, sections);
  });
  for (auto* matrix : {&sections.gauss_newton, &sections.curvature}) {
    matrix->topRows<3>().setZero();
    matrix->leftCols<3>().setZero();
  }
  complete(sections.curvature.data(), motions + 1);
  total.add(sections);
  return total;
}

class SectionedCylinder final : public Projection {
 public:
  SectionedCylinder(SectionedModel model, std::size_t points) : model_(std::move(model)), points_(points) {}

  std::string_view kind() const override { return "cylindrical"; }
  std::size_t point_count() const override { return points_; }

  double project(std::span<const Vec3> x, std::span<Vec3> out, ShapeParameters& shape) const override {
    const bool warm = shape.size() == Fit<1>::length;
    Fit<1> start = warm ? model_.start(Fit<1>::unpacked(shape)) : model_.cylinder().fitted(x, nullptr);
    if (warm) start.frame.origin += spread({x}).mean - start.mean;
    const Fit<1> fit = minimized(model_, {x}, start);
    shape = fit.packed();
    double energy = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      LocalResidual<1, 1> local;
      model_.cylinder().residual(i, fit.frame.local(x[i]), fit.size, local);
      out[i] = to_vec3(to_eigen(x[i]) - fit.frame.axes * (local.gradient.leftCols<3>().transpose() * local.value));
      energy += local.value.squaredNorm();
    }
    // Along the axis, so that points stay on the cylinder.
    model_.for_each(x, fit, [&](std::uint32_t i, const Eigen::Vector3d& y, std::size_t) {
      out[i] = to_vec3(to_eigen(out[i]) - y[2] * fit.frame.axes.col(2));
      energy += y[2] * y[2];
    });
    return energy;
  }

  void derivative(std::span<const Vec3> x, const ShapeParameters& shape, std::span<const Vec3> dx,
                  std::span<Vec3> out) const override {
    const Fit<1> fit = Fit<1>::unpacked(shape);
    const std::vector<int>& active = model_.active();
    const ActiveDerivatives at = active_derivatives(fit_derivatives(model_, {x}, fit), active);
    const double points = std::sqrt(static_cast<double>(x.size()));
    const Eigen::VectorXd scale = residual_scale(at.gauss_newton, natural_scale(active, points, spread({x}).reach()));
    std::vector<Mixed> mixed(x.size(), Mixed::Zero());
    Parameters turn = Parameters::Zero();
    for (std::size_t i = 0; i < x.size(); ++i) {
      const Eigen::Vector3d y = fit.frame.local(x[i]);
      LocalResidual<1, 1> local;
      model_.cylinder().residual(i, y, fit.size, local);
      const SecondDerivatives<1> second = second_derivatives(local, y, fit.frame);
      mixed[i] = second.xq;
      out[i] = to_vec3(to_eigen(dx[i]) - second.xx * to_eigen(dx[i]));
    }
    const Eigen::Vector3d axis = fit.frame.axes.col(2);
    std::vector<double> mean(model_.sections().size(), 0.0);
    for (std::size_t s = 0; s < mean.size(); ++s) {
      for (const std::uint32_t i : model_.sections()[s]) mean[s] += axis.dot(to_eigen(dx[i]));
      mean[s] /= static_cast<double>(model_.sections()[s].size());
    }
    model_.for_each(x, fit, [&](std::uint32_t i, const Eigen::Vector3d& y, std::size_t s) {
      Mixed turning = second_derivatives(SectionedModel::height(y), y, fit.frame).xq;
      turning.leftCols<3>().setZero();
      mixed[i] += turning;
      out[i] = to_vec3(to_eigen(out[i]) - (axis.dot(to_eigen(dx[i])) - mean[s]) * axis);
    });
    for (std::size_t i = 0; i < x.size(); ++i) turn += mixed[i].transpose() * to_eigen(dx[i]);
    solve_active(at.newton, scale, active, {turn.data(), static_cast<std::size_t>(turn.size())});
    for (std::size_t i = 0; i < x.size(); ++i) out[i] = to_vec3(to_eigen(out[i]) + mixed[i] * turn);
  }

  /// Two rows per point: from the cylinder, and from the plane of its section, which moves along the axis by a parameter of
  /// its own.
  Linearization linearize(std::span<const Vec3> x, const ShapeParameters& shape) const override {
    const Fit<1> fit = Fit<1>::unpacked(shape);
    const std::vector<int>& active = model_.active();
    const auto columns = static_cast<Eigen::Index>(active.size());
    Linearization result;
    result.rows_per_point = 2;
    result.normals.assign(2 * x.size(), Vec3{});
    result.residual.setZero(static_cast<Eigen::Index>(2 * x.size()));
    result.parameters.setZero(result.residual.size(), columns + static_cast<Eigen::Index>(model_.sections().size()));
    const auto put = [&](std::size_t row, const LocalResidual<1, 1>& local, const Eigen::Vector3d& y, int first_parameter) {
      const Eigen::Matrix<double, 1, motions + 1> J = local.gradient * chart<1>(y);
      result.normals[row] = to_vec3(fit.frame.axes * local.gradient.leftCols<3>().transpose());
      result.residual[static_cast<Eigen::Index>(row)] = local.value[0];
      for (Eigen::Index k = 0; k < columns; ++k) {
        const int parameter = active[static_cast<std::size_t>(k)];
        if (parameter >= first_parameter) result.parameters(static_cast<Eigen::Index>(row), k) = J[parameter];
      }
    };
    for (std::size_t i = 0; i < x.size(); ++i) {
      const Eigen::Vector3d y = fit.frame.local(x[i]);
      LocalResidual<1, 1> local;
      model_.cylinder().residual(i, y, fit.size, local);
      put(2 * i, local, y, along_x);
    }
    model_.for_each(x, fit, [&](std::uint32_t i, const Eigen::Vector3d& y, std::size_t s) {
      put(2 * i + 1, SectionedModel::height(y), y, about_x);
      result.parameters(static_cast<Eigen::Index>(2 * i + 1), columns + static_cast<Eigen::Index>(s)) = -1;
    });
    return result;
  }

 private:
  using Parameters = Eigen::Matrix<double, motions + 1, 1>;
  using Mixed = Eigen::Matrix<double, 3, motions + 1>;

  SectionedModel model_;
  std::size_t points_;
};

class CylinderProjection final : public FittedProjection<CylinderModel>, public WithSections {
 public:
  CylinderProjection(std::optional<double> curvature, std::size_t points)
      : FittedProjection(CylinderModel(curvature), points), kept_(curvature) {}
  std::unique_ptr<const Projection> with_sections(std::vector<Section> sections, std::optional<double> curvature) const override {
    return std::make_unique<SectionedCylinder>(SectionedModel(curvature ? curvature : kept_, std::move(sections)), point_count());
  }
  std::optional<double> kept_curvature() const override { return kept_; }

 private:
  std::optional<double> kept_;
};

}  // namespace

std::unique_ptr<const Projection> cylinder_projection(std::size_t points, std::optional<double> curvature) {
  return std::make_unique<CylinderProjection>(curvature, points);
}

double cylinder_curvature(std::span<const Vec3> x) { return std::abs(CylinderModel({}).fitted(x, nullptr).size[0]); }

}  // namespace deform
