// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/linearized_sets.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "core/base/vectors.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

constexpr Eigen::Index most_dense = 400;  // parameters of shapes
constexpr double no_information = 1e-14;  // of squares: a parameter that changes no point, two that change the same
constexpr double regularized = 1e-5;      // a singular value that counts as much as staying where the points are
constexpr double regularization = 1e-13;  // of the diagonal: changes of shapes that move no point
constexpr int refinements = 2;            // against what that changes elsewhere

using Dense = Eigen::MatrixXd;

}  // namespace

/// The least |h + B q|^2 among the q with the least |a + A q|^2, from A^T A and B^T B: q = -(1 - W B^T B) M A^T a - W B^T h.
/// Instead, for many parameters, the least of |h + B q|^2 + w |a + A q|^2.
class LinearizedSets::Shapes {
 public:
  Shapes(const Dense& AtA, Dense BtB, double limit) : BtB_(std::move(BtB)) {
    const Eigen::Index n = AtA.rows();
    M_ = W_ = Dense::Zero(n, n);
    if (n == 0) return;
    const auto eigen = symmetric_eigen(AtA);
    Eigen::Index nothing = 0;
    while (nothing < n && eigen.values[nothing] <= limit * limit) ++nothing;
    rank_ = static_cast<std::size_t>(n - nothing);
    const auto known = eigen.vectors.rightCols(n - nothing);
    M_ = known * eigen.values.tail(n - nothing).cwiseInverse().asDiagonal() * known.transpose();
    if (nothing == 0) return;
    const Dense Z = eigen.vectors.leftCols(nothing);
    const auto free = symmetric_eigen(Dense(Z.transpose() * BtB_ * Z));
    Eigen::VectorXd inverse = free.values;
    const double least = regularization * std::max(1.0, inverse[nothing - 1]);
    for (double& value : inverse) value = value > least ? 1 / value : 0;
    const Dense F = Z * free.vectors;
    W_ = F * inverse.asDiagonal() * F.transpose();
  }
  Shapes(const SparseMatrix& AtA, const SparseMatrix& BtB, const RunContext& context) : weight_(1 / (regularized * regularized)) {
    SparseMatrix H = BtB + weight_ * AtA, added(AtA.rows(), AtA.cols());
    // Relative to each entry: one for all, as large as the weight asks for, would hold back shapes that nothing else limits.
    added_ = regularization * Eigen::VectorXd(H.diagonal()).cwiseMax(1.0);
    added.setIdentity();
    H += added * added_.asDiagonal();
    H = SparseMatrix(H.triangularView<Eigen::Lower>());
    H.makeCompressed();
    factor_ = std::make_unique<const SparseCholesky>(H, context);
    rank_ = static_cast<std::size_t>(AtA.rows());
  }

  std::size_t rank() const { return rank_; }
  std::size_t bytes() const {
    const auto dense = static_cast<std::size_t>(BtB_.size() + M_.size() + W_.size()) * sizeof(double);
    return factor_ ? 3 * factor_->bytes() : 4 * dense;
  }

  /// q from A^T a and B^T h.
  Eigen::VectorXd solution(const Eigen::VectorXd& a, const Eigen::VectorXd& h) const {
    if (factor_) return inverse(-(weight_ * a + h));
    const Eigen::VectorXd q = -(M_ * a);
    return q - W_ * (h + BtB_ * q);
  }
  /// The transpose: the contributions of -p to A^T a and B^T h.
  std::pair<Eigen::VectorXd, Eigen::VectorXd> adjoint(const Eigen::VectorXd& p) const {
    if (factor_) {
      const Eigen::VectorXd q = inverse(p);
      return {weight_ * q, q};
    }
    const Eigen::VectorXd h = W_ * p;
    return {M_ * (p - BtB_ * h), h};
  }

 private:
  /// H^-1 b from the factor of H + D: sum of ((H + D)^-1 D)^k (H + D)^-1 b, which is symmetric, too.
  Eigen::VectorXd inverse(Eigen::VectorXd b) const {
    factor_->solve_in_place(b);
    Eigen::VectorXd sum = b;
    for (int k = 0; k < refinements; ++k) {
      b = added_.cwiseProduct(b).eval();
      factor_->solve_in_place(b);
      sum += b;
    }
    return sum;
  }

  Dense BtB_, M_, W_;
  double weight_ = 0;
  Eigen::VectorXd added_;  ///< D
  std::unique_ptr<const SparseCholesky> factor_;
  std::size_t rank_ = 0;
};

LinearizedSets::LinearizedSets(const SetsOnPoints& on, const std::vector<Vec3>& points, std::vector<ShapeParameters>& shapes,
                               const std::vector<std::vector<Vec3>>& forces, const RankLimits& limits, const RunContext& context)
    : on_(on) {
  linearize(points, shapes, forces);
  make_blocks();
  for (Block& block : blocks_) {
    decompose(block, limits.points);
    point_rank_ += static_cast<std::size_t>(block.rank());
  }
  make_shapes(limits.shapes, context);
}

LinearizedSets::~LinearizedSets() = default;

void LinearizedSets::linearize(const std::vector<Vec3>& points, std::vector<ShapeParameters>& shapes,
                               const std::vector<std::vector<Vec3>>& forces) {
  std::vector<double> residuals;
  for (std::size_t t = 0; t < on_.sets.size(); ++t) {
    const Projection& projection = *on_.sets[t]->projection;
    const bool pulled = projection.has_bounds() && !forces.empty();
    std::vector<Vec3> x;
    for (std::size_t i = 0; i < on_.places[t].size(); ++i) {
      x.push_back(points[on_.places[t][i]]);
      if (pulled) x.back() = x.back() + forces[t][i];
    }
    std::vector<Vec3> projected(x.size());
    projection.project(x, projected, shapes[t]);
    const Linearization linear = projection.linearize(x, shapes[t]);
    scale_parameters(t, linear.parameters);
    for (std::size_t r = 0; r < linear.normals.size(); ++r) {
      Row row{static_cast<std::uint32_t>(t),
              static_cast<std::uint32_t>(r / linear.rows_per_point),
              none,
              static_cast<Eigen::Index>(r),
              linear.normals[r],
              {}};
      if (!linear.partners.empty()) {
        row.partner = linear.partners[r];
        row.partner_normal = linear.partner_normals[r];
        if (row.partner == row.place) {
          row.normal = row.normal + row.partner_normal;
          row.partner = none;
          row.partner_normal = {};
        }
      }
      if (dot(row.normal, row.normal) + dot(row.partner_normal, row.partner_normal) == 0) continue;
      double residual = linear.residual[static_cast<Eigen::Index>(r)];
      if (pulled) {
        residual -= dot(row.normal, forces[t][row.place]);
        if (row.partner != none) residual -= dot(row.partner_normal, forces[t][row.partner]);
      }
      rows_.push_back(row);
      residuals.push_back(residual);
    }
  }
  residual_ = Eigen::Map<const Eigen::VectorXd>(residuals.data(), static_cast<Eigen::Index>(residuals.size()));
}

/// Replaces the parameters by an orthogonal basis of their effect on the distances; parameters without effect are left out.
void LinearizedSets::scale_parameters(std::size_t set, const Eigen::MatrixXd& parameters) {
  first_.push_back(parameter_count_);
  Dense& scaled = parameters_.emplace_back(parameters.rows(), 0);
  if (parameters.cols() == 0 || parameters.rows() == 0) return;
  const double points = static_cast<double>(on_.places[set].size());
  Eigen::VectorXd by = parameters.colwise().norm();
  for (double& value : by) value = value > 0 ? 1 / value : 0;
  const Dense unit = parameters * by.asDiagonal();
  const auto eigen = symmetric_eigen(Dense(unit.transpose() * unit));
  std::vector<Eigen::Index> kept;
  for (Eigen::Index k = 0; k < eigen.values.size(); ++k) {
    if (eigen.values[k] > no_information * eigen.values.maxCoeff()) kept.push_back(k);
  }
  scaled.resize(parameters.rows(), static_cast<Eigen::Index>(kept.size()));
  for (std::size_t k = 0; k < kept.size(); ++k) {
    scaled.col(static_cast<Eigen::Index>(k)) = unit * eigen.vectors.col(kept[k]) * std::sqrt(points / eigen.values[kept[k]]);
  }
  parameter_count_ += scaled.cols();
}

void LinearizedSets::make_blocks() {
  std::vector<std::uint32_t> root(on_.count());
  std::iota(root.begin(), root.end(), 0u);
  const auto root_of = [&](std::uint32_t u) {
    while (root[u] != u) u = root[u] = root[root[u]];
    return u;
  };
  const auto moves = [&](std::uint32_t u) { return static_cast<bool>(on_.moves[u]); };
  for (const Row& row : rows_) {
    if (row.partner == none || !moves(point(row)) || !moves(partner(row))) continue;
    const std::uint32_t a = root_of(point(row)), b = root_of(partner(row));
    root[std::max(a, b)] = std::min(a, b);
  }
  std::vector<std::uint32_t> block_of(on_.count(), none);
  std::uint32_t held = none;  // the block of rows without points that move
  const auto block_at = [&](std::uint32_t& place) -> Block& {
    if (place == none) {
      place = static_cast<std::uint32_t>(blocks_.size());
      blocks_.emplace_back();
    }
    return blocks_[place];
  };
  for (std::uint32_t r = 0; r < rows_.size(); ++r) {
    const Row& row = rows_[r];
    if (moves(point(row))) {
      block_at(block_of[root_of(point(row))]).rows.push_back(r);
    } else if (row.partner != none && moves(partner(row))) {
      block_at(block_of[root_of(partner(row))]).rows.push_back(r);
    } else {
      block_at(held).rows.push_back(r);
    }
  }
  for (std::uint32_t u = 0; u < on_.count(); ++u) {
    if (moves(u) && block_of[root_of(u)] != none) blocks_[block_of[root_of(u)]].points.push_back(u);
  }
}

void LinearizedSets::decompose(Block& block, double limit) const {
  const auto rows = static_cast<Eigen::Index>(block.rows.size()), columns = static_cast<Eigen::Index>(3 * block.points.size());
  if (columns == 0) return;  // all is left for the shapes; no U is needed
  Dense N = Dense::Zero(rows, columns);
  const auto add = [&](Eigen::Index r, std::uint32_t u, const Vec3& normal) {
    const auto found = std::lower_bound(block.points.begin(), block.points.end(), u);
    if (found == block.points.end() || *found != u) return;
    for (Eigen::Index k = 0; k < 3; ++k) N(r, 3 * (found - block.points.begin()) + k) += normal[static_cast<std::size_t>(k)];
  };
  for (Eigen::Index r = 0; r < rows; ++r) {
    const Row& row = rows_[block.rows[static_cast<std::size_t>(r)]];
    add(r, point(row), row.normal);
    if (row.partner != none) add(r, partner(row), row.partner_normal);
  }
  if ((N * N.transpose() - Dense::Identity(rows, rows)).cwiseAbs().maxCoeff() < 1e-12) {
    block.U = Dense::Identity(rows, rows);
    block.V = N.transpose();
    block.values = Eigen::VectorXd::Ones(rows);
    return;
  }
  const auto [values, U, V] = svd(N);
  Eigen::Index rank = 0;
  while (rank < values.size() && values[rank] > limit) ++rank;
  block.U = U;
  block.V = V.leftCols(rank);
  block.values = values.head(rank);
}

/// The parameters of its sets, one row per row of the block; columns: which of all parameters.
Eigen::MatrixXd LinearizedSets::block_parameters(const Block& block, std::vector<Eigen::Index>& columns) const {
  columns.clear();
  std::vector<std::uint32_t> sets;
  for (const std::uint32_t r : block.rows) sets.push_back(rows_[r].set);
  std::sort(sets.begin(), sets.end());
  sets.erase(std::unique(sets.begin(), sets.end()), sets.end());
  for (const std::uint32_t t : sets) {
    for (Eigen::Index k = 0; k < parameters_[t].cols(); ++k) columns.push_back(first_[t] + k);
  }
  Dense Q = Dense::Zero(static_cast<Eigen::Index>(block.rows.size()), static_cast<Eigen::Index>(columns.size()));
  for (std::size_t i = 0; i < block.rows.size(); ++i) {
    const Row& row = rows_[block.rows[i]];
    if (parameters_[row.set].cols() == 0) continue;
    const auto at = std::lower_bound(columns.begin(), columns.end(), first_[row.set]) - columns.begin();
    Q.row(static_cast<Eigen::Index>(i)).segment(at, parameters_[row.set].cols()) = parameters_[row.set].row(row.parameters);
  }
  return Q;
}

void LinearizedSets::make_shapes(double limit, const RunContext& context) {
  const bool dense = parameter_count_ <= most_dense;
  Dense A, B;
  using Entry = Eigen::Triplet<double, std::int64_t>;
  std::vector<Entry> in_A, in_B;
  if (dense) A = B = Dense::Zero(parameter_count_, parameter_count_);
  std::vector<Eigen::Index> columns;
  const auto add = [&](const Dense& rows, Dense& full, std::vector<Entry>& entries) {
    if (rows.rows() == 0) return;
    const Dense square = rows.transpose() * rows;
    for (Eigen::Index j = 0; j < square.cols(); ++j) {
      for (Eigen::Index i = 0; i < square.rows(); ++i) {
        const Eigen::Index a = columns[static_cast<std::size_t>(i)], b = columns[static_cast<std::size_t>(j)];
        if (dense) {
          full(a, b) += square(i, j);
        } else {
          entries.emplace_back(a, b, square(i, j));
        }
      }
    }
  };
  std::size_t left = 0;
  for (const Block& block : blocks_) {
    const Dense Q = block_parameters(block, columns);
    left += block.rows.size() - static_cast<std::size_t>(block.rank());
    if (columns.empty()) continue;
    if (block.points.empty()) {
      // A long list of rows, of few sets each: one after the other.
      for (Eigen::Index r = 0; r < Q.rows() && !dense; ++r) {
        const std::vector<Eigen::Index> all = columns;
        const std::uint32_t t = rows_[block.rows[static_cast<std::size_t>(r)]].set;
        columns.clear();
        for (Eigen::Index k = 0; k < parameters_[t].cols(); ++k) columns.push_back(first_[t] + k);
        add(parameters_[t].row(rows_[block.rows[static_cast<std::size_t>(r)]].parameters), A, in_A);
        columns = all;
      }
      if (dense) add(Q, A, in_A);
      continue;
    }
    const Dense turned = block.U.transpose() * Q;
    add(block.values.cwiseInverse().asDiagonal() * turned.topRows(block.rank()), B, in_B);
    add(turned.bottomRows(turned.rows() - block.rank()), A, in_A);
  }
  // As many equations make a misfit that much larger.
  limit = std::min(0.5, limit * std::sqrt(std::max(1.0, static_cast<double>(left) / 10)));
  if (dense) {
    shapes_ = std::make_unique<const Shapes>(A, std::move(B), limit);
  } else {
    SparseMatrix a(parameter_count_, parameter_count_), b(parameter_count_, parameter_count_);
    a.setFromTriplets(in_A.begin(), in_A.end());
    b.setFromTriplets(in_B.begin(), in_B.end());
    shapes_ = std::make_unique<const Shapes>(a, b, context);
  }
  shape_rank_ = shapes_->rank();
}

std::size_t LinearizedSets::bytes() const {
  std::size_t bytes = rows_.size() * (sizeof(Row) + 6 * sizeof(double)) + shapes_->bytes();
  for (const Dense& parameters : parameters_) bytes += 3 * static_cast<std::size_t>(parameters.size()) * sizeof(double);
  for (const Block& block : blocks_) {
    bytes += sizeof(Block) + (block.rows.size() + block.points.size()) * sizeof(std::uint32_t) +
             static_cast<std::size_t>(block.U.size() + block.V.size() + block.values.size()) * sizeof(double);
  }
  return bytes;
}

Eigen::VectorXd LinearizedSets::shape_rows(const Block& block, const Eigen::VectorXd& q) const {
  Eigen::VectorXd result(static_cast<Eigen::Index>(block.rows.size()));
  for (std::size_t i = 0; i < block.rows.size(); ++i) {
    const Row& row = rows_[block.rows[i]];
    const Dense& parameters = parameters_[row.set];
    result[static_cast<Eigen::Index>(i)] =
        parameters.cols() > 0 ? parameters.row(row.parameters).dot(q.segment(first_[row.set], parameters.cols())) : 0.0;
  }
  return result;
}

void LinearizedSets::add_shape_adjoint(const Block& block, const Eigen::VectorXd& rows, Eigen::VectorXd& q) const {
  for (std::size_t i = 0; i < block.rows.size(); ++i) {
    const Row& row = rows_[block.rows[i]];
    const Dense& parameters = parameters_[row.set];
    if (parameters.cols() == 0) continue;
    q.segment(first_[row.set], parameters.cols()) +=
        rows[static_cast<Eigen::Index>(i)] * parameters.row(row.parameters).transpose();
  }
}

Eigen::VectorXd LinearizedSets::gathered(const Block& block, const std::vector<Vec3>& at) const {
  Eigen::VectorXd result(static_cast<Eigen::Index>(3 * block.points.size()));
  for (std::size_t i = 0; i < block.points.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) result[static_cast<Eigen::Index>(3 * i + k)] = at[block.points[i]][k];
  }
  return result;
}

std::vector<Vec3> LinearizedSets::step(const std::vector<Vec3>& wanted, const Eigen::VectorXd& rows) const {
  const auto of_block = [&](const Block& block) {
    Eigen::VectorXd result(static_cast<Eigen::Index>(block.rows.size()));
    for (std::size_t i = 0; i < block.rows.size(); ++i) result[static_cast<Eigen::Index>(i)] = rows[block.rows[i]];
    return result;
  };
  Eigen::VectorXd a = Eigen::VectorXd::Zero(parameter_count_), h = a;
  for (const Block& block : blocks_) {
    const Eigen::VectorXd own = of_block(block);
    if (block.points.empty()) {
      add_shape_adjoint(block, own, a);
      continue;
    }
    const Eigen::Index rank = block.rank(), left = own.size() - rank;
    const Eigen::VectorXd turned = block.U.transpose() * own;
    const Eigen::VectorXd met = turned.head(rank).cwiseQuotient(block.values) + block.V.transpose() * gathered(block, wanted);
    add_shape_adjoint(block, block.U.leftCols(rank) * met.cwiseQuotient(block.values), h);
    if (left > 0) add_shape_adjoint(block, block.U.rightCols(left) * turned.tail(left), a);
  }
  const Eigen::VectorXd q = shapes_->solution(a, h);
  std::vector<Vec3> result = wanted;
  for (std::size_t u = 0; u < result.size(); ++u) {
    if (!on_.moves[u]) result[u] = {};
  }
  for (const Block& block : blocks_) {
    if (block.points.empty()) continue;
    const Eigen::VectorXd distances = of_block(block) + shape_rows(block, q);
    Eigen::VectorXd d = gathered(block, wanted);
    d -= block.V *
         (block.V.transpose() * d + (block.U.leftCols(block.rank()).transpose() * distances).cwiseQuotient(block.values));
    for (std::size_t i = 0; i < block.points.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) result[block.points[i]][k] = d[static_cast<Eigen::Index>(3 * i + k)];
    }
  }
  return result;
}

Eigen::VectorXd LinearizedSets::adjoint(const std::vector<Vec3>& cotangent) const {
  Eigen::VectorXd p = Eigen::VectorXd::Zero(parameter_count_);
  for (const Block& block : blocks_) {
    if (block.points.empty()) continue;
    const Eigen::VectorXd g = block.V.transpose() * gathered(block, cotangent);
    add_shape_adjoint(block, block.U.leftCols(block.rank()) * g.cwiseQuotient(block.values), p);
  }
  const auto [a, h] = shapes_->adjoint(p);
  Eigen::VectorXd result(static_cast<Eigen::Index>(rows_.size()));
  for (const Block& block : blocks_) {
    Eigen::VectorXd own = shape_rows(block, a);
    if (!block.points.empty()) {
      const Eigen::Index rank = block.rank(), left = own.size() - rank;
      const Eigen::VectorXd g = block.V.transpose() * gathered(block, cotangent);
      const Eigen::VectorXd by_h = (block.U.leftCols(rank).transpose() * shape_rows(block, h)).cwiseQuotient(block.values);
      Eigen::VectorXd turned(own.size());
      turned.head(rank) = (by_h - g).cwiseQuotient(block.values);
      if (left > 0) turned.tail(left) = block.U.rightCols(left).transpose() * own;
      own = block.U * turned;
    }
    for (std::size_t i = 0; i < block.rows.size(); ++i) result[block.rows[i]] = own[static_cast<Eigen::Index>(i)];
  }
  return result;
}

std::vector<std::vector<Vec3>> LinearizedSets::forces(const Eigen::VectorXd& rows) const {
  std::vector<std::vector<Vec3>> result;
  for (const auto& places : on_.places) result.emplace_back(places.size(), Vec3{});
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const Row& row = rows_[r];
    const double force = rows[static_cast<Eigen::Index>(r)];
    Vec3& at = result[row.set][row.place];
    at = at + force * row.normal;
    if (row.partner == none) continue;
    Vec3& other = result[row.set][row.partner];
    other = other + force * row.partner_normal;
  }
  return result;
}

Eigen::VectorXd LinearizedSets::held_rows(const std::vector<Vec3>& change) const {
  Eigen::VectorXd result = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(rows_.size()));
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const Row& row = rows_[r];
    double& value = result[static_cast<Eigen::Index>(r)];
    if (!on_.moves[point(row)]) value += dot(row.normal, change[point(row)]);
    if (row.partner != none && !on_.moves[partner(row)]) value += dot(row.partner_normal, change[partner(row)]);
  }
  return result;
}

std::vector<Vec3> LinearizedSets::held_adjoint(const Eigen::VectorXd& rows) const {
  std::vector<Vec3> result(on_.count(), Vec3{});
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const Row& row = rows_[r];
    const double value = rows[static_cast<Eigen::Index>(r)];
    const auto add = [&](std::uint32_t u, const Vec3& normal) {
      if (!on_.moves[u]) result[u] = result[u] + value * normal;
    };
    add(point(row), row.normal);
    if (row.partner != none) add(partner(row), row.partner_normal);
  }
  return result;
}

}  // namespace deform
