#include "core/deformers/exact_placement.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/numerics/sparse_cholesky.h"

namespace deform {

namespace {

using Entry = Eigen::Triplet<double, std::int64_t>;
constexpr double stiffness = 1e9;  // of the linearized distances against the changes
constexpr double damping = 1e-9;   // of parameters of shapes that change nothing
constexpr int most_steps = 60, most_iterations = 500;
constexpr double smallest_step = 1e-14;
constexpr double accuracy = 1e-11;  // of derivatives

}  // namespace

/// The sets that are not alone about some positions: [I + W J^T J, W J^T P; W P^T J, W P^T P].
class ExactPlacement::Joint {
 public:
  /// Factored.
  Joint(const ExactPlacement& placement, const std::vector<Vec3>& points, const RunContext& context) : Joint(placement, points) {
    factor_ = std::make_unique<const SparseCholesky>(matrix(), context);
  }

  /// Not factored, so that nothing can be solved.
  Joint(const ExactPlacement& placement, const std::vector<Vec3>& points)
      : placement_(placement), points_(points), shapes_(placement.sets_.size()) {
    std::vector<Entry> entries;
    std::vector<double> residuals;
    std::int64_t columns = placement.unknowns_;
    for (std::size_t t = 0; t < placement.sets_.size(); ++t) {
      if (placement.alone_[t]) continue;
      const std::vector<Vec3> x = placement.of_set(t, points);
      std::vector<Vec3> projected(x.size());
      const Projection& projection = *placement.sets_[t].projection;
      projection.project(x, projected, shapes_[t]);
      const Linearization linear = projection.linearize(x, shapes_[t]);
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
    for (std::int64_t j = 0; j < columns; ++j) diagonal.insert(j, j) = j < placement_.unknowns_ ? 1.0 : damping * largest;
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

  /// The step of `points` to the least value of the model that starts at `from`; its length, rms.
  double step(const std::vector<Vec3>& from, std::vector<Vec3>& points) const {
    const std::int64_t n = placement_.unknowns_;
    Eigen::VectorXd b = -stiffness * (J_.transpose() * residual_);
    b.head(n) += moving(from) - moving(points);
    factor_->solve_in_place(b);
    put(moving(points) + b.head(n), points);
    return n > 0 ? b.head(n).norm() / std::sqrt(static_cast<double>(n) / 3) : 0;
  }

  /// The derivative at the end: (I + W sum (I - P')) dy = dx over the points that move, with what the others do on the right.
  void follow(std::vector<Vec3>& change, const RunContext& context) const {
    std::vector<Vec3> held = change;
    put(Eigen::VectorXd::Zero(placement_.unknowns_), held);
    put(solved(moving(change) - stiffness * moving(unmet(held)), context), change);
  }

  /// Its transpose.
  void pull_back(std::vector<Vec3>& cotangent, const RunContext& context) const {
    std::vector<Vec3> at_moving(cotangent.size(), Vec3{});
    put(solved(moving(cotangent), context), at_moving);
    const std::vector<Vec3> pushed = unmet(at_moving);
    for (std::size_t u = 0; u < cotangent.size(); ++u) {
      for (std::size_t k = 0; k < 3; ++k) {
        cotangent[u][k] = placement_.unknown_[u] >= 0 ? at_moving[u][k] : cotangent[u][k] - stiffness * pushed[u][k];
      }
    }
  }

 private:
  /// sum over the sets of (I - P') applied to U vectors; nothing for those that are alone.
  std::vector<Vec3> unmet(const std::vector<Vec3>& change) const {
    std::vector<Vec3> result(change.size(), Vec3{});
    for (std::size_t t = 0; t < placement_.sets_.size(); ++t) {
      if (placement_.alone_[t]) continue;
      const std::vector<Vec3> x = placement_.of_set(t, points_), dx = placement_.of_set(t, change);
      std::vector<Vec3> along(x.size());
      placement_.sets_[t].projection->derivative(x, shapes_[t], dx, along);
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
    Eigen::VectorXd x = Eigen::VectorXd::Zero(b.size()), r = b, z = preconditioned(r), p = z;
    double rz = r.dot(z);
    const double wanted = accuracy * std::sqrt(std::abs(rz));
    for (int i = 0; i < most_iterations && std::sqrt(std::abs(rz)) > wanted; ++i) {
      context.check();
      put(p, field);
      const Eigen::VectorXd Hp = p + stiffness * moving(unmet(field));
      const double curvature = p.dot(Hp);
      if (!(curvature > 0)) break;  // not a minimum: what there is so far is the best that can be said
      x += rz / curvature * p;
      r -= rz / curvature * Hp;
      z = preconditioned(r);
      const double next = r.dot(z);
      p = z + next / rz * p;
      rz = next;
    }
    return x;
  }

  Eigen::VectorXd moving(const std::vector<Vec3>& points) const {
    Eigen::VectorXd result(placement_.unknowns_);
    for (std::size_t u = 0; u < points.size(); ++u) {
      const std::int64_t at = placement_.unknown_[u];
      for (std::size_t k = 0; at >= 0 && k < 3; ++k) result[at + static_cast<std::int64_t>(k)] = points[u][k];
    }
    return result;
  }
  void put(const Eigen::VectorXd& from, std::vector<Vec3>& points) const {
    for (std::size_t u = 0; u < points.size(); ++u) {
      const std::int64_t at = placement_.unknown_[u];
      for (std::size_t k = 0; at >= 0 && k < 3; ++k) points[u][k] = from[at + static_cast<std::int64_t>(k)];
    }
  }

  const ExactPlacement& placement_;
  std::vector<Vec3> points_;
  std::vector<ShapeParameters> shapes_;
  SparseMatrix J_;  ///< distances by unknowns and parameters
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
  unknown_.assign(ids_.size(), -1);
  for (const std::vector<std::uint32_t>& places : places_) {
    const auto single = [&](std::uint32_t u) { return uses[u] == 1 && moves_[u]; };
    alone_.push_back(std::all_of(places.begin(), places.end(), single));
    if (alone_.back()) continue;
    joint_ = true;
    for (const std::uint32_t u : places) {
      if (!moves_[u] || unknown_[u] >= 0) continue;
      unknown_[u] = unknowns_;
      unknowns_ += 3;
    }
  }
}

std::size_t ExactPlacement::bytes() const {
  std::size_t bytes = ids_.size() * (sizeof(PointId) + sizeof(std::int64_t) + 1);
  for (const ConstraintSet& set : sets_) bytes += set.ids.size() * (sizeof(PointId) + sizeof(Vec3) + sizeof(std::uint32_t));
  return bytes;
}

std::size_t ExactPlacement::working_bytes() const {
  const std::size_t vectors = 12 * ids_.size() * sizeof(Vec3);
  if (!joint_) return vectors;
  std::vector<Vec3> rest(ids_.size());
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    for (std::size_t i = 0; i < places_[t].size(); ++i) rest[places_[t][i]] = sets_[t].rest[i];
  }
  return vectors + Joint(*this, rest).bytes();
}

std::vector<Vec3> ExactPlacement::of_set(std::size_t t, const std::vector<Vec3>& points) const {
  std::vector<Vec3> result;
  result.reserve(places_[t].size());
  for (const std::uint32_t u : places_[t]) result.push_back(points[u]);
  return result;
}

void ExactPlacement::project_alone(std::vector<Vec3>& points) const {
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    if (!alone_[t]) continue;
    const std::vector<Vec3> x = of_set(t, points);
    std::vector<Vec3> y(x.size());
    ShapeParameters shape;
    sets_[t].projection->project(x, y, shape);
    for (std::size_t i = 0; i < y.size(); ++i) points[places_[t][i]] = y[i];
  }
}

double ExactPlacement::largest_distance(std::size_t t, const std::vector<Vec3>& points) const {
  const std::vector<Vec3> x = of_set(t, points);
  std::vector<Vec3> y(x.size());
  ShapeParameters shape;
  sets_[t].projection->project(x, y, shape);
  double largest = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    largest = std::max(largest, std::hypot(x[i][0] - y[i][0], x[i][1] - y[i][1], x[i][2] - y[i][2]));
  }
  return largest;
}

ExactPlacement::Placed ExactPlacement::place(std::vector<Vec3> from, const RunContext& context) const {
  Placed placed;
  placed.from = std::move(from);
  placed.points = placed.from;
  project_alone(placed.points);
  for (int step = 0; joint_ && step < most_steps; ++step) {
    if (Joint(*this, placed.points, context).step(placed.from, placed.points) <= smallest_step) break;
  }
  for (std::size_t t = 0; t < sets_.size(); ++t) placed.distances.push_back(largest_distance(t, placed.points));
  return placed;
}

std::vector<Vec3> ExactPlacement::alone_derivative(const Placed& at, const std::vector<Vec3>& change) const {
  std::vector<Vec3> result = change;
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    if (!alone_[t]) continue;
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
  if (joint_) Joint(*this, at.points, context).follow(result, context);
  return result;
}

std::vector<Vec3> ExactPlacement::adjoint(const Placed& at, const std::vector<Vec3>& cotangent, const RunContext& context) const {
  std::vector<Vec3> result = alone_derivative(at, cotangent);
  if (joint_) Joint(*this, at.points, context).pull_back(result, context);
  return result;
}

}  // namespace deform
