// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/exact_placement.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/numerics/sparse/conjugate_gradients.h"
#include "core/numerics/sparse/sparse_cholesky.h"

namespace deform {

namespace {

using Entry = Eigen::Triplet<double, std::int64_t>;
constexpr double stiffness = 1e9;  // of the linearized distances against the changes
constexpr double damping = 1e-9;   // of parameters of shapes that change nothing
constexpr int most_steps = 60, most_halvings = 10, most_iterations = 500;
constexpr double smallest_step = 1e-14;
constexpr double rounding = 1e-13;  // of the merit: less than this is no change of it
constexpr double met = 1e-9;        // a distance
constexpr double accuracy = 1e-11;  // of derivatives

}  // namespace

/// The sets of a piece about some positions: [I + W J^T J, W J^T P; W P^T J, W P^T P].
class ExactPlacement::Joint {
 public:
  /// Factored.
  Joint(const ExactPlacement& placement, const Piece& piece, const std::vector<Vec3>& points, const RunContext& context)
      : Joint(placement, piece, points) {
    factor_ = std::make_unique<const SparseCholesky>(matrix(), context);
  }

  /// Not factored, so that nothing can be solved.
  Joint(const ExactPlacement& placement, const Piece& piece, const std::vector<Vec3>& points)
      : placement_(placement),
        piece_(piece),
        unknowns_(3 * static_cast<std::int64_t>(piece.moving.size())),
        points_(points),
        shapes_(piece.sets.size()) {
    std::vector<Entry> entries;
    std::vector<double> residuals;
    std::int64_t columns = unknowns_;
    for (std::size_t s = 0; s < piece.sets.size(); ++s) {
      const std::size_t t = piece.sets[s];
      const std::vector<Vec3> x = placement.of_set(t, points);
      std::vector<Vec3> projected(x.size());
      const Projection& projection = *placement.sets_[t].projection;
      projection.project(x, projected, shapes_[s]);
      const Linearization linear = projection.linearize(x, shapes_[s]);
      const auto add = [&](std::size_t i, const Vec3& normal) {
        const std::int64_t column = placement.unknown_[placement.places_[t][i]];
        const auto row = static_cast<std::int64_t>(residuals.size());
        for (std::int64_t a = 0; column >= 0 && a < 3; ++a) {
          entries.emplace_back(row, column + a, normal[static_cast<std::size_t>(a)]);
        }
      };
      for (std::size_t r = 0; r < linear.normals.size(); ++r) {
        add(r / linear.rows_per_point, linear.normals[r]);
        if (!linear.partners.empty()) add(linear.partners[r], linear.partner_normals[r]);
        for (Eigen::Index q = 0; q < linear.parameters.cols(); ++q) {
          entries.emplace_back(static_cast<std::int64_t>(residuals.size()), columns + q,
                               linear.parameters(static_cast<Eigen::Index>(r), q));
        }
        residuals.push_back(linear.residual[static_cast<Eigen::Index>(r)]);
      }
      columns += linear.parameters.cols();
    }
    const auto rows = static_cast<std::int64_t>(residuals.size());
    J_.resize(rows, columns);
    J_.setFromTriplets(entries.begin(), entries.end());
    residual_ = Eigen::Map<const Eigen::VectorXd>(residuals.data(), rows);
  }

  SparseMatrix matrix() const {
    const std::int64_t columns = J_.cols();
    SparseMatrix H = stiffness * SparseMatrix(SparseMatrix(J_.transpose()) * J_).triangularView<Eigen::Lower>();
    const double largest = H.nonZeros() > 0 ? std::max(1.0, H.diagonal().maxCoeff()) : 1.0;
    SparseMatrix diagonal(columns, columns);
    diagonal.reserve(Eigen::VectorXi::Constant(static_cast<int>(columns), 1));
    for (std::int64_t j = 0; j < columns; ++j) diagonal.insert(j, j) = j < unknowns_ ? 1.0 : damping * largest;
    H += diagonal;
    H.makeCompressed();
    return H;
  }

  /// While it is made, with a factor.
  std::size_t bytes() const {
    const SparseMatrix H = matrix();
    // The entries of J in a vector that has grown, J and its transpose; J^T J, sorted, its lower triangle and sums of it.
    const auto entries = static_cast<std::size_t>(J_.nonZeros()), squares = static_cast<std::size_t>(H.nonZeros());
    constexpr std::size_t entry = sizeof(double) + sizeof(std::int64_t);
    return entries * (3 * sizeof(Entry) + 3 * entry) + squares * 7 * entry + SparseCholesky::estimate(H).peak_bytes;
  }

  /// Where the model is least that starts at `from`; only what moves is different from `points`.
  std::vector<Vec3> least(const std::vector<Vec3>& from) const {
    Eigen::VectorXd b = -stiffness * (J_.transpose() * residual_);
    b.head(unknowns_) += moving(from) - moving(points_);
    factor_->solve_in_place(b);
    std::vector<Vec3> result = points_;
    put(moving(points_) + b.head(unknowns_), result);
    return result;
  }

  /// The derivative at the end: (I + W sum (I - P')) dy = dx over the points that move, with what the others do on the right.
  void follow(std::vector<Vec3>& change, const RunContext& context) const {
    std::vector<Vec3> held = change;
    put(Eigen::VectorXd::Zero(unknowns_), held);
    put(solved(moving(change) - stiffness * moving(residual_change(held)), context), change);
  }

  /// Its transpose.
  void pull_back(std::vector<Vec3>& cotangent, const RunContext& context) const {
    std::vector<Vec3> at_moving(cotangent.size(), Vec3{});
    put(solved(moving(cotangent), context), at_moving);
    const std::vector<Vec3> pushed = residual_change(at_moving);
    for (std::size_t u = 0; u < cotangent.size(); ++u) {
      for (std::size_t k = 0; k < 3; ++k) cotangent[u][k] -= stiffness * pushed[u][k];
    }
    for (const std::uint32_t u : piece_.moving) cotangent[u] = at_moving[u];
  }

 private:
  /// sum over the sets of (I - P') applied to U vectors.
  std::vector<Vec3> residual_change(const std::vector<Vec3>& change) const {
    std::vector<Vec3> result(change.size(), Vec3{});
    for (std::size_t s = 0; s < piece_.sets.size(); ++s) {
      const std::size_t t = piece_.sets[s];
      const std::vector<Vec3> x = placement_.of_set(t, points_), dx = placement_.of_set(t, change);
      std::vector<Vec3> along(x.size());
      placement_.sets_[t].projection->derivative(x, shapes_[s], dx, along);
      for (std::size_t i = 0; i < x.size(); ++i) {
        for (std::size_t k = 0; k < 3; ++k) result[placement_.places_[t][i]][k] += dx[i][k] - along[i][k];
      }
    }
    return result;
  }

  /// Conjugate gradients; the factor leaves out the curvature of the shapes only.
  Eigen::VectorXd solved(const Eigen::VectorXd& b, const RunContext& context) const {
    const auto preconditioned = [&](const Eigen::VectorXd& r) {
      Eigen::VectorXd z = Eigen::VectorXd::Zero(J_.cols());
      z.head(r.size()) = r;
      factor_->solve_in_place(z);
      return Eigen::VectorXd(z.head(r.size()));
    };
    std::vector<Vec3> field(points_.size(), Vec3{});
    const auto product = [&](const Eigen::VectorXd& p) -> Eigen::VectorXd {
      put(p, field);
      return p + stiffness * moving(residual_change(field));
    };
    // Where this is not a minimum, what there is so far is the best that can be said.
    return conjugate_gradients(b, product, preconditioned, accuracy, most_iterations, context).x;
  }

  Eigen::VectorXd moving(const std::vector<Vec3>& points) const {
    Eigen::VectorXd result(unknowns_);
    for (std::size_t i = 0; i < piece_.moving.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) result[static_cast<Eigen::Index>(3 * i + k)] = points[piece_.moving[i]][k];
    }
    return result;
  }
  void put(const Eigen::VectorXd& from, std::vector<Vec3>& points) const {
    for (std::size_t i = 0; i < piece_.moving.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) points[piece_.moving[i]][k] = from[static_cast<Eigen::Index>(3 * i + k)];
    }
  }

  const ExactPlacement& placement_;
  const Piece& piece_;
  std::int64_t unknowns_;
  std::vector<Vec3> points_;
  std::vector<ShapeParameters> shapes_;  ///< per set of the piece
  SparseMatrix J_;                       ///< distances by unknowns and parameters
  Eigen::VectorXd residual_;
  std::unique_ptr<const SparseCholesky> factor_;
};

ExactPlacement::ExactPlacement(std::vector<ConstraintSet> sets, const std::vector<bool>& moves) : sets_(std::move(sets)) {
  for (const ConstraintSet& set : sets_) ids_.insert(ids_.end(), set.ids.begin(), set.ids.end());
  std::sort(ids_.begin(), ids_.end());
  ids_.erase(std::unique(ids_.begin(), ids_.end()), ids_.end());
  std::vector<int> uses(ids_.size(), 0);
  for (const ConstraintSet& set : sets_) {
    std::vector<std::uint32_t>& places = places_.emplace_back();
    for (const PointId id : set.ids) {
      places.push_back(static_cast<std::uint32_t>(std::lower_bound(ids_.begin(), ids_.end(), id) - ids_.begin()));
      ++uses[places.back()];
    }
  }
  for (const PointId id : ids_) moves_.push_back(moves[id]);
  connect(uses);
}

/// uses: per point, how many sets hold it.
void ExactPlacement::connect(const std::vector<int>& uses) {
  std::vector<std::size_t> root(sets_.size()), holder(ids_.size(), sets_.size());
  const auto root_of = [&](std::size_t t) {
    while (root[t] != t) t = root[t] = root[root[t]];
    return t;
  };
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    root[t] = t;
    for (const std::uint32_t u : places_[t]) {
      if (holder[u] == sets_.size()) holder[u] = t;
      const std::size_t a = root_of(holder[u]), b = root_of(t);
      root[std::max(a, b)] = std::min(a, b);
    }
  }
  unknown_.assign(ids_.size(), -1);
  std::vector<std::size_t> piece_of(sets_.size());
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    if (root_of(t) == t) {
      piece_of[t] = pieces_.size();
      pieces_.emplace_back();
    }
    Piece& piece = pieces_[piece_of[root_of(t)]];
    piece.sets.push_back(t);
    const auto single = [&](std::uint32_t u) { return uses[u] == 1 && moves_[u]; };
    piece.alone = std::all_of(places_[t].begin(), places_[t].end(), single);
    for (const std::uint32_t u : places_[t]) {
      if (piece.alone || !moves_[u] || unknown_[u] >= 0) continue;
      unknown_[u] = 3 * static_cast<std::int64_t>(piece.moving.size());
      piece.moving.push_back(u);
    }
  }
}

std::size_t ExactPlacement::bytes() const {
  std::size_t bytes = ids_.size() * (sizeof(PointId) + sizeof(std::int64_t) + sizeof(std::uint32_t) + 1);
  for (const ConstraintSet& set : sets_) bytes += set.ids.size() * (sizeof(PointId) + sizeof(Vec3) + sizeof(std::uint32_t));
  return bytes + pieces_.size() * sizeof(Piece) + sets_.size() * sizeof(std::size_t);
}

std::size_t ExactPlacement::working_bytes() const {
  std::vector<Vec3> rest(ids_.size());
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    for (std::size_t i = 0; i < places_[t].size(); ++i) rest[places_[t][i]] = sets_[t].rest[i];
  }
  std::size_t largest = 0;
  for (const Piece& piece : pieces_) {
    if (!piece.alone) largest = std::max(largest, Joint(*this, piece, rest).bytes());
  }
  return 12 * ids_.size() * sizeof(Vec3) + largest;
}

std::vector<Vec3> ExactPlacement::of_set(std::size_t t, const std::vector<Vec3>& points) const {
  std::vector<Vec3> result;
  result.reserve(places_[t].size());
  for (const std::uint32_t u : places_[t]) result.push_back(points[u]);
  return result;
}

void ExactPlacement::project(std::size_t t, std::vector<Vec3>& points) const {
  const std::vector<Vec3> x = of_set(t, points);
  std::vector<Vec3> y(x.size());
  ShapeParameters shape;
  sets_[t].projection->project(x, y, shape);
  for (std::size_t i = 0; i < y.size(); ++i) points[places_[t][i]] = y[i];
}

double ExactPlacement::merit(const Piece& piece, const std::vector<Vec3>& from, const std::vector<Vec3>& points) const {
  double moved = 0, missed = 0;
  for (const std::uint32_t u : piece.moving) moved += squared_distance(from[u], points[u]);
  for (const std::size_t t : piece.sets) {
    const std::vector<Vec3> x = of_set(t, points);
    std::vector<Vec3> y(x.size());
    ShapeParameters shape;
    missed += sets_[t].projection->project(x, y, shape);
  }
  return moved + stiffness * missed;
}

/// Every step lowers the merit, so that the last place is the best.
void ExactPlacement::descend(const Piece& piece, const std::vector<Vec3>& from, std::vector<Vec3>& points,
                             const RunContext& context) const {
  double best = merit(piece, from, points);
  for (int step = 0; step < most_steps; ++step) {
    std::vector<Vec3> least;
    try {
      least = Joint(*this, piece, points, context).least(from);
    } catch (const Error& error) {
      // Shapes that have run off make no matrix: what there is so far has to do.
      if (error.code() != ErrorCode::numerical_failure) throw;
      return;
    }
    double squares = 0;
    for (const std::uint32_t u : piece.moving) squares += squared_distance(points[u], least[u]);
    bool taken = false;
    double share = 1;
    for (int halving = 0; halving < most_halvings && !taken; ++halving, share /= 2) {
      std::vector<Vec3> next = points;
      for (const std::uint32_t u : piece.moving) {
        for (std::size_t k = 0; k < 3; ++k)
          next[u][k] = share == 1 ? least[u][k] : next[u][k] + share * (least[u][k] - next[u][k]);
      }
      const double value = merit(piece, from, next);
      // A full step that rounding hides goes along the shapes.
      taken = value < best || (share == 1 && value <= best * (1 + rounding));
      if (!taken) continue;
      best = value;
      points = std::move(next);
    }
    if (!taken || squares <= smallest_step * smallest_step * static_cast<double>(piece.moving.size())) return;
  }
}

double ExactPlacement::largest_distance(const Piece& piece, const std::vector<Vec3>& points) const {
  double largest = 0;
  for (const std::size_t t : piece.sets) {
    const std::vector<Vec3> x = of_set(t, points);
    std::vector<Vec3> y(x.size());
    ShapeParameters shape;
    sets_[t].projection->project(x, y, shape);
    for (std::size_t i = 0; i < x.size(); ++i) largest = std::max(largest, squared_distance(x[i], y[i]));
  }
  return std::sqrt(largest);
}

bool ExactPlacement::is_worse(const Piece& piece, double before, double left, const Placed& placed) const {
  const double most = most_movement(placed, left <= met);
  for (const std::size_t t : piece.sets) {
    for (const std::uint32_t u : places_[t]) {
      // So that what is not finite is worse.
      if (!(std::sqrt(squared_distance(placed.from[u], placed.points[u])) <= most)) return true;
    }
  }
  return !(left <= met || left < before);
}

ExactPlacement::Placed ExactPlacement::place(std::vector<Vec3> from, const RunContext& context) const {
  Placed placed;
  placed.from = std::move(from);
  placed.points = placed.from;
  placed.given_up.resize(sets_.size());
  std::vector<double> before;
  for (const Piece& piece : pieces_) before.push_back(largest_distance(piece, placed.from));
  for (const double distance : before) placed.distance = std::max(placed.distance, distance);
  for (std::size_t i = 0; i < pieces_.size(); ++i) {
    const Piece& piece = pieces_[i];
    if (piece.alone) {
      project(piece.sets[0], placed.points);
    } else {
      descend(piece, placed.from, placed.points, context);
    }
    const double left = largest_distance(piece, placed.points);
    if (!is_worse(piece, before[i], left, placed)) {
      placed.met = placed.met && left <= met;
      continue;
    }
    for (const std::size_t t : piece.sets) {
      placed.given_up[t] = true;
      for (const std::uint32_t u : places_[t]) placed.points[u] = placed.from[u];
    }
  }
  return placed;
}

std::vector<Vec3> ExactPlacement::alone_derivative(const Placed& at, const std::vector<Vec3>& change) const {
  std::vector<Vec3> result = change;
  for (const Piece& piece : pieces_) {
    const std::size_t t = piece.sets[0];
    if (!piece.alone || at.given_up[t]) continue;
    const std::vector<Vec3> x = of_set(t, at.from), dx = of_set(t, change);
    std::vector<Vec3> y(x.size());
    ShapeParameters shape;
    sets_[t].projection->project(x, y, shape);
    sets_[t].projection->derivative(x, shape, dx, y);
    for (std::size_t i = 0; i < y.size(); ++i) result[places_[t][i]] = y[i];
  }
  return result;
}

std::vector<Vec3> ExactPlacement::derivative(const Placed& at, const std::vector<Vec3>& change, const RunContext& context) const {
  std::vector<Vec3> result = alone_derivative(at, change);
  for (const Piece& piece : pieces_) {
    if (!piece.alone && !at.given_up[piece.sets[0]]) Joint(*this, piece, at.points, context).follow(result, context);
  }
  return result;
}

std::vector<Vec3> ExactPlacement::adjoint(const Placed& at, const std::vector<Vec3>& cotangent, const RunContext& context) const {
  std::vector<Vec3> result = alone_derivative(at, cotangent);
  for (const Piece& piece : pieces_) {
    if (!piece.alone && !at.given_up[piece.sets[0]]) Joint(*this, piece, at.points, context).pull_back(result, context);
  }
  return result;
}

}  // namespace deform
