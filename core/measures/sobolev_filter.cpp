// SPDX-License-Identifier: Apache-2.0
#include "core/measures/sobolev_filter.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/mesh/inspect.h"

namespace deform::measures {

namespace {

constexpr std::size_t row_grain = 4096;

double product(const std::vector<double>& x, const std::vector<double>& y) {
  double sum = 0;
  for (std::size_t begin = 0; begin < x.size(); begin += row_grain) {
    double part = 0;
    for (std::size_t i = begin; i < std::min(x.size(), begin + row_grain); ++i) part += x[i] * y[i];
    sum += part;
  }
  return sum;
}

struct Entry {
  std::uint32_t row, column;
  double value;
};

void check_options(const SobolevOptions& options) {
  if (!std::isfinite(options.length) || !(options.length > 0)) {
    throw Error(ErrorCode::invalid_argument, "length: " + number_digits(options.length) + ", expected a length over 0");
  }
  if (!(options.tolerance >= 1e-15 && options.tolerance <= 0.1)) {
    throw Error(ErrorCode::invalid_argument, "tolerance: " + number_digits(options.tolerance) + ", expected 1e-15 to 0.1");
  }
  check_range(options.iterations, 1, 1000000000, "iterations");
}

}  // namespace

SobolevFilter::SobolevFilter(const Mesh& mesh, std::span<const Vec3> points, const SobolevOptions& options)
    : options_(options), unknown_of_(mesh.point_count(), no_unknown), own_area_(mesh.point_count()) {
  check_options(options);
  if (points.size() != mesh.point_count()) {
    throw Error(ErrorCode::invalid_argument,
                "points: " + std::to_string(points.size()) + ", the mesh has " + std::to_string(mesh.point_count()));
  }
  check_finite(points, "points");
  assemble(chosen_triangles(mesh, options.faces).triangles, points, coincident_points(mesh.points));
}

void SobolevFilter::assemble(std::span<const Triangle> triangles, std::span<const Vec3> points,
                             const std::vector<PointId>& same) {
  constexpr double least_share = 1e-10;
  std::vector<double> mass(points.size());  // by the least point of those that are one
  std::vector<Entry> entries;               // rows and columns are points, still
  entries.reserve(6 * triangles.size());
  for (const Triangle& triangle : triangles) {
    std::array<Vec3, 3> edges;  // edge i is opposite to corner i
    double longest = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      edges[i] = points[triangle[(i + 2) % 3]] - points[triangle[(i + 1) % 3]];
      longest = std::max(longest, dot(edges[i], edges[i]));
    }
    const double twice = length(cross(edges[0], edges[1]));
    if (!(twice / 2 >= least_share * longest) || twice == 0) continue;
    for (std::size_t i = 0; i < 3; ++i) {
      own_area_[triangle[i]] += twice / 6;
      mass[same[triangle[i]]] += twice / 6;
      const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
      const double half_cotangent = -dot(edges[j], edges[k]) / (2 * twice);
      const PointId from = same[triangle[j]], to = same[triangle[k]];
      if (from == to) continue;
      entries.push_back({from, to, -half_cotangent});
      entries.push_back({to, from, -half_cotangent});
    }
  }
  std::vector<std::uint32_t> unknown(points.size(), no_unknown);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (same[i] != i || !(mass[i] > 0)) continue;
    unknown[i] = static_cast<std::uint32_t>(mass_.size());
    mass_.push_back(mass[i]);
  }
  for (std::size_t i = 0; i < points.size(); ++i) unknown_of_[i] = unknown[same[i]];
  // Stable: entries of a place are added in the order of the triangles.
  std::stable_sort(entries.begin(), entries.end(),
                   [](const Entry& s, const Entry& t) { return s.row != t.row ? s.row < t.row : s.column < t.column; });
  diagonal_ = mass_;
  starts_.assign(mass_.size() + 1, 0);
  const double square = options_.length * options_.length;
  for (std::size_t i = 0, end = 0; i < entries.size(); i = end) {
    double value = 0;
    for (end = i; end < entries.size() && entries[end].row == entries[i].row && entries[end].column == entries[i].column; ++end) {
      value += entries[end].value;
    }
    const std::uint32_t row = unknown[entries[i].row];
    columns_.push_back(unknown[entries[i].column]);
    entries_.push_back(square * value);
    diagonal_[row] -= square * value;
    ++starts_[row + 1];
  }
  for (std::size_t i = 0; i < mass_.size(); ++i) starts_[i + 1] += starts_[i];
}

std::vector<double> SobolevFilter::areas() const {
  std::vector<double> areas(point_count());
  for (std::size_t i = 0; i < areas.size(); ++i) {
    if (unknown_of_[i] != no_unknown) areas[i] = mass_[unknown_of_[i]];
  }
  return areas;
}

void SobolevFilter::multiply(const std::vector<double>& x, std::vector<double>& y, const RunContext& context) const {
  parallel_for(context, x.size(), row_grain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) {
      double sum = diagonal_[row] * x[row];
      for (std::uint64_t i = starts_[row]; i < starts_[row + 1]; ++i) sum += entries_[i] * x[columns_[i]];
      y[row] = sum;
    }
  });
}

SobolevFilter::Solution SobolevFilter::solve(const std::vector<double>& b, const RunContext& context) const {
  Solution solution{std::vector<double>(b.size()), 0, 0};
  const double size = std::sqrt(product(b, b));
  if (size == 0) return solution;
  std::vector<double>& x = solution.values;
  std::vector<double> residual = b, scaled(b.size()), direction, image(b.size());
  solution.residual = 1;
  // The residual that is carried along drifts away from the true one: it is computed anew, and goes on from there.
  constexpr int restarts = 4;
  for (int restart = 0; restart < restarts && solution.residual > options_.tolerance; ++restart) {
    double old = 0;
    direction.clear();
    while (std::sqrt(product(residual, residual)) > options_.tolerance * size && solution.iterations < options_.iterations) {
      for (std::size_t i = 0; i < b.size(); ++i) scaled[i] = residual[i] / diagonal_[i];
      const double now = product(residual, scaled);
      if (direction.empty()) {
        direction = scaled;
      } else {
        for (std::size_t i = 0; i < b.size(); ++i) direction[i] = scaled[i] + now / old * direction[i];
      }
      old = now;
      multiply(direction, image, context);
      const double step = now / product(direction, image);
      for (std::size_t i = 0; i < b.size(); ++i) {
        x[i] += step * direction[i];
        residual[i] -= step * image[i];
      }
      ++solution.iterations;
    }
    multiply(x, image, context);
    for (std::size_t i = 0; i < b.size(); ++i) residual[i] = b[i] - image[i];
    solution.residual = std::sqrt(product(residual, residual)) / size;
  }
  return solution;
}

Filtered SobolevFilter::apply(std::span<const double> field, std::size_t components, SobolevForm form,
                              const RunContext& context) const {
  const std::size_t n = point_count();
  if (components == 0 || field.size() != n * components) {
    throw Error(ErrorCode::invalid_argument, "field: " + std::to_string(field.size()) + " numbers, expected " +
                                                 std::to_string(n) + " times the number of components");
  }
  for (std::size_t i = 0; i < field.size(); ++i) {
    if (!std::isfinite(field[i]))
      throw Error(ErrorCode::invalid_argument, "field[" + std::to_string(i / components) + "]: not a finite number");
  }
  Filtered filtered;
  filtered.field.resize(field.size());
  std::vector<double> right(mass_.size());
  for (std::size_t c = 0; c < components; ++c) {
    std::fill(right.begin(), right.end(), 0.0);
    for (std::size_t i = 0; i < n; ++i) {
      if (unknown_of_[i] == no_unknown) continue;
      const double given = field[i * components + c];
      right[unknown_of_[i]] += form == SobolevForm::density ? own_area_[i] * given : given;
    }
    const Solution solution = solve(right, context);
    filtered.residual = std::max(filtered.residual, solution.residual);
    filtered.iterations += solution.iterations;
    for (std::size_t i = 0; i < n; ++i) {
      double& result = filtered.field[i * components + c];
      if (unknown_of_[i] == no_unknown) {
        result = form == SobolevForm::derivative ? 0 : field[i * components + c];
      } else {
        result = solution.values[unknown_of_[i]] * (form == SobolevForm::transposed ? own_area_[i] : 1);
      }
    }
  }
  filtered.converged = filtered.residual <= 1.01 * options_.tolerance;
  return filtered;
}

}  // namespace deform::measures
