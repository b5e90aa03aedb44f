// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// A surface as polygons.
struct SurfaceFaces {
  std::span<const Vec3> points;          ///< n
  std::span<const std::uint32_t> sizes;  ///< f, corners of every face
  std::span<const PointId> corners;      ///< sum of sizes
};

/// A face and its distance from a place, model units.
struct NearestFace {
  std::size_t face = 0;
  double distance = 0;
};

/// The face nearest to a place, by the distance from the triangles between its corners and their mean; of equally near ones the
/// first. Faces of fewer than three corners have no inside and are left out. f, infinitely far away, when there is none.
NearestFace nearest_face(const SurfaceFaces& surface, const Vec3& place);

/// The faces that a flood from `seeds` reaches, f marks. It crosses an edge when exactly two faces run along it and their normals
/// (vector areas, that of the second turned over where both run along the edge in the same direction) turn by at most `angle`
/// degrees, 0..180. Faces without area have no normal: only seeds among them are marked.
std::vector<char> smooth_patch(const SurfaceFaces& surface, std::span<const std::size_t> seeds, double angle);

}  // namespace deform
