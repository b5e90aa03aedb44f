// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <tuple>
#include <type_traits>
#include <variant>

#include "core/deformers/cage/cage_method.h"
#include "core/deformers/energy/energy_methods.h"
#include "core/deformers/ffd/ffd_method.h"
#include "core/deformers/method.h"
#include "core/deformers/rbf/rbf_method.h"

namespace deform {

/// The methods, in the order of the alternatives of Setup::method. An alternative without a method, or a method that lacks a
/// function, does not compile.
template <Method... M>
struct MethodList {
  using Options = std::variant<typename M::Options...>;

  /// Calls use.template operator()<M>() for every method.
  template <typename Use>
  static void for_each(const Use& use) {
    (use.template operator()<M>(), ...);
  }
  /// The method of some options.
  template <typename O>
  using Of = std::tuple_element_t<
      0, decltype(std::tuple_cat(
             std::declval<std::conditional_t<std::is_same_v<typename M::Options, O>, std::tuple<M>, std::tuple<>>>()...))>;
};
using Methods = MethodList<RbfMethod, ShellMethod, SubspaceMethod, MlsMethod, FfdMethod, CageMethod>;
static_assert(std::is_same_v<Methods::Options, MethodOptions>);

/// use.template operator()<M>(options) for the method M of a setup and its options, which are const if the setup is.
template <typename SetupType, typename Use>
decltype(auto) with_method(SetupType& setup, const Use& use) {
  return std::visit(
      [&](auto& options) -> decltype(auto) {
        return use.template operator()<Methods::Of<std::remove_cvref_t<decltype(options)>>>(options);
      },
      setup.method);
}

/// Checks that the method of the setup supports all parts of the setup, and its options, each as a check of `problems`. Called by
/// validate() after the checks of handles and variables.
void validate_method(const Setup& setup, const Mesh& mesh, Problems& problems);

/// The regions that the options of the method name, with their paths.
std::vector<OptionRegion> option_regions(Setup& setup);

/// Whether handles and fixed regions of the setup select control points. A method that supports this has `static bool
/// selects_controls(const Options&)` and `static ControlSet controls(const Options&, const Mesh&, const Symmetry&)`.
bool selects_controls(const Setup& setup);
/// The control points of a setup with valid options; `symmetry` is that of the setup.
ControlSet controls_of(const Setup& setup, const Mesh& mesh, const Symmetry& symmetry);
/// Where they are at rest, model units; empty for methods without `static std::vector<Vec3> control_places(...)`.
std::vector<Vec3> control_places(const Setup& setup, const Mesh& mesh, const Symmetry& symmetry);
/// Whether the method of the setup has symmetry planes of its own: MethodFeatures::symmetry, or handles that select control
/// points, which move with the images of these.
bool keeps_symmetry(const Setup& setup);

/// The points that become centres of an RBF system, ascending. std::nullopt for other methods, and if the preparation chooses
/// them (INCREMENTAL_QR). Of a composed setup those of its methods that know them. Throws what validate() throws.
std::optional<std::vector<PointId>> known_centres(const Mesh& mesh, const Setup& setup);
/// The same with the regions that validate() has selected for this mesh and setup.
std::optional<std::vector<PointId>> known_centres(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                                                  const RunContext& context = {});

}  // namespace deform
