// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/stored_form.h"

#include <optional>
#include <utility>

#include "core/base/error.h"
#include "core/deformers/composed/composed_setup.h"
#include "core/deformers/handles/restored_system.h"
#include "core/deformers/methods.h"
#include "core/deformers/mirrored_system.h"

namespace deform {

namespace {

std::optional<BasisTraits> traits_of(const Setup& setup) {
  if (is_composed(setup) || !setup.constraints.empty()) return std::nullopt;
  return with_method(setup, []<Method M>(const typename M::Options& options) -> std::optional<BasisTraits> {
    if constexpr (requires { M::basis_traits(options); }) return M::basis_traits(options);
    return std::nullopt;
  });
}

}  // namespace

bool can_be_stored(const Setup& setup) { return traits_of(setup).has_value(); }

const HandleSystem* stored_source(const Setup& setup, const System& system) {
  if (!can_be_stored(setup)) return nullptr;
  const auto* mirrored = dynamic_cast<const MirroredSystem*>(&system);
  return StoredBasis::source(mirrored == nullptr ? system : mirrored->whole());
}

std::shared_ptr<const System> restore(std::shared_ptr<const Mesh> mesh, const Setup& setup, StoredBasis&& stored,
                                      const RunContext& context) {
  const auto traits = traits_of(setup);
  if (!traits) throw Error(ErrorCode::failed_precondition, "systems of this setup are not stored");
  const auto make = [&](std::shared_ptr<const Mesh> of, const Setup& whole) {
    return std::make_shared<const RestoredSystem>(std::move(of), whole, *traits, std::move(stored), context);
  };
  if (is_mirrored(setup)) return std::make_shared<const MirroredSystem>(std::move(mesh), setup, make);
  return make(std::move(mesh), setup);
}

}  // namespace deform
