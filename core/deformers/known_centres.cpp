#include "core/deformers/known_centres.h"

#include "core/deformers/handles/constraint_points.h"
#include "core/deformers/rbf/rbf_system.h"

namespace deform {

std::optional<std::vector<PointId>> known_centres(const Mesh& mesh, const Setup& setup) {
  const SelectedRegions regions = validate(setup, mesh);
  const auto* options = std::get_if<RbfOptions>(&setup.method);
  if (options == nullptr) return std::nullopt;
  RbfCentres centres = choose_centres(mesh, regions, *options);
  if (chosen_solver(options->solver, options->kernel, centres.ids.size()) == Solver::incremental_qr) return std::nullopt;
  return std::move(centres.ids);
}

}  // namespace deform
