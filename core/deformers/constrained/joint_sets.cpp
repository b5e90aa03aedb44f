// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/joint_sets.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/constraints/fitting.h"
#include "core/numerics/sparse/conjugate_gradients.h"

namespace deform {

namespace {

constexpr int most_joint_steps = 60, most_joint_halvings = 12, most_iterations = 200;
constexpr double smallest_step = 1e-15;  // of coordinates of order one
constexpr double last_stalled_step = 1e-8;
constexpr double last_step = 1e-11;  // of an iteration that has ended
constexpr double least_rank = 1e-6, most_rank = 0.5;
constexpr double misfit_to_rank = 10;
constexpr double along_force = 1e-2;  // where curvatures are measured: s
constexpr double accuracy = 1e-13;    // of derivatives

std::vector<Vec3> of_set(const SetsOnPoints& on, std::size_t t, const std::vector<Vec3>& points) {
  std::vector<Vec3> result;
  result.reserve(on.places[t].size());
  for (const std::uint32_t u : on.places[t]) result.push_back(points[u]);
  return result;
}

Eigen::VectorXd flat(const std::vector<Vec3>& points) {
  Eigen::VectorXd result(static_cast<Eigen::Index>(3 * points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) result[static_cast<Eigen::Index>(3 * i + k)] = points[i][k];
  }
  return result;
}

std::vector<Vec3> points_from(const Eigen::VectorXd& flat) {
  std::vector<Vec3> result(static_cast<std::size_t>(flat.size()) / 3);
  for (std::size_t i = 0; i < result.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) result[i][k] = flat[static_cast<Eigen::Index>(3 * i + k)];
  }
  return result;
}

double longest(const std::vector<Vec3>& vectors) {
  double longest = 0;
  for (const Vec3& v : vectors) {
    // The negation makes NaN the largest.
    if (!(dot(v, v) <= longest)) longest = dot(v, v);
  }
  return std::sqrt(longest);
}

}  // namespace

double largest_distance(const ConstraintSet& set, const std::vector<Vec3>& x, ShapeParameters& shape) {
  std::vector<Vec3> y(x.size());
  set.projection->project(x, y, shape);
  for (std::size_t i = 0; i < x.size(); ++i) y[i] = y[i] - x[i];
  return longest(y);
}

/// The state of an iteration.
class JointSets::Iteration {
 public:
  Iteration(const SetsOnPoints& on, const std::vector<Vec3>& from, const std::vector<ShapeParameters>& shapes)
      : on_(on), from_(from) {
    now_.points = from;
    now_.shapes = shapes;
    for (std::size_t t = 0; t < on_.sets.size(); ++t) {
      bounds_ = bounds_ || on_.sets[t]->projection->has_bounds();
      radius_.push_back(std::max(spread({of_set(on_, t, from)}).radius, 1e-9));
    }
    measure(now_);
  }

  State run(double most, const RunContext& context) {
    State best = now_;
    bool ended = false;
    double last = HUGE_VAL;
    int stalled = 0;
    std::vector<std::pair<std::size_t, std::size_t>> ranks;
    for (int step = 0; step < most_joint_steps && !ended; ++step) {
      context.check();
      const RankLimits limits = rank_limits();
      const LinearizedSets sets(on_, now_.points, now_.shapes, now_.forces, limits, context);
      if (step > 0 && !bounds_) ranks.emplace_back(sets.point_rank(), sets.shape_rank());
      std::vector<Vec3> back(from_.size()), d;
      for (std::size_t u = 0; u < back.size(); ++u) back[u] = from_[u] - now_.points[u];
      d = sets.step(back, sets.residual());
      const double length = longest(d);
      for (std::size_t u = 0; u < back.size(); ++u) back[u] = back[u] - d[u];
      now_.forces = sets.forces(-sets.adjoint(back));
      if (!std::isfinite(length)) break;
      if (!take(d, length, most)) {
        ended = largest(now_) <= satisfied_distance && length <= last_stalled_step;
        break;
      }
      if (largest(now_) <= largest(best)) best = now_;
      if (far(now_, 2 * most)) break;
      // With many parameters of shapes the regularization leaves more of rounding in the steps.
      stalled = length > 0.5 * last ? stalled + 1 : 0;
      ended = length <= smallest_step || (stalled >= 1 && length <= last_step) || (stalled >= 4 && length <= last_stalled_step);
      last = length;
    }
    // Use the last iterate, where the steps ended; another one may be closer to the shapes only by rounding.
    if (ended && largest(now_) <= satisfied_distance) best = now_;
    // A rank that has decreased at the solution was caused by the misfit.
    const bool regular = std::all_of(ranks.begin(), ranks.end(), [&](const auto& rank) {
      return rank.first <= ranks.back().first && rank.second <= ranks.back().second;
    });
    best.found = ended && regular && largest(best) <= satisfied_distance && !far(best, most);
    return best;
  }

 private:
  void measure(State& state) const {
    state.distances.resize(on_.sets.size());
    for (std::size_t t = 0; t < on_.sets.size(); ++t) {
      state.distances[t] = largest_distance(*on_.sets[t], of_set(on_, t, state.points), state.shapes[t]);
    }
  }
  static double largest(const State& state) { return *std::max_element(state.distances.begin(), state.distances.end()); }
  bool far(const State& state, double most) const {
    for (std::size_t u = 0; u < from_.size(); ++u) {
      if (!(distance(state.points[u], from_[u]) <= most)) return true;
    }
    return false;
  }

  RankLimits rank_limits() const {
    double angle = 0;
    for (std::size_t t = 0; t < on_.sets.size(); ++t) angle = std::max(angle, now_.distances[t] / radius_[t]);
    const double limit = std::clamp(misfit_to_rank * angle, least_rank, most_rank);
    return {limit, limit};
  }

  bool take(const std::vector<Vec3>& d, double length, double most) {
    double share = std::min(1.0, most / length);
    for (int halving = 0; halving < most_joint_halvings; ++halving, share /= 2) {
      State next = now_;
      for (std::size_t u = 0; u < d.size(); ++u) next.points[u] = now_.points[u] + share * d[u];
      measure(next);
      const double left = largest(next);
      if (left <= std::max({(1 - 0.1 * share) * largest(now_), 0.5 * share * length, 1e-13})) {
        now_ = std::move(next);
        return true;
      }
    }
    return false;
  }

  const SetsOnPoints& on_;
  const std::vector<Vec3>& from_;
  State now_;
  std::vector<double> radius_;  ///< per set
  bool bounds_ = false;
};

JointSets::State JointSets::place(const std::vector<Vec3>& from, const std::vector<ShapeParameters>& shapes, double most,
                                  const RunContext& context) const {
  try {
    return Iteration(on_, from, shapes).run(most, context);
  } catch (const Error& error) {
    // Shapes that have run off.
    if (error.code() != ErrorCode::numerical_failure) throw;
    State state{from, shapes, {}, {}, false};
    state.distances.assign(on_.sets.size(), HUGE_VAL);
    return state;
  }
}

std::size_t JointSets::working_bytes(const std::vector<Vec3>& points, const RunContext& context) const {
  std::vector<ShapeParameters> shapes(on_.sets.size());
  const LinearizedSets sets(on_, points, shapes, {}, {0.5, 0.5}, context);
  return sets.bytes() + 20 * points.size() * sizeof(Vec3);
}

LinearizedSets JointSets::linearized(const State& at, const RunContext& context) const {
  std::vector<ShapeParameters> shapes = at.shapes;
  return LinearizedSets(on_, at.points, shapes, at.forces, {least_rank, least_rank}, context);
}

/// sum S_t of a change along the shapes: with E = P'(y + s f) - 1, s S = E - E^2 to third order.
std::vector<Vec3> JointSets::curved(const State& at, const std::vector<Vec3>& change) const {
  std::vector<Vec3> result(change.size(), Vec3{});
  for (std::size_t t = 0; t < on_.sets.size(); ++t) {
    if (longest(at.forces[t]) == 0) continue;
    std::vector<Vec3> x = of_set(on_, t, at.points), projected(x.size());
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = x[i] + along_force * at.forces[t][i];
    ShapeParameters shape = at.shapes[t];
    const Projection& projection = *on_.sets[t]->projection;
    projection.project(x, projected, shape);
    const auto bent = [&](const std::vector<Vec3>& v) {
      std::vector<Vec3> out(v.size());
      projection.derivative(x, shape, v, out);
      for (std::size_t i = 0; i < v.size(); ++i) out[i] = out[i] - v[i];
      return out;
    };
    const std::vector<Vec3> once = bent(of_set(on_, t, change)), twice = bent(once);
    for (std::size_t i = 0; i < x.size(); ++i) {
      Vec3& sum = result[on_.places[t][i]];
      sum = sum + (1 / along_force) * (once[i] - twice[i]);
    }
  }
  return result;
}

/// u = T right + T S u.
std::vector<Vec3> JointSets::tangent_solution(const State& at, const LinearizedSets& sets, const std::vector<Vec3>& right,
                                              const RunContext& context) const {
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(sets.residual().size());
  const auto product = [&](const Eigen::VectorXd& u) -> Eigen::VectorXd {
    return u - flat(sets.step(curved(at, points_from(u)), none));
  };
  const auto same = [](const Eigen::VectorXd& u) { return u; };
  // At an indefinite direction the current iterate is the best available result.
  return points_from(
      conjugate_gradients(Eigen::VectorXd(flat(sets.step(right, none))), product, same, accuracy, most_iterations, context).x);
}

std::vector<Vec3> JointSets::derivative(const State& at, const std::vector<Vec3>& change, const RunContext& context) const {
  const LinearizedSets sets = linearized(at, context);
  // First the response to the fixed points to first order, then the part along the shapes.
  std::vector<Vec3> result = sets.step(std::vector<Vec3>(change.size(), Vec3{}), sets.held_rows(change));
  for (std::size_t u = 0; u < change.size(); ++u) {
    if (!on_.moves[u]) result[u] = change[u];
  }
  std::vector<Vec3> right = curved(at, result);
  for (std::size_t u = 0; u < change.size(); ++u) right[u] = right[u] + change[u];
  const std::vector<Vec3> along = tangent_solution(at, sets, right, context);
  for (std::size_t u = 0; u < change.size(); ++u) result[u] = result[u] + along[u];
  return result;
}

std::vector<Vec3> JointSets::adjoint(const State& at, const std::vector<Vec3>& cotangent, const RunContext& context) const {
  const LinearizedSets sets = linearized(at, context);
  const std::vector<Vec3> along = tangent_solution(at, sets, cotangent, context), by_shapes = curved(at, along);
  std::vector<Vec3> followed(cotangent.size()), result = along;
  for (std::size_t u = 0; u < cotangent.size(); ++u) followed[u] = cotangent[u] + by_shapes[u];
  const std::vector<Vec3> held = sets.held_adjoint(sets.adjoint(followed));
  for (std::size_t u = 0; u < cotangent.size(); ++u) {
    if (!on_.moves[u]) result[u] = followed[u] + held[u];
  }
  return result;
}

}  // namespace deform
