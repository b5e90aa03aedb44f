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

/// The energy methods, see EnergySystem.
template <typename O>
struct EnergyMethod {
  using Options = O;
  static std::vector<OptionRegion> regions(O&) { return {}; }
  static void validate(const O& options, const Setup& setup, const Mesh& mesh, Problems& problems);
  /// Energy methods have no centres.
  static std::optional<std::vector<PointId>> known_centres(const O&, const Mesh&, const SelectedRegions&, const RunContext&) {
    return std::nullopt;
  }
  static Estimate estimate(const O& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                           const RunContext& context);
  static std::shared_ptr<const System> prepare(const O& options, const std::shared_ptr<const Mesh>& mesh, const Setup& setup,
                                               const RunContext& context, std::size_t memory_budget);
  static BasisTraits basis_traits(const O& options);
};
extern template struct EnergyMethod<ShellOptions>;
extern template struct EnergyMethod<SubspaceOptions>;
extern template struct EnergyMethod<MlsOptions>;
extern template struct EnergyMethod<FfdOptions>;

/// Thin shell (thesis 3.1, 8.2), its subspaces (8.3), moving least squares in space (8.4). Free-form deformation by energy (3.2)
/// belongs to FfdMethod.
struct ShellMethod : EnergyMethod<ShellOptions> {
  static constexpr std::string_view name = "shell";
  static constexpr MethodFeatures features{.constraints = true};
};
struct SubspaceMethod : EnergyMethod<SubspaceOptions> {
  static constexpr std::string_view name = "subspace";
  static constexpr MethodFeatures features{.constraints = true, .sampled = true, .more_of = "centres"};
};
struct MlsMethod : EnergyMethod<MlsOptions> {
  static constexpr std::string_view name = "mls";
  static constexpr MethodFeatures features{.constraints = true, .sampled = true, .more_of = "samples"};
  /// Those with weights of their own.
  static std::vector<OptionRegion> regions(MlsOptions& options);
};

}  // namespace deform
