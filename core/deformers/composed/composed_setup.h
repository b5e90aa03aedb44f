// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/mesh.h"

namespace deform {

/// One method of a setup as a setup of its own.
struct StageSetup {
  Setup setup;                         ///< with the handles, fixed regions and variables of the method; all planes and the seed
  std::size_t first_handle = 0;        ///< of its handles in the whole setup, where they follow each other
  std::vector<std::size_t> variables;  ///< of its variables in the whole setup, ascending: those that move its handles

  /// The values of its variables.
  std::vector<double> own(std::span<const double> values) const;
};

/// Whether a setup has several methods.
inline bool is_composed(const Setup& setup) { return !setup.then.empty(); }
/// The method with this position: 0 is Setup::method, s is Setup::then[s - 1]. The variables must be valid.
StageSetup stage_setup(const Setup& setup, std::size_t stage);
/// "" for the first method, else "then[0]".
std::string stage_field(std::size_t stage);

/// Checks methods and regions of a composed setup, whose names and variables have been checked, and selects the regions. Called
/// by validate().
SelectedRegions validate_stages(const Setup& setup, const Mesh& mesh, Problems& problems, const RunContext& context);
/// The sum of the estimates of the methods, of which the first remain while the others are prepared.
Estimate estimate_composed(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, const RunContext& context);

}  // namespace deform
