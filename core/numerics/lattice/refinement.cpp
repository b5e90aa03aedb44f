// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/lattice/refinement.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr double same_distance = 1e-9;  // of the axis: distances at rest that are equal but for rounding

SplineAxis finer(LatticeBasis basis, const SplineAxis& coarse) {
  if (basis != LatticeBasis::bernstein) return {basis, 2 * coarse.size() - coarse.degree()};
  if (coarse.size() >= SplineAxis::most_bernstein_points) {
    throw Error(ErrorCode::invalid_argument,
                "an axis of " + std::to_string(coarse.size()) + " Bernstein polynomials, which is the largest number there is");
  }
  return {basis, coarse.size() + 1};
}

/// The blossom of the piece of a cubic spline over a span, at three arguments: weights of the four control points from `span` on
/// (de Boor's algorithm with another argument in each of its rounds).
std::vector<double> blossom(const SplineAxis& axis, std::size_t span, const std::array<double, 3>& at) {
  constexpr std::size_t degree = 3;
  std::array<std::array<double, degree + 1>, degree + 1> d{};
  for (std::size_t j = 0; j <= degree; ++j) d[j][j] = 1;
  for (std::size_t round = 1; round <= degree; ++round) {
    for (std::size_t j = degree; j >= round; --j) {
      const double low = axis.knot(span + j), high = axis.knot(span + j + degree + 1 - round);
      const double part = (at[round - 1] - low) / (high - low);
      for (std::size_t k = 0; k <= degree; ++k) d[j][k] = (1 - part) * d[j - 1][k] + part * d[j][k];
    }
  }
  return {d[degree].begin(), d[degree].end()};
}

}  // namespace

AxisRefinement::AxisRefinement(LatticeBasis basis, const SplineAxis& coarse) : fine_(finer(basis, coarse)) {
  const std::size_t count = fine_.size();
  for (std::size_t i = 0; i < count; ++i) {
    if (basis == LatticeBasis::bernstein) {
      const double part = static_cast<double>(i) / static_cast<double>(count - 1);
      if (i == 0) {
        rows_.push_back({0, {1}});
      } else if (i + 1 == count) {
        rows_.push_back({coarse.size() - 1, {1}});
      } else {
        rows_.push_back({i - 1, {part, 1 - part}});
      }
      continue;
    }
    // A span in which the spline of this control point is not zero.
    const std::size_t span = std::min(i < 2 ? 0 : i - 2, fine_.spans() - 1) / 2;
    rows_.push_back({span, blossom(coarse, span, {fine_.knot(i + 1), fine_.knot(i + 2), fine_.knot(i + 3)})});
  }
  find_parents(coarse);
}

void AxisRefinement::find_parents(const SplineAxis& coarse) {
  parents_.resize(fine_.size());
  for (std::size_t a = 0; a < coarse.size(); ++a) {
    double least = HUGE_VAL;
    const auto away = [&](std::size_t i) { return std::abs(fine_.greville(i) - coarse.greville(a)); };
    for (std::size_t i = 0; i < fine_.size(); ++i) least = std::min(least, away(i));
    for (std::size_t i = 0; i < fine_.size(); ++i) {
      if (away(i) <= least + same_distance) parents_[i].push_back(a);
    }
  }
  for (std::size_t i = 0; i < fine_.size(); ++i) {
    if (!parents_[i].empty()) continue;
    std::size_t behind = 0;
    while (coarse.greville(behind) < fine_.greville(i)) ++behind;
    parents_[i] = {behind - 1, behind};
  }
}

LatticeRefinement::LatticeRefinement(const Lattice& coarse, LatticeBasis basis, const std::array<bool, 3>& axes) : fine_(coarse) {
  std::array<std::size_t, 3> sizes{};
  for (std::size_t k = 0; k < 3; ++k) {
    sizes_[k] = sizes[k] = coarse.axis(k).size();
    if (!axes[k]) continue;
    axes_[k].emplace_back(basis, coarse.axis(k));
    sizes[k] = axes_[k][0].fine().size();
  }
  fine_ = Lattice(coarse.frame(), sizes, basis);
}

std::vector<Vec3> LatticeRefinement::refined(std::span<const Vec3> values) const {
  if (values.size() != sizes_[0] * sizes_[1] * sizes_[2]) {
    throw Error(ErrorCode::invalid_argument,
                std::to_string(values.size()) + " values for a lattice of " + std::to_string(sizes_[0] * sizes_[1] * sizes_[2]));
  }
  std::vector<Vec3> now(values.begin(), values.end());
  std::size_t below = 1;  // control points that stand between two neighbours along the axis
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t before = sizes_[k], count = fine_.axis(k).size();
    if (!axes_[k].empty()) {
      const std::size_t above = now.size() / (below * before);
      std::vector<Vec3> next(below * count * above, Vec3{});
      for (std::size_t c = 0; c < above; ++c) {
        for (std::size_t i = 0; i < count; ++i) {
          const AxisRefinement::Row& row = axes_[k][0].row(i);
          for (std::size_t j = 0; j < row.weights.size(); ++j) {
            for (std::size_t a = 0; a < below; ++a) {
              Vec3& sum = next[a + below * (i + count * c)];
              sum = sum + row.weights[j] * now[a + below * (row.first + j + before * c)];
            }
          }
        }
      }
      now = std::move(next);
    }
    below *= count;
  }
  return now;
}

std::vector<std::size_t> LatticeRefinement::refined_selection(std::span<const std::size_t> ids) const {
  std::vector<char> selected(sizes_[0] * sizes_[1] * sizes_[2], 0);
  for (const std::size_t id : ids) selected.at(id) = 1;
  const auto parents = [&](std::size_t k, std::size_t i) {
    return axes_[k].empty() ? std::vector<std::size_t>{i} : axes_[k][0].parents(i);
  };
  std::vector<std::size_t> result;
  const std::size_t l = fine_.axis(0).size(), m = fine_.axis(1).size();
  for (std::size_t p = 0; p < fine_.size(); ++p) {
    bool all = true;
    for (const std::size_t k : parents(2, p / l / m)) {
      for (const std::size_t j : parents(1, p / l % m)) {
        for (const std::size_t i : parents(0, p % l)) all = all && selected[i + sizes_[0] * (j + sizes_[1] * k)] != 0;
      }
    }
    if (all) result.push_back(p);
  }
  return result;
}

}  // namespace deform
