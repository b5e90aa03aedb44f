// SPDX-License-Identifier: GPL-3.0-or-later
// Points put on several shapes at once: sets as detect() finds them on parts, two and three that share points, at places that are
// nearly on the shapes.
#include "core/deformers/constrained/exact_placement.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>

#include "core/base/vectors.h"
#include "core/deformers/handles/constraint_points.h"
#include "tests/core/constraints/detection/parts.h"
#include "tests/core/deformers/detected_cases.h"

namespace deform::exact_placement_test {
namespace {

using std::numbers::pi;

/// A small smooth change of all places; `phase` tells changes from each other.
Vec3 wave(const Vec3& x, double phase) {
  return {std::sin(3 * x[0] + 2 * x[1] + phase), std::cos(2 * x[2] - x[0] + 2 * phase), std::sin(2 * x[1] + x[2] - phase)};
}

/// Sets of a part in coordinates of order one.
struct Placing {
  Placing(const Mesh& mesh, const std::vector<const test::DetectedSet*>& sets, const std::vector<PointId>& held = {}) {
    const Box box = bounding_box(mesh.points);
    const double D = box.diagonal();
    for (const Vec3& p : mesh.points) places.push_back((p - box.min) / D);
    moves.assign(places.size(), true);
    for (const PointId id : held) moves[id] = false;
    std::vector<ConstraintSet> exact;
    for (const test::DetectedSet* set : sets) {
      ConstraintSet& made = exact.emplace_back(ConstraintSet{set->name, nullptr, set->points, {}, 1});
      for (const PointId id : set->points) made.rest.push_back(places[id]);
      made.projection = make_projection(set->kind, std::vector<std::vector<Vec3>>{made.rest});
    }
    placement = std::make_unique<const ExactPlacement>(std::move(exact), moves);
  }

  /// The points of the sets, turned and moved as a whole and then changed by `size`.
  std::vector<Vec3> changed(double size, double phase) const {
    const double c = std::cos(0.3), s = std::sin(0.3);
    std::vector<Vec3> points;
    for (const PointId id : placement->ids()) {
      const Vec3& x = places[id];
      points.push_back(Vec3{c * x[0] - s * x[1], s * x[0] + c * x[1], x[2] + 0.1} + size * wave(x, phase));
    }
    return points;
  }

  std::vector<Vec3> places;
  std::vector<bool> moves;
  std::unique_ptr<const ExactPlacement> placement;
};

double largest(const std::vector<Vec3>& a, const std::vector<Vec3>& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, distance(a[i], b[i]));
  return largest;
}

double sum_of_squares(const std::vector<Vec3>& a, const std::vector<Vec3>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += squared_distance(a[i], b[i]);
  return sum;
}

std::vector<Vec3> plus(const std::vector<Vec3>& x, double h, const std::vector<Vec3>& d) {
  std::vector<Vec3> result = x;
  for (std::size_t i = 0; i < x.size(); ++i) result[i] = x[i] + h * d[i];
  return result;
}

std::vector<Vec3> waves(const Placing& placing, double phase) {
  std::vector<Vec3> result;
  for (const PointId id : placing.placement->ids()) result.push_back(wave(placing.places[id], phase));
  return result;
}

/// The nearest places of points that are placed, and their derivatives.
void check_placed(const Placing& placing, const std::vector<Vec3>& from, const ExactPlacement::Placed& placed,
                  const std::string& what) {
  const ExactPlacement& placement = *placing.placement;
  constexpr double h = 1e-6;
  const std::vector<Vec3> direction = waves(placing, 1.3);
  const auto above = placement.place(plus(from, h, direction), {}), below = placement.place(plus(from, -h, direction), {});
  if (above.given_up != placed.given_up || below.given_up != placed.given_up) return;
  // Other places on the shapes are not nearer.
  for (const auto* other : {&above, &below}) {
    EXPECT_GE(std::sqrt(sum_of_squares(other->points, from)), std::sqrt(sum_of_squares(placed.points, from)) - 1e-12) << what;
  }
  const std::vector<Vec3> product = placement.derivative(placed, direction, {});
  std::vector<Vec3> difference(product.size());
  for (std::size_t i = 0; i < product.size(); ++i) difference[i] = (above.points[i] - below.points[i]) / (2 * h);
  EXPECT_LT(largest(product, difference), 1e-6) << what;
  const std::vector<Vec3> cotangent = waves(placing, -0.4), gradient = placement.adjoint(placed, cotangent, {});
  double left = 0, right = 0, size = 0;
  for (std::size_t i = 0; i < product.size(); ++i) {
    left += dot(product[i], cotangent[i]);
    right += dot(direction[i], gradient[i]);
    size += dot(cotangent[i], cotangent[i]);
  }
  EXPECT_NEAR(left, right, 1e-10 * size) << what;
}

TEST(ExactPlacement, EveryPairOfDetectedKindsThatIsMetIsTheNearestWithItsDerivatives) {
  std::map<std::string, std::array<int, 3>> seen;  // by kinds: pairs, met, met in part
  for (const test::Part& part : test::all_parts(1)) {
    const std::vector<test::DetectedSet> sets = test::detected_sets(part.mesh);
    for (std::size_t a = 0; a < sets.size(); ++a) {
      for (std::size_t b = a + 1; b < sets.size(); ++b) {
        if (!test::share_points(sets[a], sets[b])) continue;
        std::array<int, 3>& count = seen[std::string(kind_name(sets[a].kind)) + " " + std::string(kind_name(sets[b].kind))];
        if (count[0] >= 6) continue;
        const Placing placing(part.mesh, {&sets[a], &sets[b]});
        const std::vector<Vec3> from = placing.changed(1e-4, 0.1 * static_cast<double>(a));
        const ExactPlacement::Placed placed = placing.placement->place(from, {});
        const std::string what = part.name + " " + sets[a].name + " " + sets[b].name;
        ++count[0];
        count[1] += !placed.given_up[0] && !placed.given_up[1] ? 1 : 0;
        count[2] += placed.given_up[0] != placed.given_up[1] ? 1 : 0;
        EXPECT_LE(largest(placed.points, from), placed.most_movement()) << what;
        check_placed(placing, from, placed, what);
      }
    }
  }
  for (const auto& [kinds, count] : seen) {
    RecordProperty(kinds, std::to_string(count[1]) + " of " + std::to_string(count[0]));
    // A circle on a cone that is not square to it, and a straight edge along a cylinder, are told by no distance to first order.
    if (kinds != "conical circular" && kinds != "cylindrical feature_line") {
      EXPECT_EQ(count[1], count[0]) << kinds;
    }
  }
}

/// A set of a part that keeps its radius or angle.
test::DetectedSet keeping(test::DetectedSet set) {
  if (auto* circle = std::get_if<Circular>(&set.kind)) circle->radius = Size::kept;
  if (auto* cylinder = std::get_if<Cylindrical>(&set.kind)) cylinder->radius = Size::kept;
  if (auto* sphere = std::get_if<Spherical>(&set.kind)) sphere->radius = Size::kept;
  if (auto* cone = std::get_if<Conical>(&set.kind)) cone->angle = Size::kept;
  return set;
}

/// The radius of the circle through three of some points.
double circumradius(const std::vector<Vec3>& x) {
  const Vec3 a = x[0] - x[x.size() / 3], b = x[x.size() / 3] - x[2 * x.size() / 3], c = x[2 * x.size() / 3] - x[0];
  return norm(a) * norm(b) * norm(c) / (2 * norm(cross(a, b)));
}

// A rim that keeps its radius on a cylinder, free or not, is a section of it that gives it the radius.
TEST(ExactPlacement, CirclesOnCylindersKeepTheirRadii) {
  int pairs = 0;
  for (const test::Part& part : {test::capped_cylinder(2), test::step_shaft(1)}) {
    const std::vector<test::DetectedSet> sets = test::detected_sets(part.mesh);
    for (const test::DetectedSet& cylinder : sets) {
      for (const test::DetectedSet& circle : sets) {
        if (!std::holds_alternative<Cylindrical>(cylinder.kind) || !std::holds_alternative<Circular>(circle.kind)) continue;
        if (!std::includes(cylinder.points.begin(), cylinder.points.end(), circle.points.begin(), circle.points.end())) continue;
        const test::DetectedSet kept_cylinder = keeping(cylinder), kept_circle = keeping(circle);
        for (const bool both : {false, true}) {
          const Placing placing(part.mesh, {both ? &kept_cylinder : &cylinder, &kept_circle});
          const std::vector<Vec3> from = placing.changed(1e-4, 0.3);
          const ExactPlacement::Placed placed = placing.placement->place(from, {});
          const std::string what = part.name + " " + cylinder.name + " " + circle.name + (both ? " kept" : " free");
          EXPECT_FALSE(placed.given_up[0] || placed.given_up[1]) << what;
          EXPECT_LE(largest(placed.points, from), placed.most_movement()) << what;
          std::vector<Vec3> rest, now;
          for (const PointId id : circle.points) {
            const auto& ids = placing.placement->ids();
            rest.push_back(placing.places[id]);
            now.push_back(placed.points[static_cast<std::size_t>(std::lower_bound(ids.begin(), ids.end(), id) - ids.begin())]);
          }
          EXPECT_NEAR(circumradius(now), circumradius(rest), 1e-9) << what;
          check_placed(placing, from, placed, what);
          ++pairs;
        }
      }
    }
  }
  EXPECT_GE(pairs, 8);
}

// A cylinder that keeps its radius and a circle on it that keeps another one: one of them is given up and keeps its soft fit.
TEST(ExactPlacement, RadiiThatContradictEachOtherAreGivenUp) {
  const test::Part part = test::capped_cylinder(2);
  const std::vector<test::DetectedSet> sets = test::detected_sets(part.mesh);
  for (const test::DetectedSet& cylinder : sets) {
    for (const test::DetectedSet& circle : sets) {
      if (!std::holds_alternative<Cylindrical>(cylinder.kind) || !std::holds_alternative<Circular>(circle.kind)) continue;
      Mesh wide = part.mesh;
      for (const PointId id : circle.points) {
        for (std::size_t k = 0; k < 2; ++k) wide.points[id][k] *= 1.01;
      }
      const test::DetectedSet kept_cylinder = keeping(cylinder), kept_circle = keeping(circle);
      const Placing placing(wide, {&kept_cylinder, &kept_circle});
      const std::vector<Vec3> from = placing.changed(1e-3, 0.3);
      const ExactPlacement::Placed placed = placing.placement->place(from, {});
      EXPECT_NE(placed.given_up[0], placed.given_up[1]) << circle.name;
      EXPECT_LE(largest(placed.points, from), placed.most_movement()) << circle.name;
    }
  }
}

// Cones and spheres, of a kept angle or radius or a free one, beside planes and alone.
TEST(ExactPlacement, EveryKindIsTheNearestWithWhatItKeeps) {
  std::map<std::string, int> seen;
  for (const test::Part& part : test::all_parts(1)) {
    for (const test::DetectedSet& set : test::detected_sets(part.mesh)) {
      if (std::holds_alternative<Planar>(set.kind) || std::holds_alternative<FeatureLine>(set.kind)) continue;
      if (seen[std::string(kind_name(set.kind))]++ >= 4) continue;
      const test::DetectedSet kept = keeping(set);
      const Placing placing(part.mesh, {&kept});
      const std::vector<Vec3> from = placing.changed(1e-4, 0.2);
      const ExactPlacement::Placed placed = placing.placement->place(from, {});
      EXPECT_FALSE(placed.given_up[0]) << part.name << ' ' << set.name;
      check_placed(placing, from, placed, part.name + " " + set.name);
    }
  }
  for (const char* kind : {"circular", "cylindrical", "spherical", "conical"}) EXPECT_GE(seen[kind], 1) << kind;
}

}  // namespace
}  // namespace deform::exact_placement_test
