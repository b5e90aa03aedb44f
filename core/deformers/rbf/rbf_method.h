// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "core/deformers/handles/handle_basis.h"
#include "core/deformers/method.h"

namespace deform {

/// The options with defaults filled in: the kernel for the mesh, the tolerance of the solver.
RbfOptions with_defaults(RbfOptions options, const Mesh& mesh);

/// RBF deformation (thesis 3.5): see RbfSystem.
struct RbfMethod {
  using Options = RbfOptions;
  static constexpr std::string_view name = "rbf";
  static constexpr MethodFeatures features{.symmetry = true, .measures_condition = true};
  static std::vector<OptionRegion> regions(RbfOptions&) { return {}; }
  static void validate(const RbfOptions& options, const Setup& setup, const Mesh& mesh, Problems& problems);
  /// std::nullopt for INCREMENTAL_QR, and if centres are chosen to a tolerance.
  static std::optional<std::vector<PointId>> known_centres(const RbfOptions& options, const Mesh& mesh,
                                                           const SelectedRegions& regions, const RunContext& context);
  static Estimate estimate(const RbfOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                           const RunContext& context);
  static std::shared_ptr<const System> prepare(const RbfOptions& options, const std::shared_ptr<const Mesh>& mesh,
                                               const Setup& setup, const RunContext& context, std::size_t memory_budget);
  static BasisTraits basis_traits(const RbfOptions&) { return {HandleMode::hard, UnitLength::longest_edge}; }
};

}  // namespace deform
