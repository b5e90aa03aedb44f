// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/compact_levels.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "core/base/parallel.h"
#include "core/numerics/kernels/tiles.h"
#include "core/numerics/sampling/point_tree.h"

namespace deform {

namespace {

constexpr double coincident = 1e-12;
constexpr double alike = 1e-9;       // rounding decides nothing on regular meshes, so that levels are the same in other units
constexpr double radius_of_gap = 2;  // the spacing is half the gap
constexpr std::size_t places_per_task = 256;

/// Wendland's C2 function of a distance that is smaller than the radius.
double compact(double square, double radius) {
  const double q = std::sqrt(square) / radius;
  const double t = (1 - q) * (1 - q);
  return t * t * (4 * q + 1);
}

/// The places as levels take them one after the other.
class LevelChoice {
 public:
  LevelChoice(const LevelPlaces& from, const RunContext& context)
      : from_(from), gap_(distances(from.known, context)), taken_(from.places.size()) {
    std::vector<std::uint32_t> bound;
    double widest = 0;
    for (std::size_t i = 0; i < from_.places.size(); ++i) {
      if (!from_.bound[i]) continue;
      bound.push_back(static_cast<std::uint32_t>(i));
      widest = std::max(widest, gap_[i]);
    }
    distance_ = distances(bound, context);
    for (const std::uint32_t i : from_.known) taken_[i] = 1;
    std::vector<Vec3> places;
    for (std::size_t i = 0; i < from_.places.size(); ++i) {
      if (distance_[i] > (1 + alike) * radius_of_gap * widest) continue;
      candidates_.push_back(static_cast<std::uint32_t>(i));
      places.push_back(from_.places[i]);
    }
    near_.emplace(places);
  }

  /// The largest distance of a bound place from those that are taken.
  double gap() const {
    double result = 0;
    for (const std::uint32_t i : candidates_) {
      if (from_.bound[i]) result = std::max(result, gap_[i]);
    }
    return result;
  }

  CompactLevel next(double gap, const RunContext& context) {
    CompactLevel level{radius_of_gap * gap, {}};
    std::vector<PointTree::Near> near;
    std::vector<std::uint32_t> fresh;
    for (const std::uint32_t i : candidates_) {
      if (taken_[i] || gap_[i] < (1 - alike) * gap / 2 || distance_[i] > (1 + alike) * level.radius) continue;
      taken_[i] = 1;
      fresh.push_back(i);
      if (fresh.size() % 256 == 0) context.check();
      near_->within(from_.places[i], gap * gap, near);
      for (const auto& [other, square] : near) {
        double& own = gap_[candidates_[other]];
        own = std::min(own, std::sqrt(square));
      }
    }
    level.members = next_to(fresh, level.radius);
    return level;
  }

 private:
  /// The distance of each place from the nearest of some.
  std::vector<double> distances(std::span<const std::uint32_t> some, const RunContext& context) const {
    std::vector<double> result(from_.places.size(), std::numeric_limits<double>::infinity());
    if (some.empty()) return result;
    std::vector<Vec3> places;
    for (const std::uint32_t i : some) places.push_back(from_.places[i]);
    const PointTree tree(places);
    parallel_for(context, result.size(), places_per_task, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) result[i] = std::sqrt(tree.nearest(from_.places[i]).square);
    });
    return result;
  }

  /// The fresh places and the taken ones whose functions overlap with theirs, directly or by way of others.
  std::vector<std::uint32_t> next_to(const std::vector<std::uint32_t>& fresh, double radius) const {
    std::vector<std::uint32_t> result = fresh;  // those behind `open` are still to be looked around
    std::vector<char> reached(taken_.size());
    for (const std::uint32_t i : fresh) reached[i] = 1;
    std::vector<PointTree::Near> near;
    for (std::size_t open = 0; open < result.size(); ++open) {
      near_->within(from_.places[result[open]], (1 + alike) * radius * radius, near);
      for (const auto& [candidate, square] : near) {
        const std::uint32_t i = candidates_[candidate];
        if (!taken_[i] || reached[i] || distance_[i] > (1 + alike) * radius) continue;
        reached[i] = 1;
        result.push_back(i);
      }
    }
    std::sort(result.begin(), result.end());
    return result;
  }

  const LevelPlaces from_;
  std::vector<double> gap_;       ///< of each place: distance from those that are taken
  std::vector<double> distance_;  ///< of each place from the nearest bound one
  std::vector<char> taken_;
  std::vector<std::uint32_t> candidates_;
  std::optional<PointTree> near_;  ///< of the candidates
};

NearCells cells_of(std::span<const Vec3> places, const CompactLevel& level) {
  std::vector<Vec3> own;
  own.reserve(level.members.size());
  for (const std::uint32_t i : level.members) own.push_back(places[i]);
  return {own, level.radius};
}

}  // namespace

std::vector<CompactLevel> choose_levels(const LevelPlaces& from, const RunContext& context) {
  std::vector<CompactLevel> levels;
  LevelChoice choice(from, context);
  double gap = choice.gap();
  if (std::isinf(gap)) gap = bounding_box(from.places).diagonal() / 8;  // nothing is known
  while (gap > coincident) {
    levels.push_back(choice.next(gap, context));
    gap = choice.gap();
  }
  return levels;
}

SparseMatrix level_matrix(const NearCells& cells) {
  const auto count = static_cast<std::int64_t>(cells.size());
  SparseMatrix result(count, count);
  std::vector<std::int64_t> entries(cells.size());
  const auto column = [&](std::int64_t i, const auto& use) {
    cells.for_each(cells.points()[static_cast<std::size_t>(i)], [&](std::uint32_t j, double square) {
      if (j >= i) use(j, square);
    });
  };
  for (std::int64_t i = 0; i < count; ++i) column(i, [&](std::uint32_t, double) { ++entries[static_cast<std::size_t>(i)]; });
  result.reserve(entries);
  for (std::int64_t i = 0; i < count; ++i) {
    column(i, [&](std::uint32_t j, double square) { result.insert(j, i) = compact(square, cells.radius()); });
  }
  result.makeCompressed();
  return result;
}

CompactLevels::CompactLevels(std::span<const Vec3> places, std::vector<CompactLevel> levels, const RunContext& context) {
  for (const CompactLevel& level : levels) used_.insert(used_.end(), level.members.begin(), level.members.end());
  std::sort(used_.begin(), used_.end());
  used_.erase(std::unique(used_.begin(), used_.end()), used_.end());
  for (const std::uint32_t i : used_) used_places_.push_back(places[i]);
  last_level_.resize(used_.size());
  for (std::size_t l = 0; l < levels.size(); ++l) {
    std::vector<std::uint32_t> members;
    for (const std::uint32_t i : levels[l].members) {
      members.push_back(static_cast<std::uint32_t>(std::lower_bound(used_.begin(), used_.end(), i) - used_.begin()));
      last_level_[members.back()] = static_cast<std::uint32_t>(l);
    }
    NearCells cells = cells_of(places, levels[l]);
    SparseCholesky factor(level_matrix(cells), context);
    levels_.push_back({std::move(cells), std::move(members), rows_, std::move(factor)});
    rows_ += levels_.back().members.size();
  }
}

std::size_t CompactLevels::bytes() const {
  std::size_t bytes = used_.size() * (2 * sizeof(std::uint32_t) + sizeof(Vec3));
  for (const Level& level : levels_) {
    bytes += level.cells.bytes() + level.members.size() * sizeof(std::uint32_t) + level.factor.bytes();
  }
  return bytes;
}

CompactLevels::Bytes CompactLevels::estimate(std::span<const Vec3> places, std::span<const CompactLevel> levels) {
  constexpr std::size_t entry = sizeof(double) + sizeof(std::int64_t);
  Bytes bytes;
  for (const CompactLevel& level : levels) {
    const NearCells cells = cells_of(places, level);
    const SparseMatrix matrix = level_matrix(cells);
    const SparseCholesky::Estimate factor = SparseCholesky::estimate(matrix);
    // Their positions, and at most those of used() with its places, which whoever evaluates holds in tiles as well.
    const std::size_t own = level.members.size() * (3 * sizeof(std::uint32_t) + 2 * sizeof(Vec3));
    const std::size_t entries = static_cast<std::size_t>(matrix.nonZeros()) * entry;
    bytes.peak = std::max(bytes.peak, bytes.resident + cells.bytes() + own + 2 * entries + factor.peak_bytes);
    bytes.resident += cells.bytes() + own + factor.factor_bytes;
  }
  bytes.peak = std::max(bytes.peak, bytes.resident);
  return bytes;
}

Eigen::MatrixXd CompactLevels::coefficients(const Eigen::MatrixXd& values, const RunContext& context) const {
  Eigen::MatrixXd left = values, result(static_cast<Eigen::Index>(rows_), values.cols());
  for (std::size_t l = 0; l < levels_.size(); ++l) {
    context.check();
    const Level& level = levels_[l];
    const auto count = static_cast<Eigen::Index>(level.members.size());
    Eigen::MatrixXd own(count, values.cols());
    for (Eigen::Index j = 0; j < count; ++j) own.row(j) = left.row(level.members[static_cast<std::size_t>(j)]);
    level.factor.solve_in_place(own);
    result.middleRows(static_cast<Eigen::Index>(level.first), count) = own;
    parallel_for(context, used_.size(), places_per_task, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        if (last_level_[i] <= l) continue;
        level.cells.for_each(used_places_[i], [&](std::uint32_t j, double square) {
          left.row(static_cast<Eigen::Index>(i)) -= compact(square, level.cells.radius()) * own.row(j);
        });
      }
    });
  }
  return result;
}

void CompactLevels::add_values(const double* tile, const double* coefficients, std::size_t columns, double* out) const {
  for (std::size_t i = 0; i < tile_size; ++i) {
    const Vec3 x{tile[i], tile[tile_size + i], tile[2 * tile_size + i]};
    for (const Level& level : levels_) {
      level.cells.for_each(x, [&](std::uint32_t j, double square) {
        const double value = compact(square, level.cells.radius());
        const double* const of = coefficients + (level.first + j) * columns;
        for (std::size_t c = 0; c < columns; ++c) out[c * tile_size + i] += value * of[c];
      });
    }
  }
}

double CompactLevels::rounding(const double* coefficients, std::size_t stride, std::span<const Vec3> at) const {
  constexpr double unit = 4 * std::numeric_limits<double>::epsilon();
  double largest = 0;
  for (const Vec3& x : at) {
    double size = 0;
    for (const Level& level : levels_) {
      level.cells.for_each(x, [&](std::uint32_t j, double square) {
        size += compact(square, level.cells.radius()) * std::abs(coefficients[(level.first + j) * stride]);
      });
    }
    largest = std::max(largest, size);
  }
  return unit * largest;
}

/// Backwards through coefficients(): what level l leaves at the places of later levels depends on its coefficients.
Eigen::MatrixXd CompactLevels::adjoint(std::span<const Vec3> points, std::span<const Vec3> X, const RunContext& context) const {
  std::vector<Eigen::MatrixXd> back(levels_.size());
  parallel_for(context, levels_.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t l = begin; l < end; ++l) {
      const Level& level = levels_[l];
      back[l] = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(level.members.size()), 3);
      for (std::size_t i = 0; i < points.size(); ++i) {
        level.cells.for_each(points[i], [&](std::uint32_t j, double square) {
          const double value = compact(square, level.cells.radius());
          for (Eigen::Index k = 0; k < 3; ++k) back[l](j, k) += value * X[i][static_cast<std::size_t>(k)];
        });
      }
    }
  });
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(used_.size()), 3);
  for (std::size_t l = levels_.size(); l-- > 0;) {
    context.check();
    const Level& level = levels_[l];
    for (std::size_t i = 0; i < used_.size(); ++i) {
      if (last_level_[i] <= l) continue;
      level.cells.for_each(used_places_[i], [&](std::uint32_t j, double square) {
        back[l].row(j) -= compact(square, level.cells.radius()) * result.row(static_cast<Eigen::Index>(i));
      });
    }
    level.factor.solve_in_place(back[l]);
    for (std::size_t j = 0; j < level.members.size(); ++j) {
      result.row(level.members[j]) += back[l].row(static_cast<Eigen::Index>(j));
    }
  }
  return result;
}

}  // namespace deform
