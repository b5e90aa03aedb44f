// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/exact_step.h"

#include <algorithm>
#include <atomic>
#include <cmath>

#include "core/base/parallel.h"
#include "core/deformers/handles/constraint_points.h"
#include "core/numerics/sampling/farthest_points.h"

namespace deform {

CarrierPlaces carrier_places(const CarrierInput& from) {
  const bool joins = from.steps == ExactSteps::joins;
  std::vector<PointId> ids = from.moving;
  // Soft handles may hold exact points: these have a step already.
  for (const PointId id : from.held) {
    if (!joins || !std::binary_search(from.moving.begin(), from.moving.end(), id)) ids.push_back(id);
  }
  CarrierPlaces result;
  result.places = unit_places(from.mesh, from.box, ids);
  // In stored systems rounding decides which centres there are.
  const auto order = [&](std::span<const Vec3> places, std::size_t most) {
    return joins ? ResidualCorrection::centres_of(places, most, ResidualCorrection::Kind::gentle)
                 : farthest_point_order(places, most);
  };
  const std::size_t most = ResidualCorrection::centres_for(from.following), moving = from.moving.size();
  const std::span<const Vec3> places = result.places;
  std::vector<std::uint32_t> candidates = order(places.first(moving), most);
  for (const std::uint32_t j : order(places.subspan(moving), most / 2)) {
    candidates.push_back(static_cast<std::uint32_t>(moving) + j);
  }
  std::vector<Vec3> chosen;
  for (const std::uint32_t i : candidates) chosen.push_back(places[i]);
  // In this order again, so that only coincident ones are dropped.
  for (const std::uint32_t i : order(chosen, chosen.size())) result.centres.push_back(candidates[i]);
  if (!joins) return result;
  std::vector<RegionIndex> region_of = from.region_of;
  for (const PointId id : from.moving) region_of[id] = fixed_region;
  const std::vector<char> next = next_to_deformable(from.mesh, region_of);
  for (const PointId id : ids) result.bound.push_back(next[id]);
  return result;
}

ExactStep::ExactStep(const DeformationBefore& before, const std::vector<ConstraintSet>& sets,
                     const std::vector<std::size_t>& constraint_of, const RunContext& context)
    : before_(before) {
  for (std::size_t t = 0; t < sets.size(); ++t) {
    if (before_.held.setup.constraints[constraint_of[t]].exact) set_of_.push_back(t);
  }
  std::vector<ConstraintSet> exact_sets;
  for (const std::size_t t : set_of_) {
    exact_sets.push_back(sets[t]);
    constraint_of_.push_back(constraint_of[t]);
  }
  const Mesh& mesh = before_.held.mesh;
  std::vector<bool> moves(mesh.point_count());
  for (std::size_t i = 0; i < moves.size(); ++i) {
    moves[i] = !before_.hard_handles || before_.held.region_of[i] == deformable_region;
  }
  placement_ = std::make_unique<const ExactPlacement>(std::move(exact_sets), moves);

  std::vector<PointId> moving;
  for (std::size_t u = 0; u < ids().size(); ++u) {
    if (!placement_->moves(u)) continue;
    moving_.push_back(static_cast<std::uint32_t>(u));
    moving.push_back(ids()[u]);
  }
  CarrierPlaces from = carrier_places({mesh, before_.box, before_.held.region_of, moving, before_.held_ids,
                                       before_.following.size(), before_.held.setup.constraint_options.exact_steps});
  carrier_ = std::make_unique<const ResidualCorrection>(from.places, std::move(from.centres), ResidualCorrection::Kind::gentle,
                                                        from.bound, context);
  carried_from_ = from.places.size();
  places_ = TiledPoints(unit_places(mesh, before_.box, ids()));
}

/// Where the points are without the last step, or how they change there; unit coordinates.
std::vector<Vec3> ExactStep::points_before(const EnergyField& field, const BoundDesign& design, MotionKind kind) const {
  const std::vector<PointId>& ids = placement_->ids();
  const HeldPoints& points = before_.held;
  const UnitBox& box = before_.box;
  const bool positions = kind == MotionKind::position;
  std::vector<Vec3> result(ids.size());
  std::vector<double> values(3 * tile_size);
  for (std::size_t t = 0; t < places_.tiles(); ++t) {
    std::fill(values.begin(), values.end(), 0.0);
    if (field.correction.size() > 0) before_.correction->add_values(places_.tile(t), field.correction.data(), 3, values.data());
    for (std::size_t u = t * tile_size; u < std::min(ids.size(), (t + 1) * tile_size); ++u) {
      if (!placement_->moves(u)) {
        const Vec3 target = points.place(design, ids[u], kind);
        result[u] = positions ? box.to_unit(target) : Vec3{target[0] / box.scale, target[1] / box.scale, target[2] / box.scale};
        continue;
      }
      if (positions) result[u] = box.to_unit(points.mesh.points[ids[u]]);
      for (std::size_t k = 0; k < 3; ++k) {
        double value = values[k * tile_size + u % tile_size];
        before_.values.for_each(
            ids[u], [&](std::int64_t column, double weight) { value += weight * field.w(column, static_cast<Eigen::Index>(k)); });
        result[u][k] += value / box.scale;
      }
    }
  }
  return result;
}

/// The field that carries the step of the points along.
RowMajorMatrix ExactStep::carried(const std::vector<Vec3>& from, const std::vector<Vec3>& to, const RunContext& context) const {
  Eigen::MatrixXd step = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(carried_from_), 3);
  for (std::size_t i = 0; i < moving_.size(); ++i) {
    const std::uint32_t u = moving_[i];
    for (std::size_t k = 0; k < 3; ++k) {
      step(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = before_.box.scale * (to[u][k] - from[u][k]);
    }
  }
  return carrier_->coefficients(step, context);
}

void ExactStep::add_values(const double* tile, const Step& step, double* out) const {
  if (step.carried.size() > 0) carrier_->add_values(tile, step.carried.data(), 3, out);
}

ExactStep::Step ExactStep::place(const EnergyField& field, const BoundDesign& design, const std::vector<ShapeParameters>& shapes,
                                 const RunContext& context) const {
  Step step;
  std::vector<ShapeParameters> before;
  for (const std::size_t t : set_of_) before.push_back(shapes[t]);
  step.placed = placement_->place(points_before(field, design, MotionKind::position), before, context);
  if (!step.placed.any()) return step;
  step.carried = carried(step.placed.from, step.placed.points, context);
  if (carries_far(step, context)) {
    step.placed.give_up();
    step.carried.resize(0, 0);
    return step;
  }
  step.values.reserve(step.placed.points.size());
  for (const Vec3& y : step.placed.points) step.values.push_back(before_.box.to_model(y));
  return step;
}

/// Whether some point moves farther than an exact one may: the interpolant of the steps can overshoot away from the centres.
bool ExactStep::carries_far(const Step& step, const RunContext& context) const {
  const double most = step.placed.most_movement() * before_.box.scale;
  std::atomic<bool> far = false;
  parallel_for(context, before_.following_places.tiles(), 64, [&](std::size_t begin, std::size_t end) {
    std::vector<double> values(3 * tile_size);
    for (std::size_t t = begin; t < end && !far; ++t) {
      std::fill(values.begin(), values.end(), 0.0);
      add_values(before_.following_places.tile(t), step, values.data());
      for (std::size_t i = 0; i < tile_size; ++i) {
        // The negation makes NaN count as far.
        if (!(std::hypot(values[i], values[tile_size + i], values[2 * tile_size + i]) <= most)) far = true;
      }
    }
  });
  return far;
}

ExactStep::Step ExactStep::derivative(const ExactPlacement::Placed& at, const EnergyField& field, const BoundDesign& design,
                                      const RunContext& context) const {
  Step step;
  if (!at.any()) return step;
  const std::vector<Vec3> from = points_before(field, design, MotionKind::derivative);
  step.values = placement_->derivative(at, from, context);
  step.carried = carried(from, step.values, context);
  for (Vec3& value : step.values) {
    for (double& x : value) x *= before_.box.scale;
  }
  return step;
}

std::vector<Vec3> ExactStep::adjoint(const ExactPlacement::Placed& at, std::vector<Vec3>& cotangents,
                                     const RunContext& context) const {
  const std::vector<PointId>& following = before_.following;
  const std::vector<PointId>& ids = placement_->ids();
  std::vector<Vec3> places = unit_places(before_.held.mesh, before_.box, following), others = cotangents;
  std::vector<std::size_t> slots(ids.size(), following.size());
  std::vector<Vec3> y(ids.size(), Vec3{});
  for (const std::uint32_t u : moving_) {
    slots[u] = static_cast<std::size_t>(std::lower_bound(following.begin(), following.end(), ids[u]) - following.begin());
    y[u] = cotangents[slots[u]];
    others[slots[u]] = {};
  }
  const Eigen::MatrixXd steps = carrier_->adjoint(places, others, context);
  const auto step = [&](std::size_t i, std::size_t k) {
    return steps(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k));
  };
  for (std::size_t i = 0; i < moving_.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) y[moving_[i]][k] += step(i, k);
  }
  std::vector<Vec3> from = placement_->adjoint(at, y, context);
  for (std::size_t i = 0; i < moving_.size(); ++i) {
    Vec3& x = from[moving_[i]];
    for (std::size_t k = 0; k < 3; ++k) x[k] -= step(i, k);
    cotangents[slots[moving_[i]]] = x;
    x = {};
  }
  return from;
}

}  // namespace deform
