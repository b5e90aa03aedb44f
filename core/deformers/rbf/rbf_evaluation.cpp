// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/rbf/rbf_evaluation.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/handles/interpolant_tiles.h"
#include "core/numerics/interpolation/value_errors.h"
#include "core/numerics/interpolation/values_to_tolerance.h"

namespace deform {

namespace {

constexpr std::size_t most_checked_centres = 256;  // centres at which a direct solution is checked
constexpr std::size_t tiles_per_check = 64;        // between two looks at the stop token

}  // namespace

RbfEvaluation::RbfEvaluation(std::shared_ptr<const RbfSystem> system, std::span<const Design> designs, EvaluationPath path,
                             const RunContext& context)
    : HandleEvaluation(system, designs, path, context), system_(*system) {
  solve(context);
  judge();
}

RbfEvaluation::RbfEvaluation(std::shared_ptr<const RbfSystem> system, const std::vector<Affine>& derivatives,
                             const RunContext& context)
    : HandleEvaluation(system, derivatives), system_(*system) {
  solve(context);
}

void RbfEvaluation::solve(const RunContext& context) {
  if (direct_designs() == 0) return;
  solutions_.resize(system_.parts_.size());
  if (!to_tolerance(system_.info_.solver)) return solve_exactly(context);
  kind_ == MotionKind::position ? solve_to_tolerance(context) : solve_derivative(context);
}

/// Displacements of the centres: rows of the part x its components.
Eigen::MatrixXd RbfEvaluation::part_data(const BoundDesign& design, const RbfPart& part) const {
  const auto& ids = system_.centres_.ids;
  const auto& components = part.plan.components;
  Eigen::MatrixXd F(ids.size(), components.size());
  for (std::size_t j = 0; j < ids.size(); ++j) {
    const Vec3 u = part.plan.taken(prescribed_displacement(design, ids[j]));
    for (std::size_t c = 0; c < components.size(); ++c) {
      F(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(c)) = u[components[c]];
    }
  }
  return part.plan.data(F);
}

/// One design after the other: each uses all cores, and its search directions take memory.
void RbfEvaluation::solve_to_tolerance(const RunContext& context) {
  const std::vector<Vec3> points = system_.coordinates(system_.following());
  for (Solution& solution : solutions_) {
    solution.values.resize(designs_.size());
    solution.solved.resize(designs_.size());
  }
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    if (!is_direct(i)) continue;
    double squares = 0, more_squares = 0;
    Eigen::MatrixXd errors = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(system_.checked_.size()), 3);
    for (std::size_t p = 0; p < solutions_.size(); ++p) {
      const RbfPart& part = system_.parts_[p];
      const Eigen::MatrixXd F = part_data(designs_[i], part);
      const bool iterative = part.system->solver() == Solver::iterative;
      // The iterative solver's is of single components, that of incremental QR of rows.
      const double allowed = iterative ? allowed_error(i) / std::sqrt(3.0) : allowed_error(i);
      CheckedValues solved = values_to_tolerance(*part.system, *part.check, system_.checked_, F, allowed, points, context);
      const double width = iterative ? static_cast<double>(F.cols()) : 1.0;
      squares += width * solved.residual * solved.residual;
      more_squares += solved.more.squaredNorm();
      for (std::size_t c = 0; c < part.plan.components.size(); ++c) {
        errors.col(static_cast<Eigen::Index>(part.plan.components[c])) += solved.errors.col(static_cast<Eigen::Index>(c));
      }
      if (!iterative) reports_[i].converged = reports_[i].converged && solved.converged;
      solutions_[p].values[i] = std::move(solved.values);
      solutions_[p].solved[i] = std::move(solved.from);
    }
    reports_[i].interpolation_residual = std::sqrt(squares);
    set_error(i, error_margin * largest_magnitude(errors.rowwise().norm()) + std::sqrt(more_squares));
  }
}

/// With all digits that there are: gradients are compared with differences and with each other.
void RbfEvaluation::solve_derivative(const RunContext& context) {
  const std::vector<Vec3> points = system_.coordinates(system_.following());
  for (std::size_t p = 0; p < solutions_.size(); ++p) {
    const RbfPart& part = system_.parts_[p];
    const Eigen::MatrixXd F = part_data(designs_[0], part);
    const bool iterative = part.system->solver() == Solver::iterative;
    const double tolerance = iterative ? derivative_tolerance * F.cwiseAbs().maxCoeff() : 0.0;
    solutions_[p].values = {
        values_to_tolerance(*part.system, *part.check, system_.checked_, F, tolerance, points, context).values};
  }
}

void RbfEvaluation::solve_exactly(const RunContext& context) {
  for (std::size_t p = 0; p < solutions_.size(); ++p) {
    const RbfPart& part = system_.parts_[p];
    const std::size_t rows = part.system->size() + part.system->polynomials().terms();
    const std::size_t width = part.plan.components.size();
    std::vector<double>& coefficients = solutions_[p].coefficients;
    coefficients.resize(rows * direct_designs() * width);
    for_each_direct(context, [&](std::size_t i) {
      const Interpolants interpolants = part.system->interpolate(part_data(designs_[i], part), 0, context);
      const Eigen::MatrixXd& solution = interpolants.coefficients;
      if (kind_ == MotionKind::position) set_error(i, std::hypot(reports_[i].error, part_error(i, part, interpolants, context)));
      for (std::size_t r = 0; r < rows; ++r) {
        for (std::size_t c = 0; c < width; ++c) {
          coefficients[(r * direct_designs() + slot(i)) * width + c] =
              solution(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c));
        }
      }
    });
  }
  measure_residuals();
}

/// The error of the displacement components of a part.
double RbfEvaluation::part_error(std::size_t design, const RbfPart& part, const Interpolants& interpolants,
                                 const RunContext& context) {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  DesignReport& report = reports_[design];
  report.converged = report.converged && interpolants.converged;
  const std::vector<Vec3>& places = system_.checked_places_;
  if (places.empty()) return 0;
  const RowMajor coefficients = interpolants.coefficients;
  const auto columns = static_cast<std::size_t>(coefficients.cols());
  const TiledPoints tiled(places);
  Eigen::MatrixXd delivered(static_cast<Eigen::Index>(places.size()), coefficients.cols());
  std::vector<double> values(columns * tile_size);
  for (std::size_t s = 0; s < places.size(); ++s) {
    if (s % tile_size == 0) {
      std::fill(values.begin(), values.end(), 0.0);
      interpolate_tile(*part.system, tiled.tile(s / tile_size), coefficients.data(), columns, values.data());
    }
    for (std::size_t c = 0; c < columns; ++c) {
      delivered(static_cast<Eigen::Index>(s), static_cast<Eigen::Index>(c)) = values[c * tile_size + s % tile_size];
    }
  }
  const Eigen::MatrixXd errors = value_errors(*part.system, interpolants, places, delivered, context);
  return error_margin * errors.rowwise().norm().maxCoeff();
}

void RbfEvaluation::measure_residuals() {
  const auto& ids = system_.centres_.ids;
  const std::size_t count = std::min(most_checked_centres, ids.size()), designs = direct_designs();
  std::vector<PointId> samples(count);
  for (std::size_t s = 0; s < count; ++s) samples[s] = ids[s * ids.size() / count];
  const TiledPoints tiled(system_.coordinates(samples));
  std::vector<double> part_values(3 * designs * tile_size), values(3 * designs * tile_size, 0.0);  // [design][component][16]
  for (std::size_t t = 0; t < tiled.tiles(); ++t) {
    std::fill(values.begin(), values.end(), 0.0);
    for (std::size_t p = 0; p < solutions_.size(); ++p) {
      const auto& components = system_.parts_[p].plan.components;
      interpolate_tile(*system_.parts_[p].system, tiled.tile(t), solutions_[p].coefficients.data(), components.size() * designs,
                       part_values.data());
      add_components(components, designs, part_values.data(), values.data());
    }
    for (std::size_t s = t * tile_size; s < std::min((t + 1) * tile_size, count); ++s) {
      for (std::size_t i = 0; i < designs_.size(); ++i) {
        if (!is_direct(i)) continue;
        Vec3 error = prescribed_displacement(designs_[i], samples[s]);
        for (std::size_t k = 0; k < 3; ++k) error[k] -= values[(3 * slot(i) + k) * tile_size + s % tile_size];
        error = system_.components(error, samples[s]);
        double& residual = reports_[i].interpolation_residual;
        residual = std::max(residual, norm(error));
      }
    }
  }
}

/// Values of one part: [design][component of the part][16].
void RbfEvaluation::part_tile(std::size_t p, std::size_t tile, std::size_t first, std::size_t count, double* values) const {
  const RbfPart& part = system_.parts_[p];
  const Solution& solution = solutions_[p];
  const std::size_t width = part.plan.components.size(), columns = width * count;
  std::fill_n(values, columns * tile_size, 0.0);
  if (solution.values.empty()) {
    interpolate_tile_columns(*part.system, system_.deformable_.tile(tile), solution.coefficients.data() + width * slot(first),
                             width * direct_designs(), columns, values);
    return;
  }
  const std::size_t end = std::min((tile + 1) * tile_size, system_.following().size());
  for (std::size_t s = tile * tile_size; s < end; ++s) {
    for (std::size_t c = 0; c < columns; ++c) {
      values[c * tile_size + s % tile_size] = solution.values[first + c / width][width * s + c % width];
    }
  }
}

std::vector<double> RbfEvaluation::part_values(std::size_t p, std::span<const Vec3> places, double& sums_error,
                                               const RunContext& context) const {
  const RbfPart& part = system_.parts_[p];
  const Solution& solution = solutions_[p];
  if (!solution.values.empty()) return values_elsewhere(*part.system, solution.solved[0], places, sums_error, context);
  const std::size_t width = part.plan.components.size(), columns = width * direct_designs();
  std::vector<double> values(places.size() * width);
  const TiledPoints tiled(places);
  parallel_for(context, tiled.tiles(), tiles_per_check, [&](std::size_t begin, std::size_t end) {
    double tile[3 * tile_size];
    for (std::size_t t = begin; t < end; ++t) {
      std::fill_n(tile, width * tile_size, 0.0);
      interpolate_tile_columns(*part.system, tiled.tile(t), solution.coefficients.data(), columns, width, tile);
      for (std::size_t i = t * tile_size; i < std::min((t + 1) * tile_size, places.size()); ++i) {
        for (std::size_t c = 0; c < width; ++c) values[i * width + c] = tile[c * tile_size + i % tile_size];
      }
    }
  });
  return values;
}

SpaceMap::Found RbfEvaluation::displacements_at(std::span<const Vec3> points, std::uint64_t, std::span<Vec3> out,
                                                const RunContext& context) const {
  std::vector<Vec3> places;
  places.reserve(points.size());
  for (const Vec3& x : points) places.push_back(system_.coordinates(x));
  std::fill(out.begin(), out.end(), Vec3{});
  double squares = 0;
  for (std::size_t p = 0; p < system_.parts_.size(); ++p) {
    const auto& components = system_.parts_[p].plan.components;
    double error = 0;  // of a component
    const std::vector<double> values = part_values(p, places, error, context);
    for (std::size_t i = 0; i < out.size(); ++i) {
      for (std::size_t c = 0; c < components.size(); ++c) out[i][components[c]] += values[i * components.size() + c];
    }
    squares += static_cast<double>(components.size()) * error * error;
  }
  return {0, std::sqrt(squares)};
}

/// The places of partners are those of the first: the displacements of the second are turned from there. On the axis nothing
/// moves across it.
void RbfEvaluation::turn_partners(std::size_t tile, std::size_t count, double* values) const {
  const Symmetry& symmetry = system_.regions_.symmetry;
  const auto& ids = system_.following();
  for (std::size_t s = tile * tile_size; symmetry.is_sector() && s < std::min((tile + 1) * tile_size, ids.size()); ++s) {
    const bool on_axis = symmetry.sector().on_axis(ids[s]);
    if (!on_axis && !symmetry.sector().is_second(ids[s])) continue;
    for (std::size_t d = 0; d < count; ++d) {
      double* const at = values + 3 * d * tile_size + s % tile_size;
      const Vec3 u = symmetry.sector().turned({at[0], at[tile_size], at[2 * tile_size]}, 1);
      at[tile_size] = on_axis ? 0 : u[1];
      at[2 * tile_size] = on_axis ? 0 : u[2];
    }
  }
}

void RbfEvaluation::direct_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const {
  if (system_.regions_.symmetry.empty()) return part_tile(0, tile, first, count, values);
  std::fill_n(values, 3 * count * tile_size, 0.0);
  std::vector<double> part_values(3 * count * tile_size);
  for (std::size_t p = 0; p < system_.parts_.size(); ++p) {
    part_tile(p, tile, first, count, part_values.data());
    add_components(system_.parts_[p].plan.components, count, part_values.data(), values);
  }
  turn_partners(tile, count, values);
}

}  // namespace deform
