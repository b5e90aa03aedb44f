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

/// Proves of most cells that a motion does not invert them, for much less than their roots cost: what each cell bears is computed
/// once (CellTolerance) and compared with how its nodes move against each other when the affine part of the motion is taken
/// away. First, in single precision, that of a block of cells which lie together, and where that proves nothing that of the cell;
/// in the end that of the cell in double precision. What is said holds beyond all rounding. Immutable; any thread may call. The
/// cells and `rest` must outlive it.
class MotionCertificate {
 public:
  static constexpr std::size_t block_size = 128;  ///< cells

  /// left_out, determinants: one entry per cell, the latter normalized and at rest.
  MotionCertificate(std::span<const Vec3> rest, const MovingCells& cells, std::span<const char> left_out,
                    std::span<const double> determinants, const RunContext& context);

  std::size_t block_count() const { return (order_.size() + block_size - 1) / block_size; }
  /// Appends the cells of some blocks of which bounds in single precision do not prove that they are sound on the way from rest
  /// to `points`, with a normalized determinant above `floor` at its end. Those left out are not among them. points: as many as
  /// at rest, finite.
  void doubtful(std::span<const Vec3> points, double floor, std::size_t begin_block, std::size_t end_block,
                std::vector<std::uint32_t>& cells) const;

  /// How a cell is moved and deformed from rest to elsewhere: displacements are G x + q up to a translation. Then B = I + s G on
  /// the way has singular values from 1 + min(0, least) to sqrt(1 + 2 max(0, largest) + gradient^2), as |B x| >= x.B x / |x|.
  struct Stretch {
    double least = 0, largest = 0;  ///< eigenvalues of the symmetric part of G
    double gradient = 0;            ///< Frobenius norm of G
    double residual = 0;            ///< largest |q|
    /// Of (1 - share) times one motion and share times another one, or bounds of it.
    static Stretch between(const Stretch& from, const Stretch& to, double share);
  };
  Stretch stretch(std::span<const Vec3> points, std::size_t cell) const;

  struct Bound {
    bool sound = false;
    double determinant = 0;  ///< what the normalized determinant is at least, of sound cells
  };
  /// On the straight way from rest to where the cell is stretched like this.
  Bound bound(std::size_t cell, const Stretch& stretch) const;

  /// Upper bound of what is kept; nodes: of all cells, counted in each.
  static std::size_t bytes_for(std::size_t cells, std::size_t nodes);
  /// The same while it is made.
  static std::size_t bytes_to_make(std::size_t cells, std::size_t points, std::size_t nodes);

 private:
  /// A CellTolerance, rounded to the safe side; infinite: none.
  struct Tolerance {
    float inverse_radius, inverse_condition;  ///< 1 / radius, 1 / (condition - 1)
    float determinant, loss, warp_loss;
  };
  static Tolerance kept(const CellTolerance& found);

  /// What the affine part of a motion does to bounds.
  struct Affinity {
    double excess;           ///< condition - 1
    double inverse_least;    ///< 1 / the least singular value; infinite where it is not known to be positive
    double inverse_falling;  ///< 1 / (condition to the power distortion_)
  };
  Affinity affinity(const Stretch& stretch) const;
  static Bound bound(const Tolerance& tolerance, const Affinity& affinity, double residual);

  struct Block;
  void order_cells(std::span<const char> left_out, const RunContext& context);
  void list_blocks();
  void take(std::span<const Vec3> points, std::size_t block, Block& work) const;
  bool proven(const Tolerance& tolerance, std::span<const std::uint16_t> nodes, double floor, const Block& block) const;

  std::span<const Vec3> rest_;
  MovingCells::NodeLists nodes_;
  int distortion_;
  std::vector<Tolerance> tolerances_;  ///< one per cell
  std::vector<std::uint32_t> order_;   ///< cells that are not left out; each block_size of them are a block
  std::vector<Tolerance> in_order_;
  std::vector<std::uint64_t> block_nodes_begin_{0}, local_begin_{0};  ///< per block
  std::vector<PointId> block_nodes_;                                  ///< each once in its block
  std::vector<float> block_places_;                                   ///< three of each, from the first node of the block
  std::vector<std::uint32_t> cell_ends_;                              ///< per cell in order, from local_begin_ of its block
  std::vector<std::uint16_t> local_;                                  ///< nodes of the cells, as numbers within their block
};

}  // namespace deform::quality
