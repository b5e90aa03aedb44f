// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/cage/cage_method.h"

#include <string>
#include <utility>
#include <vector>

#include "core/deformers/cage/cage_model.h"
#include "core/deformers/ffd/clamped_inverse.h"
#include "core/deformers/ffd/direct_system.h"
#include "core/deformers/handles/control_system.h"
#include "core/deformers/handles/handle_basis.h"
#include "core/deformers/option_checks.h"
#include "core/mesh/winding_number.h"

namespace deform {

namespace {

constexpr double row_growth = 4;  // coordinates may be negative, so that a row is longer than 1

EnergyOptions basis_options(const CageOptions& options) {
  EnergyOptions result;
  result.basis = options.basis;
  result.basis_tolerance = options.basis_tolerance;
  return result;
}

/// A mesh that outlives the use, which does not own it.
std::shared_ptr<const Mesh> borrowed(const Mesh& mesh) { return {std::shared_ptr<const Mesh>(), &mesh}; }

Estimate estimate_controls(const CageOptions& options, const Mesh& mesh, const SelectedRegions& regions) {
  const ControlModel model = cage_model(options, borrowed(mesh));
  Estimate estimate = deform::estimate_controls(mesh, model, basis_options(options), regions);
  add_place_notes(cage_of(options), mesh, estimate.notes);
  estimate.advice = "use fewer handles or basis BASIS_NEVER";
  return estimate;
}

Estimate estimate_mesh(const CageOptions& options, const Mesh& mesh, const SelectedRegions& regions) {
  const Cage cage = cage_of(options);
  std::size_t held = regions.fixed.size();
  for (const auto& handle : regions.handles) held += handle.size();
  const DirectEstimate of{ClampedInverse::estimate(held, cage.size()),
                          held,
                          cage.size(),
                          CageRows::bytes_for(cage, held),
                          options.basis,
                          options.basis_tolerance,
                          seconds_per_row(cage)};
  Estimate estimate = estimate_direct(mesh, regions, of);
  estimate.notes.insert(estimate.notes.begin(), size_note(cage));
  add_place_notes(cage, mesh, estimate.notes);
  estimate.advice = "use a coarser cage, smaller handle and fixed regions, fewer handles or basis BASIS_NEVER";
  return estimate;
}

std::shared_ptr<const System> prepare_mesh(const CageOptions& options, const std::shared_ptr<const Mesh>& mesh,
                                           const Setup& setup, const RunContext& context, std::size_t memory_budget) {
  const auto make = [&](const std::vector<RegionIndex>& region_of) {
    std::vector<PointId> held;
    for (std::size_t i = 0; i < region_of.size(); ++i) {
      if (region_of[i] != deformable_region) held.push_back(static_cast<PointId>(i));
    }
    const auto rows = std::make_shared<const CageRows>(cage_of(options), mesh, std::move(held), context);
    DirectModel model{rows,
                      {size_note(rows->cage())},
                      options.clamp,
                      row_growth,
                      options.basis,
                      options.basis_tolerance,
                      "a larger method.cage.clamp or a coarser cage"};
    add_outside_note(rows->cage(), *mesh, context, model.notes);
    return model;
  };
  return std::make_shared<const DirectSystem>(mesh, setup, make, context, memory_budget);
}

}  // namespace

void CageMethod::validate(const CageOptions& options, const Setup&, const Mesh&) {
  cage_of(options);
  check_basis_tolerance(options.basis_tolerance, "method.cage.basis_tolerance");
  if (options.control == CageControl::controls) return;
  if (options.vertices.size() > ClampedInverse::most_functions) {
    refuse_argument("method.cage.control: MESH takes cages of at most " + std::to_string(ClampedInverse::most_functions) +
                    " vertices, this one has " + std::to_string(options.vertices.size()));
  }
  if (options.clamp != 0) {
    check_option_range(options.clamp, ClampedInverse::least_clamp, ClampedInverse::largest_clamp, "method.cage.clamp");
  }
}

Estimate CageMethod::estimate(const CageOptions& options, const Mesh& mesh, const Setup&, const SelectedRegions& regions) {
  Estimate estimate =
      options.control == CageControl::mesh ? estimate_mesh(options, mesh, regions) : estimate_controls(options, mesh, regions);
  // Cages that are checked, and the search for points outside.
  const std::size_t triangles = options.triangles.size();
  estimate.peak_bytes += 4 * Cage::bytes_for(options.vertices.size(), triangles) + WindingNumber::bytes_for(triangles);
  return estimate;
}

std::shared_ptr<const System> CageMethod::prepare(const CageOptions& options, const std::shared_ptr<const Mesh>& mesh,
                                                  const Setup& setup, const RunContext& context, std::size_t memory_budget) {
  if (options.control == CageControl::mesh) return prepare_mesh(options, mesh, setup, context, memory_budget);
  deform::validate(setup, *mesh);
  ControlModel model = cage_model(options, mesh);
  add_outside_note(cage_of(options), *mesh, context, model.notes);
  return std::make_shared<const ControlSystem>(mesh, setup, std::move(model), basis_options(options), context);
}

}  // namespace deform
