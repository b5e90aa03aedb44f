// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <concepts>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/deformers/method_features.h"
#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/mesh.h"

namespace deform {

/// A region that the options of a method name.
struct OptionRegion {
  std::string field;  ///< its path in the setup: "method.mls.weights[2].region"
  Region* region;     ///< part of the options
};

/// A deformation method, from its options to a prepared system. All functions are stateless.
///  - name: the name of the method; its options are the field method.NAME of a setup.
///  - features: see MethodFeatures.
///  - regions: the regions of its options; most have none.
///  - validate: checks each option for itself, as a check of `problems` under the name of its field. Handles and design variables
///    have been checked before, and so has whether there is such an option: those that `problems` concern have their defaults.
///  - known_centres: the points that become centres of an RBF, ascending, unless the preparation chooses them.
///  - estimate, prepare: see estimate() and prepare() of system.h; the regions are those of validate(). The context may stop
///  them.
template <typename M>
concept Method = requires(const typename M::Options& options, typename M::Options& changed, const Setup& setup, const Mesh& mesh,
                          const SelectedRegions& regions, const std::shared_ptr<const Mesh>& shared, const RunContext& context,
                          Problems& problems, std::size_t memory_budget) {
  { M::name } -> std::convertible_to<std::string_view>;
  { M::features } -> std::convertible_to<MethodFeatures>;
  { changed.basis } -> std::same_as<BasisMode&>;
  { M::regions(changed) } -> std::same_as<std::vector<OptionRegion>>;
  { M::validate(options, setup, mesh, problems) } -> std::same_as<void>;
  { M::known_centres(options, mesh, regions, context) } -> std::same_as<std::optional<std::vector<PointId>>>;
  { M::estimate(options, mesh, setup, regions, context) } -> std::same_as<Estimate>;
  { M::prepare(options, shared, setup, context, memory_budget) } -> std::same_as<std::shared_ptr<const System>>;
};

}  // namespace deform
