#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/deformers/handles/field_tiles.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/numerics/interpolation/interpolator.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

/// The handle basis of thesis 4.2 (eq. 4.1): d x 4H, the values at the d deformable points of the interpolants of the handles'
/// fields. Immutable.
class HandleBasis : public FieldTiles {
 public:
  /// fields: m x 4H values at the centres. `tolerance` is for the solvers that have one. Progress "basis".
  HandleBasis(const Interpolator& system, const Eigen::MatrixXd& fields, const TiledPoints& deformable, double tolerance,
              const RunContext& context);

  std::size_t bytes() const { return FieldTiles::bytes() + residuals_.size() * sizeof(double); }
  static std::size_t bytes_for(std::size_t points, std::size_t fields) {
    return FieldTiles::bytes_for(points, fields) + fields * sizeof(double);
  }

  /// Per field: largest |interpolant - prescribed value| over the centres.
  const std::vector<double>& residuals() const { return residuals_; }

  /// False when a solution stopped above the tolerance.
  bool converged() const { return converged_; }

 private:
  void fill(const Interpolator& system, const Eigen::MatrixXd& fields, const TiledPoints& deformable, const RunContext& context);
  void fill_to_tolerance(const Interpolator& system, const Eigen::MatrixXd& fields, const TiledPoints& deformable,
                         double tolerance, const RunContext& context);

  std::vector<double> residuals_;
  bool converged_ = true;
};

/// Adds the values of interpolants at one tile of points: out[c][16] += kernel sums plus polynomials. coefficients (m + q) rows
/// of row stride ld, of which `columns` columns count.
void interpolate_tile_columns(const Interpolator& system, const double* tile, const double* coefficients, std::size_t ld,
                              std::size_t columns, double* out);
/// The same for all columns, into zeroed memory.
void interpolate_tile(const Interpolator& system, const double* tile, const double* coefficients, std::size_t columns,
                      double* out);

/// Whether a basis of so many bytes is stored beside a factor of so many.
bool wants_basis(BasisMode mode, std::size_t basis_bytes, std::size_t factor_bytes);

}  // namespace deform
