// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/constrained_points.h"

#include <algorithm>
#include <span>
#include <utility>

#include "core/base/vectors.h"
#include "core/deformers/constrained/sparse_sum.h"

namespace deform {

std::vector<std::int64_t> functions_reaching(const FunctionRows& values, const std::vector<ConstraintSet>& sets) {
  std::vector<bool> reaches(static_cast<std::size_t>(values.cols()), false);
  for (const ConstraintSet& set : sets) {
    for (const PointId id : set.ids) {
      values.for_each(id, [&](std::int64_t column, double) { reaches[static_cast<std::size_t>(column)] = true; });
    }
  }
  std::vector<std::int64_t> result;
  for (std::size_t j = 0; j < reaches.size(); ++j) {
    if (reaches[j]) result.push_back(static_cast<std::int64_t>(j));
  }
  return result;
}

ConstrainedPoints::ConstrainedPoints(std::vector<ConstraintSet> sets, const FunctionRows& values, const ReducedEnergy& energy)
    : sets_(std::move(sets)), first_{0} {
  const auto r = static_cast<std::int64_t>(energy.size());
  std::vector<std::int64_t> place(static_cast<std::size_t>(values.cols()), -1);
  for (std::int64_t i = 0; i < r; ++i) place[static_cast<std::size_t>(energy.function(static_cast<std::size_t>(i)))] = i;
  std::vector<Eigen::Triplet<double, std::int64_t>> rows;
  SparseSum sum(r);
  for (const ConstraintSet& set : sets_) {
    const auto row_of = [&](std::size_t i) { return static_cast<std::int64_t>(first_.back() + i); };
    if (set.column) {
      set.column->for_each_row([&](std::size_t row, std::span<const StretchedColumn::Entry> entries) {
        sum.clear();
        for (const auto& [point, factor] : entries) {
          values.for_each(set.ids[point], [&, by = factor](std::int64_t column, double value) {
            sum.add(place[static_cast<std::size_t>(column)], by * value);
          });
        }
        for (const std::int64_t column : sum.places()) rows.emplace_back(row_of(row), column, sum.value(column));
      });
    } else {
      for (std::size_t i = 0; i < set.ids.size(); ++i) {
        values.for_each(set.ids[i], [&](std::int64_t column, double value) {
          rows.emplace_back(row_of(i), place[static_cast<std::size_t>(column)], value);
        });
      }
    }
    first_.push_back(first_.back() + set.ids.size());
  }
  phi_.resize(static_cast<std::int64_t>(count()), r);
  phi_.setFromTriplets(rows.begin(), rows.end());
  transposed_ = SparseMatrix(phi_.transpose());
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    for (std::size_t i = first_[t]; i < first_[t + 1]; ++i) {
      for (SparseMatrix::InnerIterator it(transposed_, static_cast<std::int64_t>(i)); it; ++it) {
        it.valueRef() *= weight_per_point(t);
      }
    }
  }
}

std::size_t ConstrainedPoints::bytes() const {
  std::size_t bytes = sparse_bytes(phi_) + sparse_bytes(transposed_) + count() * (sizeof(Vec3) + sizeof(PointId));
  for (const ConstraintSet& set : sets_) bytes += set.column ? set.ids.size() * StretchedColumn::point_bytes : 0;
  return bytes;
}

template <typename Map>
std::vector<Vec3> ConstrainedPoints::with_columns(std::vector<Vec3> x, const Map& map) const {
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    if (!sets_[t].column) continue;
    const std::vector<Vec3> y = map(*sets_[t].column, std::span<const Vec3>(x.data() + first(t), size(t)));
    std::copy(y.begin(), y.end(), x.begin() + static_cast<std::ptrdiff_t>(first(t)));
  }
  return x;
}

std::vector<Vec3> ConstrainedPoints::stretched(std::vector<Vec3> x) const {
  return with_columns(std::move(x),
                      [](const StretchedColumn& column, std::span<const Vec3> own) { return column.stretched(own); });
}

std::vector<Vec3> ConstrainedPoints::stretched_adjoint(std::vector<Vec3> y) const {
  return with_columns(std::move(y), [](const StretchedColumn& column, std::span<const Vec3> own) { return column.adjoint(own); });
}

std::vector<Vec3> ConstrainedPoints::mesh_points(std::size_t set, const std::vector<Vec3>& points) const {
  const std::span<const Vec3> own{points.data() + first(set), size(set)};
  return sets_[set].column ? sets_[set].column->unstretched(own) : std::vector<Vec3>(own.begin(), own.end());
}

std::vector<Vec3> ConstrainedPoints::displacements(const Eigen::MatrixXd& v) const {
  std::vector<Vec3> result(count(), Vec3{});
  for (std::size_t i = 0; i < result.size(); ++i) {
    for (SparseRows::InnerIterator it(phi_, static_cast<std::int64_t>(i)); it; ++it) {
      for (std::size_t k = 0; k < 3; ++k) result[i][k] += it.value() * v(it.col(), static_cast<Eigen::Index>(k));
    }
  }
  return result;
}

Eigen::MatrixXd ConstrainedPoints::weighted_sums(const std::vector<Vec3>& y) const {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(transposed_.rows(), 3);
  for (std::size_t i = 0; i < y.size(); ++i) {
    for (SparseMatrix::InnerIterator it(transposed_, static_cast<std::int64_t>(i)); it; ++it) {
      for (Eigen::Index k = 0; k < 3; ++k) result(it.row(), k) += it.value() * y[i][static_cast<std::size_t>(k)];
    }
  }
  return result;
}

std::vector<Vec3> ConstrainedPoints::projection_residual_change(const std::vector<Vec3>& points,
                                                                const std::vector<ShapeParameters>& shapes,
                                                                const std::vector<Vec3>& dx) const {
  std::vector<Vec3> result(dx.size());
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    const std::size_t begin = first(t), count = size(t);
    sets_[t].solved_projection().derivative({points.data() + begin, count}, shapes[t], {dx.data() + begin, count},
                                            {result.data() + begin, count});
  }
  for (std::size_t i = 0; i < dx.size(); ++i) result[i] = dx[i] - result[i];
  return result;
}

}  // namespace deform
