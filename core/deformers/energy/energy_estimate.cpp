// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/energy_estimate.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "core/base/parallel.h"
#include "core/deformers/constrained/constrained_estimate.h"
#include "core/deformers/constrained/constrained_solver.h"
#include "core/deformers/constrained/constraint_sets.h"
#include "core/deformers/constrained/energy_solver.h"
#include "core/deformers/constrained/exact_placement.h"
#include "core/deformers/energy/exact_step.h"
#include "core/deformers/energy/layer_step.h"
#include "core/deformers/energy/residual_correction.h"
#include "core/deformers/energy/spaces/lattice_space.h"
#include "core/deformers/energy/spaces/mls.h"
#include "core/deformers/energy/spaces/shell.h"
#include "core/deformers/energy/spaces/subspace.h"
#include "core/deformers/handles/constraint_points.h"
#include "core/deformers/handles/handle_basis.h"

namespace deform {

namespace {

constexpr std::size_t entry_bytes = sizeof(double) + sizeof(std::int64_t);
constexpr std::size_t fill = 12;         // entries of a factor over those of the matrix, supports of a dozen samples
constexpr std::size_t few_bytes = 1024;  // of matrices without entries
constexpr double nominal_rate = 5e9;     // flops per second of a sparse factorization on one core
constexpr double dense_rate = 2e10;      // of a dense one
// Seconds on one core: of a term of the product that couples functions at held points, of a value of a function in doubles and in
// extended precision, of a distance between held points, of a value of the correction's kernel and of a term of its sums.
constexpr double per_square = 6e-9, per_value = 2e-9, per_long_value = 5e-9;
constexpr double per_distance = 2e-9, per_kernel = 3e-9, per_term = 0.5e-9;
// Seconds for many functions at once: of a term of such a sum, and of an entry of the inverse that solves for its coefficients.
constexpr double per_sum = 0.2e-9, per_centre = 0.8e-10;

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
  std::size_t making = 0;         ///< beside these, of the matrix that is factored
  std::size_t held = 0;           ///< held points that enter the system
  bool eliminated = false;        ///< these points
  std::vector<PointId> held_ids;  ///< of a shell
  double values = 0;              ///< of functions at them
  double squares = 0;             ///< of their numbers at each, the sum
  double entries = 0;             ///< of the matrix of the energy
  SparseCholesky::Estimate factor;
  ConstrainedBytes constrained;
  std::size_t delivered_points = 0, delivered_functions = 0;  ///< of DeliveredRows
  double making_space = 0;                                    ///< seconds; 0: by the bytes of `assembly`
};

/// The input of the estimates of spaces.
struct Case {
  const Mesh& mesh;
  const ConstraintPoints& points;
  const std::vector<ConstraintSet>& sets;
  bool delivered;  ///< whether constraints are for the points with the correction
  const RunContext& context;
};

DeliveredRows delivered_points(const Case& of) {
  DeliveredRows result;
  std::vector<bool> held(of.points.region_of.size());
  for (std::size_t i = 0; i < held.size(); ++i) held[i] = of.points.region_of[i] != deformable_region;
  result.take_points(of.sets, held);
  return result;
}

/// The factor of a shell depends on how its surface is connected: ordered, not factored.
Sizes sizes_of(const ShellOptions& options, const Case& of, Estimate& estimate) {
  Sizes sizes;
  const double diagonal = bounding_box(of.mesh.points).diagonal();
  const EnergyModel model = shell_model(of.mesh, of.points.region_of, options, diagonal > 0 ? diagonal : 1, of.context);
  of.context.check();
  sizes.factor = SparseCholesky::estimate(model.space.energy);
  of.context.check();
  sizes.constrained = constrained_bytes(model.space.energy, model.space.values, of.sets, nullptr, of.context);
  const std::size_t energy = sparse_bytes(model.space.energy);
  sizes.matrices = energy + sparse_bytes(model.space.values) + sparse_bytes(model.coupling);
  // The bending energy is a product, of which both triangles are made and sorted before one is kept.
  sizes.assembly = shell_assembly_bytes(of.mesh) + 2 * sizes.matrices + 2 * energy;
  sizes.functions = model.space.samples;
  sizes.held = model.held.size();
  sizes.eliminated = model.eliminated;
  sizes.held_ids = model.held;
  sizes.entries = static_cast<double>(model.space.energy.nonZeros());
  // The rows of the held points with their weights, and the matrix with their squares.
  if (!model.eliminated) {
    sizes.matrices += energy + sizes.held * (3 * entry_bytes + sizeof(double));
    sizes.making = 2 * energy + 4 * sizes.held * entry_bytes;
    sizes.values = sizes.squares = static_cast<double>(sizes.held);
  }
  (model.eliminated ? estimate.held_points : estimate.samples) = model.eliminated ? sizes.held : sizes.functions;
  estimate.notes = model.space.notes;
  return sizes;
}

/// The matrix of a lattice is made as well: it is small, and its factor has its pattern, which the held points do not change.
Sizes sizes_of(const FfdOptions& options, const Case& of, Estimate& estimate) {
  Sizes sizes;
  const EnergyModel model = lattice_model(of.mesh, options, of.points.region_of, of.context);
  of.context.check();
  sizes.factor = SparseCholesky::estimate(model.space.energy);
  of.context.check();
  DeliveredRows delivered;
  if (of.delivered) {
    delivered = delivered_points(of);
    for (const PointId id : model.held) {
      model.space.functions().for_each(id, [&](std::int64_t column, double) { delivered.functions.push_back(column); });
    }
    std::sort(delivered.functions.begin(), delivered.functions.end());
    delivered.functions.erase(std::unique(delivered.functions.begin(), delivered.functions.end()), delivered.functions.end());
    sizes.delivered_points = delivered.ids.size();
    sizes.delivered_functions = delivered.functions.size();
  }
  sizes.constrained =
      constrained_bytes(model.space.energy, model.space.functions(), of.sets, of.delivered ? &delivered : nullptr, of.context);
  const std::size_t energy = sparse_bytes(model.space.energy);
  sizes.held = model.held.size();
  std::size_t entries = 0;
  for (const PointId id : model.held) {
    const std::size_t count = model.space.functions().count(id);
    entries += count;
    sizes.squares += static_cast<double>(count) * static_cast<double>(count);
  }
  sizes.values = static_cast<double>(entries);
  sizes.entries = static_cast<double>(model.space.energy.nonZeros());
  const std::size_t rows = entries * entry_bytes + sizes.held * (sizeof(double) + sizeof(std::int64_t));
  sizes.functions = model.space.samples;
  // Beside the matrices their sums and the held points' rows weighted, transposed and multiplied, whose product is full.
  sizes.assembly = model.space.value_bytes() + 3 * energy;
  sizes.matrices = model.space.value_bytes() + rows + 2 * energy + sparse_bytes(model.space.linear);
  sizes.making = 2 * rows + 4 * energy;
  estimate.samples = sizes.functions;
  estimate.notes = model.space.notes;
  return sizes;
}

SpaceBytes space_bytes(const SubspaceOptions& options, const Mesh& mesh) { return estimate_shell_subspace(mesh, options); }
SpaceBytes space_bytes(const MlsOptions& options, const Mesh& mesh) { return estimate_mls_space(mesh, options); }

std::size_t most_reaching(const SubspaceOptions&, const Case&) { return std::numeric_limits<std::size_t>::max(); }
std::size_t most_reaching(const MlsOptions& options, const Case& of) {
  std::vector<Vec3> places;
  for (const ConstraintSet& set : of.sets) {
    for (const PointId id : set.ids) places.push_back(of.mesh.points[id]);
  }
  return estimate_mls_reach(of.mesh, options, places);
}

template <typename Options>
Sizes sizes_of(const Options& options, const Case& of, Estimate& estimate) {
  Sizes sizes;
  const SpaceBytes space = space_bytes(options, of.mesh);
  // Supports are wide, so that the factor fills up: a multiple of the matrix, at most a full triangle.
  const std::size_t k = space.samples;
  const std::size_t entries = std::min(k * (k + 1) / 2, fill * space.energy_entries);
  // The rows of the held points again, transposed; what stays of the space is mostly rows.
  sizes.held = estimate.constraint_points;
  const std::size_t held = space.resident / std::max<std::size_t>(1, of.mesh.point_count()) * sizes.held;
  sizes.assembly = space.peak;
  sizes.making_space = space.seconds;
  sizes.matrices = space.resident + held + 2 * space.energy_entries * entry_bytes;
  sizes.making = 2 * held + 4 * space.energy_entries * entry_bytes;
  sizes.functions = k;
  sizes.values = static_cast<double>(sizes.held) * static_cast<double>(space.cover);
  sizes.squares = sizes.values * static_cast<double>(space.cover);
  sizes.entries = static_cast<double>(space.energy_entries);
  sizes.factor.factor_bytes = entries * sizeof(double);
  sizes.factor.peak_bytes = 2 * sizes.factor.factor_bytes;
  sizes.factor.flops =
      static_cast<double>(entries) * static_cast<double>(entries) / static_cast<double>(std::max<std::size_t>(1, k));
  const std::size_t delivered = of.delivered ? delivered_points(of).points() : 0;
  sizes.delivered_points = delivered;
  sizes.delivered_functions = of.delivered ? k : 0;
  sizes.constrained =
      constrained_bytes({k, space.cover, space.energy_entries, entries, most_reaching(options, of), delivered}, of.sets);
  estimate.samples = k;
  return sizes;
}

/// A ResidualCorrection and its evaluation points.
struct CorrectionBytes {
  std::size_t resident = 0, peak = 0;
};

CorrectionBytes correction_bytes(std::size_t centres, std::size_t places) {
  const std::size_t own = centres * (sizeof(Vec3) + sizeof(std::uint32_t));
  return {interpolator_bytes(centres, Solver::cholesky) + own,
          interpolator_peak_bytes(centres, Solver::cholesky) + 3 * own + places * (2 * sizeof(Vec3) + sizeof(double))};
}

std::vector<PointId> held_points(const std::vector<RegionIndex>& region_of) {
  std::vector<PointId> held;
  for (std::size_t i = 0; i < region_of.size(); ++i) {
    if (region_of[i] != deformable_region) held.push_back(static_cast<PointId>(i));
  }
  return held;
}

/// What its levels add.
CorrectionBytes level_bytes(std::span<const Vec3> places, std::span<const std::uint32_t> centres, std::span<const char> bound) {
  if (places.size() <= centres.size()) return {};
  const CompactLevels::Bytes bytes = CompactLevels::estimate(places, choose_levels({places, centres, bound}, {}));
  return {bytes.resident, bytes.peak};
}

void add(const CorrectionBytes& levels, CorrectionBytes& correction) {
  correction.peak = std::max(correction.peak, correction.resident + levels.peak);
  correction.resident += levels.resident;
}

/// What the held points take: their part of the matrix, solutions for so many columns with their uncertainty, and a correction of
/// their misfit by so many centres at the following points, none of a basis without one.
struct HeldWork {
  std::size_t columns = 0, centres = 0, following = 0;
  int steps = 1;  ///< of multipliers
};

double held_seconds(const Sizes& sizes, const HeldWork& work) {
  const auto columns = static_cast<double>(work.columns), centres = static_cast<double>(work.centres);
  const auto held = static_cast<double>(sizes.held), following = static_cast<double>(work.following);
  const double solves = static_cast<double>(work.steps + 1) * static_cast<double>(sizes.factor.factor_bytes) / 4e9;
  const double values = 2 * work.steps * per_value * sizes.values;
  const double uncertainty = 2 * per_long_value * (sizes.values + sizes.entries);
  const double correction = centres * centres * centres / 3 / dense_rate + centres * held * per_distance;
  const double evaluation = following * centres * (columns > 0 ? per_kernel + columns * per_term : 0);
  return sizes.squares * per_square + correction + columns * values +
         (columns * (solves + uncertainty) + evaluation) / thread_count({});
}

// Seconds of a design with constraints: for a byte of the factor in the solutions of a round, and for a pair of a centre and a
// held point in a correction of the misfit.
constexpr double per_round_byte = 1.2e-9, per_pair_of_centre = 1.7e-8;

/// One design with constraints, and with `rounds` of multipliers. The misfit is corrected for the result, for the deformation
/// without constraints that reports compare it with, for what each round leaves, and once more with exact constraints.
double design_seconds(const Sizes& sizes, const HeldWork& work, int rounds, bool placed) {
  const auto centres = static_cast<double>(work.centres), following = static_cast<double>(work.following);
  const double corrections = static_cast<double>(rounds + (placed ? 3 : 2));
  const double correcting = corrections * per_pair_of_centre * centres * static_cast<double>(sizes.held);
  const double evaluating = following * centres * (per_kernel + 3 * per_term) / thread_count({});
  return sizes.constrained.design_seconds + rounds * per_round_byte * static_cast<double>(sizes.factor.factor_bytes) +
         correcting + evaluating;
}

std::size_t tiled_bytes(std::size_t points) { return tile_count(points) * tile_size * sizeof(Vec3); }

/// Exact constraints.
struct PlacementBytes {
  std::size_t resident = 0, peak = 0;
  std::size_t working = 0;  ///< of one design
};

struct PlacementInput {
  const Setup& setup;
  const Mesh& mesh;
  const UnitBox& box;
  const ConstraintSets& constraints;
  const std::vector<RegionIndex>& region_of;
  const std::vector<PointId>& held;
  std::size_t following;
  bool hard;
};

PlacementBytes placement_bytes(const PlacementInput& of) {
  std::vector<ConstraintSet> sets;
  for (std::size_t t = 0; t < of.constraints.sets.size(); ++t) {
    if (of.setup.constraints[of.constraints.constraint_of[t]].exact) sets.push_back(of.constraints.sets[t]);
  }
  if (sets.empty()) return {};
  std::vector<bool> moves(of.region_of.size());
  for (std::size_t i = 0; i < moves.size(); ++i) moves[i] = !of.hard || of.region_of[i] == deformable_region;
  const ExactPlacement placement(std::move(sets), moves);
  std::vector<PointId> moving;
  for (std::size_t u = 0; u < placement.ids().size(); ++u) {
    if (placement.moves(u)) moving.push_back(placement.ids()[u]);
  }
  const CarrierPlaces from =
      carrier_places({of.mesh, of.box, of.region_of, moving, of.held, of.following, of.setup.constraint_options.exact_steps});
  const std::size_t places = from.places.size();
  CorrectionBytes correction = correction_bytes(from.centres.size(), places);
  if (!from.bound.empty()) add(level_bytes(from.places, from.centres, from.bound), correction);
  const std::size_t own = placement.bytes() + tiled_bytes(placement.ids().size()) + moving.size() * sizeof(std::uint32_t);
  return {own + correction.resident, own + correction.peak + places * (sizeof(Vec3) + 1),
          placement.working_bytes({}) + 12 * places * sizeof(Vec3)};
}

/// Constraints are counted by their rest points, and with the solution of one design (peak_bytes).
template <typename Options>
Estimate estimate_of(const Options& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                     const RunContext& context) {
  const bool hard = options.handles == HandleMode::hard;
  const ConstraintPoints constrained_points = constraint_points(mesh, regions, context);
  const Box bounds = bounding_box(mesh.points);
  const double diagonal = bounds.diagonal();
  const UnitBox box{bounds.min, diagonal > 0 ? diagonal : 1};
  context.check();
  const ConstraintSets constraints = constraint_sets(mesh, setup, regions, box);
  context.check();
  Estimate estimate;
  estimate.constraint_points = constrained_points.count;
  const std::size_t following = hard ? constrained_points.deformable.size() : mesh.point_count();
  const bool columns = std::all_of(constraints.sets.begin(), constraints.sets.end(),
                                   [](const ConstraintSet& set) { return set.column != nullptr; });  // or none
  const bool joins =
      hard && options.misfit == MisfitRule::joins && !columns && setup.constraint_options.exact_steps == ExactSteps::joins;
  Sizes sizes = sizes_of(options, Case{mesh, constrained_points, constraints.sets, joins, context}, estimate);
  context.check();
  estimate.notes.insert(estimate.notes.end(), constraints.notes.begin(), constraints.notes.end());

  const std::vector<PointId> held =
      sizes.held_ids.empty() ? held_points(constrained_points.region_of) : std::move(sizes.held_ids);
  const std::size_t solver = sizes.factor.factor_bytes + sizes.matrices + few_bytes;
  const bool corrected = hard && !sizes.eliminated && sizes.held > 0;
  const std::size_t centres = corrected ? std::min(ResidualCorrection::centres_for(following), sizes.held) : 0;
  CorrectionBytes correction = corrected ? correction_bytes(centres, sizes.held) : CorrectionBytes();
  if (corrected && options.misfit == MisfitRule::joins) {
    const std::vector<char> next = next_to_deformable(mesh, constrained_points.region_of);
    std::vector<char> bound;
    for (const PointId id : held) bound.push_back(next[id]);
    const std::vector<Vec3> held_places = unit_places(mesh, box, held);
    add(level_bytes(held_places, ResidualCorrection::centres_of(held_places, centres, ResidualCorrection::Kind::smooth), bound),
        correction);
  }
  context.check();
  const PlacementBytes placement =
      placement_bytes({setup, mesh, box, constraints, constrained_points.region_of, held, following, hard});
  std::size_t set_points = 0;
  for (const ConstraintSet& set : constraints.sets) set_points += set.ids.size();
  const bool placed = placement.resident > 0;
  std::size_t column_points = 0;
  for (const ConstraintSet& set : constraints.sets) column_points += set.column ? set.ids.size() : 0;
  const std::size_t layers = column_points > 0 ? LayerStep::bytes_for(column_points, following) : 0;
  const std::size_t places =
      (corrected || placed ? tiled_bytes(following) : 0) + (corrected || placed ? tiled_bytes(set_points) : 0);
  const std::size_t before_sets = solver + correction.resident + places;
  const std::size_t before_placement = before_sets + sizes.constrained.resident + layers;
  estimate.factor_bytes = before_placement + placement.resident;

  const std::size_t fields = 4 * regions.handles.size();
  const std::size_t basis_bytes = HandleBasis::bytes_for(following, fields, options.basis_tolerance);
  const bool basis = setup.constraints.empty() && wants_basis(options.basis, basis_bytes, solver);
  estimate.basis_bytes = basis ? basis_bytes : 0;
  const std::size_t points = point_bytes(mesh.point_count(), regions.symmetry);
  const std::size_t checked = basis && !sizes.eliminated ? std::min(HandleBasis::most_held, sizes.held) : 0;
  estimate.resident_bytes = estimate.factor_bytes + estimate.basis_bytes + points + checked * fields * sizeof(double);
  const std::size_t making = basis ? HandleBasis::peak_bytes_for(following, fields, options.basis_tolerance) : 0;
  const std::size_t solving = making + 8 * sizes.functions * 3 * sizeof(double);
  const std::size_t working = sizes.constrained.working + placement.working + 12 * column_points * sizeof(Vec3);
  // The sets are there from the beginning.
  estimate.peak_bytes = points + 2 * set_points * (sizeof(Vec3) + sizeof(PointId)) +
                        std::max({sizes.assembly, sizes.matrices + std::max(sizes.making, sizes.factor.peak_bytes),
                                  solver + correction.peak, before_sets + sizes.constrained.preparing,
                                  before_placement + placement.peak, estimate.factor_bytes + std::max(solving, working)});
  const auto factor_bytes = static_cast<double>(sizes.factor.factor_bytes);
  const bool multipliers = hard && !sizes.eliminated;
  const HeldWork work{(basis ? fields : 0) + (multipliers ? 1 : 0), centres, basis ? following : 0,
                      multipliers ? EnergySolver::multiplier_steps : 1};
  // What is interpolated of every function at the points of the sets.
  const double interpolating =
      static_cast<double>(sizes.delivered_functions) * static_cast<double>(centres) *
      (per_sum * static_cast<double>(sizes.delivered_points) / thread_count({}) + per_centre * static_cast<double>(centres));
  estimate.seconds = interpolating + (sizes.factor.flops + sizes.constrained.operations) / nominal_rate + factor_bytes * 5e-9 +
                     held_seconds(sizes, work) + sizes.constrained.seconds +
                     (sizes.making_space > 0 ? sizes.making_space : static_cast<double>(sizes.assembly) * 1e-8);
  if (!setup.constraints.empty()) {
    estimate.design_seconds =
        design_seconds(sizes, {0, centres, following, 0}, multipliers ? ConstrainedSolver::rounds : 1, placed);
  }
  if (!basis && setup.constraints.empty()) {
    estimate.notes.push_back("No handle basis will be stored: every design is solved for.");
  }
  estimate.advice = std::string("use a larger fixed region, fewer samples, fewer handles") +
                    (setup.constraints.empty() ? "" : ", smaller regions of constraints") + " or basis BASIS_NEVER";
  return estimate;
}

}  // namespace

Estimate estimate_energy(const ShellOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                         const RunContext& context) {
  return estimate_of(options, mesh, setup, regions, context);
}
Estimate estimate_energy(const SubspaceOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                         const RunContext& context) {
  return estimate_of(options, mesh, setup, regions, context);
}
Estimate estimate_energy(const MlsOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                         const RunContext& context) {
  return estimate_of(options, mesh, setup, regions, context);
}
Estimate estimate_energy(const FfdOptions& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                         const RunContext& context) {
  return estimate_of(options, mesh, setup, regions, context);
}

}  // namespace deform
