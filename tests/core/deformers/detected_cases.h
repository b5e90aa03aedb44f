// SPDX-License-Identifier: GPL-3.0-or-later
// Setups whose exact constraints are sets as detect() finds them, with handles and fixed points inside: sets that overlap (a
// cylinder, the circles at its ends, the planes beside it) and may contradict each other.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "core/constraints/detection/detect.h"
#include "core/deformers/system.h"
#include "proto/convert/report.h"
#include "proto/convert/verdict.h"
#include "tests/core/deformers/shapes.h"

namespace deform::test {

struct DetectedSet {
  std::string name;
  ConstraintKind kind;
  std::vector<PointId> points;
};

inline std::vector<DetectedSet> detected_sets(const Mesh& mesh) {
  const Detection found = detect(mesh, {});
  std::vector<DetectedSet> sets;
  for (const Primitive& p : found.primitives) {
    ConstraintKind kind = Planar{};
    std::size_t least = 4;
    if (p.kind == PrimitiveKind::cylinder) kind = Cylindrical{}, least = 6;
    if (p.kind == PrimitiveKind::sphere) kind = Spherical{}, least = 5;
    if (p.kind == PrimitiveKind::cone) kind = Conical{}, least = 7;
    if (p.points.size() >= least) sets.push_back({p.name, kind, p.points});
  }
  for (const EdgeFeature& e : found.edges) {
    ConstraintKind kind = FeatureLine{};
    if (e.kind != EdgeKind::line) kind = Circular{};
    std::vector<PointId> points = e.points;
    std::sort(points.begin(), points.end());
    if (points.size() >= 4) sets.push_back({e.name, kind, points});
  }
  return sets;
}

inline Constraint exact_constraint(const DetectedSet& set) { return {set.name, {{Region::Ids{set.points}}}, set.kind, 0, true}; }

inline bool share_points(const DetectedSet& a, const DetectedSet& b) {
  std::vector<PointId> common;
  std::set_intersection(a.points.begin(), a.points.end(), b.points.begin(), b.points.end(), std::back_inserter(common));
  return common.size() >= 2;
}

/// The `count` points nearest to a point that are not in `without`.
inline std::vector<PointId> nearest_points(const Mesh& mesh, PointId to, std::size_t count, const std::vector<PointId>& without) {
  std::vector<PointId> ids;
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    if (!std::binary_search(without.begin(), without.end(), static_cast<PointId>(i))) ids.push_back(static_cast<PointId>(i));
  }
  const auto nearer = [&](PointId a, PointId b) {
    const double left = distance(mesh.points[a], mesh.points[to]), right = distance(mesh.points[b], mesh.points[to]);
    return left != right ? left < right : a < b;
  };
  std::sort(ids.begin(), ids.end(), nearer);
  ids.resize(std::min(count, ids.size()));
  std::sort(ids.begin(), ids.end());
  return ids;
}

struct DetectedCase {
  Setup setup;
  Design design;
};

/// Two to five sets that hang together, a fixed region inside of the first, a handle there or anywhere, and a motion of it.
inline std::optional<DetectedCase> detected_case(const Mesh& mesh, const std::vector<DetectedSet>& sets, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const DetectedSet& first = sets[random() % sets.size()];
  std::vector<std::size_t> others;
  for (std::size_t t = 0; t < sets.size(); ++t) {
    if (&sets[t] != &first && share_points(first, sets[t])) others.push_back(t);
  }
  if (others.empty()) return {};
  for (std::size_t i = others.size(); i > 1; --i) std::swap(others[i - 1], others[random() % i]);
  DetectedCase result;
  result.setup.constraints.push_back(exact_constraint(first));
  const std::size_t wanted = 1 + random() % 4;
  for (std::size_t i = 0; i < std::min(wanted, others.size()); ++i) {
    result.setup.constraints.push_back(exact_constraint(sets[others[i]]));
  }
  const auto some = [&] {
    return static_cast<std::size_t>((0.01 + 0.1 * std::abs(uniform(random))) * static_cast<double>(mesh.points.size())) + 4;
  };
  const PointId at =
      seed % 2 == 0 ? first.points[random() % first.points.size()] : static_cast<PointId>(random() % mesh.points.size());
  const std::vector<PointId> handle = nearest_points(mesh, at, some(), {});
  PointId far = first.points[random() % first.points.size()];
  for (const PointId id : first.points) {
    if (random() % 3 != 0 && distance(mesh.points[id], mesh.points[at]) > distance(mesh.points[far], mesh.points[at])) far = id;
  }
  const std::vector<PointId> fixed = nearest_points(mesh, far, some(), handle);
  result.setup.handles = {{"handle", {Region::Ids{handle}}}};
  result.setup.fixed = {{Region::Ids{fixed}}};
  result.setup.method = ShellOptions{};
  const double D = bounding_box(mesh.points).diagonal();
  const double angle = 0.5 * uniform(random), c = std::cos(angle), s = std::sin(angle);
  const Vec3& x = mesh.points[at];
  Affine m{c, -s, 0, 0, s, c, 0, 0, 0, 0, 1, 0};
  if (random() % 2 == 0) m = {1, 0, 0, 0, 0, c, -s, 0, 0, s, c, 0};
  for (std::size_t k = 0; k < 3; ++k) {
    m[4 * k + 3] = x[k] + 0.1 * D * uniform(random) - m[4 * k] * x[0] - m[4 * k + 1] * x[1] - m[4 * k + 2] * x[2];
  }
  result.design.motions = {{0, m}};
  return result;
}

/// What exact constraints make of a case, beside the same without `exact`. Lengths over D.
struct ExactOutcome {
  bool given_up = false, missed = false;
  std::size_t met = 0;        ///< sets
  double soft_residual = 0;   ///< largest of the sets
  double exact_residual = 0;  ///< as delivered
  double moved = 0;           ///< largest distance of a point from its soft place
  double soft_ratio = 0;      ///< of the largest displacement to the largest prescribed one
  v1::Verdict soft_verdict = v1::VERDICT_UNKNOWN, exact_verdict = v1::VERDICT_UNKNOWN;

  /// How far a point may have moved: see ExactPlacement.
  double most_moved() const { return 3 * soft_residual + 1.001e-6; }
};

inline Points points_of(const Evaluation& evaluation, std::size_t design, std::size_t count) {
  Points points(count);
  Vec3* const out = points.data();
  evaluation.evaluate(0, count, design, {&out, 1});
  return points;
}

/// The verdict on a design whose points move by up to `motion`.
inline v1::Verdict verdict_of(const System& system, const Setup& setup, const DesignReport& report, double motion) {
  v1::DesignResult result;
  result.set_max_displacement(motion);
  result.set_prescribed_displacement(report.prescribed_displacement);
  result.set_estimated_error(report.error);
  if (motion > 0) result.set_relative_error(report.error / motion);
  *result.mutable_constraints() = convert::constraints_report(report, setup);
  convert::set_verdict({system.info().diagonal, system.info().condition, report.converged}, result);
  return result.verdict();
}

inline ExactOutcome exact_outcome(const std::shared_ptr<const Mesh>& mesh, const DetectedCase& of) {
  const auto system = prepare(mesh, of.setup);
  const auto bound = system->bind({&of.design, 1}, EvaluationPath::automatic, {});
  Setup soft = of.setup;
  for (Constraint& constraint : soft.constraints) constraint.exact = false;
  const auto soft_system = prepare(mesh, soft);
  const auto soft_bound = soft_system->bind({&of.design, 1}, EvaluationPath::automatic, {});
  const double D = system->info().diagonal;
  ExactOutcome outcome;
  for (std::size_t i = 0; i < soft.constraints.size(); ++i) {
    const ConstraintReport& report = bound->report(0).constraints[i];
    outcome.given_up = outcome.given_up || report.given_up;
    outcome.missed = outcome.missed || report.missed;
    outcome.met += report.missed ? 0 : 1;
    outcome.soft_residual = std::max(outcome.soft_residual, soft_bound->report(0).constraints[i].max / D);
    outcome.exact_residual = std::max(outcome.exact_residual, report.max / D);
  }
  const std::size_t n = mesh->point_count();
  const Points exact_points = points_of(*bound, 0, n), soft_points = points_of(*soft_bound, 0, n);
  outcome.moved = distance(exact_points, soft_points) / D;
  const double soft_motion = distance(soft_points, mesh->points);
  const double prescribed = soft_bound->report(0).prescribed_displacement;
  outcome.soft_ratio = prescribed > 0 ? soft_motion / prescribed : 0;
  outcome.soft_verdict = verdict_of(*soft_system, soft, soft_bound->report(0), soft_motion);
  outcome.exact_verdict = verdict_of(*system, of.setup, bound->report(0), distance(exact_points, mesh->points));
  return outcome;
}

/// Random cases, each held against what exact constraints promise.
struct ExactCases {
  std::size_t cases = 0, sets = 0, met = 0;
  std::size_t far = 0;  ///< whose soft result moves a point by more than 3 times the largest prescribed displacement

  void check(const std::string& name, const std::shared_ptr<const Mesh>& mesh, std::uint64_t seeds) {
    const std::vector<DetectedSet> found = detected_sets(*mesh);
    if (found.size() < 2) return;
    for (std::uint64_t seed = 0; seed < seeds; ++seed) {
      const auto of = detected_case(*mesh, found, seed);
      if (!of) continue;
      const ExactOutcome outcome = exact_outcome(mesh, *of);
      EXPECT_LE(outcome.moved, outcome.most_moved()) << name << ' ' << seed;
      // Below 1e-9 a set counts as met.
      EXPECT_LE(outcome.exact_residual, std::max(outcome.soft_residual, 1e-9)) << name << ' ' << seed;
      if (outcome.soft_ratio > 3) {
        ++far;
        EXPECT_GE(outcome.soft_verdict, v1::VERDICT_DOUBTFUL) << name << ' ' << seed << ": " << outcome.soft_ratio;
        EXPECT_GE(outcome.exact_verdict, v1::VERDICT_DOUBTFUL) << name << ' ' << seed << ": " << outcome.soft_ratio;
      }
      ++cases;
      sets += of->setup.constraints.size();
      met += outcome.met;
    }
  }
};

}  // namespace deform::test
