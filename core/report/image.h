// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// Pixels row by row from the top, red, green, blue and opacity of each.
struct Image {
  std::size_t width = 0, height = 0;
  std::vector<std::uint8_t> pixels;  ///< 4 width height
};

/// The bytes of a PNG file (RFC 2083). The same for the same image and version of zlib.
std::string png_bytes(const Image& image);

/// A parallel projection: x to the right and y up in the picture, the third axis towards the viewer.
struct View {
  std::array<Vec3, 3> axes{};  ///< orthonormal
  Vec3 centre{};               ///< in the middle of the picture
  double width = 1;            ///< of the visible part, model units
};

/// The direction in which pages first show a mesh, z up; of points that all have the same z from above. The points fit into the
/// picture with a margin. Throws Error(invalid_argument) without points.
View view_of(std::span<const Vec3> points, double width_over_height);

/// What is drawn.
struct ImageSource {
  std::span<const Vec3> points;          ///< n
  std::span<const std::uint32_t> sizes;  ///< f, corners of every face
  std::span<const PointId> corners;      ///< sum of sizes
  /// n: a place on the scale of colours, 0..1, of every point; what is beyond has the colour of the end, not a number is grey. A
  /// face has the mean of its corners.
  std::span<const double> values;
  std::span<const char> hidden = {};  ///< f marks, or none: faces that are left out
  std::span<const char> marked = {};  ///< f marks, or none: faces in the colour of errors
};

/// Draws faces, lit from the viewer, the nearest in front; polygons as fans around the mean of their corners.
/// Faces with a corner that is not finite are left out. Deterministic. Throws Error(invalid_argument) when sizes do not fit.
Image draw(const ImageSource& source, const View& view, std::size_t width, std::size_t height);

/// The colours of the scale from 0 to 1 as a gradient of CSS.
std::string scale_gradient();

}  // namespace deform
