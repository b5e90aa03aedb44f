// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/rbf/centres.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/mesh/adjacency.h"
#include "core/numerics/sampling/point_tree.h"

namespace deform {

namespace {

constexpr std::size_t few = 5000;                  // constraint points that are all centres
constexpr std::size_t aim = 4000;                  // of centres by distance alone, where that is enough
constexpr double almost_all = 0.75;                // of the constraint points: the others are not worth a loss
constexpr std::size_t coarse_aim = 1500;           // where there are more by distance: with these the others are looked for
constexpr double ratios[] = {0.5, 0.6, 0.7, 0.8};  // of the distance between centres to that from the deformable region

// Points in the components of the deformable region that a constraint point can be reached from.
bool every_component_is_held(const Adjacency& adjacency, const ConstraintPoints& points) {
  std::vector<char> held(points.region_of.size());
  for (std::size_t i = 0; i < held.size(); ++i) held[i] = points.region_of[i] != deformable_region;
  const std::vector<char> reached = adjacency.grow(held, -1);
  return std::all_of(points.deformable.begin(), points.deformable.end(), [&](PointId id) { return reached[id] != 0; });
}

// The centres within the rings, or the reason why all of them are needed.
std::string reduce(const Mesh& mesh, const RbfOptions& options, std::size_t handles, const ConstraintPoints& points,
                   std::vector<PointId>& kept) {
  if (points.deformable.empty()) return "no point is deformable";
  if (mesh.face_count() == 0) return "the geometry has no faces";
  const Adjacency adjacency(mesh);
  const auto loose = std::count_if(points.deformable.begin(), points.deformable.end(),
                                   [&](PointId id) { return adjacency.faces_of(id).empty(); });
  if (loose > 0) return "no face holds " + std::to_string(loose) + " of the deformable points (the inside of a volume)";
  std::vector<char> deformable(mesh.point_count());
  for (const PointId id : points.deformable) deformable[id] = 1;
  const std::vector<char> near = adjacency.grow(deformable, options.reduction_rings);
  const std::vector<char> defects = adjacency.non_manifold_points();
  std::size_t bad = 0;
  PointId first = 0;
  for (std::size_t i = mesh.point_count(); i-- > 0;) {
    if (near[i] && defects[i]) {
      ++bad;
      first = static_cast<PointId>(i);
    }
  }
  if (bad != 0) {
    return "the mesh is not manifold at " + std::to_string(bad) + " points near the deformable region, the first is point " +
           std::to_string(first);
  }
  if (!every_component_is_held(adjacency, points)) return "a component of the mesh has no handle and no fixed point";
  std::vector<char> seen(handles);
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    const RegionIndex region = points.region_of[i];
    if (!near[i] || region == deformable_region) continue;
    kept.push_back(static_cast<PointId>(i));
    if (region < handles) seen[region] = 1;
  }
  if (std::find(seen.begin(), seen.end(), 0) != seen.end()) return "a handle lies farther away from the deformable region";
  return {};
}

// Coincident points must have the same motion, so the first candidate represents them. Returns the number of candidates merged.
std::size_t keep_one_per_place(const ConstraintPoints& points, const std::vector<PointId>& candidates,
                               std::vector<PointId>& kept) {
  std::size_t merged = 0;
  std::unordered_map<PointId, PointId> first_of;
  for (const auto& cluster : points.coincident) {
    for (const PointId id : cluster) first_of[id] = cluster.front();
  }
  std::unordered_set<PointId> taken;
  for (const PointId id : candidates) {
    const auto found = first_of.find(id);
    if (taken.insert(found == first_of.end() ? id : found->second).second) {
      kept.push_back(id);
    } else {
      ++merged;
    }
  }
  return merged;
}

/// The number of constraint points represented by a coincident one.
std::size_t merged_points(const ConstraintPoints& points) {
  std::size_t count = 0;
  for (const auto& cluster : points.coincident) count += cluster.size() - 1;
  return count;
}

/// Mask of the constraint points that share a face with a deformable point.
std::vector<char> border_of(const Mesh& mesh, const ConstraintPoints& points) {
  std::vector<char> border(mesh.point_count());
  const auto deformable = [&](PointId id) { return points.region_of[id] == deformable_region; };
  const PointId* corners = mesh.face_points.data();
  for (const std::uint32_t size : mesh.face_sizes) {
    if (std::any_of(corners, corners + size, deformable)) {
      for (std::uint32_t c = 0; c < size; ++c) border[corners[c]] = deformable(corners[c]) ? 0 : 1;
    }
    corners += size;
  }
  return border;
}

/// The candidates for centres by their distance from the deformable region.
class GradedChoice {
 public:
  GradedChoice(const Mesh& mesh, const ConstraintPoints& points, const std::vector<PointId>& candidates,
               const RunContext& context)
      : candidates_(candidates), tree_(places(mesh, candidates)), distance_(candidates.size()), order_(candidates.size()) {
    const PointTree deformable(places(mesh, points.deformable));
    parallel_for(context, candidates.size(), 4096, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) distance_[i] = std::sqrt(deformable.nearest(tree_.points()[i]).square);
    });
    const std::vector<char> border = border_of(mesh, points);
    for (const PointId id : candidates) border_.push_back(border[id]);
    std::iota(order_.begin(), order_.end(), std::uint32_t{0});
    std::stable_sort(order_.begin(), order_.end(), [&](std::uint32_t a, std::uint32_t b) {
      return border_[a] != border_[b] ? border_[a] > border_[b] : distance_[a] < distance_[b];
    });
  }

  /// All candidates at the border, and of the others those whose distance from the ones chosen before is at least `ratio` times
  /// their distance from the deformable region. Ascending; stops after exceeding `most`.
  std::vector<PointId> chosen(double ratio, std::size_t most, const RunContext& context) const {
    return chosen(ratio, 0, most, context);
  }

  /// At most `most` candidates by the same rule, as if none were nearer to the deformable region than some distance and there
  /// were no border.
  std::vector<PointId> coarse(double ratio, std::size_t most, const RunContext& context) const {
    double least = bounding_box(tree_.points()).diagonal() * smallest_distance;
    std::vector<PointId> result;
    while (result = chosen(ratio, least, most, context), result.size() > most) least *= 2;
    return result;
  }

 private:
  static constexpr double smallest_distance = 1.0 / 256;  // of the diagonal

  /// With distances of at least `least`; the border counts if that is 0.
  std::vector<PointId> chosen(double ratio, double least, std::size_t most, const RunContext& context) const {
    std::vector<PointId> result;
    std::vector<char> covered(candidates_.size());
    std::vector<PointTree::Near> near;
    for (const std::uint32_t i : order_) {
      if (covered[i] && !(border_[i] && least == 0)) continue;
      result.push_back(candidates_[i]);
      if (result.size() > most) return result;
      if (result.size() % 64 == 0) context.check();
      // A point z that i covers has |z - i| < ratio d(z) <= ratio (d(i) + |z - i|).
      // With a least distance no more than that of the nearest, or ratio times it.
      const double reach = std::max(ratio * distance_[i] / (1 - ratio), ratio * least);
      tree_.within(tree_.points()[i], reach * reach, near);
      for (const auto& [other, square] : near) {
        const double own = ratio * std::max(distance_[other], least);
        if (square < own * own) covered[other] = 1;
      }
    }
    std::sort(result.begin(), result.end());
    return result;
  }

  static std::vector<Vec3> places(const Mesh& mesh, const std::vector<PointId>& ids) {
    std::vector<Vec3> result;
    result.reserve(ids.size());
    for (const PointId id : ids) result.push_back(mesh.points[id]);
    return result;
  }

  const std::vector<PointId>& candidates_;
  const PointTree tree_;              ///< of the candidates
  std::vector<double> distance_;      ///< of each candidate from the nearest deformable point
  std::vector<char> border_;          ///< of each candidate: at the border
  std::vector<std::uint32_t> order_;  ///< the border first, then by distance
};

/// Chooses candidates by distance. Otherwise returns the reason why all are needed, or an empty string if there is nothing
/// to report.
std::string choose_graded(const Mesh& mesh, const RbfOptions& options, const ConstraintPoints& points,
                          const std::vector<PointId>& candidates, const RunContext& context, std::vector<PointId>& kept,
                          RbfCentres& centres) {
  if (candidates.size() <= few || options.solver == Solver::incremental_qr) return {};
  if (points.deformable.empty()) return "no point is deformable";
  if (properties(*options.kernel).has_shape) return "a kernel with a shape needs them as dense as the mesh";
  const GradedChoice choice(mesh, points, candidates, context);
  for (const double ratio : ratios) {
    const std::size_t most = ratio == *std::rbegin(ratios) ? candidates.size() : aim;
    kept = choice.chosen(ratio, most, context);
    if (kept.size() <= most) break;
  }
  if (static_cast<double>(kept.size()) <= almost_all * static_cast<double>(candidates.size())) {
    if (kept.size() > aim) centres.coarse = choice.coarse(ratios[0], coarse_aim, context);
    return {};
  }
  kept.clear();
  return "most of them are near the deformable points";
}

}  // namespace

double reduction_error(const RbfOptions& options, double misfit) {
  constexpr double amplified[] = {1, 1, 60, 150};  // by the order of the kernel
  const auto order = static_cast<std::size_t>(properties(*options.kernel).order);
  return misfit * (options.reduction == CentreReduction::rings ? 1 : amplified[std::min<std::size_t>(order, 3)]);
}

RbfCentres choose_centres(const Mesh& mesh, const ConstraintPoints& points, std::size_t handles, const RbfOptions& options,
                          const RunContext& context) {
  RbfCentres centres;
  std::vector<PointId> candidates;
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    if (points.region_of[i] != deformable_region) candidates.push_back(static_cast<PointId>(i));
  }
  if (options.reduction == CentreReduction::tolerance) {
    std::vector<PointId> kept;
    const std::string reason = choose_graded(mesh, options, points, candidates, context, kept, centres);
    if (!reason.empty()) {
      centres.notes.push_back("All " + std::to_string(candidates.size()) + " constraint points are centres: " + reason + ".");
    }
    if (!kept.empty()) {
      centres.reduced = true;
      candidates = std::move(kept);
    }
  }
  if (options.reduction == CentreReduction::rings) {
    std::vector<PointId> kept;
    const std::string reason = reduce(mesh, options, handles, points, kept);
    const std::string rings = std::to_string(options.reduction_rings) + " rings around the deformable region";
    if (!reason.empty()) {
      centres.notes.push_back("All " + std::to_string(candidates.size()) + " constraint points are centres, not only " + rings +
                              ": " + reason + ".");
    } else if (kept.size() < candidates.size()) {
      centres.notes.push_back(std::to_string(kept.size()) + " of " + std::to_string(candidates.size()) +
                              " constraint points are centres: those within " + rings + ".");
      centres.reduced = true;
      candidates = std::move(kept);
    }
  }
  centres.merged = keep_one_per_place(points, candidates, centres.ids);
  if (centres.merged != 0) {
    centres.notes.push_back(std::to_string(centres.merged) + " coincident constraint points were merged with others.");
  }
  const std::size_t m = centres.ids.size();
  centres.most = m;
  if (centres.reduced && options.reduction == CentreReduction::tolerance) {
    centres.most = std::min(points.count - merged_points(points), 2 * std::max(m, aim));
  }
  const std::vector<PointId> coarse = std::move(centres.coarse);
  centres.coarse.clear();
  keep_one_per_place(points, coarse, centres.coarse);
  return centres;
}

void join_coarse(const ConstraintPoints& points, RbfCentres& centres) {
  std::vector<PointId> either;
  std::set_union(centres.ids.begin(), centres.ids.end(), centres.coarse.begin(), centres.coarse.end(),
                 std::back_inserter(either));
  centres.ids.clear();
  keep_one_per_place(points, either, centres.ids);
  centres.coarse.clear();
}

void take_most(const ConstraintPoints& points, RbfCentres& centres) {
  std::vector<char> chosen(points.region_of.size());
  for (const PointId id : centres.ids) chosen[id] = 1;
  for (std::size_t i = 0; i < chosen.size() && centres.ids.size() < centres.most; ++i) {
    if (!chosen[i] && points.region_of[i] != deformable_region) centres.ids.push_back(static_cast<PointId>(i));
  }
  std::sort(centres.ids.begin(), centres.ids.end());
}

std::vector<PointId> most_missed(const Mesh& mesh, const std::vector<PointId>& centres, std::span<const PointId> ids,
                                 std::span<const double> misfits, double tolerance, std::size_t most) {
  constexpr std::size_t most_candidates = 20000;
  std::vector<std::uint32_t> order;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (misfits[i] > 0.5 * tolerance) order.push_back(static_cast<std::uint32_t>(i));
  }
  const auto worse = [&](std::uint32_t a, std::uint32_t b) {
    return misfits[a] != misfits[b] ? misfits[a] > misfits[b] : ids[a] < ids[b];
  };
  if (order.size() > most_candidates) {
    std::nth_element(order.begin(), order.begin() + most_candidates, order.end(), worse);
    order.resize(most_candidates);
  }
  std::sort(order.begin(), order.end(), worse);
  std::vector<Vec3> places;
  for (const PointId id : centres) places.push_back(mesh.points[id]);
  const PointTree tree(places);
  std::vector<PointId> result;
  for (const std::uint32_t i : order) {
    if (result.size() >= most) break;
    const Vec3& x = mesh.points[ids[i]];
    const double clear = 0.5 * tree.nearest(x).square;
    if (clear == 0) continue;
    const auto near = [&](PointId id) {
      const Vec3 d = mesh.points[id] - x;
      return dot(d, d) < clear;
    };
    if (std::none_of(result.begin(), result.end(), near)) result.push_back(ids[i]);
  }
  std::sort(result.begin(), result.end());
  return result;
}

}  // namespace deform
