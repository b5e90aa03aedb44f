// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/fitting.h"

#include <numeric>

#include "core/numerics/dense/decompositions.h"

namespace deform {

Frame Frame::moved(const Eigen::Vector3d& v, const Eigen::Vector3d& w) const {
  Frame frame;
  frame.origin = origin + axes * v;
  const double angle = w.norm();
  if (angle == 0) {
    frame.axes = axes;
    return frame;
  }
  // Through a unit quaternion: the axes stay orthonormal over any number of steps.
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(angle, w / angle));
  frame.axes = (Eigen::Quaterniond(axes).normalized() * turn).normalized().toRotationMatrix();
  return frame;
}

Spread spread(const PointSample& sample) {
  Spread result;
  if (sample.x.empty()) return result;
  const Eigen::Vector3d first = to_eigen(sample.x[0]);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double count = 0;
  for (std::size_t i = 0; i < sample.x.size(); i += sample.stride) {
    sum += to_eigen(sample.x[i]) - first;
    count += 1;
  }
  // Relative to the first point: coincident points have exactly no spread.
  const Eigen::Vector3d mean = sum / count;
  double squares = 0;
  for (std::size_t i = 0; i < sample.x.size(); i += sample.stride)
    squares += (to_eigen(sample.x[i]) - first - mean).squaredNorm();
  result.mean = first + mean;
  result.radius = std::sqrt(squares / count);
  return result;
}

namespace {

constexpr double no_information = 1e-13;  // of the largest eigenvalue

/// The pseudo-inverse of a symmetric matrix in variables scaled by `scale`.
Eigen::MatrixXd scaled_inverse(const Eigen::MatrixXd& H, const Eigen::VectorXd& scale) {
  const Eigen::VectorXd by = scale.cwiseInverse();
  const auto eigen = symmetric_eigen(Eigen::MatrixXd(by.asDiagonal() * H * by.asDiagonal()));
  const Eigen::VectorXd& values = eigen.values;
  const double least = no_information * values.cwiseAbs().maxCoeff();
  Eigen::VectorXd inverse = Eigen::VectorXd::Zero(values.size());
  for (Eigen::Index k = 0; k < values.size(); ++k) {
    if (std::abs(values[k]) > least) inverse[k] = 1 / values[k];
  }
  const Eigen::MatrixXd U = by.asDiagonal() * eigen.vectors;
  return U * inverse.asDiagonal() * U.transpose();
}

}  // namespace

void solve_active(const Eigen::MatrixXd& H, const Eigen::VectorXd& scale, const std::vector<int>& active,
                  std::span<double> parameters) {
  Eigen::VectorXd some(H.rows());
  for (Eigen::Index k = 0; k < some.size(); ++k)
    some[k] = parameters[static_cast<std::size_t>(active[static_cast<std::size_t>(k)])];
  some = scaled_inverse(H, scale) * some;
  std::fill(parameters.begin(), parameters.end(), 0.0);
  for (Eigen::Index k = 0; k < some.size(); ++k)
    parameters[static_cast<std::size_t>(active[static_cast<std::size_t>(k)])] = some[k];
}

void complete(double* matrix, std::size_t count) {
  for (std::size_t j = 0; j < count; ++j) {
    for (std::size_t i = 0; i < j; ++i) matrix[count * i + j] = matrix[count * j + i];
  }
}

void add_motion_curvature(const Eigen::Matrix3d& K, const Eigen::Vector3d& g, const Eigen::Vector3d& y,
                          Eigen::Ref<Eigen::Matrix<double, motions, motions>, 0, Eigen::OuterStride<>> H) {
  // Y = [-1, Y_w], Y_w = [y]x; K Y_w has the columns K (y x e).
  const Eigen::Matrix3d turned = K * cross_matrix(y);
  H.block<3, 3>(0, 0) += K;
  H.block<3, 3>(0, 3) += cross_matrix(g) - turned;  // y = exp(-w)(y0 - v): the mixed derivative is e_w x e_v
  Eigen::Matrix3d turning = 0.5 * (g * y.transpose() + y * g.transpose());
  turning.diagonal().array() -= g.dot(y);
  H.block<3, 3>(3, 3) += turning - cross_matrix(y) * turned;
}

Eigen::VectorXd natural_scale(const std::vector<int>& active, double points, double radius) {
  Eigen::VectorXd scale(static_cast<Eigen::Index>(active.size()));
  for (std::size_t k = 0; k < active.size(); ++k) {
    // Sizes are curvatures, factors and angles: a curvature bends the points by about radius^2 / 2; the others are of order one,
    // as are the coordinates.
    const double unit = active[k] < about_x ? 1 : active[k] < motions ? radius : radius * std::min(radius, 1.0);
    scale[static_cast<Eigen::Index>(k)] = points * unit;
  }
  return scale;
}

Eigen::VectorXd residual_scale(const Eigen::MatrixXd& gauss_newton, const Eigen::VectorXd& natural) {
  return gauss_newton.diagonal().cwiseSqrt().cwiseMax(1e-6 * natural);
}

ActiveDerivatives selected(const double* gradient, const double* gauss_newton, const double* curvature, std::size_t count,
                           const std::vector<int>& active) {
  const auto n = static_cast<Eigen::Index>(active.size());
  ActiveDerivatives some{0, Eigen::VectorXd(n), Eigen::MatrixXd(n, n), Eigen::MatrixXd(n, n)};
  for (Eigen::Index j = 0; j < n; ++j) {
    const auto column = static_cast<std::size_t>(active[static_cast<std::size_t>(j)]);
    some.gradient[j] = gradient[column];
    for (Eigen::Index i = 0; i < n; ++i) {
      const std::size_t at = count * column + static_cast<std::size_t>(active[static_cast<std::size_t>(i)]);
      some.gauss_newton(i, j) = gauss_newton[at];
      some.newton(i, j) = gauss_newton[at] + curvature[at];
    }
  }
  return some;
}

std::vector<std::size_t> ascending(const std::vector<double>& energies) {
  std::vector<std::size_t> order(energies.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return energies[a] < energies[b]; });
  return order;
}

double minimize(Minimization problem) {
  ActiveDerivatives at = std::move(problem.start);
  const double reach = problem.reach;
  const double rounding = 1e-31 * reach * reach;
  double damping = 0, last = 1e300;
  for (int step = 0; step < problem.steps; ++step) {
    const Eigen::VectorXd scale = residual_scale(at.gauss_newton, problem.natural);
    const Eigen::VectorXd move = damped_step({at.newton, at.gauss_newton, at.gradient, scale, damping});
    const double length = scale.cwiseProduct(move).norm();
    // Below this a step only follows the rounding errors of the sums.
    if (!(length > 1e-15 * reach) || (length < 1e-9 * reach && length > 0.5 * last && damping < 1e-6)) break;
    ActiveDerivatives there = problem.tried(move);
    if (there.energy <= at.energy * (1 + 1e-13) + rounding) {
      problem.take();
      at = std::move(there);
      // Where Newton's method squares the error, the next step would be below the rounding errors.
      if (damping == 0 && length < 1e-9 * reach && length < 1e-4 * last) break;
      last = length;
      damping = damping < 1e-9 ? 0 : damping * 0.1;
    } else {
      damping = damping == 0 ? 1e-3 : damping * 10;
      if (damping > 1e12) break;
    }
  }
  return at.energy;
}

Eigen::VectorXd damped_step(const StepRequest& request) {
  const Eigen::VectorXd by = request.scale.cwiseInverse();
  const Eigen::VectorXd gradient = by.cwiseProduct(request.gradient);
  for (const Eigen::MatrixXd* H : {&request.newton, &request.gauss_newton}) {
    const auto eigen = symmetric_eigen(Eigen::MatrixXd(by.asDiagonal() * (*H) * by.asDiagonal()));
    const Eigen::VectorXd& values = eigen.values;
    const double largest = values.cwiseAbs().maxCoeff();
    if (H == &request.newton && values.minCoeff() < -1e-12 * largest) continue;
    Eigen::VectorXd step = eigen.vectors.transpose() * gradient;
    for (Eigen::Index k = 0; k < step.size(); ++k) {
      // Directions without information (rotation about the axis of a surface of revolution) are kept.
      step[k] = values[k] > 1e-14 * largest ? -step[k] / (values[k] + request.damping * largest) : 0;
    }
    return by.cwiseProduct(eigen.vectors * step);
  }
  return Eigen::VectorXd::Zero(request.gradient.size());
}

}  // namespace deform
