// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/ffd/damped_inverse.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/numerics/dense/decompositions.h"
#include "core/numerics/sparse/row_gram.h"

namespace deform {

namespace {

constexpr double first_damping_decade = 2, last_damping_decade = 5, damping_step = 0.5;
constexpr int power_steps = 100;     // of the largest singular value: functions are positive, so the first step is close
constexpr int refinement_steps = 5;  // with the least damping each leaves about a hundredth of the error
constexpr double damped_growth = 8;  // of rounding, over epsilon times the largest singular value

std::vector<std::int64_t> damped_functions(const FunctionRows& rows, const std::vector<PointId>& held) {
  std::vector<std::int64_t> result = reached_functions(rows, held);
  if (result.size() > DampedInverse::most_functions) {
    throw Error(ErrorCode::invalid_argument,
                "method.ffd.control: MESH takes at most " + std::to_string(DampedInverse::most_functions) +
                    " control points that reach handles and fixed regions, here are " + std::to_string(result.size()) +
                    "; use fewer points of the lattice, or control ENERGY");
  }
  return result;
}

std::vector<std::int64_t> places_of(const std::vector<std::int64_t>& active, std::int64_t columns) {
  std::vector<std::int64_t> place(static_cast<std::size_t>(columns), -1);
  for (std::size_t i = 0; i < active.size(); ++i) place[static_cast<std::size_t>(active[i])] = static_cast<std::int64_t>(i);
  return place;
}

/// What the rows of the held points sum up to, cell by cell: where there are more points than functions, their triangular factor.
RowBlocks compressed_rows(const FunctionRows& rows, const std::vector<PointId>& held, const std::vector<std::int64_t>& place) {
  RowBlocks result;
  for (const auto& [first, points] : points_by_function(rows, held)) {
    std::vector<std::uint32_t> columns;
    rows.for_each(held[static_cast<std::size_t>(points[0])], [&](std::int64_t column, double) {
      columns.push_back(static_cast<std::uint32_t>(place[static_cast<std::size_t>(column)]));
    });
    Eigen::MatrixXd part(static_cast<Eigen::Index>(points.size()), static_cast<Eigen::Index>(columns.size()));
    for (std::size_t i = 0; i < points.size(); ++i) {
      Eigen::Index c = 0;
      rows.for_each(held[static_cast<std::size_t>(points[i])],
                    [&](std::int64_t, double value) { part(static_cast<Eigen::Index>(i), c++) = value; });
    }
    if (part.rows() > part.cols()) {
      const HouseholderQr qr(part);
      part = Eigen::MatrixXd(qr.packed().topRows(part.cols()).triangularView<Eigen::Upper>());
    }
    for (Eigen::Index i = 0; i < part.rows(); ++i) {
      for (Eigen::Index c = 0; c < part.cols(); ++c) {
        result.columns.push_back(columns[static_cast<std::size_t>(c)]);
        result.values.push_back(part(i, c));
      }
      result.starts.push_back(static_cast<std::int64_t>(result.columns.size()));
    }
  }
  return result;
}

std::size_t bytes_of(const SparseMatrix& matrix) {
  return static_cast<std::size_t>(matrix.nonZeros()) * (sizeof(double) + sizeof(std::int64_t)) +
         static_cast<std::size_t>(matrix.outerSize() + 1) * sizeof(std::int64_t);
}

}  // namespace

DampedInverse::DampedInverse(const FunctionRows& rows, const std::vector<PointId>& held, const Options& options,
                             const RunContext& context)
    : rows_(rows), held_(held), active_(damped_functions(rows, held)), place_(places_of(active_, rows.cols())) {
  if (active_.empty()) {
    throw Error(ErrorCode::numerical_failure, "no control point of the lattice reaches a handle or fixed point");
  }
  const double damping = options.clamp;
  if (damping != 0 && damping < least_damping) {
    throw Error(ErrorCode::invalid_argument, "method.ffd.clamp: " + number_digits(damping) + " is less than " +
                                                 number_digits(least_damping) + ", with which " + std::to_string(active_.size()) +
                                                 " control points that reach handles and fixed regions are damped");
  }
  gram_ = lower_gram(compressed_rows(rows, held, place_), active_.size(), context);
  context.check();
  Eigen::VectorXd v = Eigen::VectorXd::Ones(gram_.cols()).normalized();
  for (int k = 0; k < power_steps; ++k) {
    v = gram_.selfadjointView<Eigen::Lower>() * v;
    largest_ = std::sqrt(v.norm());
    v.normalize();
  }
  if (damping != 0) {
    factor(damping, context);
  } else {
    const double chosen = automatic(options.typical, context);
    if (chosen != damping_) factor(chosen, context);
  }
  gram_ = SparseMatrix();
  for (const SparseRows& sums : options.checked.kinds) {
    Eigen::VectorXd& growth = growth_.emplace_back(sums.rows());
    for (Eigen::Index p = 0; p < sums.rows(); ++p) growth[p] = sums.row(p).norm();
  }
}

void DampedInverse::factor(double damping, const RunContext& context) {
  damping_ = damping;
  SparseMatrix damped = gram_;
  const double square = damping * largest_ * damping * largest_;
  for (Eigen::Index j = 0; j < damped.cols(); ++j) damped.coeffRef(j, j) += square;
  factor_.reset();
  factor_ = std::make_unique<const SparseCholesky>(damped, context);
}

/// The point of slope -1 on the L-curve of the fields, or a stronger damping that keeps control points back for the waves; weaker
/// ones are not tried once a product grows, because each takes a factorization.
double DampedInverse::automatic(const Typical& typical, const RunContext& context) {
  const double floor = least_misfit * typical.fields.norm();
  double best = 0, least = std::numeric_limits<double>::infinity();
  for (double decade = first_damping_decade; decade <= last_damping_decade; decade += damping_step) {
    context.check();
    factor(std::pow(10.0, -decade), context);
    const auto motion_of = [&](const Eigen::MatrixXd& columns) {
      double largest = 0;
      for (Eigen::Index c = 0; c < columns.cols(); ++c) {
        context.check();
        largest = std::max(largest, fitted(columns.col(c)).cwiseAbs().maxCoeff());
      }
      return largest;
    };
    if (best > 0 && motion_of(typical.waves) > most_motion) break;
    double misfit = 0, motion = 0;
    for (Eigen::Index c = 0; c < typical.fields.cols(); ++c) {
      context.check();
      const Eigen::VectorXd w = fitted(typical.fields.col(c));
      misfit += (at_held(w) - typical.fields.col(c)).squaredNorm();
      motion += w.squaredNorm();
    }
    const double product = std::max(std::sqrt(misfit), floor) * std::sqrt(motion);
    if (product >= least) break;
    least = product;
    best = damping_;
  }
  return best;
}

Eigen::VectorXd DampedInverse::at_held(const Eigen::VectorXd& w) const {
  Eigen::VectorXd result = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(held_.size()));
  for (std::size_t j = 0; j < held_.size(); ++j) {
    rows_.for_each(held_[j], [&](std::int64_t column, double value) {
      result[static_cast<Eigen::Index>(j)] += value * w[place_[static_cast<std::size_t>(column)]];
    });
  }
  return result;
}

Eigen::VectorXd DampedInverse::transposed(const Eigen::VectorXd& h) const {
  Eigen::VectorXd result = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(active_.size()));
  for (std::size_t j = 0; j < held_.size(); ++j) {
    rows_.for_each(held_[j], [&](std::int64_t column, double value) {
      result[place_[static_cast<std::size_t>(column)]] += value * h[static_cast<Eigen::Index>(j)];
    });
  }
  return result;
}

/// The same as refined(transposed(h)), with residuals at the held points, whose rounding is that of what is missed there.
Eigen::VectorXd DampedInverse::fitted(const Eigen::VectorXd& h) const {
  const double square = damping_ * largest_ * damping_ * largest_;
  Eigen::VectorXd x = factor_->solve(transposed(h));
  for (int step = 0; step < refinement_steps; ++step) {
    const Eigen::VectorXd residual = transposed(h - at_held(x)) - square * x;
    x += Eigen::VectorXd(factor_->solve(residual));
  }
  return x;
}

/// The damped equations for a right-hand side. Their residual is taken from the functions, not from the matrix: the rounding of
/// its entries is divided by the square of the damping.
Eigen::VectorXd DampedInverse::refined(const Eigen::VectorXd& b) const {
  const double square = damping_ * largest_ * damping_ * largest_;
  Eigen::VectorXd x = factor_->solve(b);
  for (int step = 0; step < refinement_steps; ++step) {
    const Eigen::VectorXd residual = b - transposed(at_held(x)) - square * x;
    x += Eigen::VectorXd(factor_->solve(residual));
  }
  return x;
}

HeldInverse::Solution DampedInverse::solution(const Eigen::MatrixXd& h) const {
  Solution result{Eigen::MatrixXd::Zero(rows_.cols(), h.cols()), Eigen::MatrixXd(0, h.cols())};
  for (Eigen::Index c = 0; c < h.cols(); ++c) {
    const Eigen::VectorXd w = fitted(h.col(c));
    for (std::size_t i = 0; i < active_.size(); ++i) result.coefficients(active_[i], c) = w[static_cast<Eigen::Index>(i)];
  }
  return result;
}

Eigen::MatrixXd DampedInverse::adjoint(const Eigen::MatrixXd& g) const {
  Eigen::MatrixXd result(static_cast<Eigen::Index>(held_.size()), g.cols());
  for (Eigen::Index c = 0; c < g.cols(); ++c) {
    Eigen::VectorXd some(static_cast<Eigen::Index>(active_.size()));
    for (std::size_t i = 0; i < active_.size(); ++i) some[static_cast<Eigen::Index>(i)] = g(active_[i], c);
    result.col(c) = at_held(refined(some));
  }
  return result;
}

/// First-order perturbation of the damped least-squares problem.
Eigen::VectorXd DampedInverse::uncertainty(std::size_t kind, const Eigen::VectorXd& /*parts*/, const Sizes& sizes) const {
  const double change = damped_growth * std::numeric_limits<double>::epsilon() * largest_;
  const double least = damping_ * largest_;
  return change * (sizes.coefficients / least + sizes.misfit / (least * least)) * growth_[kind];
}

std::size_t DampedInverse::bytes() const {
  return factor_->bytes() + held_.size() * sizeof(PointId) + (active_.size() + place_.size()) * sizeof(std::int64_t);
}

std::string DampedInverse::note() const {
  return "Control points are damped with " + number_digits(damping_) + " of the largest singular value, because " +
         std::to_string(active_.size()) + " of them reach handles or fixed points, too many for a decomposition.";
}

HeldInverse::Bytes DampedInverse::estimate(const FunctionRows& rows, const std::vector<PointId>& held) {
  const std::vector<std::int64_t> active = damped_functions(rows, held);
  const RowBlocks blocks = compressed_rows(rows, held, places_of(active, rows.cols()));
  const SparseMatrix gram = lower_gram(blocks, active.size());
  const SparseCholesky::Estimate factor = SparseCholesky::estimate(gram);
  Bytes result;
  result.functions = active.size();
  result.resident = factor.factor_bytes + held.size() * sizeof(PointId) +
                    (active.size() + static_cast<std::size_t>(rows.cols())) * sizeof(std::int64_t);
  result.peak = factor.peak_bytes - std::min(factor.peak_bytes, factor.factor_bytes) + 3 * bytes_of(gram) +
                blocks.columns.size() * (sizeof(std::uint32_t) + sizeof(double)) + blocks.starts.size() * sizeof(std::int64_t);
  constexpr double tries = 1 + (last_damping_decade - first_damping_decade) / damping_step;
  result.flops = tries * factor.flops;
  return result;
}

}  // namespace deform
