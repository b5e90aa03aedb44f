// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/constrained_points.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "core/base/vectors.h"
#include "core/deformers/constrained/sparse_sum.h"

namespace deform {

std::vector<std::int64_t> functions_reaching(const FunctionRows& values, const std::vector<ConstraintSet>& sets,
                                             const DeliveredRows* delivered) {
  std::vector<bool> reaches(static_cast<std::size_t>(values.cols()), false);
  for (const ConstraintSet& set : sets) {
    for (const PointId id : set.ids) {
      values.for_each(id, [&](std::int64_t column, double) { reaches[static_cast<std::size_t>(column)] = true; });
    }
  }
  if (delivered != nullptr) {
    for (const std::int64_t column : delivered->functions) reaches[static_cast<std::size_t>(column)] = true;
  }
  std::vector<std::int64_t> result;
  for (std::size_t j = 0; j < reaches.size(); ++j) {
    if (reaches[j]) result.push_back(static_cast<std::int64_t>(j));
  }
  return result;
}

namespace {

/// For each of k functions its place among those of the energy, or -1; without one those places themselves.
std::vector<std::int64_t> places_of(std::int64_t functions, const ReducedEnergy* energy) {
  std::vector<std::int64_t> place(static_cast<std::size_t>(functions), -1);
  const auto count = energy != nullptr ? static_cast<std::int64_t>(energy->size()) : functions;
  for (std::int64_t i = 0; i < count; ++i) {
    place[static_cast<std::size_t>(energy != nullptr ? energy->function(static_cast<std::size_t>(i)) : i)] = i;
  }
  return place;
}

}  // namespace

DeliveredRows::Form DeliveredRows::form(std::size_t points, std::size_t reaching, std::size_t functions,
                                        std::size_t factor_entries) {
  const bool chosen = ReducedEnergy::is_dense(reaching, functions);
  const std::size_t r = chosen ? reaching : functions;
  if (r <= most_functions && points * r <= most_entries) return Form::functions;
  const bool fits = points * functions <= most_entries && ReducedEnergy::affordable_basis(points, functions, factor_entries);
  return fits ? Form::basis : Form::none;
}

void DeliveredRows::take_points(const std::vector<ConstraintSet>& sets, const std::vector<bool>& held) {
  for (const ConstraintSet& set : sets) {
    for (const PointId id : set.ids) {
      if (set.column) columns.push_back(id);
      if (!set.column && !held[id]) ids.push_back(id);
    }
  }
  for (std::vector<PointId>* some : {&ids, &columns}) {
    std::sort(some->begin(), some->end());
    some->erase(std::unique(some->begin(), some->end()), some->end());
  }
}

std::size_t DeliveredRows::row_of(const ConstraintSet& set, PointId id) const {
  const std::vector<PointId>& some = set.column ? columns : ids;
  const auto found = std::lower_bound(some.begin(), some.end(), id);
  if (found == some.end() || *found != id) return points();
  return static_cast<std::size_t>(found - some.begin()) + (set.column ? ids.size() : 0);
}

Eigen::MatrixXd DeliveredRows::values(const FunctionRows& values, const ReducedEnergy* energy) const {
  const std::vector<std::int64_t> place = places_of(values.cols(), energy);
  const auto size = static_cast<Eigen::Index>(energy != nullptr ? static_cast<std::int64_t>(energy->size()) : values.cols());
  Eigen::MatrixXd V = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(points()), size);
  for (std::size_t f = 0; f < functions.size(); ++f) {
    V.col(place[static_cast<std::size_t>(functions[f])]).head(interpolated.rows()) =
        -interpolated.col(static_cast<Eigen::Index>(f));
  }
  for (std::size_t u = 0; u < points(); ++u) {
    values.for_each(point(u), [&](std::int64_t column, double value) {
      V(static_cast<Eigen::Index>(u), place[static_cast<std::size_t>(column)]) += value;
    });
  }
  return V;
}

ConstrainedPoints::ConstrainedPoints(std::vector<ConstraintSet> sets, const FunctionRows& values, const ReducedEnergy& energy,
                                     const DeliveredRows* delivered, Eigen::MatrixXd all)
    : energy_(energy), sets_(std::move(sets)), first_{0}, all_(std::move(all)) {
  const auto r = static_cast<std::int64_t>(energy.size());
  for (const ConstraintSet& set : sets_) first_.push_back(first_.back() + set.ids.size());
  phi_.resize(static_cast<std::int64_t>(count()), r);
  transposed_.resize(r, static_cast<std::int64_t>(count()));
  if (delivered != nullptr) {
    make_dense(values, *delivered);
  } else {
    make_sparse(values, places_of(values.cols(), &energy));
  }
}

/// Calls use(row, set, entries) for each row of Phi, where entries are places of points in the set with their factors.
template <typename Use>
void ConstrainedPoints::for_each_row(const Use& use) const {
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    const ConstraintSet& set = sets_[t];
    const auto row_of = [&](std::size_t i) { return static_cast<std::int64_t>(first_[t] + i); };
    if (set.column) {
      set.column->for_each_row(
          [&](std::size_t row, std::span<const StretchedColumn::Entry> entries) { use(row_of(row), set, entries); });
      continue;
    }
    for (std::size_t i = 0; i < set.ids.size(); ++i) {
      const StretchedColumn::Entry entry{static_cast<std::uint32_t>(i), 1.0};
      use(row_of(i), set, std::span<const StretchedColumn::Entry>(&entry, 1));
    }
  }
}

void ConstrainedPoints::make_sparse(const FunctionRows& values, const std::vector<std::int64_t>& place) {
  std::vector<Eigen::Triplet<double, std::int64_t>> rows;
  SparseSum sum(phi_.cols());
  for_each_row([&](std::int64_t row, const ConstraintSet& set, std::span<const StretchedColumn::Entry> entries) {
    if (!set.column) {
      values.for_each(set.ids[entries[0].first], [&](std::int64_t column, double value) {
        rows.emplace_back(row, place[static_cast<std::size_t>(column)], value);
      });
      return;
    }
    sum.clear();
    for (const auto& [point, factor] : entries) {
      values.for_each(set.ids[point], [&, by = factor](std::int64_t column, double value) {
        sum.add(place[static_cast<std::size_t>(column)], by * value);
      });
    }
    for (const std::int64_t column : sum.places()) rows.emplace_back(row, column, sum.value(column));
  });
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

void ConstrainedPoints::make_dense(const FunctionRows& values, const DeliveredRows& delivered) {
  std::vector<Eigen::Triplet<double, std::int64_t>> entries;
  for (std::size_t u = 0; u < delivered.points(); ++u) {
    values.for_each(delivered.point(u), [&](std::int64_t column, double value) {
      entries.emplace_back(static_cast<std::int64_t>(u), column, value);
    });
  }
  alone_.resize(static_cast<std::int64_t>(delivered.points()), values.cols());
  alone_.setFromTriplets(entries.begin(), entries.end());
  entries.clear();
  Eigen::MatrixXd V = all_.size() > 0 ? dense_product(all_, energy_.basis()) : delivered.values(values, &energy_);
  for_each_row([&](std::int64_t row, const ConstraintSet& set, std::span<const StretchedColumn::Entry> of) {
    for (const auto& [point, factor] : of) {
      const std::size_t u = delivered.row_of(set, set.ids[point]);
      if (u < delivered.points()) entries.emplace_back(row, static_cast<std::int64_t>(u), factor);
    }
  });
  SparseRows spread(static_cast<std::int64_t>(count()), V.rows());
  spread.setFromTriplets(entries.begin(), entries.end());
  dense_.emplace(std::move(V), std::move(spread));
}

std::size_t ConstrainedPoints::entries() const {
  return dense_ ? static_cast<std::size_t>(dense_->values().size()) : static_cast<std::size_t>(phi_.nonZeros());
}

std::size_t ConstrainedPoints::bytes() const {
  std::size_t bytes = sparse_bytes(phi_) + sparse_bytes(transposed_) + count() * (sizeof(Vec3) + sizeof(PointId));
  if (dense_) bytes += dense_->bytes() + sparse_bytes(alone_) + static_cast<std::size_t>(all_.size()) * sizeof(double);
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
  if (dense_) return dense_->times(v);
  std::vector<Vec3> result(count(), Vec3{});
  for (std::size_t i = 0; i < result.size(); ++i) {
    for (SparseRows::InnerIterator it(phi_, static_cast<std::int64_t>(i)); it; ++it) {
      for (std::size_t k = 0; k < 3; ++k) result[i][k] += it.value() * v(it.col(), static_cast<Eigen::Index>(k));
    }
  }
  return result;
}

std::vector<Vec3> ConstrainedPoints::displacements_of_all(const Eigen::MatrixXd& w) const {
  return all_.size() > 0 ? dense_->spread_out(dense_product(all_, w)) : displacements(energy_.restricted(w));
}

double ConstrainedPoints::reach(const Eigen::MatrixXd& v) const {
  double squares = 0;
  for (const Vec3& u : displacements(v)) squares += dot(u, u);
  const double result = std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, count())));
  if (!dense_ || alone_.rows() == 0) return result;
  const Eigen::MatrixXd alone = alone_ * energy_.spread(v);
  return std::max(result, alone.norm() / std::sqrt(static_cast<double>(alone_.rows())));
}

Eigen::MatrixXd ConstrainedPoints::weighted_sums(const std::vector<Vec3>& y) const {
  if (dense_) {
    std::vector<Vec3> weighted = y;
    for (std::size_t t = 0; t < sets_.size(); ++t) {
      for (std::size_t i = first_[t]; i < first_[t + 1]; ++i) weighted[i] = weight_per_point(t) * y[i];
    }
    return dense_->transposed_times(weighted);
  }
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
