// Which space a method has, and what it takes before it is made.
#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/deformers/energy_system.h"
#include "core/deformers/mls_space.h"
#include "core/deformers/rbf_parts.h"
#include "core/deformers/subspace_space.h"

namespace deform {

namespace {

constexpr std::size_t entry_bytes = sizeof(double) + sizeof(std::int64_t);
constexpr std::size_t fill = 12;      // entries of a factor over those of the matrix, supports of a dozen samples
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

/// Bytes and work before the system is there.
struct Sizes {
  std::size_t assembly = 0;  ///< peak while the space is made
  std::size_t matrices = 0;  ///< what stays of it
  std::size_t functions = 0;
  SparseCholesky::Estimate factor;
};

Sizes sizes_of(const Mesh& mesh, const Setup& setup, const std::vector<RegionIndex>& region_of, Estimate& estimate) {
  Sizes sizes;
  if (!std::holds_alternative<ShellOptions>(setup.method)) {
    const auto* mls = std::get_if<MlsOptions>(&setup.method);
    const auto* subspace = std::get_if<SubspaceOptions>(&setup.method);
    const SpaceBytes space = mls != nullptr ? estimate_mls_space(mesh, *mls) : estimate_subspace_space(mesh, *subspace);
    // Supports are wide, so that the factor fills up: a multiple of the matrix, at most a full triangle.
    const std::size_t k = space.samples;
    const std::size_t entries = std::min(k * (k + 1) / 2, fill * space.energy_entries);
    // The rows of the held points again, transposed; what stays of the space is mostly rows.
    const std::size_t held = space.resident / std::max<std::size_t>(1, mesh.point_count()) * estimate.constraint_points;
    sizes = {space.peak, space.resident + held + 2 * space.energy_entries * entry_bytes, k, {}};
    sizes.factor.factor_bytes = entries * sizeof(double);
    sizes.factor.peak_bytes = 2 * sizes.factor.factor_bytes;
    sizes.factor.flops =
        static_cast<double>(entries) * static_cast<double>(entries) / static_cast<double>(std::max<std::size_t>(1, k));
    estimate.centres = k;
    return sizes;
  }
  // The factor of a shell depends on how its surface is connected: ordered, not factored.
  const double diagonal = bounding_box(mesh.points).diagonal();
  const EnergyModel model = energy_model(mesh, setup, region_of, {{}, diagonal > 0 ? diagonal : 1}, {});
  sizes.factor = SparseCholesky::estimate(model.space.energy);
  sizes.matrices = sparse_bytes(model.space.energy) + sparse_bytes(model.space.values) + sparse_bytes(model.coupling);
  sizes.assembly = shell_assembly_bytes(mesh) + 2 * sizes.matrices;
  sizes.functions = model.space.samples;
  estimate.centres = model.eliminated ? model.held.size() : model.space.samples;
  estimate.notes = model.space.notes;
  return sizes;
}

}  // namespace

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

Estimate estimate_energy(const Mesh& mesh, const Setup& setup) {
  const SelectedRegions regions = validate(setup, mesh);
  const EnergyOptions options = energy_options(setup);
  const std::vector<RegionIndex> region_of = regions_of_points(mesh.point_count(), regions);
  Estimate estimate;
  for (const RegionIndex region : region_of) estimate.constraint_points += region != deformable_region ? 1 : 0;
  const std::size_t following =
      options.handles == HandleMode::hard ? mesh.point_count() - estimate.constraint_points : mesh.point_count();
  const Sizes sizes = sizes_of(mesh, setup, region_of, estimate);

  estimate.factor_bytes = sizes.factor.factor_bytes + sizes.matrices;
  const std::size_t fields = 4 * regions.handles.size();
  const std::size_t basis_bytes = FieldTiles::bytes_for(following, fields);
  const bool basis = setup.constraints.empty() && wants_basis(options.basis, basis_bytes, estimate.factor_bytes);
  estimate.basis_bytes = basis ? basis_bytes : 0;
  const std::size_t points = point_bytes(mesh.point_count(), regions.symmetry);
  estimate.resident_bytes = estimate.factor_bytes + estimate.basis_bytes + points;
  const std::size_t solving = estimate.basis_bytes + 8 * sizes.functions * 3 * sizeof(double);
  estimate.peak_bytes =
      points + std::max({sizes.assembly, sizes.matrices + sizes.factor.peak_bytes, estimate.factor_bytes + solving});
  const auto factor_bytes = static_cast<double>(sizes.factor.factor_bytes);
  estimate.seconds = sizes.factor.flops / nominal_rate + factor_bytes * 5e-9 +
                     (basis ? static_cast<double>(fields) : 0) * factor_bytes / 4e9 / thread_count({}) +
                     static_cast<double>(sizes.assembly) * 1e-8;
  if (!basis && setup.constraints.empty()) {
    estimate.notes.push_back("No handle basis will be stored: every design is solved for.");
  }
  return estimate;
}

}  // namespace deform
