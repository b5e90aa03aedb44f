// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/related_planes.h"

#include "core/constraints/fit_starts.h"
#include "core/constraints/fitted_projection.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

/// Planes through the origin: all with the normal z.
class ParallelModel {
 public:
  static constexpr int rows = 1, sizes = 0;
  std::string_view kind() const { return "parallel"; }
  const std::vector<int>& active() const { return active_; }

  void residual(std::size_t, const Eigen::Vector3d& y, const Eigen::Matrix<double, 0, 1>&, LocalResidual<1, 0>& out) const {
    out.value[0] = y[2];
    out.gradient << 0, 0, 1;
    out.curvature.setZero();
  }

  Fit<0> fitted(std::span<const Vec3> x, const Fit<0>*) const {
    const PrincipalAxes axes = principal_axes(x);
    Fit<0> fit;
    fit.frame.axes = axes_from(axes.axes.col(0), axes.axes.col(2));
    return fit;
  }

 private:
  std::vector<int> active_{about_x, about_y};
};

/// Planes through the origin: the first `split` points in the one with the normal z, the others in the one with the normal x.
class OrthogonalModel {
 public:
  static constexpr int rows = 1, sizes = 0;
  explicit OrthogonalModel(std::size_t split) : split_(split) {}

  std::string_view kind() const { return "orthogonal"; }
  const std::vector<int>& active() const { return active_; }

  void residual(std::size_t i, const Eigen::Vector3d& y, const Eigen::Matrix<double, 0, 1>&, LocalResidual<1, 0>& out) const {
    const Eigen::Index axis = i < split_ ? 2 : 0;
    out.value[0] = y[axis];
    out.gradient.setZero();
    out.gradient[axis] = 1;
    out.curvature.setZero();
  }

  Fit<0> fitted(std::span<const Vec3> x, const Fit<0>* last) const {
    if (last != nullptr) {
      // The regions are about their means: nothing moves but the axes.
      Fit<0> fit = minimized(*this, {x}, *last);
      fit.mean.setZero();
      return fit;
    }
    const PrincipalAxes first = principal_axes(x.first(split_)), second = principal_axes(x.subspan(split_));
    std::vector<Fit<0>> starts;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d n = first.axes.col(k), m = second.axes.col(k);
      starts.push_back(with_axes(n, least_across(n, second)));
      starts.push_back(with_axes(least_across(m, first), m));
    }
    Fit<0> fit = best_minimum(*this, x, starts);
    fit.mean.setZero();
    return fit;
  }

 private:
  static Fit<0> with_axes(const Eigen::Vector3d& z, const Eigen::Vector3d& x) {
    Fit<0> fit;
    fit.frame.axes = axes_from(z, x);
    return fit;
  }

  /// The direction of least moment at right angles to n.
  static Eigen::Vector3d least_across(const Eigen::Vector3d& n, const PrincipalAxes& of) {
    const Eigen::Matrix3d frame = axes_from(n, Eigen::Vector3d::Zero());
    const Eigen::Matrix<double, 2, 3> across = frame.leftCols<2>().transpose() * of.axes;
    const Eigen::Matrix2d moments = (across * of.moments.asDiagonal() * across.transpose()).triangularView<Eigen::Lower>();
    return frame.leftCols<2>() * symmetric_eigen(moments).vectors.col(0);
  }

  std::size_t split_;
  std::vector<int> active_{about_x, about_y, about_z};
};

/// A projection of regions that may move independently of each other: that of the points about the mean of their region (the
/// operator C), which keeps these means. So P' = 1 - C (1 - P'_centred) C.
class CentredProjection final : public Projection {
 public:
  CentredProjection(std::unique_ptr<const Projection> centred, const std::vector<std::size_t>& points)
      : centred_(std::move(centred)), counts_(points) {}

  std::string_view kind() const override { return centred_->kind(); }
  std::size_t point_count() const override { return centred_->point_count(); }

  double project(std::span<const Vec3> x, std::span<Vec3> out, ShapeParameters& shape) const override {
    const Points z = about_means(x);
    const double energy = centred_->project(z, out, shape);
    for (std::size_t i = 0; i < x.size(); ++i) out[i] = to_vec3(to_eigen(out[i]) + (to_eigen(x[i]) - to_eigen(z[i])));
    return energy;
  }

  void derivative(std::span<const Vec3> x, const ShapeParameters& shape, std::span<const Vec3> dx,
                  std::span<Vec3> out) const override {
    const Points dz = about_means(dx);
    centred_->derivative(about_means(x), shape, dz, out);
    Points change(dz.size());
    for (std::size_t i = 0; i < dz.size(); ++i) change[i] = to_vec3(to_eigen(dz[i]) - to_eigen(out[i]));
    change = about_means(change);
    for (std::size_t i = 0; i < dz.size(); ++i) out[i] = to_vec3(to_eigen(dx[i]) - to_eigen(change[i]));
  }

  Linearization linearize(std::span<const Vec3> x, const ShapeParameters& shape) const override {
    Linearization result = centred_->linearize(about_means(x), shape);
    const Eigen::Index turns = result.parameters.cols(), regions = static_cast<Eigen::Index>(counts_.size());
    result.parameters.conservativeResize(Eigen::NoChange, turns + regions);
    result.parameters.rightCols(regions).setZero();
    Eigen::Index begin = 0;
    for (Eigen::Index r = 0; r < regions; ++r) {  // every plane moves along its normal
      const auto count = static_cast<Eigen::Index>(counts_[static_cast<std::size_t>(r)]);
      result.parameters.block(begin, turns + r, count, 1).setConstant(-1);
      begin += count;
    }
    return result;
  }

 private:
  Points about_means(std::span<const Vec3> x) const {
    Points z(x.begin(), x.end());
    std::size_t begin = 0;
    for (const std::size_t count : counts_) {
      const Eigen::Vector3d mean = spread({x.subspan(begin, count)}).mean;
      for (std::size_t i = begin; i < begin + count; ++i) z[i] = to_vec3(to_eigen(x[i]) - mean);
      begin += count;
    }
    return z;
  }

  std::unique_ptr<const Projection> centred_;
  std::vector<std::size_t> counts_;
};

std::size_t sum(const std::vector<std::size_t>& points) {
  std::size_t all = 0;
  for (const std::size_t count : points) all += count;
  return all;
}

}  // namespace

std::unique_ptr<const Projection> parallel_projection(const std::vector<std::size_t>& points) {
  return std::make_unique<CentredProjection>(std::make_unique<FittedProjection<ParallelModel>>(ParallelModel{}, sum(points)),
                                             points);
}

std::unique_ptr<const Projection> orthogonal_projection(const std::vector<std::size_t>& points) {
  return std::make_unique<CentredProjection>(
      std::make_unique<FittedProjection<OrthogonalModel>>(OrthogonalModel(points.at(0)), sum(points)), points);
}

}  // namespace deform
