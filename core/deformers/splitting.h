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

/// How a motion is cut into steps.
enum class SplitMode {
  uniform,   ///< thesis 7.4: n = 1, 2, 3, ... equal steps, until after none of them a cell is inverted
  adaptive,  ///< each step takes a share of what the mesh bears: one factorization a step and no attempt in vain
};

struct SplitOptions {
  SplitMode mode = SplitMode::uniform;
  std::size_t most_steps = 20;  ///< 1..1000; more are not tried
  /// Adaptive: a step goes this far along the safe amplitude of what remains. 0 < share < 1; nearer to 1 takes fewer steps and
  /// leaves flatter cells behind. A step of less than 1e-3 of the motion ends the attempt.
  double share = 0.5;
  /// Least normalized determinant (Inversions) that the cells shall keep, 0 <= margin < 1: a place where a cell has less counts
  /// as one with an inverted cell. Cells that have less at rest are only kept from inversion.
  double margin = 0;
};

/// Throws Error(invalid_argument) naming the field ("splitting.most_steps"), its value and the limits.
void validate_split_options(const SplitOptions& options);

/// What is to be moved without turning cells inside out. Everything is of the mesh at rest.
struct SplitProblem {
  std::shared_ptr<const Mesh> mesh;
  Setup setup;
  CellSet cells;  ///< over the points of the mesh; borrowed during the call
  /// Prepared from mesh and setup; null: prepared here.
  std::shared_ptr<const System> system;
  std::size_t memory_budget = 0;  ///< bytes for everything that is made here, 0 = unlimited
};

/// One step of the way that led to the result.
struct Substep {
  double fraction = 1;  ///< of the whole motion, at its end
  /// t* of the straight way from where it starts to where it ends, adaptive: to where all that remained would end. Less than 1
  /// with nothing inverted at the end: cells turned inside out on the way and back.
  double amplitude = 1;
  Extreme least_determinant;  ///< at its end: the least normalized determinant (Inversions) and the cell
};

/// One n that was tried.
struct SplitAttempt {
  std::size_t steps = 1;
  std::size_t completed = 0;     ///< steps after which nothing was inverted
  std::size_t inverted = 0;      ///< cells, after the step that ended it; with a margin those that have less
  double least_determinant = 1;  ///< then
  std::string failure;           ///< why there is no such step instead: the system at the place reached cannot be solved
};

struct SplitResult {
  bool inversion_free = false;  ///< nothing is inverted after any step, and the handles are where they were sent
  std::size_t steps = 1;        ///< n; those of the last attempt when there is none that is free of inversions
  /// How much of the motion `points` have made: 1 when free of inversions, else the farthest place that was reached without any.
  double reached = 0;
  /// Short of its end: `points` are X + reached (Y - X), on the straight way to those Y of the full step, which bears more than
  /// any number of steps along the way of the handles did.
  bool straight = false;
  Points points;                       ///< n x 3; handle points are exactly where their way is at `reached`
  Extreme least_determinant{1, 0};     ///< of `points`, without the cells that are inverted at rest
  std::vector<Substep> substeps;       ///< to `points`
  std::vector<SplitAttempt> attempts;  ///< in their order; adaptive: one
  SafeAmplitude full_step;             ///< of the motion in one step
  Inversions at_rest;                  ///< cells that were inverted to begin with: nobody looks at them
  std::size_t factorizations = 0;      ///< systems that were prepared here
  std::size_t reused = 0;              ///< steps that needed none, since they start at rest
};

/// Deformation without inverted elements by iterative splitting (thesis 7.4, figure 7.9; Gain, Dodgson 2001).
///
/// The motion of a handle is cut along its way: at fraction t of it the design variables have t times their values, so that
/// handles which turn go on arcs and keep their shape. An affine motion without variables is a stretch and then a rigid motion:
/// at t the stretch is 1 + t (P - 1) about the middle of the handle, P the symmetric factor of the polar decomposition, and the
/// rigid motion a screw by t times its angle and its shift. Affine motions that mirror, and displacements point by point, go
/// straight, to x + t u(x); so do all when faces in the plane would leave it on their way. Every step moves the centres, hence is
/// prepared anew with the points of the regions at rest and the mesh where the step before left it. All steps from rest share one
/// system, as the deformation is linear in the displacements.
///
/// Where no number of steps arrives, the farthest place is looked for beyond the last sound one, by halving with one more system,
/// and on the straight way to the full step: the result is never less than X + t* (Y - X), t* that of full_step (less where a
/// margin asks for it).
///
/// In one step, when that is enough, the result is that of System::evaluate(), bit for bit. When no number of steps up to
/// most_steps is, that is a result, not an error.
///
/// Throws what validate(), prepare(), System::bind() and InversionCheck throw; Error(invalid_argument) for options out of range
/// and for handles that select control points, out_of_budget, cancelled, deadline_exceeded. Progress "split": the fraction of the
/// motion in the current attempt, besides the stages of prepare().
SplitResult evaluate_split(const SplitProblem& problem, const Design& design, const SplitOptions& options = {},
                           const RunContext& context = {});

/// What one step costs beyond the first, which needs the prepared system only: peak_bytes includes the copies of the mesh,
/// seconds are those to prepare, evaluate and check. How many it takes is not known before: uniform splitting makes at most 1 + 2
/// + ... + (most_steps - 1) of them, adaptive most_steps - 1. Throws what validate() throws, and for handles that select control
/// points.
Estimate estimate_substep(const Mesh& mesh, const Setup& setup, const CellSet& cells);

}  // namespace deform
