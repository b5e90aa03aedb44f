// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <concepts>
#include <cstddef>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/mesh.h"

namespace deform {

/// The optional parts of a setup that a method supports.
struct MethodFeatures {
  bool symmetry = false;     ///< symmetry planes of its own; other methods deform the model with its images, see MirroredSystem
  bool constraints = false;  ///< geometric constraints
};

/// A deformation method, from its options to a prepared system. All functions are stateless.
///  - name: the name of the method; its options are the field method.NAME of a setup.
///  - validate: throws Error(invalid_argument) naming the field for options that are out of range. Handles and design variables
///    have been checked before.
///  - known_centres: the points that become centres of an RBF, ascending, unless the preparation chooses them.
///  - estimate, prepare: see estimate() and prepare() of system.h; the regions are those of validate(). The context may stop
///  them.
template <typename M>
concept Method = requires(const typename M::Options& options, typename M::Options& changed, const Setup& setup, const Mesh& mesh,
                          const SelectedRegions& regions, const std::shared_ptr<const Mesh>& shared, const RunContext& context,
                          std::size_t memory_budget) {
  { M::name } -> std::convertible_to<std::string_view>;
  { M::features } -> std::convertible_to<MethodFeatures>;
  { changed.basis } -> std::same_as<BasisMode&>;
  { M::validate(options, setup, mesh) } -> std::same_as<void>;
  { M::known_centres(options, mesh, regions, context) } -> std::same_as<std::optional<std::vector<PointId>>>;
  { M::estimate(options, mesh, setup, regions, context) } -> std::same_as<Estimate>;
  { M::prepare(options, shared, setup, context, memory_budget) } -> std::same_as<std::shared_ptr<const System>>;
};

}  // namespace deform
