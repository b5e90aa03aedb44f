// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/projection.h"

// Least-squares fits of a shape that moves with a frame, the common part of all fitted projections.
//
// A shape is defined by its residuals in its own frame: those of point i are r(y, sizes) at y = axes^T (x - origin). Their
// gradients with respect to y are orthonormal, so that sum r^2 is the squared distance from the shape. A small motion (v, w) of
// the shape takes y to exp(-w)(y - v), which gives the derivatives with respect to position and orientation. The energy F(x, q) =
// 1/2 sum r^2 at its minimum over q = (motion, sizes) has the gradient x - P(x), and its Hessian gives the derivative of the
// projection, P' = I - F_xx + F_xq F_qq^-1 F_qx (implicit function theorem on F_q = 0).

namespace deform {

inline Eigen::Vector3d to_eigen(const Vec3& v) { return {v[0], v[1], v[2]}; }
inline Vec3 to_vec3(const Eigen::Vector3d& v) { return {v[0], v[1], v[2]}; }

/// A right-handed orthonormal frame.
struct Frame {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  ///< columns

  Eigen::Vector3d local(const Vec3& x) const { return axes.transpose() * (to_eigen(x) - origin); }
  /// The frame translated by v and then rotated by the rotation vector w, both in its own axes.
  Frame moved(const Eigen::Vector3d& v, const Eigen::Vector3d& w) const;
};

/// Parameters 0..5 of every shape are translations along and rotations about the axes of its frame; the sizes follow.
enum FrameMotion : int { along_x, along_y, along_z, about_x, about_y, about_z, motions };

inline Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d M;
  M << 0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0;
  return M;
}

/// The residuals of one point in the frame of the shape.
template <int rows, int sizes>
struct LocalResidual {
  Eigen::Matrix<double, rows, 1> value;
  Eigen::Matrix<double, rows, 3 + sizes> gradient;        ///< with respect to (y, sizes)
  Eigen::Matrix<double, 3 + sizes, 3 + sizes> curvature;  ///< sum over the rows of value * second derivatives
};

/// A fitted shape.
template <int sizes>
struct Fit {
  Frame frame;
  Eigen::Matrix<double, sizes, 1> size = Eigen::Matrix<double, sizes, 1>::Zero();
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();  ///< mean of the fitted points, to translate the start of a later fit
  double energy = 0;                               ///< sum of squared residuals

  static constexpr std::size_t length = 15 + sizes;

  ShapeParameters packed() const {
    ShapeParameters all(length);
    Eigen::Map<Eigen::Vector3d>(all.data()) = mean;
    Eigen::Map<Eigen::Vector3d>(all.data() + 3) = frame.origin;
    Eigen::Map<Eigen::Matrix3d>(all.data() + 6) = frame.axes;
    for (int k = 0; k < sizes; ++k) all[15 + static_cast<std::size_t>(k)] = size[k];
    return all;
  }
  static Fit unpacked(const ShapeParameters& all) {
    Fit fit;
    fit.mean = Eigen::Map<const Eigen::Vector3d>(all.data());
    fit.frame.origin = Eigen::Map<const Eigen::Vector3d>(all.data() + 3);
    fit.frame.axes = Eigen::Map<const Eigen::Matrix3d>(all.data() + 6);
    for (int k = 0; k < sizes; ++k) fit.size[k] = all[15 + static_cast<std::size_t>(k)];
    return fit;
  }
};

/// Points 0, stride, 2 stride, ... of a set.
struct PointSample {
  std::span<const Vec3> x;
  std::size_t stride = 1;
};

/// The mean of the points and their root-mean-square distance from it.
struct Spread {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double radius = 0;

  /// The radius for scaling, bounded from below so that its powers do not underflow.
  double reach() const { return std::max({radius, 1e-14 * mean.norm(), 1e-60}); }
};
Spread spread(const PointSample& sample);

/// The energy and its derivatives with respect to all parameters (motions, then sizes).
template <int sizes>
struct FitDerivatives {
  static constexpr int count = motions + sizes;
  using Vector = Eigen::Matrix<double, count, 1>;
  using Matrix = Eigen::Matrix<double, count, count>;

  double energy = 0;  ///< sum r^2, so twice F
  Vector gradient = Vector::Zero();
  Matrix gauss_newton = Matrix::Zero();  ///< J^T J
  Matrix curvature = Matrix::Zero();     ///< F_qq - J^T J

  void add(const FitDerivatives& other) {
    energy += other.energy;
    gradient += other.gradient;
    gauss_newton += other.gauss_newton;
    curvature += other.curvature;
  }
};

/// Derivatives of y and the sizes with respect to all parameters.
template <int sizes>
Eigen::Matrix<double, 3 + sizes, motions + sizes> chart(const Eigen::Vector3d& y) {
  Eigen::Matrix<double, 3 + sizes, motions + sizes> Y = Eigen::Matrix<double, 3 + sizes, motions + sizes>::Zero();
  Y.template block<3, 3>(0, 0) = -Eigen::Matrix3d::Identity();
  Y.template block<3, 3>(0, 3) = cross_matrix(y);
  for (int k = 0; k < sizes; ++k) Y(3 + k, motions + k) = 1;
  return Y;
}

/// Adds the contribution of y to the curvature of the energy of one point: Y^T K Y, where Y is the derivative of y with respect
/// to the motion, and g . d^2 y / dq^2 with the gradient g. Adds the blocks of the upper triangle only.
void add_motion_curvature(const Eigen::Matrix3d& K, const Eigen::Vector3d& g, const Eigen::Vector3d& y,
                          Eigen::Ref<Eigen::Matrix<double, motions, motions>, 0, Eigen::OuterStride<>> H);

/// Adds one point to the blocks on and above the diagonal (motion, motion), (motion, size), (size, size).
template <int rows, int sizes>
void add_point(const LocalResidual<rows, sizes>& local, const Eigen::Vector3d& y, FitDerivatives<sizes>& to) {
  for (int r = 0; r < rows; ++r) {
    const Eigen::Vector3d n = local.gradient.row(r).template head<3>();
    typename FitDerivatives<sizes>::Vector J;
    J.template head<3>() = -n;
    J.template segment<3>(about_x) = n.cross(y);
    J.template tail<sizes>() = local.gradient.row(r).template tail<sizes>().transpose();
    to.energy += local.value[r] * local.value[r];
    to.gradient += local.value[r] * J;
    for (int k = 0; k < motions + sizes; ++k) to.gauss_newton.col(k) += J[k] * J;
  }
  const Eigen::Vector3d g = local.gradient.template leftCols<3>().transpose() * local.value;
  add_motion_curvature(local.curvature.template topLeftCorner<3, 3>(), g, y,
                       to.curvature.template topLeftCorner<motions, motions>());
  for (int k = 0; k < sizes; ++k) {
    const Eigen::Vector3d mixed = local.curvature.col(3 + k).template head<3>();
    to.curvature.col(motions + k).template segment<3>(along_x) -= mixed;
    to.curvature.col(motions + k).template segment<3>(about_x) += mixed.cross(y);
  }
  to.curvature.template bottomRightCorner<sizes, sizes>() += local.curvature.template bottomRightCorner<sizes, sizes>();
}

/// Second derivatives of half the squared distance of one point, with respect to x twice, and to x and the parameters.
template <int sizes>
struct SecondDerivatives {
  Eigen::Matrix3d xx;
  Eigen::Matrix<double, 3, motions + sizes> xq;
};

template <int rows, int sizes>
SecondDerivatives<sizes> second_derivatives(const LocalResidual<rows, sizes>& local, const Eigen::Vector3d& y,
                                            const Frame& frame) {
  const auto gradient_y = local.gradient.template leftCols<3>();
  const Eigen::Vector3d g = gradient_y.transpose() * local.value;
  const Eigen::Matrix<double, 3, 3 + sizes> by_y =
      gradient_y.transpose() * local.gradient + local.curvature.template topRows<3>();
  SecondDerivatives<sizes> second;
  second.xq = by_y * chart<sizes>(y);
  // The normal turns with the shape: e_w x g.
  second.xq.template block<3, 3>(0, about_x) -= cross_matrix(g);
  second.xq = (frame.axes * second.xq).eval();
  second.xx = frame.axes * by_y.template leftCols<3>() * frame.axes.transpose();
  return second;
}

/// Copies the upper triangle of a matrix of `count` columns to the lower one.
void complete(double* matrix, std::size_t count);

template <class Model>
FitDerivatives<Model::sizes> fit_derivatives(const Model& model, const PointSample& sample, const Fit<Model::sizes>& fit) {
  constexpr std::size_t block = 256;  // sums of sums lose fewer digits
  FitDerivatives<Model::sizes> total, part;
  LocalResidual<Model::rows, Model::sizes> local;
  std::size_t in_part = 0;
  for (std::size_t i = 0; i < sample.x.size(); i += sample.stride) {
    const Eigen::Vector3d y = fit.frame.local(sample.x[i]);
    model.residual(i, y, fit.size, local);
    add_point(local, y, part);
    if (++in_part == block) {
      total.add(part);
      part = {};
      in_part = 0;
    }
  }
  total.add(part);
  complete(total.curvature.data(), motions + Model::sizes);
  return total;
}

/// Replaces a gradient by the solution of H q = gradient for the Hessian H of the active parameters, zero for the others, in
/// variables scaled by `scale`. Directions without information stay where they are.
void solve_active(const Eigen::MatrixXd& H, const Eigen::VectorXd& scale, const std::vector<int>& active,
                  std::span<double> parameters);

/// The displacement of the points (root of the sum of squares) per unit of each active parameter, for points at a distance of
/// about `radius` from the origin of the frame. Makes parameters of different units comparable where the residuals do not.
Eigen::VectorXd natural_scale(const std::vector<int>& active, double points, double radius);

/// The change of the residuals per unit of each active parameter, at least 1e-6 of the natural scale.
Eigen::VectorXd residual_scale(const Eigen::MatrixXd& gauss_newton, const Eigen::VectorXd& natural);

/// The energy and its derivatives with respect to the active parameters.
struct ActiveDerivatives {
  double energy = 0;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd gauss_newton, newton;
};
/// Picks them out of those with respect to `count` parameters: a gradient and two matrices, column by column.
ActiveDerivatives selected(const double* gradient, const double* gauss_newton, const double* curvature, std::size_t count,
                           const std::vector<int>& active);
template <int sizes>
ActiveDerivatives active_derivatives(const FitDerivatives<sizes>& all, const std::vector<int>& active) {
  ActiveDerivatives some = selected(all.gradient.data(), all.gauss_newton.data(), all.curvature.data(), motions + sizes, active);
  some.energy = all.energy;
  return some;
}

/// A step of the damped Newton method in scaled parameters, or of Gauss-Newton if the Hessian is not positive definite.
struct StepRequest {
  const Eigen::MatrixXd& newton;
  const Eigen::MatrixXd& gauss_newton;
  const Eigen::VectorXd& gradient;
  const Eigen::VectorXd& scale;
  double damping = 0;
};
Eigen::VectorXd damped_step(const StepRequest& request);

template <int sizes>
Fit<sizes> stepped(const Fit<sizes>& fit, const std::vector<int>& active, const Eigen::VectorXd& step) {
  Eigen::Matrix<double, motions + sizes, 1> q = Eigen::Matrix<double, motions + sizes, 1>::Zero();
  for (std::size_t k = 0; k < active.size(); ++k) q[active[k]] = step[static_cast<Eigen::Index>(k)];
  const double angle = q.template segment<3>(about_x).norm();
  if (angle > 0.5) q *= 0.5 / angle;
  Fit<sizes> moved = fit;
  moved.frame = fit.frame.moved(q.template segment<3>(along_x), q.template segment<3>(about_x));
  moved.size += q.template tail<sizes>();
  return moved;
}

/// Finds a local minimum of the energy by the Levenberg-Marquardt method, with the full Hessian where it is positive definite, so
/// that it converges quadratically even for large residuals. Stops at the level of rounding. Deterministic, bit for bit. Returns
/// the least energy. One function for all models: Eigen's expressions in it take seconds to compile.
struct Minimization {
  ActiveDerivatives start;
  Eigen::VectorXd natural;                                         ///< natural_scale()
  double reach = 0;                                                ///< of all points together
  int steps = 0;                                                   ///< at most
  std::function<ActiveDerivatives(const Eigen::VectorXd&)> tried;  ///< after a step from what was taken last
  std::function<void()> take;                                      ///< takes what was tried last
};
double minimize(Minimization problem);

/// The local minimum over the active parameters that is reached from `start`, see minimize().
template <class Model>
Fit<Model::sizes> minimized(const Model& model, const PointSample& sample, const Fit<Model::sizes>& start, int steps = 200) {
  const std::vector<int>& active = model.active();
  const Spread size = spread(sample);
  const double points = std::sqrt(static_cast<double>((sample.x.size() + sample.stride - 1) / sample.stride));
  Fit<Model::sizes> fit = start, next;
  fit.mean = size.mean;
  const auto derivatives = [&](const Fit<Model::sizes>& at) {
    return active_derivatives(fit_derivatives(model, sample, at), active);
  };
  fit.energy = minimize({derivatives(fit), natural_scale(active, points, size.reach()), points * size.reach(), steps,
                         [&](const Eigen::VectorXd& step) {
                           next = stepped(fit, active, step);
                           return derivatives(next);
                         },
                         [&] { fit = next; }});
  return fit;
}

/// The order of the energies, ascending; equal ones stay in theirs.
std::vector<std::size_t> ascending(const std::vector<double>& energies);

/// The best of the minima reached from several starts. Large sets are first fitted on a sample.
template <class Model>
Fit<Model::sizes> best_minimum(const Model& model, std::span<const Vec3> x, const std::vector<Fit<Model::sizes>>& starts) {
  constexpr std::size_t sample_size = 1000;
  const PointSample sample{x, std::max<std::size_t>(1, x.size() / sample_size)};
  std::vector<Fit<Model::sizes>> found;
  std::vector<double> energies;
  for (const auto& start : starts) {
    found.push_back(minimized(model, sample, start, 60));
    energies.push_back(found.back().energy);
  }
  const std::vector<std::size_t> order = ascending(energies);
  const double least = energies[order[0]];
  Fit<Model::sizes> best = minimized(model, {x}, found[order[0]]);
  for (std::size_t k = 1; k < std::min<std::size_t>(found.size(), 3) && sample.stride > 1; ++k) {
    // Another minimum, not the same one again, and nearly as good on the sample.
    const double energy = energies[order[k]];
    if (energy < least * (1 + 1e-6) || energy > 1.5 * least) continue;
    const Fit<Model::sizes> other = minimized(model, {x}, found[order[k]]);
    if (other.energy < best.energy) best = other;
  }
  return best;
}

/// The minimum reached from `last`, translated with the mean of the points.
template <class Model>
Fit<Model::sizes> refitted(const Model& model, std::span<const Vec3> x, Fit<Model::sizes> last) {
  last.frame.origin += spread({x}).mean - last.mean;
  return minimized(model, {x}, last);
}

}  // namespace deform
