// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <variant>

#include "core/base/types.h"
#include "core/measures/faces.h"
#include "core/measures/measure.h"
#include "core/mesh/mesh.h"

namespace deform::measures {

/// What a body must keep out of: an axis-aligned box, or the inside of a closed mesh. It does not move with the design.
using KeepOut = std::variant<Box, Mesh>;

/// The least signed distance of the points of faces to a keep-out, as SmoothLeast: one value, model units, negative where a point
/// is inside. Measurement::least has the true minimum over the points. Faces may come nearer between their points, by at most
/// Least::covering of the design (the longest edge of their triangles over the root of 3; Jung 1901). The distance to a mesh is
/// that to its nearest triangle, with the sign of its generalized winding number (Jacobson, Kavan, Sorkine-Hornung 2013).
///
/// tolerance: of the aggregation, model units; 0: 1e-3 of the diagonal of the mesh. Throws as chosen_triangles(),
/// Error(invalid_argument) naming `tolerance`, and `keep_out` for a box whose min is above its max and a mesh that is not closed.
std::unique_ptr<const Measure> make_clearance(const Mesh& mesh, const FaceChoice& choice, const KeepOut& keep_out,
                                              double tolerance);

}  // namespace deform::measures
