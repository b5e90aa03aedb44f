// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/rbf/interpolated_basis.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/deformers/handles/interpolant_tiles.h"

namespace deform {

namespace {

constexpr std::size_t tiles_per_task = 64;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Largest difference between the interpolants and their data over the centres, per column.
std::vector<double> centre_residuals(const Interpolator& system, const RowMajor& coefficients, const Eigen::MatrixXd& data,
                                     const RunContext& context) {
  const TiledPoints tiled(system.centres());
  const auto columns = static_cast<std::size_t>(data.cols());
  std::vector<double> per_tile(tiled.tiles() * columns);
  parallel_for(context, tiled.tiles(), 8, [&](std::size_t begin, std::size_t end) {
    std::vector<double> values(columns * tile_size);
    for (std::size_t t = begin; t < end; ++t) {
      interpolate_tile(system, tiled.tile(t), coefficients.data(), columns, values.data());
      for (std::size_t c = 0; c < columns; ++c) {
        double largest = 0;
        for (std::size_t i = t * tile_size; i < std::min((t + 1) * tile_size, tiled.count()); ++i) {
          const double target = data(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(c));
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

/// A handle at a time: its four fields share the sums, and a solution takes memory per field.
void fill_to_tolerance(const Interpolator& system, const Eigen::MatrixXd& fields, const TiledPoints& deformable, double tolerance,
                       const RunContext& context, HandleBasis& basis) {
  constexpr std::size_t together = 4;
  const std::size_t points = deformable.count(), count = basis.tiles.fields();
  std::vector<Vec3> places(points);
  for (std::size_t i = 0; i < points; ++i) {
    const double* x = deformable.tile(i / tile_size) + i % tile_size;
    places[i] = {x[0], x[tile_size], x[2 * tile_size]};
  }
  for (std::size_t first = 0; first < count; first += together) {
    const std::size_t width = std::min(together, count - first);
    const Interpolants interpolants = system.interpolate(
        fields.middleCols(static_cast<Eigen::Index>(first), static_cast<Eigen::Index>(width)), tolerance, context);
    basis.converged = basis.converged && interpolants.converged;
    basis.residuals.insert(basis.residuals.end(), width, interpolants.residual);
    const std::vector<double> values = system.values(interpolants, places, context);
    for (std::size_t i = 0; i < points; ++i) {
      for (std::size_t f = 0; f < width; ++f) basis.tiles.at(i, first + f) = values[i * width + f];
    }
    context.progress("basis", static_cast<double>(first + width) / static_cast<double>(count));
  }
}

void fill(const Interpolator& system, const Eigen::MatrixXd& fields, const TiledPoints& deformable, const RunContext& context,
          HandleBasis& basis) {
  const RowMajor coefficients = system.interpolate(fields, 0, context).coefficients;
  basis.residuals = centre_residuals(system, coefficients, fields, context);
  parallel_for(context, deformable.tiles(), tiles_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      if (t % 8 == 0) context.check();
      interpolate_tile(system, deformable.tile(t), coefficients.data(), basis.tiles.fields(), basis.tiles.tile(t));
    }
    context.progress("basis", static_cast<double>(end) / static_cast<double>(deformable.tiles()));
  });
}

}  // namespace

HandleBasis interpolated_basis(const std::vector<std::size_t>& components, const Interpolator& system,
                               const Eigen::MatrixXd& fields, const TiledPoints& deformable, double tolerance,
                               const RunContext& context) {
  HandleBasis basis{components, FieldTiles(deformable.count(), static_cast<std::size_t>(fields.cols())), {}};
  if (to_tolerance(system.solver())) {
    fill_to_tolerance(system, fields, deformable, tolerance, context, basis);
  } else {
    fill(system, fields, deformable, context, basis);
  }
  return basis;
}

}  // namespace deform
