// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/base/types.h"
#include "core/mesh/cells.h"

namespace deform::quality {

/// Motions that leave a cell sound, by bounds that hold for every motion of their kind. From its shape at rest the cell goes to
/// B (x + q) up to a translation, B a matrix of condition (largest over least singular value) chi, |q| at most r at every node.
/// Where on all of the way chi <= condition and r <= radius, the cell is not inverted on it, beyond all rounding and tolerances,
/// and its normalized determinant is at least
///   (determinant - min(loss max(x, r / radius), warp_loss + (loss - warp_loss) r / radius)) / chi^p,
/// x = (chi - 1) / (condition - 1) and p = MovingCells::distortion(). In units of the coordinates.
struct CellTolerance {
  double radius = -1;      ///< negative: of this cell nothing can be said
  double condition = 1;    ///< > 1 where radius >= 0
  double determinant = 0;  ///< normalized, least at rest
  double loss = 0;         ///< with r = radius and chi = condition
  double warp_loss = 0;    ///< with r = 0 and chi = condition, <= loss
};

/// A face of a polyhedral cell and the side of it on which the cell lies: sign -1 where the face's normal points into the cell.
struct SignedFace {
  std::span<const PointId> corners;
  double sign = 1;
};

/// Of a polyhedral cell with the inversions of MovingCells, `determinant` as at rest. First-order bounds of area vectors, face
/// centres (weights of their triangles are bounded, too) and the cell's centre; none for cells whose volume or a pyramid is
/// below 1e-4 of its size, with edges below 1e-11 of the cell, or with faces of less than three corners.
CellTolerance polyhedron_tolerance(std::span<const Vec3> rest, std::span<const SignedFace> faces, double determinant);

}  // namespace deform::quality
