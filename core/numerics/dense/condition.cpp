// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/dense/condition.h"

#include <algorithm>
#include <cmath>

namespace deform {

double inverse_norm1(Eigen::Index size, const std::function<void(Eigen::VectorXd&)>& solve) {
  if (size == 0) return 0;
  const auto n = static_cast<double>(size);
  Eigen::VectorXd x = Eigen::VectorXd::Constant(size, 1 / n);
  double estimate = 0;
  Eigen::Index last = -1;
  for (int step = 0; step < 5; ++step) {
    Eigen::VectorXd y = x;
    solve(y);
    const double norm = y.lpNorm<1>();
    if (step > 0 && norm <= estimate) break;
    estimate = norm;
    Eigen::VectorXd z = y.unaryExpr([](double v) { return v < 0 ? -1.0 : 1.0; });
    solve(z);
    Eigen::Index largest = 0;
    const double peak = z.cwiseAbs().maxCoeff(&largest);
    if (largest == last || (step > 0 && peak <= z.dot(x))) break;
    last = largest;
    x.setZero();
    x[largest] = 1;
  }
  // A vector that the power steps are blind to (Higham's alternative estimate).
  Eigen::VectorXd alternating(size);
  for (Eigen::Index i = 0; i < size; ++i) {
    alternating[i] = (i % 2 == 0 ? 1.0 : -1.0) * (1 + static_cast<double>(i) / std::max(1.0, n - 1));
  }
  solve(alternating);
  return std::max(estimate, 2 * alternating.lpNorm<1>() / (3 * n));
}

}  // namespace deform
