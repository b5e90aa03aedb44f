// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/newton_form.h"

#include <algorithm>
#include <vector>

namespace deform {

namespace {

double cube(std::size_t n) {
  const auto x = static_cast<double>(n);
  return x * x * x / 3;
}

}  // namespace

void NewtonSizes::add(const Projection& projection, std::span<const Vec3> rest) {
  std::vector<Vec3> projected(rest.size());
  ShapeParameters shape;
  projection.project(rest, projected, shape);
  const Linearization linear = projection.linearize(rest, shape);
  points += rest.size();
  rows += linear.normals.size();
  touched += linear.normals.size() + linear.partners.size();
  parameters += static_cast<std::size_t>(linear.parameters.cols());
  jacobian += static_cast<std::size_t>(linear.parameters.size());
}

NewtonChoice cheapest_newton(const NewtonSizes& sizes, std::size_t memory_limit) {
  const auto N = static_cast<double>(sizes.points), rows = static_cast<double>(sizes.rows);
  const std::size_t size = 3 * sizes.functions + sizes.parameters;
  const double solution = solution_cost * static_cast<double>(sizes.factor_bytes) / sizeof(double);
  const double bytes = (N * N + rows * rows) * sizeof(double);
  const bool fits = memory_limit == 0 || bytes <= static_cast<double>(memory_limit) / 2;
  // Dense rows: V S^-1 V^T and its spreading to all points, or V^T Q V for six pairs of coordinates.
  const auto u = static_cast<double>(sizes.dense_points), r = static_cast<double>(sizes.functions);
  const bool dense_rows = sizes.dense_points > 0;
  const double compliance = dense_rows ? u * solution + 2 * u * u * r : N * solution;
  const bool in_forces_too = fits && compliance <= affordable_compliance && sizes.rows <= most_forces;
  const double in_forces = in_forces_too ? cube(sizes.rows) : HUGE_VAL;
  const double full = (sizes.dense || dense_rows) && size <= most_full ? cube(size) + 12 * u * r * r : HUGE_VAL;
  const double sparse = sizes.dense || dense_rows ? HUGE_VAL : sparse_newton_cost * sizes.factor_operations;
  const double least = std::min({in_forces, full, sparse});
  if (least > affordable_newton) return {};
  return {least == in_forces ? NewtonForm::forces : least == full ? NewtonForm::full : NewtonForm::sparse, least};
}

int newton_patience(NewtonForm form, double operations, std::size_t factor_bytes, std::size_t entries) {
  constexpr int least_patience = 4, most_patience = 150;
  constexpr double steps_per_round = 1;  // Gauss-Newton matrices that one round of the alternation may cost
  constexpr double dense_speed = 8;      // operations of a factorization in the time of one of a triangular solution
  if (form == NewtonForm::none) return most_patience;
  const double iteration = 12.0 * static_cast<double>(factor_bytes) / sizeof(double) + 40.0 * static_cast<double>(entries);
  const double ratio = steps_per_round * operations / (dense_speed * iteration);
  return static_cast<int>(std::clamp(ratio, double{least_patience}, double{most_patience}));
}

}  // namespace deform
