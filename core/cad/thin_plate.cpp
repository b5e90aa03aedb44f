// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/thin_plate.h"

#include <Eigen/LU>
#include <cmath>
#include <utility>

namespace deform::cad {

namespace {

double kernel(double square) { return square > 0 ? 0.5 * square * std::log(square) : 0; }

}  // namespace

ThinPlate::ThinPlate(std::vector<Eigen::Vector2d> centres, const Eigen::MatrixXd& values) : centres_(std::move(centres)) {
  const auto n = static_cast<Eigen::Index>(centres_.size());
  Eigen::MatrixXd system = Eigen::MatrixXd::Zero(n + 3, n + 3), right = Eigen::MatrixXd::Zero(n + 3, values.cols());
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j) system(i, j) = kernel((centres_[i] - centres_[j]).squaredNorm());
    system.block<1, 3>(i, n) << centres_[i].x(), centres_[i].y(), 1;
    system.block<3, 1>(n, i) = system.block<1, 3>(i, n).transpose();
  }
  right.topRows(n) = values;
  weights_ = system.partialPivLu().solve(right);
}

Eigen::RowVectorXd ThinPlate::operator()(const Eigen::Vector2d& x) const {
  if (is_zero()) return {};
  const auto n = static_cast<Eigen::Index>(centres_.size());
  Eigen::RowVectorXd value = x.x() * weights_.row(n) + x.y() * weights_.row(n + 1) + weights_.row(n + 2);
  for (Eigen::Index i = 0; i < n; ++i) value += kernel((x - centres_[i]).squaredNorm()) * weights_.row(i);
  return value;
}

Eigen::Matrix2Xd ThinPlate::gradient(const Eigen::Vector2d& x) const {
  if (is_zero()) return {};
  const auto n = static_cast<Eigen::Index>(centres_.size());
  Eigen::Matrix2Xd gradient = weights_.middleRows(n, 2);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector2d away = x - centres_[i];
    const double square = away.squaredNorm();
    if (square > 0) gradient += (std::log(square) + 1) * away * weights_.row(i);
  }
  return gradient;
}

}  // namespace deform::cad
