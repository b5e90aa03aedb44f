// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/fitting.h"

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

Eigen::MatrixXd scaled_inverse(const Eigen::MatrixXd& H, const Eigen::VectorXd& scale, double cut) {
  const Eigen::VectorXd by = scale.cwiseInverse();
  const auto eigen = symmetric_eigen(Eigen::MatrixXd(by.asDiagonal() * H * by.asDiagonal()));
  const Eigen::VectorXd& values = eigen.values;
  const double least = cut * values.cwiseAbs().maxCoeff();
  Eigen::VectorXd inverse = Eigen::VectorXd::Zero(values.size());
  for (Eigen::Index k = 0; k < values.size(); ++k) {
    if (std::abs(values[k]) > least) inverse[k] = 1 / values[k];
  }
  const Eigen::MatrixXd U = by.asDiagonal() * eigen.vectors;
  return U * inverse.asDiagonal() * U.transpose();
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
