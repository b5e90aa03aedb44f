// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/exact_placement.h"

#include <cmath>
#include <numeric>
#include <utility>

#include "core/base/vectors.h"

namespace deform {

namespace {

std::vector<Vec3> chosen(const std::vector<Vec3>& all, const std::vector<std::uint32_t>& which) {
  std::vector<Vec3> result;
  result.reserve(which.size());
  for (const std::uint32_t u : which) result.push_back(all[u]);
  return result;
}

void put(const std::vector<Vec3>& some, const std::vector<std::uint32_t>& where, std::vector<Vec3>& all) {
  for (std::size_t i = 0; i < where.size(); ++i) all[where[i]] = some[i];
}

/// The largest error of a set as it is reported; `shape` is that of an earlier fit.
double reported_error(const ConstraintSet& set, const std::vector<Vec3>& x, ShapeParameters shape) {
  std::vector<Vec3> y(x.size());
  set.projection->project(x, y, shape);
  return set.projection->misfit(x, y).largest;
}

/// The sets of a group that are tried again: without the one that is missed most or, when all are met but too far away, that
/// pulls most; of many sets without more of these at once. Ascending.
std::vector<std::size_t> without_worst(const JointSets::State& at) {
  std::vector<double> badness = at.distances;
  if (*std::max_element(badness.begin(), badness.end()) <= JointSets::satisfied_distance && !at.forces.empty()) {
    for (std::size_t s = 0; s < badness.size(); ++s) {
      for (const Vec3& force : at.forces[s]) badness[s] = std::max(badness[s], length(force));
    }
  }
  std::vector<std::size_t> order(badness.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return badness[a] < badness[b]; });
  order.resize(order.size() - std::max<std::size_t>(1, order.size() / 8));
  std::sort(order.begin(), order.end());
  return order;
}

}  // namespace

ExactPlacement::ExactPlacement(std::vector<ConstraintSet> sets, const std::vector<bool>& moves) : sets_(std::move(sets)) {
  for (const ConstraintSet& set : sets_) ids_.insert(ids_.end(), set.ids.begin(), set.ids.end());
  std::sort(ids_.begin(), ids_.end());
  ids_.erase(std::unique(ids_.begin(), ids_.end()), ids_.end());
  for (const PointId id : ids_) moves_.push_back(moves[id]);
  for (const ConstraintSet& set : sets_) {
    std::vector<std::uint32_t>& places = places_.emplace_back();
    for (const PointId id : set.ids) {
      places.push_back(static_cast<std::uint32_t>(std::lower_bound(ids_.begin(), ids_.end(), id) - ids_.begin()));
    }
    // A point in two regions of a set occurs there twice.
    std::vector<std::uint32_t> own = places;
    std::sort(own.begin(), own.end());
    const bool once = std::adjacent_find(own.begin(), own.end()) == own.end();
    all_move_.push_back(once &&
                        std::all_of(own.begin(), own.end(), [&](std::uint32_t u) { return static_cast<bool>(moves_[u]); }));
  }
}

/// Sets that hang together by common points that move; in the order of their first.
std::vector<std::vector<std::size_t>> ExactPlacement::connected(const std::vector<std::size_t>& sets) const {
  std::vector<std::size_t> root(sets.size()), holder(ids_.size(), sets.size());
  const auto root_of = [&](std::size_t t) {
    while (root[t] != t) t = root[t] = root[root[t]];
    return t;
  };
  for (std::size_t s = 0; s < sets.size(); ++s) {
    root[s] = s;
    for (const std::uint32_t u : places_[sets[s]]) {
      if (!moves_[u]) continue;
      if (holder[u] == sets.size()) holder[u] = s;
      const std::size_t a = root_of(holder[u]), b = root_of(s);
      root[std::max(a, b)] = std::min(a, b);
    }
  }
  std::vector<std::vector<std::size_t>> groups;
  std::vector<std::size_t> group_of(sets.size());
  for (std::size_t s = 0; s < sets.size(); ++s) {
    if (root_of(s) == s) {
      group_of[s] = groups.size();
      groups.emplace_back();
    }
    groups[group_of[root_of(s)]].push_back(sets[s]);
  }
  return groups;
}

/// The circles among `sets` whose points are all on a cylinder, as positions in it. Marks these circles in `in_section`, which
/// has one entry for each of `sets`. Circles that keep another radius than the cylinder or those before them are none.
ExactPlacement::Sections ExactPlacement::sections_of(std::size_t cylinder, const std::vector<std::size_t>& sets,
                                                     std::vector<bool>& in_section) const {
  constexpr std::size_t fewest = 5;  // four points of a circle may lie on a cylinder in other ways
  constexpr double same = 1e-10;     // of two radii
  std::vector<std::pair<std::uint32_t, std::uint32_t>> places;
  for (std::uint32_t i = 0; i < places_[cylinder].size(); ++i) places.emplace_back(places_[cylinder][i], i);
  std::sort(places.begin(), places.end());
  std::vector<bool> taken(places_[cylinder].size(), false);
  Sections sections;
  sections.curvature = dynamic_cast<const WithSections&>(*sets_[cylinder].projection).kept_curvature();
  for (std::size_t s = 0; s < sets.size(); ++s) {
    const auto* circle = dynamic_cast<const IsSection*>(sets_[sets[s]].projection.get());
    if (in_section[s] || sets_[sets[s]].ids.size() < fewest || circle == nullptr) continue;
    const std::optional<double> own = circle->kept_curvature();
    if (own && sections.curvature && std::abs(*own - *sections.curvature) > same * *own) continue;
    Section section;
    for (const std::uint32_t u : places_[sets[s]]) {
      const auto found = std::lower_bound(places.begin(), places.end(), std::pair<std::uint32_t, std::uint32_t>(u, 0));
      if (found == places.end() || found->first != u || taken[found->second]) break;
      section.push_back(found->second);
    }
    if (section.size() < places_[sets[s]].size()) continue;
    for (const std::uint32_t i : section) taken[i] = true;
    in_section[s] = true;
    if (own && !sections.curvature) sections.curvature = own;
    sections.all.push_back(std::move(section));
  }
  return sections;
}

ExactPlacement::Part ExactPlacement::part_of(const std::vector<std::size_t>& sets, Circles circles) const {
  Part part;
  for (const std::size_t t : sets) part.points.insert(part.points.end(), places_[t].begin(), places_[t].end());
  std::sort(part.points.begin(), part.points.end());
  part.points.erase(std::unique(part.points.begin(), part.points.end()), part.points.end());
  for (const std::uint32_t u : part.points) part.on.moves.push_back(moves_[u]);
  std::vector<bool> in_section(sets.size(), false);
  std::vector<const ConstraintSet*> of(sets.size());
  for (std::size_t s = 0; s < sets.size(); ++s) {
    const ConstraintSet& set = sets_[sets[s]];
    of[s] = &set;
    const auto* shape = dynamic_cast<const WithSections*>(set.projection.get());
    if (circles == Circles::apart || shape == nullptr) continue;
    Sections sections = sections_of(sets[s], sets, in_section);
    if (sections.all.empty()) continue;
    part.made.push_back(std::make_unique<const ConstraintSet>(ConstraintSet{
        set.name, shape->with_sections(std::move(sections.all), sections.curvature), set.ids, set.rest, set.weight}));
    of[s] = part.made.back().get();
  }
  for (std::size_t s = 0; s < sets.size(); ++s) {
    if (in_section[s]) continue;
    part.first.push_back(sets[s]);
    part.on.sets.push_back(of[s]);
    std::vector<std::uint32_t>& places = part.on.places.emplace_back();
    for (const std::uint32_t u : places_[sets[s]]) {
      const auto found = std::lower_bound(part.points.begin(), part.points.end(), u);
      places.push_back(static_cast<std::uint32_t>(found - part.points.begin()));
    }
  }
  return part;
}

std::size_t ExactPlacement::bytes() const {
  std::size_t bytes = ids_.size() * (sizeof(PointId) + 1);
  for (const ConstraintSet& set : sets_) bytes += set.ids.size() * (sizeof(PointId) + sizeof(Vec3) + sizeof(std::uint32_t));
  return bytes + sets_.size() * (sizeof(ConstraintSet) + sizeof(std::vector<std::uint32_t>));
}

std::size_t ExactPlacement::working_bytes(const RunContext& context) const {
  std::vector<Vec3> rest(ids_.size());
  std::vector<std::size_t> all;
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    all.push_back(t);
    for (std::size_t i = 0; i < places_[t].size(); ++i) rest[places_[t][i]] = sets_[t].rest[i];
  }
  std::size_t largest = 0;
  for (const std::vector<std::size_t>& group : connected(all)) {
    if (is_projected(group)) continue;
    const Part part = part_of(group);
    largest = std::max(largest, JointSets(part.on).working_bytes(chosen(rest, part.points), context));
  }
  return 12 * ids_.size() * sizeof(Vec3) + largest;
}

std::vector<Vec3> ExactPlacement::of_set(std::size_t t, const std::vector<Vec3>& points) const {
  return chosen(points, places_[t]);
}

/// Gives up the worst sets until the others are satisfied; the remaining sets may no longer be connected.
void ExactPlacement::place_group(const std::vector<std::size_t>& sets, const std::vector<ShapeParameters>& shapes, Placed& placed,
                                 const RunContext& context) const {
  std::vector<std::vector<std::size_t>> waiting{sets};
  while (!waiting.empty()) {
    const std::vector<std::size_t> now = std::move(waiting.back());
    waiting.pop_back();
    Group group{now, {}, is_projected(now)};
    if (group.projected) {
      const std::size_t t = now[0];
      const std::vector<Vec3> x = of_set(t, placed.from);
      group.at.points.resize(x.size());
      group.at.shapes = {shapes[t]};
      sets_[t].projection->project(x, group.at.points, group.at.shapes[0]);
      put(group.at.points, places_[t], placed.points);
      placed.groups.push_back(std::move(group));
      continue;
    }
    for (const Circles circles : {Circles::sections, Circles::apart}) {
      const Part part = part_of(now, circles);
      if (circles == Circles::sections && part.made.empty()) continue;
      std::vector<ShapeParameters> starts;
      for (const std::size_t t : part.first) starts.push_back(shapes[t]);
      group.at = JointSets(part.on).place(chosen(placed.from, part.points), starts, placed.most_movement(), context);
      group.sectioned = circles == Circles::sections;
      if (!group.at.found) continue;
      put(group.at.points, part.points, placed.points);
      break;
    }
    if (group.at.found) {
      placed.groups.push_back(std::move(group));
      continue;
    }
    std::vector<std::size_t> rest;
    for (const std::size_t s : without_worst(group.at)) rest.push_back(now[s]);
    for (const std::size_t t : now) placed.given_up[t] = !std::binary_search(rest.begin(), rest.end(), t);
    std::vector<std::vector<std::size_t>> parts = connected(rest);
    waiting.insert(waiting.end(), std::make_move_iterator(parts.rbegin()), std::make_move_iterator(parts.rend()));
  }
}

/// Sets that share points with a set that is given up must not increase its error beyond the largest initial one.
void ExactPlacement::check_given_up(const std::vector<ShapeParameters>& before, Placed& placed) const {
  std::vector<std::size_t> group_of(ids_.size());
  for (bool again = true; again;) {
    again = false;
    std::fill(group_of.begin(), group_of.end(), placed.groups.size());
    for (std::size_t g = 0; g < placed.groups.size(); ++g) {
      for (const std::size_t t : placed.groups[g].sets) {
        for (const std::uint32_t u : places_[t]) group_of[u] = g;
      }
    }
    for (std::size_t t = 0; t < sets_.size() && !again; ++t) {
      if (!placed.given_up[t]) continue;
      if (reported_error(sets_[t], of_set(t, placed.points), before[t]) <= placed.misfit) continue;
      for (const std::uint32_t u : places_[t]) {
        const std::size_t g = group_of[u];
        if (g == placed.groups.size()) continue;
        for (const std::size_t s : placed.groups[g].sets) {
          placed.given_up[s] = true;
          for (const std::uint32_t v : places_[s]) placed.points[v] = placed.from[v];
        }
        placed.groups.erase(placed.groups.begin() + static_cast<std::ptrdiff_t>(g));
        again = true;
        break;
      }
    }
  }
}

ExactPlacement::Placed ExactPlacement::place(std::vector<Vec3> from, const RunContext& context) const {
  return place(std::move(from), std::vector<ShapeParameters>(sets_.size()), context);
}

ExactPlacement::Placed ExactPlacement::place(std::vector<Vec3> from, const std::vector<ShapeParameters>& before,
                                             const RunContext& context) const {
  Placed placed;
  std::vector<ShapeParameters> shapes = before;
  placed.from = std::move(from);
  placed.points = placed.from;
  placed.given_up.assign(sets_.size(), false);
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    const std::vector<Vec3> x = of_set(t, placed.from);
    placed.misfit = std::max(placed.misfit, reported_error(sets_[t], x, before[t]));
    placed.distance = std::max(placed.distance, largest_distance(sets_[t], x, shapes[t]));
  }
  std::vector<std::size_t> possible;
  for (std::size_t t = 0; t < sets_.size(); ++t) {
    if (!all_move_[t]) {
      const Part part = part_of({t});
      const JointSets::State alone =
          JointSets(part.on).place(chosen(placed.from, part.points), {shapes[t]}, placed.most_movement(), context);
      placed.given_up[t] = !alone.found;
    }
    if (!placed.given_up[t]) possible.push_back(t);
  }
  for (const std::vector<std::size_t>& group : connected(possible)) place_group(group, shapes, placed, context);
  check_given_up(before, placed);
  return placed;
}

std::vector<Vec3> ExactPlacement::derivative(const Placed& at, const std::vector<Vec3>& change, const RunContext& context) const {
  std::vector<Vec3> result = change;
  for (const Group& group : at.groups) {
    if (group.projected) {
      const std::size_t t = group.sets[0];
      const std::vector<Vec3> dx = of_set(t, change);
      std::vector<Vec3> dy(dx.size());
      sets_[t].projection->derivative(of_set(t, at.from), group.at.shapes[0], dx, dy);
      put(dy, places_[t], result);
      continue;
    }
    const Part part = part_of(group.sets, group.sectioned ? Circles::sections : Circles::apart);
    put(JointSets(part.on).derivative(group.at, chosen(change, part.points), context), part.points, result);
  }
  return result;
}

/// Groups share only fixed points, where cotangents add up.
std::vector<Vec3> ExactPlacement::adjoint(const Placed& at, const std::vector<Vec3>& cotangent, const RunContext& context) const {
  std::vector<Vec3> result = cotangent;
  for (const Group& group : at.groups) {
    if (group.projected) {
      const std::size_t t = group.sets[0];
      const std::vector<Vec3> y = of_set(t, cotangent);
      std::vector<Vec3> x(y.size());
      sets_[t].projection->derivative(of_set(t, at.from), group.at.shapes[0], y, x);
      put(x, places_[t], result);
      continue;
    }
    const Part part = part_of(group.sets, group.sectioned ? Circles::sections : Circles::apart);
    const std::vector<Vec3> g = chosen(cotangent, part.points), x = JointSets(part.on).adjoint(group.at, g, context);
    for (std::size_t i = 0; i < part.points.size(); ++i) {
      Vec3& sum = result[part.points[i]];
      sum = moves_[part.points[i]] ? x[i] : sum + (x[i] - g[i]);
    }
  }
  return result;
}

}  // namespace deform
