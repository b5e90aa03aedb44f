// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/mesh.h"

namespace deform {

/// Estimates the cost of an EnergySystem before it is prepared. Constraints are counted by their rest points; peak_bytes includes
/// the solution of one design. Throws the errors of shell_model(), lattice_model() and constraint_sets().
Estimate estimate_energy(const ShellOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                         const RunContext& context);
Estimate estimate_energy(const SubspaceOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                         const RunContext& context);
Estimate estimate_energy(const MlsOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                         const RunContext& context);
Estimate estimate_energy(const FfdOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                         const RunContext& context);

}  // namespace deform
