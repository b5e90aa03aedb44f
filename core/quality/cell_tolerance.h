// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/base/types.h"
#include "core/mesh/cells.h"

namespace deform::quality {

/// Bounds of the motions that do not invert a cell. The cell moves from its rest shape to B (x + q) up to a translation, where
/// the matrix B has the condition number chi (largest over smallest singular value) and |q| <= r at every node. If chi <=
/// condition and r <= radius hold on the whole path, the cell is not inverted on it, whatever the rounding and tolerances, and
/// its normalized determinant is at least
///   (determinant - min(loss max(x, r / radius), warp_loss + (loss - warp_loss) r / radius)) / chi^p,
/// with x = (chi - 1) / (condition - 1) and p = MovingCells::distortion(). Lengths are in the units of the coordinates.
struct CellTolerance {
  double radius = -1;      ///< negative if there is no bound for this cell
  double condition = 1;    ///< > 1 if radius >= 0
  double determinant = 0;  ///< smallest normalized determinant at rest
  double loss = 0;         ///< with r = radius and chi = condition
  double warp_loss = 0;    ///< with r = 0 and chi = condition, <= loss
};

/// A face of a polyhedral cell. The sign is -1 if its normal points into the cell.
struct SignedFace {
  std::span<const PointId> corners;
  double sign = 1;
};

/// The tolerance of a polyhedral cell, for the inversions of MovingCells; `determinant` is the one at rest. Uses first-order
/// bounds of area vectors, face centres (including the weights of their triangles) and the centre of the cell. There is no
/// bound for cells with a volume or pyramid below 1e-4 of their size, edges below 1e-11 of their size, or faces with fewer than
/// three corners.
CellTolerance polyhedron_tolerance(std::span<const Vec3> rest, std::span<const SignedFace> faces, double determinant);

}  // namespace deform::quality
