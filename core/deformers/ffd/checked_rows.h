// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/deformers/mirrored_mesh.h"
#include "core/numerics/sparse/function_rows.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// The displacements that are delivered at some points, as sums of functions times displacements of control points. For a model
/// that is one of several images they are means of those at the images, mirrored or turned back (MirroredSystem). What rounding
/// adds along functions that are odd where the model is even, or the reverse, is not in them, so that errors of the functions'
/// sums do not tell those of the means.
struct CheckedRows {
  /// In a frame a component of a displacement is a sum over so many of these: of rows of a kind, times a component of the
  /// displacements of the control points.
  struct Term {
    std::size_t kind = 0, component = 0;
  };
  std::size_t points = 0;
  std::vector<SparseRows> kinds;  ///< points x functions, at most three
  std::array<Vec3, 3> axes{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  std::array<std::vector<Term>, 3> terms;  ///< of each component; of either sign
};

/// `points` are those of the model, which is image 0 of `images`; null: there is no other image. `rows` has all images.
CheckedRows checked_rows(const FunctionRows& rows, std::span<const PointId> points, const MirroredMesh* images);

}  // namespace deform
