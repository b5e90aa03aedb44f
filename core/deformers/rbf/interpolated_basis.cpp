// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/rbf/interpolated_basis.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/base/parallel.h"
#include "core/deformers/handles/interpolant_tiles.h"
#include "core/numerics/interpolation/value_errors.h"
#include "core/numerics/interpolation/values_to_tolerance.h"

namespace deform {

namespace {

constexpr std::size_t interpolated_tiles_per_task = 64;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Largest difference between the interpolants and their data over the centres, per column.
std::vector<double> centre_residuals(const Interpolator& system, const RowMajor& coefficients, const Eigen::MatrixXd& data,
                                     const RunContext& context) {
  std::vector<std::uint32_t> rows = system.representatives();
  if (rows.empty()) {
    rows.resize(system.size());
    std::iota(rows.begin(), rows.end(), 0u);
  }
  std::vector<Vec3> centres;
  for (const std::uint32_t row : rows) centres.push_back(system.centres()[row]);
  const TiledPoints tiled(centres);
  const auto columns = static_cast<std::size_t>(data.cols());
  std::vector<double> per_tile(tiled.tiles() * columns);
  parallel_for(context, tiled.tiles(), 8, [&](std::size_t begin, std::size_t end) {
    std::vector<double> values(columns * tile_size);
    for (std::size_t t = begin; t < end; ++t) {
      interpolate_tile(system, tiled.tile(t), coefficients.data(), columns, values.data());
      for (std::size_t c = 0; c < columns; ++c) {
        double largest = 0;
        for (std::size_t i = t * tile_size; i < std::min((t + 1) * tile_size, tiled.count()); ++i) {
          const double target = data(static_cast<Eigen::Index>(rows[i]), static_cast<Eigen::Index>(c));
          largest = std::max(largest, std::abs(values[c * tile_size + i % tile_size] - target));
        }
        per_tile[t * columns + c] = largest;
      }
    }
  });
  std::vector<double> largest(columns, 0.0);
  for (std::size_t k = 0; k < per_tile.size(); ++k) largest[k % columns] = std::max(largest[k % columns], per_tile[k]);
  return largest;
}

Vec3 place(const TiledPoints& points, std::size_t i) {
  const double* x = points.tile(i / tile_size) + i % tile_size;
  return {x[0], x[tile_size], x[2 * tile_size]};
}

/// A handle at a time: its four fields share the sums, and a solution takes memory per field.
void fill_to_tolerance(const RbfPart& part, const Eigen::MatrixXd& fields, const TiledPoints& deformable,
                       std::span<const std::uint32_t> checked, double tolerance, const RunContext& context, HandleBasis& basis) {
  constexpr std::size_t together = 4;
  const std::size_t points = deformable.count(), count = basis.tiles.fields();
  std::vector<Vec3> places(points);
  for (std::size_t i = 0; i < points; ++i) {
    places[i] = place(deformable, i);
  }
  // Incremental QR has its own meaning of the tolerance.
  const bool iterative = part.system->solver() == Solver::iterative;
  const double each = iterative ? tolerance / static_cast<double>(count) : tolerance;
  basis.errors.resize(checked.size() * count);
  for (std::size_t first = 0; first < count; first += together) {
    const std::size_t width = std::min(together, count - first);
    const CheckedValues values = values_to_tolerance(
        *part.system, *part.check, checked, fields.middleCols(static_cast<Eigen::Index>(first), static_cast<Eigen::Index>(width)),
        each, places, context);
    basis.converged = basis.converged && (iterative ? values.error <= tolerance : values.converged);
    basis.residuals.insert(basis.residuals.end(), width, values.residual);
    basis.more.insert(basis.more.end(), values.more.begin(), values.more.end());
    for (std::size_t f = 0; f < width; ++f) {
      for (std::size_t i = 0; i < points; ++i) basis.tiles.at(i, first + f) = values.values[i * width + f];
      for (std::size_t s = 0; s < checked.size(); ++s) {
        basis.errors[s * count + first + f] = values.errors(static_cast<Eigen::Index>(s), static_cast<Eigen::Index>(f));
      }
    }
    context.progress("basis", static_cast<double>(first + width) / static_cast<double>(count));
  }
}

/// The errors of the stored values of each field at the samples.
std::vector<double> errors_at(std::span<const std::uint32_t> samples, const Interpolator& system,
                              const Interpolants& interpolants, const TiledPoints& deformable, const FieldTiles& tiles,
                              const RunContext& context) {
  std::vector<Vec3> places;
  Eigen::MatrixXd stored(static_cast<Eigen::Index>(samples.size()), static_cast<Eigen::Index>(tiles.fields()));
  for (std::size_t s = 0; s < samples.size(); ++s) {
    places.push_back(place(deformable, samples[s]));
    for (std::size_t f = 0; f < tiles.fields(); ++f) {
      stored(static_cast<Eigen::Index>(s), static_cast<Eigen::Index>(f)) = tiles.at(samples[s], f);
    }
  }
  std::vector<double> errors(tiles.fields(), 0.0);
  if (samples.empty() || errors.empty()) return errors;
  const Eigen::MatrixXd each = value_errors(system, interpolants, places, stored, context);
  for (std::size_t f = 0; f < errors.size(); ++f) errors[f] = error_margin * each.col(static_cast<Eigen::Index>(f)).maxCoeff();
  return errors;
}

void fill(const Interpolator& system, const Eigen::MatrixXd& fields, const TiledPoints& deformable,
          std::span<const std::uint32_t> samples, const RunContext& context, HandleBasis& basis) {
  const Interpolants interpolants = system.interpolate(fields, 0, context);
  const RowMajor coefficients = interpolants.coefficients;
  basis.converged = interpolants.converged;
  basis.residuals = centre_residuals(system, coefficients, fields, context);
  parallel_for(context, deformable.tiles(), interpolated_tiles_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      if (t % 8 == 0) context.check();
      interpolate_tile(system, deformable.tile(t), coefficients.data(), basis.tiles.fields(), basis.tiles.tile(t));
    }
    context.progress("basis", static_cast<double>(end) / static_cast<double>(deformable.tiles()));
  });
  basis.more = errors_at(samples, system, interpolants, deformable, basis.tiles, context);
}

}  // namespace

HandleBasis interpolated_basis(const RbfPart& part, const Eigen::MatrixXd& fields, const TiledPoints& deformable,
                               std::span<const std::uint32_t> checked, double tolerance, const RunContext& context) {
  HandleBasis basis{part.plan.components, FieldTiles(deformable.count(), static_cast<std::size_t>(fields.cols())), {}};
  if (to_tolerance(part.system->solver())) {
    fill_to_tolerance(part, fields, deformable, checked, tolerance, context, basis);
  } else {
    fill(*part.system, fields, deformable, checked, context, basis);
  }
  return basis;
}

}  // namespace deform
