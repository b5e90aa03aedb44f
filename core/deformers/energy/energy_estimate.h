// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/mesh.h"

namespace deform {

/// What an EnergySystem takes, before it is prepared. Constraints count with what their points at rest say, and with one design
/// that is solved for (peak_bytes). Throws what shell_model(), lattice_model() and
/// constraint_sets() throw.
Estimate estimate_energy(const ShellOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions);
Estimate estimate_energy(const SubspaceOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions);
Estimate estimate_energy(const MlsOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions);
Estimate estimate_energy(const FfdOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions);

}  // namespace deform
