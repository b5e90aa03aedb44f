// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

#include "core/base/types.h"

namespace deform {

/// The corner of a face, as its index in `corners`, around which a fan of triangles has the highest lowest triangle, the first of
/// equal ones: hanging nodes and mid-edge nodes on a straight side make no triangle without height, and a concave quad is cut
/// inside. A height is one above the longest side, relative to that side, and negative where the triangle faces away from the
/// face. 0 for triangles, for faces without area, and for those with more than 64 corners. points: those of the mesh.
std::size_t fan_apex(std::span<const Vec3> points, std::span<const PointId> corners);

}  // namespace deform
