// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/kernels/kernel_rows.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/numerics/sampling/point_tree.h"

namespace deform {

namespace {

constexpr std::size_t rows_per_range = 128;

double squared(const Vec3& a, const Vec3& b) {
  const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
  return x * x + y * y + z * z;
}

}  // namespace

SparseRows kernel_rows(const RadialKernel& kernel, double reach, std::span<const Vec3> centres, std::span<const Vec3> points,
                       const RunContext& context) {
  const PointTree tree(centres);
  SparseRows rows(static_cast<Eigen::Index>(points.size()), static_cast<Eigen::Index>(centres.size()));
  std::int64_t* const starts = rows.outerIndexPtr();
  starts[0] = 0;
  const auto each = [&](const auto& use) {
    parallel_for(context, points.size(), rows_per_range, [&](std::size_t begin, std::size_t end) {
      std::vector<PointTree::Near> near;
      for (std::size_t i = begin; i < end; ++i) {
        tree.within(points[i], reach * reach, near);
        use(i, near);
      }
    });
  };
  each([&](std::size_t i, const auto& near) { starts[i + 1] = static_cast<std::int64_t>(near.size()); });
  for (std::size_t i = 0; i < points.size(); ++i) starts[i + 1] += starts[i];
  rows.resizeNonZeros(starts[points.size()]);
  each([&](std::size_t i, auto& near) {
    std::sort(near.begin(), near.end(), [](const auto& a, const auto& b) { return a.point < b.point; });
    for (std::size_t a = 0; a < near.size(); ++a) {
      const auto at = starts[i] + static_cast<std::int64_t>(a);
      rows.innerIndexPtr()[at] = near[a].point;
      rows.valuePtr()[at] = value(kernel, near[a].square);
    }
  });
  return rows;
}

Eigen::MatrixXd full_kernel_rows(const RadialKernel& kernel, std::span<const Vec3> centres, std::span<const Vec3> points,
                                 const RunContext& context) {
  Eigen::MatrixXd rows(static_cast<Eigen::Index>(points.size()), static_cast<Eigen::Index>(centres.size()));
  parallel_for(context, centres.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t j = begin; j < end; ++j) {
      for (std::size_t i = 0; i < points.size(); ++i) {
        rows(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = value(kernel, squared(points[i], centres[j]));
      }
    }
  });
  return rows;
}

}  // namespace deform
