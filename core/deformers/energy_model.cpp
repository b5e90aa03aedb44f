// Which space a method has, and what it takes before it is made.
#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/deformers/energy_system.h"
#include "core/deformers/rbf_parts.h"

namespace deform {

namespace {

constexpr std::size_t entry_bytes = sizeof(double) + sizeof(std::int64_t);
constexpr double nominal_rate = 5e9;  // flops per second of a sparse factorization on one core

std::vector<RegionIndex> regions_of_points(std::size_t n, const SelectedRegions& regions) {
  std::vector<RegionIndex> region_of(n, deformable_region);
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    for (const PointId id : regions.handles[h]) region_of[id] = static_cast<RegionIndex>(h);
  }
  for (const PointId id : regions.fixed) region_of[id] = fixed_region;
  return region_of;
}

std::size_t shell_assembly_bytes(const Mesh& mesh) {
  // Triplets of the operators, the operators, and the roots of the bending energy with their triplets.
  const std::size_t triangles = mesh.face_points.size() - std::min(mesh.face_points.size(), 2 * mesh.face_count());
  return triangles * (12 * 24 + 4 * entry_bytes + 4 * (24 + 2 * entry_bytes)) + mesh.point_count() * 64;
}

}  // namespace

EnergyModel energy_model(const Mesh& mesh, const Setup& setup, const SelectedRegions&, const std::vector<RegionIndex>& region_of,
                         const UnitBox& box, const RunContext&) {
  if (const auto* shell = std::get_if<ShellOptions>(&setup.method)) return shell_model(mesh, region_of, *shell, box.scale);
  throw Error(ErrorCode::invalid_argument, "method: subspace and mls are not there yet");
}

Estimate estimate_energy(const Mesh& mesh, const Setup& setup) {
  const SelectedRegions regions = validate(setup, mesh);
  const EnergyOptions options = energy_options(setup);
  const std::vector<RegionIndex> region_of = regions_of_points(mesh.point_count(), regions);
  Estimate estimate;
  for (const RegionIndex region : region_of) estimate.constraint_points += region != deformable_region ? 1 : 0;
  const std::size_t following =
      options.handles == HandleMode::hard ? mesh.point_count() - estimate.constraint_points : mesh.point_count();

  const double diagonal = bounding_box(mesh.points).diagonal();
  const EnergyModel model = energy_model(mesh, setup, regions, region_of, {{}, diagonal > 0 ? diagonal : 1}, {});
  const SparseCholesky::Estimate factor = SparseCholesky::estimate(model.space.energy);
  const std::size_t matrices =
      2 * sparse_bytes(model.space.energy) + sparse_bytes(model.space.values) + sparse_bytes(model.coupling);
  estimate.centres = model.eliminated ? model.held.size() : model.space.samples;
  estimate.factor_bytes = factor.factor_bytes + matrices;
  const std::size_t fields = 4 * regions.handles.size();
  const std::size_t basis_bytes = FieldTiles::bytes_for(following, fields);
  const bool basis = setup.constraints.empty() && wants_basis(options.basis, basis_bytes, estimate.factor_bytes);
  estimate.basis_bytes = basis ? basis_bytes : 0;
  const std::size_t points = point_bytes(mesh.point_count(), regions.symmetry);
  estimate.resident_bytes = estimate.factor_bytes + estimate.basis_bytes + points;
  const std::size_t solving = estimate.basis_bytes + 8 * model.space.samples * 3 * sizeof(double);
  estimate.peak_bytes =
      points + std::max({shell_assembly_bytes(mesh) + matrices, matrices + factor.peak_bytes, estimate.factor_bytes + solving});
  const double columns = basis ? static_cast<double>(fields) : 0;
  estimate.seconds = factor.flops / nominal_rate + static_cast<double>(factor.factor_bytes) * 5e-9 +
                     columns * static_cast<double>(factor.factor_bytes) / 4e9 / thread_count({}) +
                     static_cast<double>(mesh.point_count()) * 3e-6;
  estimate.notes = model.space.notes;
  if (!basis && setup.constraints.empty()) {
    estimate.notes.push_back("No handle basis will be stored: every design is solved for.");
  }
  return estimate;
}

}  // namespace deform
