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

/// Numbers by which a picture of a surface may be coloured.
struct PictureField {
  enum class Of { faces, points };
  std::string label;
  Of of = Of::points;
  std::vector<double> values;  ///< f or n; not a number: drawn grey
  Better better = Better::neither;
};

/// What is drawn: a surface, where its points were before, fields.
struct PictureSource {
  const Mesh& mesh;
  std::span<const Vec3> before;  ///< n, or none
  std::vector<PictureField> fields;
  std::span<const FaceId> shown{};  ///< only parts with these faces are shown at first; none: all
  std::size_t most_triangles = 300'000;
};

/// Triangles to draw: polygons as fans around the mean of their corners. Floats are offsets from `centre` over `scale`.
struct Picture {
  struct Field {
    std::string label;
    PictureField::Of of = PictureField::Of::points;
    Better better = Better::neither;
    std::vector<float> values;  ///< per triangle or per point
    double low = 0, high = 0;   ///< range of colours: least and largest, of points without the largest hundredth
    bool clipped = false;       ///< whether there are values above `high`
  };
  Vec3 centre{};
  double scale = 1;
  std::vector<float> points, before;   ///< 3 per point; before: as many or none
  std::vector<std::uint32_t> corners;  ///< 3 per triangle
  /// Per triangle, bit k: the edge opposite to corner k is one of the mesh.
  std::vector<std::uint8_t> edges;
  /// A part is the faces of which it is the first group; the last one may be that of the faces in no group, with an empty name.
  struct Part {
    std::string name;
    bool shown = true;
  };
  std::vector<Part> parts;          ///< those that are drawn, in the order of the groups; at most 65535
  std::vector<std::uint16_t> part;  ///< per triangle
  std::vector<Field> fields;
  std::size_t all_triangles = 0;  ///< of the whole surface
  std::size_t grid = 0;           ///< > 0: points were merged to a grid of so many cells along the box to get below the limit

  std::size_t triangles() const { return edges.size(); }
};

/// Too many triangles are thinned: points that share a cell of a grid become one (the first of them), triangles that collapse or
/// come twice are left out; the finest grid is taken that gets below the limit, out of a sequence that halves. Faces of fewer
/// than three corners are not drawn. Deterministic. Throws Error(invalid_argument) when sizes do not fit, cancelled,
/// deadline_exceeded.
Picture make_picture(const PictureSource& source, const RunContext& context = {});

}  // namespace deform
