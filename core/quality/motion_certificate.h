// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/quality/moving_cells.h"

namespace deform::quality {

/// Proves for most cells that a motion does not invert them, at much lower cost than finding roots. The tolerance of each cell
/// (CellTolerance) is computed once and compared with the relative motion of its nodes after removing an affine part: first that
/// of a block of neighbouring cells in single precision, then, where that is not conclusive, that of the cell, in the end in
/// double precision. The proofs account for rounding. Immutable; any thread may call. The cells and `rest` must outlive it.
class MotionCertificate {
 public:
  static constexpr std::size_t block_size = 128;  ///< cells

  /// left_out and determinants have one entry for each cell; the determinants are normalized and at rest.
  MotionCertificate(std::span<const Vec3> rest, const MovingCells& cells, std::span<const char> left_out,
                    std::span<const double> determinants, const RunContext& context);

  /// A CellTolerance rounded to the safe side; infinite if there is none.
  struct Tolerance {
    float inverse_radius, inverse_condition;  ///< 1 / radius, 1 / (condition - 1)
    float determinant, loss, warp_loss;
  };

  /// The cells that are not left out, neighbours near each other; blocks are ranges of this order.
  std::span<const std::uint32_t> order() const { return order_; }
  const Tolerance& tolerance(std::size_t place_in_order) const { return in_order_[place_in_order]; }
  std::span<const PointId> nodes(std::size_t cell) const { return nodes_.of(cell); }
  int distortion() const { return distortion_; }

  std::size_t block_count() const { return (order_.size() + block_size - 1) / block_size; }
  /// Appends the cells of a range of blocks for which bounds in single precision do not prove that they are never inverted on the
  /// straight path from rest to `points` and have a normalized determinant above `floor` at its end. Cells left out are not
  /// appended. There must be as many points as at rest, all finite.
  void doubtful(std::span<const Vec3> points, double floor, std::size_t begin_block, std::size_t end_block,
                std::vector<std::uint32_t>& cells) const;

  /// The deformation of a cell from rest: displacements are G x + q up to a translation. On the straight path B = I + s G has
  /// singular values from 1 + min(0, least) to sqrt(1 + 2 max(0, largest) + gradient^2), because |B x| >= x.B x / |x|.
  struct Stretch {
    double least = 0, largest = 0;  ///< eigenvalues of the symmetric part of G
    double gradient = 0;            ///< Frobenius norm of G
    double residual = 0;            ///< largest |q|
    /// The stretch of a matrix G, by rows.
    static Stretch of(const std::array<Vec3, 3>& gradient, double residual);
    /// Bounds of the stretch of all matrices that differ from this one by at most `deviation` (Frobenius norm), without residual.
    /// They cost less and are wider by a few percent.
    static Stretch about(const std::array<Vec3, 3>& gradient, double deviation);
    /// The stretch, or bounds of it, of (1 - share) times one motion plus share times another one.
    static Stretch between(const Stretch& from, const Stretch& to, double share);
  };
  Stretch stretch(std::span<const Vec3> points, std::size_t cell) const;

  struct Bound {
    bool sound = false;
    double determinant = 0;  ///< lower bound of the normalized determinant if sound
  };
  /// The bound on the straight path from rest to a state with this stretch.
  Bound bound(std::size_t cell, const Stretch& stretch) const;

  /// The effect of the affine part of a motion on the bounds.
  struct Affinity {
    double excess;           ///< condition - 1
    double inverse_least;    ///< 1 / smallest singular value; infinite if not known to be positive
    double inverse_falling;  ///< 1 / (condition to the power distortion_)
  };
  Affinity affinity(const Stretch& stretch) const;
  /// The bound for a cell with this tolerance.
  static Bound bound(const Tolerance& tolerance, const Affinity& affinity, double residual);

  /// An upper bound of the memory in bytes. `nodes` is the sum of the numbers of nodes of all cells.
  static std::size_t bytes_for(std::size_t cells, std::size_t nodes);
  /// An upper bound of the peak memory of the construction.
  static std::size_t bytes_to_make(std::size_t cells, std::size_t points, std::size_t nodes);

 private:
  static Tolerance kept(const CellTolerance& found);

  struct Block;
  void order_cells(std::span<const char> left_out, const RunContext& context);
  void list_blocks();
  void take(std::span<const Vec3> points, std::size_t block, Block& work) const;
  bool proven(const Tolerance& tolerance, std::span<const std::uint16_t> nodes, double floor, const Block& block) const;

  std::span<const Vec3> rest_;
  MovingCells::NodeLists nodes_;
  int distortion_;
  std::vector<Tolerance> tolerances_;  ///< one per cell
  std::vector<std::uint32_t> order_;   ///< cells that are not left out, in blocks of block_size
  std::vector<Tolerance> in_order_;
  std::vector<std::uint64_t> block_nodes_begin_{0}, local_begin_{0};  ///< offsets of each block
  std::vector<PointId> block_nodes_;                                  ///< nodes of each block, each once
  std::vector<float> block_places_;       ///< 3 coordinates of each, relative to the first node of the block
  std::vector<std::uint32_t> cell_ends_;  ///< end of each cell in order, relative to local_begin_ of its block
  std::vector<std::uint16_t> local_;      ///< nodes of the cells, as numbers within their block
};

}  // namespace deform::quality
