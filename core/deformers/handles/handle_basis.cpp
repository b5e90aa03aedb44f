#include "core/deformers/handles/handle_basis.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"

namespace deform {

namespace {

constexpr std::size_t tiles_per_task = 64;
constexpr std::size_t basis_always_fits = std::size_t{1} << 30;
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

}  // namespace

void interpolate_tile(const Interpolator& system, const double* tile, const double* coefficients, std::size_t columns,
                      double* out) {
  std::fill_n(out, columns * tile_size, 0.0);
  interpolate_tile_columns(system, tile, coefficients, columns, columns, out);
}

void interpolate_tile_columns(const Interpolator& system, const double* tile, const double* coefficients, std::size_t ld,
                              std::size_t columns, double* out) {
  tile_kernel_sums(system.kernel(), tile, system.centres(), coefficients, ld, columns, out);
  const std::size_t q = system.polynomials().terms();
  if (q == 0) return;
  double terms[10];
  double P[10 * tile_size];
  for (std::size_t i = 0; i < tile_size; ++i) {
    system.polynomials().values({tile[i], tile[tile_size + i], tile[2 * tile_size + i]}, terms);
    for (std::size_t t = 0; t < q; ++t) P[t * tile_size + i] = terms[t];
  }
  tile_product(P, q, coefficients + system.size() * ld, ld, columns, out);
}

HandleBasis::HandleBasis(const Interpolator& system, const Eigen::MatrixXd& fields, const TiledPoints& deformable,
                         double tolerance, const RunContext& context)
    : FieldTiles(deformable.count(), static_cast<std::size_t>(fields.cols())) {
  if (to_tolerance(system.solver())) {
    fill_to_tolerance(system, fields, deformable, tolerance, context);
  } else {
    fill(system, fields, deformable, context);
  }
}

/// A handle at a time: its four fields share the sums, and a solution takes memory per field.
void HandleBasis::fill_to_tolerance(const Interpolator& system, const Eigen::MatrixXd& fields, const TiledPoints& deformable,
                                    double tolerance, const RunContext& context) {
  constexpr std::size_t together = 4;
  std::vector<Vec3> places(points());
  for (std::size_t i = 0; i < points(); ++i) {
    const double* x = deformable.tile(i / tile_size) + i % tile_size;
    places[i] = {x[0], x[tile_size], x[2 * tile_size]};
  }
  for (std::size_t first = 0; first < this->fields(); first += together) {
    const std::size_t width = std::min(together, this->fields() - first);
    const Interpolants interpolants = system.interpolate(
        fields.middleCols(static_cast<Eigen::Index>(first), static_cast<Eigen::Index>(width)), tolerance, context);
    converged_ = converged_ && interpolants.converged;
    residuals_.insert(residuals_.end(), width, interpolants.residual);
    const std::vector<double> values = system.values(interpolants, places, context);
    for (std::size_t i = 0; i < points(); ++i) {
      for (std::size_t f = 0; f < width; ++f) at(i, first + f) = values[i * width + f];
    }
    context.progress("basis", static_cast<double>(first + width) / static_cast<double>(this->fields()));
  }
}

void HandleBasis::fill(const Interpolator& system, const Eigen::MatrixXd& fields, const TiledPoints& deformable,
                       const RunContext& context) {
  const RowMajor coefficients = system.interpolate(fields, 0, context).coefficients;
  residuals_ = centre_residuals(system, coefficients, fields, context);
  parallel_for(context, deformable.tiles(), tiles_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      if (t % 8 == 0) context.check();
      interpolate_tile(system, deformable.tile(t), coefficients.data(), this->fields(), tile(t));
    }
    context.progress("basis", static_cast<double>(end) / static_cast<double>(deformable.tiles()));
  });
}

bool wants_basis(BasisMode mode, std::size_t basis_bytes, std::size_t factor_bytes) {
  if (mode != BasisMode::automatic) return mode == BasisMode::always;
  return basis_bytes <= std::max(4 * factor_bytes, basis_always_fits);
}

}  // namespace deform
