// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/handles/constraint_points.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The constraint points that become centres of an RBF (thesis 3.5, figure 3.10).
struct RbfCentres {
  std::vector<PointId> ids;  ///< ascending; coincident points are represented by the smallest id
  std::size_t merged = 0;    ///< centres saved by merging
  bool reduced = false;
  /// The largest number of centres. If it exceeds ids.size(), points with the largest misfit of the motions of the handles are to
  /// be added until the tolerance of the options is met or this number is reached.
  std::size_t most = 0;
  /// If ids are many, most of them near deformable points: a coarser set to begin with. The points that it misses and that are
  /// added to it join ids, so that not every step takes a factorization of all of them.
  std::vector<PointId> coarse;
  std::vector<std::string> notes;
};

/// The tolerance of the options, or its default.
inline double reduction_tolerance(const RbfOptions& options) {
  return options.reduction_tolerance != 0 ? options.reduction_tolerance : default_reduction_tolerance(*options.kernel);
}

/// About the largest distance of a point from where it would be if all constraint points were centres, for a largest misfit at
/// those that are none, both as fractions of the largest displacement. With the rule of the tolerance misfits are left next to
/// deformable points, too, where smooth kernels amplify them: on bodies of 5,000 to 150,000 points by at most 52 with r^3, 130
/// with r^5 and 0.6 with r (centres_bench --reduction). Those of rings are far away, where they matter less than they are.
double reduction_error(const RbfOptions& options, double misfit);

/// Chooses centres by the rule of the options. For CentreReduction::tolerance this is the initial set, which depends on positions
/// alone: constraint points that share a face with a deformable point, and of the others a subset whose mutual distances are at
/// least half their distance from the nearest deformable point (up to 0.8 of it if that gives too many). So the density depends
/// on the positions of points and not on the connectivity of the mesh, and points near deformable ones, as in boundary layers,
/// are kept.
RbfCentres choose_centres(const Mesh& mesh, const ConstraintPoints& points, std::size_t handles, const RbfOptions& options,
                          const RunContext& context = {});

/// Lets the coarse set, with what was added to it, join the centres.
void join_coarse(const ConstraintPoints& points, RbfCentres& centres);

/// The largest number of centres of the coarse set and those added to it.
inline constexpr std::size_t most_coarse = 4000;

/// The number of points whose misfits are measured at once.
inline constexpr std::size_t points_looked_at = 65536;

/// Fills the centres up to their largest number with arbitrary constraint points, for upper bounds.
void take_most(const ConstraintPoints& points, RbfCentres& centres);

/// Selects the constraint points among `ids` that are to become centres, from the misfits of the motions there: those with
/// the largest misfits above half of the tolerance, with mutual distances similar to those from the centres. At most
/// `most`, ascending.
std::vector<PointId> most_missed(const Mesh& mesh, const std::vector<PointId>& centres, std::span<const PointId> ids,
                                 std::span<const double> misfits, double tolerance, std::size_t most);

}  // namespace deform
