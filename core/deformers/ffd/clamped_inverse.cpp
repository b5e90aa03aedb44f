// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/ffd/clamped_inverse.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

// Below 1e-8 rounding is multiplied to more than 1e-7 of the motion.
constexpr double candidates_per_decade = 4, first_decade = 1, last_decade = 8;
// Fractions of the prescribed values: what keeping control points back may cost, and where the L-curve says nothing.
constexpr double negligible_misfit = 1e-6, bearable_misfit = 3e-5;
// The same if control points then keep within most_motion; less is not worth it.
constexpr double dear_misfit = 1e-5;
// The standard deviation of the entries of what the decomposition changes a matrix by, in the bases of its singular vectors, over
// epsilon times its largest singular value: 0.002 to 0.004 for matrices of 200 to 900 columns.
constexpr double decomposition_change = 0.004;
constexpr double beside_gap = 2;     // times the smallest singular value in use, or divided by it
constexpr double away_growth = 1.5;  // of what pairs of singular values that are farther apart change, over that of values apart
constexpr double largest_of_many = 2;  // over the standard deviation

std::vector<std::int64_t> reached(const FunctionRows& rows, const std::vector<PointId>& held) {
  std::vector<std::int64_t> result = reached_functions(rows, held);
  if (result.size() > ClampedInverse::most_functions) {
    throw Error(ErrorCode::invalid_argument, std::to_string(result.size()) +
                                                 " control points reach handles and fixed regions, at most " +
                                                 std::to_string(ClampedInverse::most_functions) + " can be decomposed");
  }
  return result;
}

}  // namespace

/// By the first function: rows of one cell have the same ones. Points outside have none and are left out.
std::vector<ClampedInverse::Group> ClampedInverse::groups_of(const FunctionRows& rows, const std::vector<PointId>& held) {
  std::vector<Group> groups;
  Eigen::Index next = 0;
  for (auto& [first, points] : points_by_function(rows, held)) {
    Group group;
    group.points = points;
    const std::size_t functions = rows.count(held[static_cast<std::size_t>(group.points[0])]);
    group.first = next;
    group.rows = static_cast<Eigen::Index>(std::min(functions, group.points.size()));
    next += group.rows;
    groups.push_back(std::move(group));
  }
  return groups;
}

ClampedInverse::ClampedInverse(const FunctionRows& rows, const std::vector<PointId>& held, const Options& options,
                               const RunContext& context)
    : columns_(rows.cols()), held_(held.size()), groups_(groups_of(rows, held)), active_(reached(rows, held)) {
  if (active_.empty()) {
    throw Error(ErrorCode::numerical_failure, "no control point of the lattice reaches a handle or fixed point");
  }
  std::vector<Eigen::Index> place(static_cast<std::size_t>(columns_), -1);
  for (std::size_t i = 0; i < active_.size(); ++i) place[static_cast<std::size_t>(active_[i])] = static_cast<Eigen::Index>(i);
  compressed_rows_ = groups_.back().first + groups_.back().rows;
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(compressed_rows_, static_cast<Eigen::Index>(active_.size()));
  parallel_for(context, groups_.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t g = begin; g < end; ++g) {
      Group& group = groups_[g];
      std::vector<Eigen::Index> columns;
      rows.for_each(held[static_cast<std::size_t>(group.points[0])],
                    [&](std::int64_t column, double) { columns.push_back(place[static_cast<std::size_t>(column)]); });
      const auto count = static_cast<Eigen::Index>(group.points.size());
      Eigen::MatrixXd part(count, static_cast<Eigen::Index>(columns.size()));
      for (Eigen::Index i = 0; i < count; ++i) {
        Eigen::Index c = 0;
        rows.for_each(held[static_cast<std::size_t>(group.points[static_cast<std::size_t>(i)])],
                      [&](std::int64_t, double value) { part(i, c++) = value; });
      }
      if (count > group.rows) {
        const HouseholderQr qr(part);
        group.Q = qr.leading_q(group.rows);
        part = Eigen::MatrixXd(qr.packed().topRows(group.rows).triangularView<Eigen::Upper>());
      }
      for (Eigen::Index c = 0; c < part.cols(); ++c) {
        M.block(group.first, columns[static_cast<std::size_t>(c)], group.rows, 1) = part.col(c);
      }
    }
  });
  context.check();
  const ThinSvd svd = thin_svd(std::move(M));
  largest_ = svd.values[0];
  clamp_ = options.clamp > 0 ? options.clamp
                             : strengthened(automatic_clamp(svd.U, svd.values, options.typical.fields), svd, options.typical);
  keep(svd);
  change_ = std::hypot(decomposition_change * std::numeric_limits<double>::epsilon() * largest_, options.checked.rounding);
  context.check();
  for (const SparseRows& sums : options.checked.kinds) look_at(sums, svd.V);
}

void ClampedInverse::keep(const ThinSvd& svd) {
  Eigen::Index rank = 1;
  while (rank < svd.values.size() && svd.values[rank] > clamp_ * largest_) ++rank;
  const double smallest = svd.values[rank - 1];
  Eigen::Index end = rank;
  while (end < svd.values.size() && beside_gap * svd.values[end] > smallest) ++end;
  while (svd.values[beside_] >= beside_gap * smallest) ++beside_;
  U_ = svd.U.leftCols(end);
  V_ = svd.V.leftCols(rank);
  values_ = svd.values.head(rank);
  left_ = svd.values.segment(rank, end - rank);
}

void ClampedInverse::look_at(const SparseRows& sums, const Eigen::MatrixXd& V) {
  const Eigen::Index count = sums.rows(), rank = values_.size();
  Eigen::MatrixXd functions = Eigen::MatrixXd::Zero(count, static_cast<Eigen::Index>(active_.size()));
  for (Eigen::Index p = 0; p < count; ++p) {
    for (SparseRows::InnerIterator it(sums, p); it; ++it) {
      const auto at = std::lower_bound(active_.begin(), active_.end(), it.col());
      if (at != active_.end() && *at == it.col()) functions(p, at - active_.begin()) = it.value();
    }
  }
  const Eigen::MatrixXd squares = (functions * V.leftCols(rank + left_.size())).cwiseAbs2();
  const Eigen::VectorXd inverse = values_.cwiseAbs2().cwiseInverse();
  Sums result;
  result.of_misfit = squares.leftCols(rank) * inverse.cwiseAbs2();
  result.of_coefficients = squares.leftCols(rank) * inverse;
  result.outside = (functions.rowwise().squaredNorm() - squares.leftCols(rank).rowwise().sum()).cwiseMax(0);
  result.near_squares = squares.rightCols(squares.cols() - beside_).cast<float>();
  sums_.push_back(std::move(result));
}

/// Least product of misfit and motion.
double ClampedInverse::automatic_clamp(const Eigen::MatrixXd& U, const Eigen::VectorXd& values,
                                       const Eigen::MatrixXd& fields) const {
  const Eigen::MatrixXd parts = U.transpose() * compressed(fields);
  const double all = fields.squaredNorm();
  const Eigen::VectorXd squares = parts.rowwise().squaredNorm();
  // What no function can meet, so that small misfits are not differences of large numbers.
  const double beyond = (fields - at_points(U * parts)).squaredNorm();
  double best = 0, least = std::numeric_limits<double>::infinity();
  for (double decade = first_decade; decade <= last_decade; decade += 1 / candidates_per_decade) {
    const double candidate = std::pow(10.0, -decade);
    double misfit = beyond, motion = 0;
    for (Eigen::Index i = values.size() - 1; i >= 0; --i) {
      if (i > 0 && values[i] <= candidate * values[0]) {
        misfit += squares[i];
      } else {
        motion += squares[i] / (values[i] * values[i]);
      }
    }
    const double product = std::max(std::sqrt(misfit), least_misfit * std::sqrt(all)) * std::sqrt(motion);
    if (product < least) {
      least = product;
      best = candidate;
    }
  }
  return best > 0 ? best : std::pow(10.0, -first_decade);
}

/// The L-curve knows the affine motions of handles only. If one handle holds all points, these are met with any clamp, and with a
/// weak one everything else makes control points swing. Where handles move against each other or against what is fixed, what they
/// are missed by is what the clamp is chosen for, and stays negligible, whatever other motions do to control points. At every
/// point: a mean over many would hide those that are missed.
double ClampedInverse::strengthened(double clamp, const ThinSvd& svd, const Typical& typical) const {
  if (typical.waves.cols() == 0) return clamp;
  const Eigen::MatrixXd parts = svd.U.transpose() * compressed(typical.waves);
  const Eigen::MatrixXd of_fields = svd.U.transpose() * compressed(typical.fields);
  const auto rank_of = [&](double candidate) {
    Eigen::Index rank = 1;
    while (rank < svd.values.size() && svd.values[rank] > candidate * svd.values[0]) ++rank;
    return rank;
  };
  // The misfit of what a clamp leaves out; the rest no clamp meets.
  const auto misfit_of = [&](Eigen::Index rank) {
    const Eigen::Index left = of_fields.rows() - rank;
    return left == 0 ? 0.0 : at_points(svd.U.rightCols(left) * of_fields.bottomRows(left)).rowwise().norm().maxCoeff();
  };
  const bool one_handle = typical.fields.cols() == 4 && (typical.fields.col(0).array() == 1).all();
  const double size = typical.fields.rowwise().norm().maxCoeff();
  const double most_misfit = (one_handle ? bearable_misfit : negligible_misfit) * size;
  const double strongest = std::pow(10.0, -first_decade);
  double best = clamp, least = std::numeric_limits<double>::infinity();
  for (double next = clamp; next < strongest && least > most_motion; next *= std::pow(10.0, 1 / candidates_per_decade)) {
    const Eigen::Index rank = rank_of(next);
    const double misfit = next > clamp ? misfit_of(rank) : 0;
    if (misfit > std::max(most_misfit, dear_misfit * size)) break;
    const Eigen::MatrixXd weights = parts.topRows(rank).array().colwise() / svd.values.head(rank).array();
    const double motion = (svd.V.leftCols(rank) * weights).cwiseAbs().maxCoeff();
    if (misfit > most_misfit && motion > most_motion) continue;
    if (motion < least) best = next;
    least = std::min(least, motion);
  }
  return best;
}

Eigen::MatrixXd ClampedInverse::compressed(const Eigen::MatrixXd& h) const {
  Eigen::MatrixXd result(compressed_rows_, h.cols());
  for (const Group& group : groups_) {
    Eigen::MatrixXd part(static_cast<Eigen::Index>(group.points.size()), h.cols());
    for (std::size_t i = 0; i < group.points.size(); ++i) part.row(static_cast<Eigen::Index>(i)) = h.row(group.points[i]);
    if (group.Q.size() > 0) part = Eigen::MatrixXd(group.Q.transpose() * part);
    result.middleRows(group.first, group.rows) = part;
  }
  return result;
}

Eigen::MatrixXd ClampedInverse::at_points(const Eigen::MatrixXd& rows) const {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(held_), rows.cols());
  for (const Group& group : groups_) {
    Eigen::MatrixXd part = rows.middleRows(group.first, group.rows);
    if (group.Q.size() > 0) part = Eigen::MatrixXd(group.Q * part);
    for (std::size_t i = 0; i < group.points.size(); ++i) result.row(group.points[i]) = part.row(static_cast<Eigen::Index>(i));
  }
  return result;
}

/// Column by column: products with several columns sum in another order, and a design must not depend on others.
HeldInverse::Solution ClampedInverse::solution(const Eigen::MatrixXd& h) const {
  Solution result{Eigen::MatrixXd::Zero(columns_, h.cols()), Eigen::MatrixXd(U_.cols(), h.cols())};
  for (Eigen::Index c = 0; c < h.cols(); ++c) {
    result.parts.col(c) = U_.transpose() * compressed(h.col(c)).col(0);
    const Eigen::VectorXd w = V_ * result.parts.col(c).head(values_.size()).cwiseQuotient(values_);
    for (std::size_t i = 0; i < active_.size(); ++i) result.coefficients(active_[i], c) = w[static_cast<Eigen::Index>(i)];
  }
  return result;
}

Eigen::MatrixXd ClampedInverse::adjoint(const Eigen::MatrixXd& g) const {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(held_), g.cols());
  for (Eigen::Index c = 0; c < g.cols(); ++c) {
    Eigen::VectorXd some(static_cast<Eigen::Index>(active_.size()));
    for (std::size_t i = 0; i < active_.size(); ++i) some[static_cast<Eigen::Index>(i)] = g(active_[i], c);
    const Eigen::VectorXd rows = U_.leftCols(values_.size()) * (V_.transpose() * some).cwiseQuotient(values_);
    for (const Group& group : groups_) {
      Eigen::VectorXd part = rows.segment(group.first, group.rows);
      if (group.Q.size() > 0) part = Eigen::VectorXd(group.Q * part);
      for (std::size_t i = 0; i < group.points.size(); ++i) {
        result(group.points[i], c) = part[static_cast<Eigen::Index>(i)];
      }
    }
  }
  return result;
}

/// With errors E and E' in these bases, a pair of values a in use and b left out adds c_a (E + E' b / a) / (a^2 - b^2) along the
/// vector of b, and c_b (E' + E b / a) / (a^2 - b^2) along that of a, where c are the parts of the column: the vectors turn in
/// their plane. To second order they turn away from themselves, which is all that is left where means leave out what is along the
/// others.
Eigen::VectorXd ClampedInverse::uncertainty(std::size_t kind, const Eigen::VectorXd& parts, const Sizes& sizes) const {
  const Sums& sums = sums_[kind];
  const Eigen::Index rank = values_.size(), kept = rank - beside_;
  Eigen::VectorXd turned = Eigen::VectorXd::Zero(kept + left_.size());
  for (Eigen::Index j = 0; j < left_.size(); ++j) {
    const double b = left_[j];
    for (Eigen::Index i = 0; i < kept; ++i) {
      const double a = values_[beside_ + i], apart = (a - b) * (a + b), turn = away_growth * change_ * std::hypot(a, b);
      const double angle = turn < apart ? turn / apart : 1;
      const double of_kept = parts[beside_ + i] / a, of_left = parts[rank + j] / a;
      turned[kept + j] += angle * angle * (of_kept * of_kept + angle * angle * of_left * of_left);
      turned[i] += angle * angle * (of_left * of_left + angle * angle * of_kept * of_kept);
    }
  }
  const double over = parts.head(rank).cwiseQuotient(values_.cwiseAbs2()).squaredNorm();
  const double change = away_growth * away_growth * change_ * change_;
  const Eigen::ArrayXd squares = change * (sizes.misfit * sizes.misfit * sums.of_misfit +
                                           sizes.coefficients * sizes.coefficients * sums.of_coefficients + over * sums.outside) +
                                 sizes.data * sizes.data * sums.of_coefficients +
                                 (sums.near_squares.cast<double>() * turned).array();
  return largest_of_many * squares.sqrt();
}

std::string ClampedInverse::note() const {
  return "Singular values up to " + scientific(clamp_) + " of the largest one are left out: rank " + std::to_string(rank()) +
         ", " + std::to_string(functions()) + " control points reach handles or fixed points.";
}

std::size_t ClampedInverse::bytes() const {
  std::size_t sum = static_cast<std::size_t>(U_.size() + V_.size() + values_.size() + left_.size()) * sizeof(double) +
                    active_.size() * sizeof(std::int64_t) + groups_.size() * sizeof(Group);
  for (const Sums& sums : sums_) {
    sum += sizeof(Sums) + static_cast<std::size_t>(3 * sums.outside.size()) * sizeof(double) +
           static_cast<std::size_t>(sums.near_squares.size()) * sizeof(float);
  }
  for (const Group& group : groups_) {
    sum += group.points.size() * sizeof(std::int64_t) + static_cast<std::size_t>(group.Q.size()) * sizeof(double);
  }
  return sum;
}

namespace {

/// Sums up the memory of groups of held points from their numbers of points and rows.
struct GroupBytes {
  ClampedInverse::Bytes bytes;
  std::size_t compressed = 0, largest = 0;

  void add(std::size_t count, std::size_t kept, std::size_t group) {
    compressed += kept;
    bytes.resident += 2 * count * sizeof(std::int64_t) + group + (count > kept ? count * kept * sizeof(double) : 0);
    largest = std::max(largest, count * std::max(kept, std::size_t{1}) * sizeof(double));
    bytes.flops += count > kept ? 6.0 * static_cast<double>(count) * static_cast<double>(kept * kept) : 0;
  }
  ClampedInverse::Bytes all(std::size_t functions, std::size_t kinds) const {
    ClampedInverse::Bytes result = bytes;
    result.functions = functions;
    const std::size_t k = std::min(compressed, functions);
    result.resident += (compressed + functions + 1) * k * sizeof(double) + functions * sizeof(std::int64_t);
    result.resident += kinds * HeldInverse::most_checked * (k * sizeof(float) + 4 * sizeof(double));
    result.peak =
        thin_svd_bytes(compressed, functions) + 4 * largest + HeldInverse::most_checked * (functions + k) * sizeof(double);
    result.flops += 20.0 * static_cast<double>(std::max(compressed, functions)) * static_cast<double>(k * k);
    return result;
  }
};

}  // namespace

ClampedInverse::Bytes ClampedInverse::estimate(const FunctionRows& rows, const std::vector<PointId>& held, std::size_t kinds) {
  const std::size_t functions = reached(rows, held).size();
  GroupBytes sum;
  for (const Group& group : groups_of(rows, held)) {
    sum.add(group.points.size(), static_cast<std::size_t>(group.rows), sizeof(Group));
  }
  return sum.all(functions, kinds);
}

ClampedInverse::Bytes ClampedInverse::estimate(std::size_t held, std::size_t functions, std::size_t kinds) {
  GroupBytes sum;
  sum.add(held, std::min(held, functions), sizeof(Group));
  return sum.all(functions, kinds);
}

}  // namespace deform
