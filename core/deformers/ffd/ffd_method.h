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

/// Free-form deformation (thesis 3.2, 3.3): see FfdOptions.
struct FfdMethod {
  using Options = FfdOptions;
  static constexpr std::string_view name = "ffd";
  static constexpr MethodFeatures features{.constraints = true, .control_points = true, .more_of = "control points"};
  static std::vector<OptionRegion> regions(FfdOptions&) { return {}; }
  /// Rejects constraints unless control is FfdControl::energy, and moved control points if it is.
  static void validate(const FfdOptions& options, const Setup& setup, const Mesh& mesh, Problems& problems);
  static bool selects_controls(const FfdOptions& options) { return options.control == FfdControl::controls; }
  static ControlSet controls(const FfdOptions& options, const Mesh& mesh, const Symmetry& symmetry);
  static std::vector<Vec3> control_places(const FfdOptions& options, const Mesh& mesh, const Symmetry& symmetry);
  /// Free-form deformation has no centres.
  static std::optional<std::vector<PointId>> known_centres(const FfdOptions&, const Mesh&, const SelectedRegions&,
                                                           const RunContext&) {
    return std::nullopt;
  }
  static Estimate estimate(const FfdOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                           const RunContext& context);
  static std::shared_ptr<const System> prepare(const FfdOptions& options, const std::shared_ptr<const Mesh>& mesh,
                                               const Setup& setup, const RunContext& context, std::size_t memory_budget);
  /// std::nullopt unless control is FfdControl::energy: reports of the others need the control points.
  static std::optional<BasisTraits> basis_traits(const FfdOptions& options);
};

}  // namespace deform
