// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/ffd/ffd_method.h"

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

#include "core/base/parallel.h"
#include "core/deformers/energy/energy_methods.h"
#include "core/deformers/energy/spaces/model_lattice.h"
#include "core/deformers/ffd/clamped_inverse.h"
#include "core/deformers/ffd/damped_inverse.h"
#include "core/deformers/ffd/direct_system.h"
#include "core/deformers/ffd/lattice_images.h"
#include "core/deformers/handles/control_system.h"
#include "core/deformers/option_checks.h"

namespace deform {

namespace {

using ByEnergy = EnergyMethod<FfdOptions>;

/// The standard deviation of the rounding errors of splines: of their arguments, which are counted in spans, and of their sums.
/// Local coordinates in a moved lattice are found to a tolerance.
double spline_rounding(const LatticeOptions& options, const Lattice& lattice) {
  constexpr double epsilon = std::numeric_limits<double>::epsilon(), found = 1e-13, slope = 0.3;
  double most = 0;
  for (std::size_t k = 0; k < 3; ++k) most = std::max(most, static_cast<double>(lattice.axis(k).size()));
  return (options.control_points.empty() ? 0.04 * epsilon : slope * found) * most;
}

const char* name_of(FfdControl control) { return control == FfdControl::mesh ? "MESH" : "CONTROLS"; }

Estimate estimate_mesh(const FfdOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                       const RunContext& context) {
  const ConstraintPoints points = constraint_points(mesh, regions, context);
  std::vector<PointId> held;
  for (std::size_t i = 0; i < points.region_of.size(); ++i) {
    if (points.region_of[i] != deformable_region) held.push_back(static_cast<PointId>(i));
  }
  const ModelLattice made = model_lattice(mesh, options.lattice, points.region_of, context);
  context.check();
  const bool large = reached_functions(*made.rows, held).size() > ClampedInverse::most_functions;
  DirectEstimate of{
      large ? DampedInverse::estimate(*made.rows, held) : ClampedInverse::estimate(*made.rows, held, checked_kinds(setup)),
      held.size(),
      static_cast<std::size_t>(made.rows->cols()),
      made.rows->bytes() + made.in_space->bytes(),
      options.basis,
      options.basis_tolerance};
  Estimate estimate = estimate_direct(mesh, regions, of);
  estimate.notes.insert(estimate.notes.begin(), made.notes.begin(), made.notes.end());
  estimate.advice = "use fewer points of the lattice, smaller handle and fixed regions, fewer handles or basis BASIS_NEVER";
  return estimate;
}

}  // namespace

void FfdMethod::validate(const FfdOptions& options, const Setup& setup, const Mesh& mesh, Problems& problems) {
  ByEnergy::validate(options, setup, mesh, problems);
  if (options.control == FfdControl::energy) {
    problems.check("method.ffd.lattice.control_points", [&] {
      if (options.lattice.control_points.empty()) return;
      refuse_argument(
          "method.ffd.lattice.control_points: control ENERGY integrates over a lattice at rest; use control MESH or "
          "CONTROLS, or leave them out");
    });
    return;
  }
  problems.check("method", [&] {
    if (setup.constraints.empty()) return;
    refuse_argument(std::string("constraints: method.ffd with control ") + name_of(options.control) +
                    " does not take geometric constraints; use control ENERGY");
  });
  if (options.control == FfdControl::controls) return;
  problems.check("method.ffd.lattice.points", [&] {
    const auto& points = options.lattice.points;
    const std::size_t all = points[0] * points[1] * points[2];
    if (options.lattice.basis != LatticeBasis::bernstein || all <= ClampedInverse::most_functions) return;
    refuse_argument("method.ffd.lattice.points: BERNSTEIN functions reach all points, so that control MESH takes at most " +
                    std::to_string(ClampedInverse::most_functions) + " of them, here are " + std::to_string(all) +
                    "; use another basis, or control ENERGY");
  });
  if (options.clamp == 0) return;
  check_option_range(problems, options.clamp, ClampedInverse::least_clamp, ClampedInverse::largest_clamp, "method.ffd.clamp");
}

ControlSet FfdMethod::controls(const FfdOptions& options, const Mesh& mesh, const Symmetry& symmetry) {
  const Lattice lattice = lattice_of(whole_lattice(options.lattice, mesh, symmetry), mesh);
  return {lattice.size(), {{lattice.axis(0).size(), lattice.axis(1).size(), lattice.axis(2).size()}}};
}

std::vector<Vec3> FfdMethod::control_places(const FfdOptions& options, const Mesh& mesh, const Symmetry& symmetry) {
  if (!options.lattice.control_points.empty()) return options.lattice.control_points;
  return lattice_of(whole_lattice(options.lattice, mesh, symmetry), mesh).control_points();
}

Estimate FfdMethod::estimate(const FfdOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                             const RunContext& context) {
  if (options.control == FfdControl::energy) return ByEnergy::estimate(options, mesh, setup, regions, context);
  if (options.control == FfdControl::controls) {
    const ControlModel model = lattice_controls(options.lattice, mesh, regions.symmetry, context);
    check_images(model.matches, setup, regions);
    return estimate_controls(mesh, model, options, regions);
  }
  return estimate_mesh(options, mesh, setup, regions, context);
}

std::shared_ptr<const System> FfdMethod::prepare(const FfdOptions& options, const std::shared_ptr<const Mesh>& mesh,
                                                 const Setup& setup, const RunContext& context, std::size_t memory_budget) {
  if (options.control == FfdControl::energy) return ByEnergy::prepare(options, mesh, setup, context, memory_budget);
  if (options.control == FfdControl::controls) {
    const Symmetry symmetry = deform::validate(setup, *mesh).symmetry;
    return std::make_shared<const ControlSystem>(mesh, setup, lattice_controls(options.lattice, *mesh, symmetry, context),
                                                 options, context);
  }
  const auto make = [&](const std::vector<RegionIndex>& region_of) {
    ModelLattice made = model_lattice(*mesh, options.lattice, region_of, context);
    return DirectModel{made.rows,
                       made.in_space,
                       std::move(made.notes),
                       options.clamp,
                       1,
                       spline_rounding(options.lattice, made.lattice),
                       options.basis,
                       options.basis_tolerance,
                       "a larger method.ffd.clamp, fewer points of the lattice or control ENERGY"};
  };
  return std::make_shared<const DirectSystem>(mesh, setup, make, context, memory_budget);
}

std::optional<BasisTraits> FfdMethod::basis_traits(const FfdOptions& options) {
  if (options.control == FfdControl::energy) return ByEnergy::basis_traits(options);
  return std::nullopt;
}

}  // namespace deform
