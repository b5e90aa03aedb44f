// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/cages/principal_axes.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "core/base/vectors.h"

namespace deform {

Eigenvectors eigenvectors(SymmetricMatrix a) {
  SymmetricMatrix v{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  // columns are the vectors
  for (int sweep = 0; sweep < 30; ++sweep) {
    if (a[0][1] == 0 && a[0][2] == 0 && a[1][2] == 0) break;
    for (const auto& [p, q] : {std::pair<std::size_t, std::size_t>{0, 1}, {0, 2}, {1, 2}}) {
      if (a[p][q] == 0) continue;
      const double theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
      const double t = (theta < 0 ? -1 : 1) / (std::abs(theta) + std::hypot(theta, 1.0));
      const double c = 1 / std::hypot(t, 1.0), s = t * c;
      for (SymmetricMatrix* m : {&a, &v}) {
        for (Vec3& row : *m) {
          const double x = row[p], y = row[q];
          row[p] = c * x - s * y;
          row[q] = s * x + c * y;
        }
      }
      for (std::size_t k = 0; k < 3; ++k) {
        const double x = a[p][k], y = a[q][k];
        a[p][k] = c * x - s * y;
        a[q][k] = s * x + c * y;
      }
      if (std::abs(a[p][q]) < 1e-300) a[p][q] = a[q][p] = 0;
    }
  }
  std::array<std::size_t, 3> order{0, 1, 2};
  std::sort(order.begin(), order.end(), [&](std::size_t i, std::size_t j) { return a[i][i] < a[j][j]; });
  Eigenvectors result;
  for (std::size_t k = 0; k < 3; ++k) {
    result.values[k] = a[order[k]][order[k]];
    for (std::size_t i = 0; i < 3; ++i) result.vectors[k][i] = v[i][order[k]];
  }
  return result;
}

void add_product(SymmetricMatrix& m, double factor, const Vec3& a, const Vec3& b) {
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) m[i][j] += 0.5 * factor * (a[i] * b[j] + b[i] * a[j]);
  }
}

PrincipalAxes principal_axes(std::span<const TriangleCorners> triangles) {
  PrincipalAxes axes;
  for (const TriangleCorners& t : triangles) {
    for (const Vec3& x : t) axes.box.add(x);
  }
  const Vec3 middle = 0.5 * (axes.box.min + axes.box.max);
  const double unit = axes.box.diagonal() > 0 ? axes.box.diagonal() : 1;
  const auto weight = [&](const TriangleCorners& t) { return 0.5 * norm(cross((t[1] - t[0]) / unit, (t[2] - t[0]) / unit)); };
  double area = 0;
  for (const TriangleCorners& t : triangles) area += weight(t);
  const bool has_area = area > 0;
  double sum = 0;
  Vec3 first{};
  for (const TriangleCorners& t : triangles) {
    const double w = has_area ? weight(t) : 1;
    sum += w;
    first = first + w / 3 * (t[0] + t[1] + t[2] - 3.0 * middle);
  }
  axes.centre = middle + first / sum;
  SymmetricMatrix second{};
  for (const TriangleCorners& t : triangles) {
    const double w = has_area ? weight(t) : 1;
    Vec3 all{};
    for (const Vec3& corner : t) {
      const Vec3 x = (corner - axes.centre) / unit;
      add_product(second, w / 12, x, x);
      all = all + x;
    }
    add_product(second, w / 12, all, all);
  }
  axes.moments = eigenvectors(second);
  return axes;
}

}  // namespace deform
