// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/rbf/rbf_method.h"

#include <algorithm>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/deformers/handles/handle_basis.h"
#include "core/deformers/option_checks.h"
#include "core/deformers/rbf/rbf_system.h"
#include "core/numerics/fast_sums/fast_sums.h"

namespace deform {

namespace {

/// The sizes of all parts together. With the iterative solver they share one system.
struct CentreSizes {
  std::size_t rows = 0;            ///< rows of the largest system
  std::size_t factor_bytes = 0;    ///< memory of all factors
  std::size_t factoring_peak = 0;  ///< peak while the last one is factored, including the others
  std::size_t places = 0;          ///< centres of all systems
  std::size_t check_bytes = 0;     ///< memory of the error estimation
  std::size_t checking = 0;        ///< of one estimate besides, the most of any part
};

CentreSizes centre_sizes(const std::vector<PartPlan>& parts, Kernel kernel, Solver solver, std::size_t points) {
  CentreSizes sizes;
  for (const PartPlan& part : parts) {
    sizes.rows = std::max(sizes.rows, part.size);
    if (&part != &parts.front() && part.shares(*(&part - 1), solver)) continue;
    sizes.places += part.size;
    sizes.factoring_peak =
        std::max(sizes.factoring_peak, sizes.factor_bytes + sizes.check_bytes + part.system_peak_bytes(solver));
    sizes.factor_bytes += part.system_bytes(solver);
    if (!to_tolerance(solver)) continue;
    const RadialKernel checked{kernel, 1, part.parity};
    sizes.factoring_peak = std::max(sizes.factoring_peak,
                                    sizes.factor_bytes + sizes.check_bytes + PointErrors::peak_bytes(part.size, checked, solver));
    const std::size_t kept = PointErrors::bytes_for(part.size, checked, solver);
    const std::size_t solving = PointErrors::peak_bytes(part.size, checked, solver) - kept;
    sizes.checking = std::max({sizes.checking, solving, PointErrors::largest_bytes(points, part.size, checked)});
    sizes.check_bytes += kept;
  }
  return sizes;
}

/// Nominal rates of one current core, halved work for two.
double seconds_for(const std::vector<PartPlan>& parts, Solver solver, std::size_t images, std::size_t d, std::size_t fields) {
  const double cores = thread_count({});
  const auto columns = static_cast<double>(fields);
  double seconds = 0;
  for (const PartPlan& part : parts) {
    const auto M = static_cast<double>(part.size);
    const double rows = M + (fields > 0 ? static_cast<double>(d) : 0.0);
    if (part.cyclic) {
      // A complex system of the orbits, and accurate residuals of them.
      const auto m = static_cast<double>(part.cyclic->orbits());
      const double factors = part.turned ? 0 : 4 * m * m * m / 3 / 1e10;
      seconds +=
          factors +
          (m * M / 2 / 5e8 + static_cast<double>(d) * M * (1 / 8e8 + 2 * columns / 1.5e10) + 4 * m * M * columns / 1e9) / cores;
      continue;
    }
    if (solver == Solver::iterative) {
      // Factors of the subsets, then a dozen fast sums per four fields.
      const double solves = std::max(1.0, columns / 4);
      const double factors = seconds == 0 ? M * 2e-4 / cores + 1 : 0;  // once
      seconds += factors + solves * (M * 2.5e-4 + rows * 2e-5) / cores;
      continue;
    }
    const auto values = static_cast<double>(images);  // of the kernel, for each pair
    if (solver == Solver::incremental_qr) {
      const double k = std::min<double>(M, most_incremental_centres);
      seconds +=
          (2 * M * k * k / 2e10 + values * rows * k * (1 / 8e8 + 2 * columns / 1.5e10)) / cores + 4 * M * k * columns / 5e9;
      continue;
    }
    seconds += (values * M * M / 2 / 5e8 + M * M * M / 3 / 2.5e10 + rows * M * (values / 8e8 + 2 * columns / 1.5e10)) / cores +
               4 * values * M * M * columns / 1e10;
  }
  return seconds;
}

void validate_sample(const Setup& setup, const std::vector<double>& sample, const std::string& field) {
  try {
    handle_motions(setup, sample);
  } catch (const Error& error) {
    refuse_argument(field + "." + error.what());
  }
  if (std::all_of(sample.begin(), sample.end(), [](double value) { return value == 0; })) {
    refuse_argument(field + ": moves nothing; all its variables are 0");
  }
}

}  // namespace

RbfOptions with_defaults(RbfOptions options, const Mesh& mesh) {
  if (!options.kernel) options.kernel = default_kernel(bounding_box(mesh.points));
  if (options.tolerance == 0) options.tolerance = default_tolerance(options.solver);
  return options;
}

namespace {

/// The kernel of a method whose option is wrong is another one.
void check_degree(const RbfOptions& options, const Mesh& mesh, bool kernel_is_known) {
  const int degree = options.polynomial_degree;
  const std::string field = "method.rbf.polynomial_degree: " + std::to_string(degree);
  if (degree < -1 || degree > 2) {
    refuse_argument(field + " is out of range, at least the order of the kernel - 1 and at most 2");
  }
  if (degree < 0 || !kernel_is_known) return;
  const KernelProperties kernel = properties(*with_defaults(options, mesh).kernel);
  if (degree < kernel.order - 1) {
    refuse_argument(field + " is too small, the kernel " + kernel.name + " needs at least " + std::to_string(kernel.order - 1));
  }
}

}  // namespace

void RbfMethod::validate(const RbfOptions& options, const Setup& setup, const Mesh& mesh, Problems& problems) {
  if (options.tolerance != 0) {
    check_option_range(problems, options.tolerance, least_tolerance, largest_tolerance, "method.rbf.tolerance");
  }
  problems.check("method.rbf.shape", [&] {
    if (options.shape >= 0 && options.shape <= 100) return;
    refuse_argument("method.rbf.shape: " + number_digits(options.shape) + " is out of range, must be 0 (automatic) or up to 100");
  });
  check_option_range(problems, options.reduction_rings, 1, 100, "method.rbf.reduction_rings");
  check_basis_tolerance(problems, options.basis_tolerance, "method.rbf.basis_tolerance");
  if (options.reduction_tolerance != 0) {
    check_option_range(problems, options.reduction_tolerance, 1e-8, 0.1, "method.rbf.reduction_tolerance");
  }
  problems.check("method.rbf.polynomial_degree", [&] { check_degree(options, mesh, !problems.concern("method.rbf.kernel")); });
  for (std::size_t s = 0; s < options.samples.size(); ++s) {
    const std::string field = "method.rbf.samples[" + std::to_string(s) + "]";
    problems.check(field, [&] { validate_sample(setup, options.samples[s], field); });
  }
}

Estimate RbfMethod::estimate(const RbfOptions& given, const Mesh& mesh, const Setup&, const SelectedRegions& regions,
                             const RunContext& context) {
  const RbfOptions options = with_defaults(given, mesh);
  const ConstraintPoints points = constraint_points(mesh, regions, context);
  context.check();
  RbfCentres centres = choose_centres(mesh, points, regions.handles.size(), options, context);
  context.check();
  merge_partners(regions.symmetry, points, centres);
  const bool open = centres.most > centres.ids.size();
  if (open) take_most(points, centres);
  const std::size_t d = points.deformable.size();
  const Solver solver = solver_for(options, regions.symmetry, centres.ids.size());
  const std::size_t fields = 4 * regions.handles.size();
  const std::vector<PartPlan> parts = plan_parts(regions.symmetry, centres, solver);
  const CentreSizes sizes = centre_sizes(parts, *options.kernel, solver, d);

  Estimate estimate;
  estimate.constraint_points = points.count;
  estimate.centres = centres.ids.size();
  estimate.factor_bytes = sizes.factor_bytes + sizes.places * sizeof(Vec3);
  const std::size_t basis_bytes = parts.size() * HandleBasis::bytes_for(d, fields, options.basis_tolerance);
  const bool basis = wants_basis(options.basis, basis_bytes, sizes.factor_bytes);
  estimate.basis_bytes = basis ? basis_bytes : 0;
  const std::size_t errors_bytes = basis && to_tolerance(solver) ? parts.size() * 400 * fields * sizeof(double) : 0;
  estimate.resident_bytes = estimate.factor_bytes + sizes.check_bytes + errors_bytes + estimate.basis_bytes +
                            point_bytes(mesh.point_count(), regions.symmetry);
  // The samples for which the centres of incremental QR are chosen, and their transforms by the factorization.
  const std::size_t columns = options.samples.empty() ? fields : 3 * options.samples.size();
  const std::size_t samples = solver == Solver::incremental_qr ? 6 * sizes.rows * columns * sizeof(double) : 0;
  const std::size_t factor_extra = sizes.factoring_peak + 2 * sizes.places * sizeof(Vec3) + samples;
  // A part's basis is compressed before the next is made.
  const std::size_t making = basis ? (parts.size() - 1) * HandleBasis::bytes_for(d, fields, options.basis_tolerance) +
                                         HandleBasis::peak_bytes_for(d, fields, options.basis_tolerance)
                                   : 0;
  // Data, solution and the copies that a solve makes of them, beside the factor.
  const std::size_t basis_extra =
      (solver == Solver::iterative ? interpolator_peak_bytes(sizes.rows, solver) + FastSums::bytes_for(d, sizes.rows, 12)
                                   : estimate.factor_bytes + sizes.checking) +
      sizes.check_bytes + errors_bytes + making + (basis ? 5 * (sizes.rows + 10) * fields * sizeof(double) : 0);
  const std::size_t adjacency = 16 * (mesh.point_count() + mesh.face_count()) + 24 * mesh.face_points.size();
  // Every part's rows and the data that they are copied from.
  const std::size_t plans =
      regions.symmetry.empty() ? 0 : parts.size() * sizes.rows * (sizeof(PartPlan::Row) + fields * sizeof(double));
  // Searches while centres are chosen, and the fields at the points where they are looked at.
  const std::size_t choice = open ? mesh.point_count() * 100 + points_looked_at * (2 * fields + 8) * sizeof(double) : 0;
  estimate.peak_bytes = point_bytes(mesh.point_count(), regions.symmetry) + d * sizeof(Vec3) + plans +
                        std::max({factor_extra, basis_extra, adjacency, choice}) + (open ? choice : 0);
  estimate.notes = centres.notes;
  if (open) {
    estimate.notes.push_back("At most " + std::to_string(centres.ids.size()) + " of " + std::to_string(points.count) +
                             " constraint points become centres; how many the reduction tolerance of " +
                             scientific(reduction_tolerance(options)) + " needs is not known before.");
  }
  if (!open) {
    const auto planes = symmetry_notes(regions.symmetry, centres);
    estimate.notes.insert(estimate.notes.end(), planes.begin(), planes.end());
  }
  if (solver == Solver::incremental_qr) {
    estimate.notes.push_back("Incremental QR: at most; how many centres the tolerance needs is not known before.");
  }
  if (!basis) estimate.notes.push_back("No handle basis will be stored: every design is solved for and summed directly.");
  estimate.seconds = seconds_for(parts, solver, std::size_t{1} << regions.symmetry.planes(), d, basis ? fields : 0);
  if (solver != Solver::iterative) estimate.seconds += static_cast<double>(mesh.point_count()) * 2e-7;
  estimate.advice = "use solver ITERATIVE, smaller handle and fixed regions, fewer handles or basis BASIS_NEVER";
  return estimate;
}

std::optional<std::vector<PointId>> RbfMethod::known_centres(const RbfOptions& given, const Mesh& mesh,
                                                             const SelectedRegions& regions, const RunContext& context) {
  const RbfOptions options = with_defaults(given, mesh);
  const ConstraintPoints points = constraint_points(mesh, regions, context);
  context.check();
  RbfCentres centres = choose_centres(mesh, points, regions.handles.size(), options, context);
  context.check();
  merge_partners(regions.symmetry, points, centres);
  if (solver_for(options, regions.symmetry, centres.ids.size()) == Solver::incremental_qr) return std::nullopt;
  if (centres.most > centres.ids.size()) return std::nullopt;
  return std::move(centres.ids);
}

std::shared_ptr<const System> RbfMethod::prepare(const RbfOptions& options, const std::shared_ptr<const Mesh>& mesh,
                                                 const Setup& setup, const RunContext& context, std::size_t memory_budget) {
  return std::make_shared<const RbfSystem>(mesh, setup, with_defaults(options, *mesh), context, memory_budget);
}

}  // namespace deform
