#include "core/deformers/rbf.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/deformers/rbf_evaluation.h"
#include "core/numerics/fast_sums.h"

namespace deform {

namespace {

// Seconds since the last call.
class Stopwatch {
 public:
  double lap() {
    const auto now = RunContext::Clock::now();
    const double seconds = std::chrono::duration<double>(now - last_).count();
    last_ = now;
    return seconds;
  }

 private:
  RunContext::Clock::time_point last_ = RunContext::Clock::now();
};

int polynomial_degree(const RbfOptions& options) {
  const KernelProperties kernel = properties(options.kernel);
  if (options.polynomial_degree < 0) return std::max(1, kernel.order - 1);
  if (options.polynomial_degree < kernel.order - 1) {
    throw Error(ErrorCode::invalid_argument, "method.rbf.polynomial_degree: " + std::to_string(options.polynomial_degree) +
                                                 " is too small, the kernel " + kernel.name + " needs at least " +
                                                 std::to_string(kernel.order - 1));
  }
  return options.polynomial_degree;
}

UnitBox unit_box(const Box& box) {
  UnitBox unit{box.min, 0};
  for (int k = 0; k < 3; ++k) unit.scale = std::max(unit.scale, box.max[k] - box.min[k]);
  if (unit.scale <= 0) unit.scale = 1;
  return unit;
}

/// Median distance to the nearest other place, over an evenly strided sample of the places.
double median_spacing(const std::vector<Vec3>& places) {
  constexpr std::size_t sample = 500;
  const std::size_t stride = places.size() / sample + 1;
  std::vector<double> nearest;
  for (std::size_t i = 0; i < places.size(); i += stride) {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < places.size(); ++j) {
      if (j != i)
        least =
            std::min(least, std::hypot(places[i][0] - places[j][0], places[i][1] - places[j][1], places[i][2] - places[j][2]));
    }
    nearest.push_back(least);
  }
  const auto middle = nearest.begin() + static_cast<std::ptrdiff_t>(nearest.size() / 2);
  std::nth_element(nearest.begin(), middle, nearest.end());
  return *middle;
}

std::string scientific(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1e", value);
  return text;
}

constexpr std::size_t basis_always_fits = std::size_t{1} << 30;

bool wants_basis(BasisMode mode, std::size_t basis_bytes, std::size_t factor_bytes) {
  if (mode != BasisMode::automatic) return mode == BasisMode::always;
  return basis_bytes <= std::max(4 * factor_bytes, basis_always_fits);
}

// Per point: region, rank, id and unit coordinates (a tile more), group lists.
std::size_t point_bytes(std::size_t n) { return n * (4 + 4 + 4 + 24 + 4) + 4096; }

}  // namespace

RbfSystem::RbfSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context, std::size_t memory_budget)
    : mesh_(std::move(mesh)), setup_(setup) {
  const auto& options = std::get<RbfOptions>(setup_.method);
  Stopwatch watch;
  context.progress("select", 0);
  regions_ = validate(setup_, *mesh_);
  const int degree = polynomial_degree(options);
  const Box bounds = bounding_box(mesh_->points);
  box_ = unit_box(bounds);
  centres_ = choose_centres(*mesh_, regions_, options);
  rank_of_.assign(mesh_->point_count(), 0);
  for (const auto& handle : regions_.handles) {
    for (std::size_t k = 0; k < handle.size(); ++k) rank_of_[handle[k]] = static_cast<std::uint32_t>(k);
  }
  std::vector<Vec3> unit;
  unit.reserve(centres_.deformable.size());
  for (const PointId id : centres_.deformable) unit.push_back(box_.to_unit(mesh_->points[id]));
  deformable_ = TiledPoints(unit);
  unit.clear();
  unit.shrink_to_fit();
  for (const auto& handle : regions_.handles) {
    Box extent;
    for (const PointId id : handle) extent.add(box_.to_unit(mesh_->points[id]));
    HandleFrame frame;
    for (int k = 0; k < 3; ++k) frame.reference[k] = 0.5 * (extent.min[k] + extent.max[k]);
    frames_.push_back(frame);
  }
  info_.stage_seconds.emplace_back("select", watch.lap());
  context.check();

  std::vector<Vec3> places;
  Box extent;
  for (const PointId id : centres_.ids) {
    places.push_back(box_.to_unit(mesh_->points[id]));
    extent.add(places.back());
  }
  InterpolationOptions interpolation;
  const double size = extent.diagonal() > 0 ? extent.diagonal() : 1.0;
  interpolation.kernel = {options.kernel, options.shape * size};
  if (options.shape == 0) interpolation.kernel.shape = automatic_shape(options.kernel, median_spacing(places), size);
  interpolation.polynomial_degree = degree;
  interpolation.solver = options.solver;
  interpolation.memory_limit = memory_budget;
  if (options.solver == Solver::incremental_qr) {
    // Affine motions combine these fields.
    interpolation.samples = handle_fields(places);
    interpolation.sample_tolerance = options.tolerance;
    interpolation.columns_per_field = 4;
  }
  system_ = std::make_unique<InterpolationSystem>(std::move(places), interpolation, context);
  info_.stage_seconds.emplace_back("factor", watch.lap());
  prepare_basis(options, context);
  info_.stage_seconds.emplace_back("basis", watch.lap());

  info_.points = mesh_->point_count();
  info_.fixed_points = regions_.fixed.size();
  for (const auto& handle : regions_.handles) info_.handle_points += handle.size();
  info_.deformable_points = centres_.deformable.size();
  info_.constraint_points = centres_.constraint_points;
  info_.centres = system_->weighted();
  info_.merged_duplicates = centres_.merged;
  info_.polynomial_terms = system_->polynomials().terms();
  info_.affine_hull_dimension = system_->polynomials().hull_dimension();
  info_.diagonal = bounds.diagonal();
  info_.condition = system_->condition();
  info_.tolerance = to_tolerance(system_->solver()) ? options.tolerance : 0;
  info_.solver = system_->solver();
  info_.reduced = centres_.reduced;
  info_.basis_fields = basis_ ? basis_->fields() : 0;
  info_.factor_bytes = system_->bytes();
  info_.basis_bytes = basis_ ? basis_->bytes() : 0;
  info_.bytes = info_.factor_bytes + info_.basis_bytes + point_bytes(mesh_->point_count());
  add_notes(degree);
  if (properties(options.kernel).has_shape && options.shape == 0) {
    info_.notes.push_back("The shape is " + std::to_string(interpolation.kernel.shape / size) +
                          " of the diagonal of the centres (automatic).");
  }
}

void RbfSystem::add_notes(int degree) {
  info_.notes = centres_.notes;
  const auto& solver_notes = system_->notes();
  info_.notes.insert(info_.notes.end(), solver_notes.begin(), solver_notes.end());
  static const char* const hulls[] = {"in one point", "on a line", "in a plane"};
  if (degree > 0 && info_.affine_hull_dimension < 3) {
    info_.notes.push_back(std::string("The centres lie ") + hulls[info_.affine_hull_dimension] +
                          ": the polynomial part is constant across it.");
  }
  if (system_->polynomials().dropped() > 0) {
    info_.notes.push_back(std::to_string(system_->polynomials().dropped()) +
                          " monomials depend on the others at the centres and were left out.");
  }
  if (system_->solver() == Solver::iterative) {
    info_.notes.push_back("The systems are solved iteratively, to " + scientific(info_.tolerance) + " of the diagonal.");
  }
  if (system_->solver() == Solver::incremental_qr) {
    info_.notes.push_back("Least squares: " + std::to_string(info_.centres) + " of the " + std::to_string(system_->size()) +
                          " constraint points are centres, for an RMS error of " + scientific(info_.tolerance) +
                          " of the diagonal.");
  }
  if (to_tolerance(system_->solver())) {
    if (basis_ && !basis_->converged()) {
      info_.notes.push_back("The solver did not reach its tolerance for the handle basis: the largest residual is " +
                            scientific(*std::max_element(basis_->residuals().begin(), basis_->residuals().end())) + ".");
    }
  }
  if (info_.condition > 1e13) info_.notes.push_back("The system is ill-conditioned: expect a loss of digits.");
  if (!basis_) info_.notes.push_back("No handle basis is stored: every design is solved for and summed directly.");
}

Eigen::MatrixXd RbfSystem::handle_fields(std::span<const Vec3> places) const {
  Eigen::MatrixXd fields =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(centres_.ids.size()), static_cast<Eigen::Index>(4 * frames_.size()));
  for (std::size_t j = 0; j < centres_.ids.size(); ++j) {
    const RegionIndex region = centres_.region_of[centres_.ids[j]];
    if (region == fixed_region) continue;
    const Vec3& x = places[j];
    const auto row = static_cast<Eigen::Index>(j);
    const auto column = static_cast<Eigen::Index>(4 * region);
    fields(row, column) = 1;
    for (int k = 0; k < 3; ++k) fields(row, column + 1 + k) = x[k] - frames_[region].reference[k];
  }
  return fields;
}

void RbfSystem::prepare_basis(const RbfOptions& options, const RunContext& context) {
  const std::size_t fields = 4 * frames_.size();
  if (!wants_basis(options.basis, HandleBasis::bytes_for(deformable_.count(), fields),
                   InterpolationSystem::factor_bytes(system_->size(), system_->solver()))) {
    return;
  }
  basis_ = std::make_unique<HandleBasis>(*system_, handle_fields(system_->centres()), deformable_, options.tolerance, context);
}

std::unique_ptr<const Evaluation> RbfSystem::bind(std::span<const Design> designs, EvaluationPath path,
                                                  const RunContext& context) const {
  return std::make_unique<RbfEvaluation>(std::static_pointer_cast<const RbfSystem>(shared_from_this()), designs, path, context);
}

Points RbfSystem::jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                                  const RunContext& context) const {
  const std::size_t count = setup_.variables.size();
  if (direction.size() != count) {
    throw Error(ErrorCode::invalid_argument, "direction: expected " + std::to_string(count) +
                                                 " values, one per design variable, got " + std::to_string(direction.size()));
  }
  std::vector<Affine> motion(frames_.size(), Affine{});
  for (std::size_t k = 0; k < count; ++k) {
    if (!std::isfinite(direction[k])) {
      throw Error(ErrorCode::invalid_argument, "direction[" + std::to_string(k) + "]: must be finite");
    }
    const std::vector<Affine> derivative = handle_motion_derivative(setup_, variables, k);
    for (std::size_t h = 0; h < motion.size(); ++h) {
      for (std::size_t j = 0; j < 12; ++j) motion[h][j] += direction[k] * derivative[h][j];
    }
  }
  const RbfEvaluation evaluation(std::static_pointer_cast<const RbfSystem>(shared_from_this()), motion, context);
  Points result(mesh_->point_count());
  parallel_for(context, result.size(), 8192, [&](std::size_t begin, std::size_t end) {
    Vec3* out = result.data() + begin;
    evaluation.evaluate(begin, end, 0, std::span<Vec3* const>(&out, 1));
  });
  return result;
}

std::vector<double> RbfSystem::pull_back(std::span<const Vec3> field, const RunContext& context) const {
  std::vector<Vec3> at_deformable;
  at_deformable.reserve(centres_.deformable.size());
  for (const PointId id : centres_.deformable) at_deformable.push_back(field[id]);
  if (basis_) return basis_->transposed_product(at_deformable, context);

  // u = [Phi P] S [fields; 0] with the symmetric S, so the adjoint is fields^T times the first rows of S [Phi^T; P^T].
  std::vector<Vec3> unit;
  unit.reserve(centres_.deformable.size());
  for (const PointId id : centres_.deformable) unit.push_back(box_.to_unit(mesh_->points[id]));
  const std::size_t m = system_->size();
  const auto q = static_cast<Eigen::Index>(system_->polynomials().terms());
  const std::span<const double> weights(unit.empty() ? nullptr : at_deformable[0].data(), 3 * unit.size());
  const std::vector<double> sums = system_->sums_at_centres(unit, weights, 3, context);
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(m) + q, 3);
  for (std::size_t j = 0; j < m; ++j) {
    for (int k = 0; k < 3; ++k) B(static_cast<Eigen::Index>(j), k) = sums[3 * j + static_cast<std::size_t>(k)];
  }
  std::vector<double> terms(static_cast<std::size_t>(q));
  for (std::size_t i = 0; i < unit.size(); ++i) {
    system_->polynomials().values(unit[i], terms.data());
    for (Eigen::Index t = 0; t < q; ++t) {
      for (int k = 0; k < 3; ++k)
        B(static_cast<Eigen::Index>(m) + t, k) += terms[static_cast<std::size_t>(t)] * at_deformable[i][k];
    }
  }
  const Eigen::MatrixXd G = handle_fields(system_->centres()).transpose() * system_->adjoint(std::move(B), context);
  std::vector<double> result(3 * static_cast<std::size_t>(G.rows()));
  for (Eigen::Index r = 0; r < G.rows(); ++r) {
    for (int k = 0; k < 3; ++k) result[static_cast<std::size_t>(3 * r + k)] = G(r, k);
  }
  return result;
}

std::vector<double> RbfSystem::vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                               const RunContext& context) const {
  if (cotangent.size() != mesh_->point_count()) {
    throw Error(ErrorCode::invalid_argument, "cotangent: expected " + std::to_string(mesh_->point_count()) +
                                                 " vectors, one per point, got " + std::to_string(cotangent.size()));
  }
  for (std::size_t i = 0; i < cotangent.size(); ++i) {
    if (!std::isfinite(cotangent[i][0] + cotangent[i][1] + cotangent[i][2])) {
      throw Error(ErrorCode::invalid_argument, "cotangent[" + std::to_string(i) + "]: must be finite");
    }
  }
  const std::vector<double> G = pull_back(cotangent, context);
  // Moments of the cotangent over the handle points: what an affine derivative there is multiplied with.
  std::vector<Affine> moments(frames_.size(), Affine{});
  for (std::size_t h = 0; h < frames_.size(); ++h) {
    for (const PointId id : regions_.handles[h]) {
      const Vec3& x = mesh_->points[id];
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) moments[h][4 * i + j] += cotangent[id][i] * x[j];
        moments[h][4 * i + 3] += cotangent[id][i];
      }
    }
  }
  std::vector<double> gradient(setup_.variables.size(), 0.0);
  double block[12];
  for (std::size_t k = 0; k < gradient.size(); ++k) {
    const std::vector<Affine> derivative = handle_motion_derivative(setup_, variables, k);
    for (std::size_t h = 0; h < frames_.size(); ++h) {
      if (derivative[h] == Affine{}) continue;
      field_coefficients(derivative[h], MotionKind::derivative, frames_[h], box_, block);
      for (std::size_t j = 0; j < 12; ++j) gradient[k] += block[j] * G[12 * h + j] + derivative[h][j] * moments[h][j];
    }
  }
  return gradient;
}

Estimate estimate_rbf(const Mesh& mesh, const Setup& setup) {
  const auto& options = std::get<RbfOptions>(setup.method);
  const SelectedRegions regions = validate(setup, mesh);
  polynomial_degree(options);
  const RbfCentres centres = choose_centres(mesh, regions, options);
  const std::size_t m = centres.ids.size();
  const std::size_t d = centres.deformable.size();
  const Solver solver = chosen_solver(options.solver, options.kernel, m);
  const std::size_t fields = 4 * regions.handles.size();

  Estimate estimate;
  estimate.constraint_points = centres.constraint_points;
  estimate.centres = m;
  estimate.factor_bytes = InterpolationSystem::factor_bytes(m, solver) + m * sizeof(Vec3);
  const std::size_t basis_bytes = HandleBasis::bytes_for(d, fields);
  const bool basis = wants_basis(options.basis, basis_bytes, InterpolationSystem::factor_bytes(m, solver));
  estimate.basis_bytes = basis ? basis_bytes : 0;
  estimate.resident_bytes = estimate.factor_bytes + estimate.basis_bytes + point_bytes(mesh.point_count());
  const std::size_t factor_extra = InterpolationSystem::peak_bytes(m, solver) + 2 * m * sizeof(Vec3);
  // Data, solution and the copies that a solve makes of them, beside the factor.
  const std::size_t samples = solver == Solver::incremental_qr ? 4 * m * fields * sizeof(double) : 0;
  const std::size_t basis_extra =
      (solver == Solver::iterative ? InterpolationSystem::peak_bytes(m, solver) + FastSums::bytes_for(d, m, 12)
                                   : estimate.factor_bytes) +
      estimate.basis_bytes + (basis ? 4 * (m + 10) * fields * sizeof(double) : 0);
  const std::size_t adjacency = 16 * (mesh.point_count() + mesh.face_count()) + 24 * mesh.face_points.size();
  estimate.peak_bytes =
      point_bytes(mesh.point_count()) + d * sizeof(Vec3) + std::max({factor_extra + samples, basis_extra, adjacency});
  estimate.notes = centres.notes;
  if (!basis) estimate.notes.push_back("No handle basis will be stored: every design is solved for and summed directly.");

  // Nominal rates of one current core, halved work for two.
  const double cores = thread_count({});
  const auto M = static_cast<double>(m);
  const double rows = M + (basis ? static_cast<double>(d) : 0.0);
  const double columns = basis ? static_cast<double>(fields) : 0.0;
  if (solver == Solver::iterative) {
    // Factors of the subsets, then a dozen fast sums per four fields.
    const double solves = std::max(1.0, columns / 4);
    estimate.seconds = (M * 2e-4 + solves * (M * 2.5e-4 + rows * 2e-5)) / cores + 1;
    return estimate;
  }
  if (solver == Solver::incremental_qr) {
    const double k = std::min<double>(M, most_incremental_centres);
    estimate.notes.push_back("Incremental QR: at most; how many centres the tolerance needs is not known before.");
    estimate.seconds = (2 * M * k * k / 2e10 + rows * k * (1 / 8e8 + 2 * columns / 1.5e10)) / cores + 4 * M * k * columns / 5e9;
    return estimate;
  }
  estimate.seconds = (M * M / 2 / 5e8 + M * M * M / 3 / 2.5e10 + rows * M * (1 / 8e8 + 2 * columns / 1.5e10)) / cores +
                     4 * M * M * columns / 1e10 + static_cast<double>(mesh.point_count()) * 2e-7;
  return estimate;
}

}  // namespace deform
