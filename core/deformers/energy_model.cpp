// Which space a method has.
#include "core/deformers/energy_system.h"
#include "core/deformers/mls_space.h"
#include "core/deformers/subspace_space.h"

namespace deform {

EnergyModel energy_model(const Mesh& mesh, const Setup& setup, const std::vector<RegionIndex>& region_of, const UnitBox& box,
                         const RunContext& context) {
  if (const auto* shell = std::get_if<ShellOptions>(&setup.method)) return shell_model(mesh, region_of, *shell, box.scale);
  EnergyModel model;
  if (const auto* mls = std::get_if<MlsOptions>(&setup.method)) {
    model.space = mls_space(mesh, *mls, setup.seed, context);
  } else {
    model.space = subspace_space(mesh, std::get<SubspaceOptions>(setup.method), setup.seed, context);
  }
  for (std::size_t i = 0; i < region_of.size(); ++i) {
    if (region_of[i] != deformable_region) model.held.push_back(static_cast<PointId>(i));
  }
  return model;
}

}  // namespace deform
