// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "core/deformers/method.h"

namespace deform {

/// Cage-based deformation (thesis 3.4): see CageOptions.
struct CageMethod {
  using Options = CageOptions;
  static constexpr std::string_view name = "cage";
  static constexpr MethodFeatures features{.control_points = true};
  static std::vector<OptionRegion> regions(CageOptions&) { return {}; }
  static void validate(const CageOptions& options, const Setup& setup, const Mesh& mesh, Problems& problems);
  static bool selects_controls(const CageOptions& options) { return options.control == CageControl::controls; }
  static ControlSet controls(const CageOptions& options, const Mesh&, const Symmetry&) { return {options.vertices.size()}; }
  static std::vector<Vec3> control_places(const CageOptions& options, const Mesh&, const Symmetry&) { return options.vertices; }
  /// A cage has no centres.
  static std::optional<std::vector<PointId>> known_centres(const CageOptions&, const Mesh&, const SelectedRegions&,
                                                           const RunContext&) {
    return std::nullopt;
  }
  static Estimate estimate(const CageOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                           const RunContext& context);
  static std::shared_ptr<const System> prepare(const CageOptions& options, const std::shared_ptr<const Mesh>& mesh,
                                               const Setup& setup, const RunContext& context, std::size_t memory_budget);
};

}  // namespace deform
