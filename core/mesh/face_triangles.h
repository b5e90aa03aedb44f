// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/mesh/mesh.h"

namespace deform {

/// Calls use(a, b, c) with the corners of each triangle of the faces, which are fans around their first corner. `points`: one per
/// point of the mesh. Faces with fewer than three corners have none.
template <typename Use>
void for_each_triangle(const Mesh& mesh, std::span<const Vec3> points, const Use& use) {
  std::size_t at = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    const PointId* const corners = mesh.face_points.data() + at;
    for (std::size_t i = 2; i < size; ++i) use(points[corners[0]], points[corners[i - 1]], points[corners[i]]);
    at += size;
  }
}

}  // namespace deform
