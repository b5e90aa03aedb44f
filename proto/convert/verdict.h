// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "deform/v1/deformation.pb.h"
#include "deform/v1/setup.pb.h"

namespace deform::convert {

/// What is known of the method of a setup and matters for verdicts and warnings.
struct MethodFacts {
  /// What a large condition does to the points.
  enum class Effect {
    unknown,
    measured  ///< it is part of the estimated error
  };
  Effect condition_effect = Effect::unknown;
  bool manipulates_directly = false;   ///< control MESH: control points are found by least squares with a clamp
  double least_squares_tolerance = 0;  ///< of INCREMENTAL_QR, as a fraction of the diagonal; else 0
  /// Why points may move much farther than prescribed, and what to do; empty if nothing is known.
  std::string overshoot{};
  /// What lets the functions of the method meet constraints better, "take more samples, "; empty if nothing does.
  std::string more_freedom{};
};

/// The effect of a condition is measured if it is for all methods of the setup, see MethodFeatures::measures_condition. Points
/// overshoot with some kernels, see KernelProperties::overshoots. Any thread.
MethodFacts method_facts(const v1::Setup& setup);

/// The facts on which a verdict depends besides the result of a design.
struct SolutionFacts {
  double diagonal = 0;         ///< ModelSize::judged_by: of the bounding box at rest, model units
  double condition = 0;        ///< condition number of the factored matrix; 0 = not estimated
  bool converged = true;       ///< DesignReport::converged
  std::size_t torn_edges = 0;  ///< DesignReport::torn_edges
  double misfit = 0;           ///< DesignReport::misfit, model units: of direct manipulation
  MethodFacts method{};
  std::vector<std::string> shapes{};  ///< handles that are mirrored or flattened, a sentence each
};

/// That constraints could not be met to their tolerance, since that is less than doubles can reach, but as near as this (model
/// units).
std::string rounding_note(double convergence_error);

/// Sets the verdict and its reasons from all other fields of `result`; see v1::Verdict.
void set_verdict(const SolutionFacts& facts, v1::DesignResult& result);

}  // namespace deform::convert
