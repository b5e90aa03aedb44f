// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/anderson.h"

#include <algorithm>

#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

Eigen::VectorXd coordinates_of(const std::vector<Vec3>& points) {
  return Eigen::Map<const Eigen::VectorXd>(points.empty() ? nullptr : points[0].data(),
                                           static_cast<Eigen::Index>(3 * points.size()));
}

}  // namespace

void Anderson::clear() {
  p_.resize(0);
  q_changes_.clear();
  f_changes_.clear();
  ratios_.clear();
}

double Anderson::add(const std::vector<Vec3>& p, const std::vector<Vec3>& q) {
  Eigen::VectorXd new_p = coordinates_of(p), new_q = coordinates_of(q);
  if (p_.size() > 0) {
    const Eigen::VectorXd dp = new_p - p_;
    Eigen::VectorXd dq = new_q - q_;
    const double length = dp.norm();
    if (length > 0) {
      ratios_.push_back(dq.norm() / length);
      f_changes_.emplace_back(dq - dp);
      q_changes_.push_back(std::move(dq));
    }
    if (q_changes_.size() > window) {
      q_changes_.pop_front();
      f_changes_.pop_front();
      ratios_.pop_front();
    }
  }
  p_ = std::move(new_p);
  q_ = std::move(new_q);
  return ratios_.empty() ? 0 : *std::max_element(ratios_.begin(), ratios_.end());
}

std::vector<Vec3> Anderson::next() const {
  Eigen::MatrixXd F(q_.size(), static_cast<Eigen::Index>(f_changes_.size()));
  for (std::size_t i = 0; i < f_changes_.size(); ++i) F.col(static_cast<Eigen::Index>(i)) = f_changes_[i];
  const Eigen::VectorXd gamma = pivoted_solution(F, q_ - p_).x;
  Eigen::VectorXd p = q_;
  for (std::size_t i = 0; i < q_changes_.size(); ++i) p -= gamma[static_cast<Eigen::Index>(i)] * q_changes_[i];
  std::vector<Vec3> result(static_cast<std::size_t>(p.size()) / 3);
  for (std::size_t i = 0; i < result.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) result[i][k] = p[static_cast<Eigen::Index>(3 * i + k)];
  }
  return result;
}

}  // namespace deform
