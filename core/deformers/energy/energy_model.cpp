// Which space a method has.
#include <utility>

#include "core/deformers/energy/energy_system.h"
#include "core/deformers/energy/spaces/mls.h"
#include "core/deformers/energy/spaces/subspace.h"

namespace deform {

EnergyModel energy_model(const Mesh& mesh, const Setup& setup, const std::vector<RegionIndex>& region_of, const UnitBox& box,
                         const RunContext& context) {
  if (const auto* shell = std::get_if<ShellOptions>(&setup.method)) return shell_model(mesh, region_of, *shell, box.scale);
  const auto* mls = std::get_if<MlsOptions>(&setup.method);
  EnergyModel model{mls != nullptr ? mls_space(mesh, *mls, setup.seed, context)
                                   : subspace_space(mesh, std::get<SubspaceOptions>(setup.method), setup.seed, context),
                    {},
                    false,
                    {}};
  for (std::size_t i = 0; i < region_of.size(); ++i) {
    if (region_of[i] != deformable_region) model.held.push_back(static_cast<PointId>(i));
  }
  return model;
}

void swap(EnergyModel& a, EnergyModel& b) {
  a.space.values.swap(b.space.values);
  a.space.energy.swap(b.space.energy);
  a.space.linear.swap(b.space.linear);
  a.space.notes.swap(b.space.notes);
  std::swap(a.space.samples, b.space.samples);
  std::swap(a.space.cubature_points, b.space.cubature_points);
  a.held.swap(b.held);
  std::swap(a.eliminated, b.eliminated);
  a.coupling.swap(b.coupling);
}

}  // namespace deform
