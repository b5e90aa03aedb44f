// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/cage/cage_method.h"

#include <string>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/deformers/cage/cage_images.h"
#include "core/deformers/cage/cage_model.h"
#include "core/deformers/cage/green_system.h"
#include "core/deformers/cage/whole_cage.h"
#include "core/deformers/ffd/clamped_inverse.h"
#include "core/deformers/ffd/direct_system.h"
#include "core/deformers/handles/control_system.h"
#include "core/deformers/handles/handle_basis.h"
#include "core/deformers/mirrored_mesh.h"
#include "core/deformers/option_checks.h"
#include "core/mesh/winding_number.h"

namespace deform {

namespace {

constexpr double row_growth = 4;          // coordinates may be negative, so that a row is longer than 1
constexpr double row_rounding = 0x1p-53;  // standard deviation of the rounding errors of coordinates

EnergyOptions basis_options(const CageOptions& options) {
  EnergyOptions result;
  result.basis = options.basis;
  result.basis_tolerance = options.basis_tolerance;
  return result;
}

/// A mesh that outlives the use, which does not own it.
std::shared_ptr<const Mesh> borrowed(const Mesh& mesh) { return {std::shared_ptr<const Mesh>(), &mesh}; }

Estimate estimate_controls(const CageOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions) {
  const auto [model, places] = cage_controls(options, borrowed(mesh), regions.symmetry);
  check_images(model.matches, setup, regions);
  const Cage cage = cage_of(options);
  check_faces(cage, model.matches, *places, regions.symmetry);
  Estimate estimate = deform::estimate_controls(mesh, model, basis_options(options), regions);
  add_outside_note(cage, *places, OutsidePoints::few, 0, {}, estimate.notes);
  estimate.advice = "use fewer handles or basis BASIS_NEVER";
  return estimate;
}

/// The number of points of a half model that is deformed with its images, without these; else 0.
std::size_t model_points(const Setup& setup) { return setup.images ? setup.images->points() : 0; }

Estimate estimate_mesh(const CageOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions) {
  const Cage cage = cage_of(options);
  std::size_t held = regions.fixed.size();
  for (const auto& handle : regions.handles) held += handle.size();
  const DirectEstimate of{ClampedInverse::estimate(held, cage.size(), checked_kinds(setup)),
                          held,
                          cage.size(),
                          CageRows::bytes_for(cage, held),
                          options.basis,
                          options.basis_tolerance,
                          seconds_per_row(cage)};
  Estimate estimate = estimate_direct(mesh, regions, of);
  estimate.notes.insert(estimate.notes.begin(), size_note(cage));
  add_outside_note(cage, mesh, OutsidePoints::few, model_points(setup), {}, estimate.notes);
  estimate.advice = "use a coarser cage, smaller handle and fixed regions, fewer handles or basis BASIS_NEVER";
  return estimate;
}

/// Throws for points outside of the box of a cage, which takes no time.
void check_cage_box(const std::vector<Vec3>& vertices, const Mesh& mesh) {
  const Box cage = bounding_box(vertices);
  const double rounding = 1e-12 * cage.diagonal();
  std::size_t outside = 0, first = 0;
  for (std::size_t i = mesh.point_count(); i-- > 0;) {
    bool beyond = false;
    for (std::size_t k = 0; k < 3; ++k) {
      beyond = beyond || mesh.points[i][k] < cage.min[k] - rounding || mesh.points[i][k] > cage.max[k] + rounding;
    }
    if (!beyond) continue;
    ++outside;
    first = i;
  }
  if (outside > 0) {
    refuse_argument("method.cage.coordinates: GREEN exist only inside of the cage, but " + std::to_string(outside) +
                    " points of the mesh lie outside of its box, the first is " + std::to_string(first) +
                    "; use a cage around all points, which `deform cage mesh` makes, or coordinates MEAN_VALUE");
  }
}

/// The same for points in its box, of which only some are looked at where there are many.
void check_inside(const Cage& cage, const Mesh& mesh) {
  const OutsidePoints outside = points_outside(cage, mesh, OutsidePoints::few, {});
  if (outside.count == 0) return;
  refuse_argument("method.cage.coordinates: GREEN exist only inside of the cage, but " + points_text(outside.ids, outside.count) +
                  " of " + std::to_string(outside.looked_at) +
                  (outside.looked_at < mesh.point_count() ? " that were looked at" : "") +
                  (outside.count == 1 ? " lies" : " lie") +
                  " outside; use a cage around all points, which `deform cage mesh` makes, or coordinates MEAN_VALUE");
}

Estimate estimate_green(const CageOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions) {
  const WholeCage whole = whole_cage(options, regions.symmetry);
  check_images(whole.matches, setup, regions);
  check_cage_box(whole.cage.vertices(), mesh);
  check_inside(whole.cage, mesh);
  const ControlSources sources(whole.matches, whole.controls, regions);
  const GreenColumns columns(whole, sources, regions.symmetry);
  const std::size_t n = mesh.point_count();
  const std::size_t coordinates = FieldTiles::bytes_for(n, columns.size());
  const bool stored = wants_basis(options.basis, coordinates, 0);
  Estimate estimate;
  estimate.samples = whole.controls;
  estimate.constraint_points = regions.fixed.size();
  for (const auto& handle : regions.handles) estimate.constraint_points += handle.size();
  estimate.resident_bytes = (stored ? coordinates : 0) + green_overhead_bytes(whole, sources, columns) + n * sizeof(PointId) +
                            point_bytes(n + whole.controls, regions.symmetry);
  estimate.peak_bytes = estimate.resident_bytes + n * sizeof(PointId);           // points outside
  if (!regions.symmetry.empty()) estimate.peak_bytes += 4 * whole.cage.bytes();  // cages in the making
  estimate.seconds = static_cast<double>(n) * seconds_per_row(whole.cage) / thread_count({});
  estimate.notes = whole.notes;
  if (!stored) estimate.notes.push_back("No coordinates will be stored: every design computes those of all points again.");
  for (std::string& note : whole.idle_notes(setup, regions)) estimate.notes.push_back(std::move(note));
  if (const auto units = units_note("cage", whole.cage.diagonal(), bounding_box(mesh.points).diagonal())) {
    estimate.notes.push_back(*units);
  }
  estimate.advice = stored ? "use fewer handle vertices or basis BASIS_NEVER" : "use a coarser cage";
  return estimate;
}

void validate_green(const CageOptions& options, Problems& problems) {
  problems.check("method.cage.coordinates", [&] {
    if (options.control != CageControl::mesh) return;
    refuse_argument(
        "method.cage.coordinates: GREEN go with control CONTROLS only, as points are no linear function of the vertices, which "
        "direct "
        "manipulation needs; use coordinates MEAN_VALUE or control CONTROLS");
  });
  problems.check("method.cage.basis_tolerance", [&] {
    if (options.basis_tolerance == 0) return;
    refuse_argument("method.cage.basis_tolerance: coordinates GREEN have no handle basis; leave it out");
  });
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
                      rows,
                      {size_note(rows->cage())},
                      options.clamp,
                      row_growth,
                      row_rounding,
                      options.basis,
                      options.basis_tolerance,
                      "a larger method.cage.clamp or a coarser cage"};
    add_outside_note(rows->cage(), *mesh, 0, model_points(setup), context, model.notes);
    return model;
  };
  return std::make_shared<const DirectSystem>(mesh, setup, make, context, memory_budget);
}

}  // namespace

void CageMethod::validate(const CageOptions& options, const Setup& setup, const Mesh& mesh, Problems& problems) {
  const bool green = options.coordinates == CageCoordinates::green;
  if (!problems.contain("method.cage")) {
    const bool is_cage = problems.check("method.cage", [&] { cage_of(options); });
    // With symmetry the cage has images, and estimate() checks the same.
    if (is_cage && green && setup.symmetry.empty() && options.control != CageControl::mesh) {
      problems.check("method.cage.coordinates", [&] { check_cage_box(options.vertices, mesh); });
    }
  }
  check_basis_tolerance(problems, options.basis_tolerance, "method.cage.basis_tolerance");
  if (green) validate_green(options, problems);
  if (options.control == CageControl::controls) return;
  problems.check("method.cage.control", [&] {
    if (options.vertices.size() <= ClampedInverse::most_functions) return;
    refuse_argument("method.cage.control: MESH takes cages of at most " + std::to_string(ClampedInverse::most_functions) +
                    " vertices, this one has " + std::to_string(options.vertices.size()));
  });
  if (options.clamp == 0) return;
  check_option_range(problems, options.clamp, ClampedInverse::least_clamp, ClampedInverse::largest_clamp, "method.cage.clamp");
}

Estimate CageMethod::estimate(const CageOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                              const RunContext& context) {
  context.check();
  Estimate estimate;
  if (options.control == CageControl::mesh) {
    estimate = estimate_mesh(options, mesh, setup, regions);
  } else if (options.coordinates == CageCoordinates::green) {
    estimate = estimate_green(options, mesh, setup, regions);
  } else {
    estimate = estimate_controls(options, mesh, setup, regions);
  }
  // Cages that are checked, and the search for points outside.
  const std::size_t triangles = options.triangles.size();
  estimate.peak_bytes += 4 * Cage::bytes_for(options.vertices.size(), triangles) + WindingNumber::bytes_for(triangles);
  return estimate;
}

std::shared_ptr<const System> CageMethod::prepare(const CageOptions& options, const std::shared_ptr<const Mesh>& mesh,
                                                  const Setup& setup, const RunContext& context, std::size_t memory_budget) {
  if (options.control == CageControl::mesh) return prepare_mesh(options, mesh, setup, context, memory_budget);
  const Symmetry symmetry = deform::validate(setup, *mesh, context).symmetry;
  if (options.coordinates == CageCoordinates::green) {
    return std::make_shared<const GreenSystem>(mesh, setup, options, whole_cage(options, symmetry), context);
  }
  auto [model, places] = cage_controls(options, mesh, symmetry);
  check_cut(model, *mesh, symmetry, context);
  add_outside_note(cage_of(options), *places, 0, 0, context, model.notes);
  return std::make_shared<const ControlSystem>(mesh, setup, std::move(model), basis_options(options), context);
}

}  // namespace deform
