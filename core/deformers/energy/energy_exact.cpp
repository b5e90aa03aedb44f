// Exact constraints: the last step of a design, and its derivatives.
#include <algorithm>
#include <atomic>
#include <cmath>

#include "core/base/parallel.h"
#include "core/deformers/energy/energy_system.h"
#include "core/numerics/sampling/farthest_points.h"

namespace deform {

void EnergySystem::prepare_exact(const std::vector<ConstraintSet>& sets, const RunContext& context) {
  std::vector<std::size_t> chosen_sets;
  for (std::size_t t = 0; t < sets.size(); ++t) {
    if (setup_.constraints[constraint_of_[t]].exact) chosen_sets.push_back(t);
  }
  if (chosen_sets.empty()) return;
  // By content, so that the order in which they are written does not matter.
  std::stable_sort(chosen_sets.begin(), chosen_sets.end(), [&](std::size_t a, std::size_t b) {
    const std::string_view kind = sets[a].projection->kind(), other = sets[b].projection->kind();
    return kind != other ? kind < other : sets[a].ids < sets[b].ids;
  });
  std::vector<ConstraintSet> exact_sets;
  for (const std::size_t t : chosen_sets) {
    exact_sets.push_back(sets[t]);
    exact_constraint_of_.push_back(constraint_of_[t]);
  }
  std::vector<bool> moves(mesh_->point_count());
  for (std::size_t i = 0; i < moves.size(); ++i) moves[i] = !exact() || region_of_[i] == deformable_region;
  placement_ = std::make_unique<const ExactPlacement>(std::move(exact_sets), moves);

  std::vector<PointId> moving;
  for (std::size_t u = 0; u < placement_->ids().size(); ++u) {
    if (!placement_->moves(u)) continue;
    moving_exact_.push_back(static_cast<std::uint32_t>(u));
    moving.push_back(placement_->ids()[u]);
  }
  const std::size_t most = ResidualCorrection::centres_for(following_.size());
  std::vector<Vec3> places = unit_places(moving);
  const std::vector<Vec3> held_places = unit_places(model_.held);
  std::vector<std::uint32_t> candidates = farthest_point_order(places, most);
  for (const std::uint32_t j : farthest_point_order(held_places, most / 2)) {
    candidates.push_back(static_cast<std::uint32_t>(places.size()) + j);
  }
  places.insert(places.end(), held_places.begin(), held_places.end());
  std::vector<Vec3> chosen;
  for (const std::uint32_t i : candidates) chosen.push_back(places[i]);
  // In this order again, so that only coincident ones are dropped.
  std::vector<std::uint32_t> centres;
  for (const std::uint32_t i : farthest_point_order(chosen, chosen.size())) centres.push_back(candidates[i]);
  placement_correction_ =
      std::make_unique<const ResidualCorrection>(places, std::move(centres), ResidualCorrection::Kind::gentle, context);
  exact_places_ = TiledPoints(unit_places(placement_->ids()));
  if (!correction_) following_places_ = TiledPoints(unit_places(following_));
}

/// Where the points are without the last step, or how they change there; unit coordinates.
std::vector<Vec3> EnergySystem::before_exact(const Solution& solution, const BoundDesign& design, MotionKind kind) const {
  const std::vector<PointId>& ids = placement_->ids();
  const HeldPoints points = held();
  const bool positions = kind == MotionKind::position;
  std::vector<Vec3> result(ids.size());
  std::vector<double> values(3 * tile_size);
  for (std::size_t t = 0; t < exact_places_.tiles(); ++t) {
    std::fill(values.begin(), values.end(), 0.0);
    if (solution.correction.size() > 0)
      correction_->add_values(exact_places_.tile(t), solution.correction.data(), 3, values.data());
    for (std::size_t u = t * tile_size; u < std::min(ids.size(), (t + 1) * tile_size); ++u) {
      if (!placement_->moves(u)) {
        const Vec3 told = points.place(design, ids[u], kind);
        result[u] = positions ? box_.to_unit(told) : Vec3{told[0] / box_.scale, told[1] / box_.scale, told[2] / box_.scale};
        continue;
      }
      if (positions) result[u] = box_.to_unit(mesh_->points[ids[u]]);
      for (std::size_t k = 0; k < 3; ++k) {
        double value = values[k * tile_size + u % tile_size];
        for (SparseRows::InnerIterator it(model_.space.values, ids[u]); it; ++it) {
          value += it.value() * solution.w(it.col(), static_cast<Eigen::Index>(k));
        }
        result[u][k] += value / box_.scale;
      }
    }
  }
  return result;
}

/// What carries the step of the exact points along.
void EnergySystem::set_placement(const std::vector<Vec3>& from, const std::vector<Vec3>& to, Solution& solution,
                                 const RunContext& context) const {
  Eigen::MatrixXd step = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(moving_exact_.size() + model_.held.size()), 3);
  for (std::size_t i = 0; i < moving_exact_.size(); ++i) {
    const std::uint32_t u = moving_exact_[i];
    for (std::size_t k = 0; k < 3; ++k) {
      step(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = box_.scale * (to[u][k] - from[u][k]);
    }
  }
  solution.placement = placement_correction_->coefficients(step, context);
}

void EnergySystem::place_exactly(const BoundDesign& design, Solution& solution, const RunContext& context) const {
  solution.exact = placement_->place(before_exact(solution, design, MotionKind::position), context);
  if (!solution.exact.any()) return;
  set_placement(solution.exact.from, solution.exact.points, solution, context);
  if (carries_far(solution, context)) {
    solution.exact.give_up();
    solution.placement.resize(0, 0);
    return;
  }
  solution.exact_values.reserve(solution.exact.points.size());
  for (const Vec3& y : solution.exact.points) solution.exact_values.push_back(box_.to_model(y));
}

/// Whether some point is carried along farther than an exact one may move: the interpolant of the steps can overshoot where no
/// point holds it.
bool EnergySystem::carries_far(const Solution& solution, const RunContext& context) const {
  const double most = ExactPlacement::most_movement(solution.exact) * box_.scale;
  std::atomic<bool> far = false;
  parallel_for(context, following_places_.tiles(), 64, [&](std::size_t begin, std::size_t end) {
    std::vector<double> values(3 * tile_size);
    for (std::size_t t = begin; t < end && !far; ++t) {
      std::fill(values.begin(), values.end(), 0.0);
      placement_correction_->add_values(following_places_.tile(t), solution.placement.data(), 3, values.data());
      for (std::size_t i = 0; i < tile_size; ++i) {
        // So that what is not finite is far.
        if (!(std::hypot(values[i], values[tile_size + i], values[2 * tile_size + i]) <= most)) far = true;
      }
    }
  });
  return far;
}

void EnergySystem::derive_exactly(const ExactPlacement::Placed& at, const BoundDesign& design, Solution& solution,
                                  const RunContext& context) const {
  if (!at.any()) return;
  const std::vector<Vec3> from = before_exact(solution, design, MotionKind::derivative);
  solution.exact_values = placement_->derivative(at, from, context);
  set_placement(from, solution.exact_values, solution, context);
  for (Vec3& value : solution.exact_values) {
    for (double& x : value) x *= box_.scale;
  }
}

/// Cotangents of the following points become those of the deformation without the last step; the result is what arrives at the
/// points of exact sets that are told where to be (U).
std::vector<Vec3> EnergySystem::pull_back_exact(const ExactPlacement::Placed& at, std::vector<Vec3>& cotangents,
                                                const RunContext& context) const {
  const std::vector<PointId>& ids = placement_->ids();
  std::vector<Vec3> places = unit_places(following_), others = cotangents;
  std::vector<std::size_t> slots(ids.size(), following_.size());
  std::vector<Vec3> y(ids.size(), Vec3{});
  for (const std::uint32_t u : moving_exact_) {
    slots[u] = static_cast<std::size_t>(std::lower_bound(following_.begin(), following_.end(), ids[u]) - following_.begin());
    y[u] = cotangents[slots[u]];
    others[slots[u]] = {};
  }
  const Eigen::MatrixXd steps = placement_correction_->adjoint(places, others, context);
  const auto step = [&](std::size_t i, std::size_t k) {
    return steps(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k));
  };
  for (std::size_t i = 0; i < moving_exact_.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) y[moving_exact_[i]][k] += step(i, k);
  }
  std::vector<Vec3> from = placement_->adjoint(at, y, context);
  for (std::size_t i = 0; i < moving_exact_.size(); ++i) {
    Vec3& x = from[moving_exact_[i]];
    for (std::size_t k = 0; k < 3; ++k) x[k] -= step(i, k);
    cotangents[slots[moving_exact_[i]]] = x;
    x = {};
  }
  return from;
}

}  // namespace deform
