// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/mesh.h"
#include "core/quality/safe_amplitude.h"

namespace deform {

/// How a motion is divided into steps.
enum class SplitMode {
  uniform,   ///< thesis 7.4: n = 1, 2, 3, ... equal steps, until no step inverts a cell
  adaptive,  ///< each step is a share of the safe amplitude: one factorization per step, no failed attempts
};

struct SplitOptions {
  SplitMode mode = SplitMode::uniform;
  std::size_t most_steps = 20;  ///< limit of the number of steps, 1..1000
  /// Adaptive: the length of a step as a fraction of the safe amplitude of the remaining motion, 0 < share < 1. Values closer to
  /// 1 take fewer steps, but leave flatter cells. The attempt ends with a step of less than 1e-3 of the motion.
  double share = 0.5;
  /// The normalized determinant (Inversions) that cells must keep, 0 <= margin < 1: a state in which a cell has less counts as
  /// one with an inverted cell. Cells that have less at rest are only kept from inversion.
  double margin = 0;
};

/// Throws Error(invalid_argument) naming the field ("splitting.most_steps"), its value and the limits.
void validate_split_options(const SplitOptions& options);

/// A deformation to be computed without inverting cells. All members refer to the rest mesh.
struct SplitProblem {
  std::shared_ptr<const Mesh> mesh;
  Setup setup;
  CellSet cells;  ///< over the points of the mesh; borrowed during the call
  /// Prepared from mesh and setup; if null, it is prepared here.
  std::shared_ptr<const System> system;
  std::size_t memory_budget = 0;  ///< bytes for everything that is allocated here, 0 = unlimited
};

/// One step on the path to the result.
struct Substep {
  double fraction = 1;  ///< fraction of the whole motion at its end
  /// The safe amplitude t* of the straight path from start to end of the step (adaptive: to the end of the whole remaining
  /// motion). Less than 1 without inverted cells at the end means that cells were inverted temporarily.
  double amplitude = 1;
  Extreme least_determinant;  ///< smallest normalized determinant (Inversions) at its end, and the cell
};

/// An attempt with n steps.
struct SplitAttempt {
  std::size_t steps = 1;
  std::size_t completed = 0;     ///< steps after which no cell was inverted
  std::size_t inverted = 0;      ///< inverted cells after the last step; with a margin those below it
  double least_determinant = 1;  ///< after the last step
  std::string failure;           ///< if the system at the state reached could not be solved, the reason
};

struct SplitResult {
  bool inversion_free = false;  ///< no cell is inverted after any step, and the handles have reached their targets
  std::size_t steps = 1;        ///< n; if no attempt is free of inversions, that of the last one
  /// The fraction of the motion at `points`: 1 if free of inversions, else the largest one reached without inversions.
  double reached = 0;
  /// If reached < 1: whether `points` are X + reached (Y - X) on the straight path to the points Y of the full step, which went
  /// farther than any number of steps along the paths of the handles.
  bool straight = false;
  Points points;                       ///< n x 3; handle points are exactly on their paths at `reached`
  Extreme least_determinant{1, 0};     ///< at `points`, without the cells inverted at rest
  std::vector<Substep> substeps;       ///< the steps to `points`
  std::vector<SplitAttempt> attempts;  ///< in order; adaptive: a single one
  SafeAmplitude full_step;             ///< safe amplitude of the motion in one step
  Inversions at_rest;                  ///< cells inverted at rest, which are ignored
  std::size_t factorizations = 0;      ///< number of systems prepared here
  std::size_t reused = 0;              ///< number of steps without a new system, because they start at rest
};

/// Deforms a mesh without inverting elements by iterative splitting (thesis 7.4, figure 7.9; Gain, Dodgson 2001).
///
/// The motion of a handle is divided along its path. At fraction t the design variables have t times their values, so that
/// rotating handles move on arcs and keep their shape. An affine motion without variables is decomposed into a stretch and a
/// rigid motion: at t the stretch is 1 + t (P - 1) about the centre of the handle, where P is the symmetric factor of the polar
/// decomposition, and the rigid motion is a screw by t times its angle and its translation. Affine motions that reflect, and
/// displacements point by point, have straight paths x + t u(x), and so have all motions if the faces of a 2D mesh would leave
/// its plane otherwise. Each step starts from the mesh of the previous one and moves the centres, so a new system is prepared
/// with the same points in the regions as at rest. All steps from rest share one system, because the deformation is linear in
/// the displacements.
///
/// If no number of steps reaches the target, the largest possible fraction is searched for beyond the last valid state, by
/// bisection with one more system, and on the straight path to the full step. So the result never falls short of X + t* (Y - X),
/// with the t* of full_step (less if a margin requires it).
///
/// If one step suffices, the result equals that of System::evaluate(), bit for bit. If no number of steps up to most_steps does,
/// that is a result, not an error.
///
/// Throws the errors of validate(), prepare(), System::bind() and InversionCheck; Error(invalid_argument) for options out of
/// range, for handles that select control points and for composed setups, out_of_budget, cancelled, deadline_exceeded. Reports
/// "split" progress, the fraction of the motion in the current attempt, besides the stages of prepare().
SplitResult evaluate_split(const SplitProblem& problem, const Design& design, const SplitOptions& options = {},
                           const RunContext& context = {});

/// Estimates the cost of one step after the first, which only needs the prepared system: peak_bytes includes the copies of the
/// mesh, seconds include preparation, evaluation and check. The number of these steps is not known in advance; uniform splitting
/// takes at most 1 + 2 + ... + (most_steps - 1), adaptive splitting most_steps - 1. Throws the errors of validate(), and
/// Error(invalid_argument) for handles that select control points and for composed setups.
Estimate estimate_substep(const Mesh& mesh, const Setup& setup, const CellSet& cells);

}  // namespace deform
