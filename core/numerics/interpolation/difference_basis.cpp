// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/difference_basis.h"

#include <limits>

namespace deform {

DifferenceBasis::DifferenceBasis(std::span<const Vec3> centres, const RunContext& context) : parents_(centres.size(), none) {
  std::vector<double> squared(centres.size(), std::numeric_limits<double>::infinity());  // to the nearest one before
  std::vector<std::uint32_t> nearest(centres.size(), none);
  std::size_t next = 0;
  for (std::size_t taken = 0; taken < centres.size(); ++taken) {
    if (taken % 64 == 0) context.check();
    const std::size_t current = next;
    if (squared[current] < close * close) {
      parents_[current] = nearest[current];
      order_.push_back(static_cast<std::uint32_t>(current));
    }
    squared[current] = -1;
    const Vec3 c = centres[current];
    for (std::size_t i = 0; i < centres.size(); ++i) {
      const Vec3& x = centres[i];
      const double dx = x[0] - c[0], dy = x[1] - c[1], dz = x[2] - c[2];
      const double distance = dx * dx + dy * dy + dz * dz;
      if (distance < squared[i]) {
        squared[i] = distance;
        nearest[i] = static_cast<std::uint32_t>(current);
      }
      if (squared[i] > squared[next]) next = i;
    }
  }
}

void DifferenceBasis::apply(Eigen::MatrixXd& F) const {
  for (std::size_t k = order_.size(); k-- > 0;) F.row(order_[k]) -= F.row(parents_[order_[k]]);
}

void DifferenceBasis::apply_transposed(Eigen::MatrixXd& W) const {
  for (const std::uint32_t i : order_) W.row(parents_[i]) -= W.row(i);
}

}  // namespace deform
