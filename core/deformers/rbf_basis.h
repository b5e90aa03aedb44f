#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/interpolation_system.h"
#include "core/numerics/tiles.h"

namespace deform {

/// Coordinates of the unit box: x = origin + scale * unit.
struct UnitBox {
  Vec3 origin{};
  double scale = 1;
  Vec3 to_unit(const Vec3& x) const {
    return {(x[0] - origin[0]) / scale, (x[1] - origin[1]) / scale, (x[2] - origin[2]) / scale};
  }
};

/// What moves with a handle: the fields 1, x, y, z of its points, in unit coordinates relative to a point of reference
/// (thesis 4.2).
struct HandleFrame {
  Vec3 reference{};  ///< unit coordinates
};

/// Displacement field of an affine motion on a handle as the coefficients of its four fields, 4 x 3 row by row, model units.
/// `motion` maps positions to positions (displacement = motion(x) - x) or, with derivative, positions to displacements.
enum class MotionKind { position, derivative };
void field_coefficients(const Affine& motion, MotionKind kind, const HandleFrame& frame, const UnitBox& box, double* out);

/// The handle basis of thesis 4.2 (eq. 4.1): d x 4H, the values at the d deformable points of the interpolants of the handles'
/// fields. Stored in tiles of 16 points, field after field in a tile, so that one design is one pass through memory in order.
/// Immutable.
class HandleBasis {
 public:
  /// fields: m x 4H values at the centres. `tolerance` is for the solvers that have one. Progress "basis".
  HandleBasis(const InterpolationSystem& system, const Eigen::MatrixXd& fields, const TiledPoints& deformable, double tolerance,
              const RunContext& context);

  std::size_t fields() const { return fields_; }
  std::size_t bytes() const { return (values_.size() + residuals_.size()) * sizeof(double); }
  static std::size_t bytes_for(std::size_t points, std::size_t fields) {
    return (tile_count(points) * tile_size + 1) * fields * sizeof(double);
  }

  const double* tile(std::size_t t) const { return values_.data() + t * fields_ * tile_size; }

  /// Per field: largest |interpolant - prescribed value| over the centres.
  const std::vector<double>& residuals() const { return residuals_; }

  /// False when a solution stopped above the tolerance.
  bool converged() const { return converged_; }

  /// basis^T times X (d x 3): 4H x 3, row by row. Summed in a fixed order.
  std::vector<double> transposed_product(std::span<const Vec3> X, const RunContext& context) const;

 private:
  void fill(const InterpolationSystem& system, const Eigen::MatrixXd& fields, const TiledPoints& deformable,
            const RunContext& context);
  void fill_to_tolerance(const InterpolationSystem& system, const Eigen::MatrixXd& fields, const TiledPoints& deformable,
                         double tolerance, const RunContext& context);

  std::size_t fields_;
  std::size_t points_;
  std::vector<double> values_;
  std::vector<double> residuals_;
  bool converged_ = true;
};

/// Adds the values of interpolants at one tile of points: out[c][16] += kernel sums plus polynomials. coefficients (m + q) rows
/// of row stride ld, of which `columns` columns count.
void interpolate_tile_columns(const InterpolationSystem& system, const double* tile, const double* coefficients, std::size_t ld,
                              std::size_t columns, double* out);
/// The same for all columns, into zeroed memory.
void interpolate_tile(const InterpolationSystem& system, const double* tile, const double* coefficients, std::size_t columns,
                      double* out);

}  // namespace deform
