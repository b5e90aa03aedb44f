// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/quality/report.h"

namespace deform {

/// Values by which a picture of a surface can be coloured.
struct PictureField {
  enum class Of { faces, points };
  std::string label;
  Of of = Of::points;
  std::vector<double> values;  ///< f or n values; NaN is drawn grey
  Better better = Better::neither;
};

/// The input of a picture: a surface, its points before the deformation, and fields.
struct PictureSource {
  const Mesh& mesh;
  std::span<const Vec3> before;  ///< n, or empty
  std::vector<PictureField> fields;
  std::span<const FaceId> shown{};  ///< initially only parts with these faces are shown; all if empty
  std::size_t most_triangles = 300'000;
};

/// The triangles to draw; polygons are fans around the mean of their corners. Floats are offsets from `centre` divided
/// by `scale`.
struct Picture {
  struct Field {
    std::string label;
    PictureField::Of of = PictureField::Of::points;
    Better better = Better::neither;
    std::vector<float> values;  ///< one for each triangle or point
    double low = 0, high = 0;   ///< range of colours: smallest and largest value, for points without the top 1 %
    bool clipped = false;       ///< whether there are values above `high`
  };
  Vec3 centre{};
  double scale = 1;
  std::vector<float> points, before;   ///< 3 for each point; `before` may be empty
  std::vector<std::uint32_t> corners;  ///< 3 for each triangle
  /// For each triangle, bit k tells whether the edge opposite to corner k is an edge of the mesh.
  std::vector<std::uint8_t> edges;
  /// The faces whose first group this is. The last part may hold the faces without a group; its name is empty.
  struct Part {
    std::string name;
    bool shown = true;
  };
  std::vector<Part> parts;          ///< parts with triangles, in the order of the groups; at most 65535
  std::vector<std::uint16_t> part;  ///< part of each triangle
  std::vector<Field> fields;
  std::size_t all_triangles = 0;  ///< number before thinning
  std::size_t grid = 0;           ///< cells along the box of the grid used for thinning; 0 if all triangles are drawn

  std::size_t triangles() const { return edges.size(); }
};

/// Triangulates the surface. If there are more than most_triangles triangles, points in the same cell of a grid are merged into
/// the first of them, and triangles that collapse or occur twice are left out; the finest grid of a halving sequence that meets
/// the limit is used. Faces with fewer than three corners are not drawn. Deterministic. Throws Error(invalid_argument) if sizes
/// do not match, cancelled, deadline_exceeded.
Picture make_picture(const PictureSource& source, const RunContext& context = {});

}  // namespace deform
