// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/mesh/elements.h"
#include "core/quality/extreme.h"

namespace deform {

/// Quality measures of finite elements.
///
/// Scaled Jacobian of a linear element: the minimum over the corners of the determinant of the three edges, divided by the
/// product of their lengths (Knupp 2000). It is 1 for cubes and 1 / sqrt(2) for the regular tetrahedron; Verdict multiplies the
/// value of tetrahedra by sqrt(2). For a pyramid only the corners of the base count. For a quadratic element the derivatives of
/// its quadratic map (QuadraticMap) along the three edges of a corner take the place of the edges, and the minimum is over all
/// nodes: at corners with their own edges, at other nodes, and at a pyramid's apex in the limit along its axis, with the edges of
/// each corner except an apex. An affine quadratic element has the value of its linear part.
///
/// Volume: signed. Faces of linear elements with four corners are fans around their mean. For quadratic elements it is the
/// integral of the determinant by an exact Gauss quadrature. Both agree for straight edges.
///
/// Length of an edge: in quadratic elements that of the polyline through its mid-edge node.
///
/// Aspect ratio: longest edge over smallest height, infinite if the volume is not positive. The height over a face is k volume /
/// area, with the k of the reference element: 3 for tetrahedra and the base of a pyramid, 3/2 for its sides, 2 for the quads of a
/// prism, 1 for its triangles and for hexahedra. Areas are lengths of vector areas. The ratio is 1 for cubes and sqrt(3/2) for
/// the regular tetrahedron.
struct ElementMeasures {
  std::size_t elements = 0;            ///< number of elements
  Extreme least_scaled_jacobian;       ///< of an element
  double average_scaled_jacobian = 0;  ///< over the elements
  Extreme least_volume;                ///< of an element
  Extreme largest_volume;              ///< of an element
  double total_volume = 0;             ///< of all elements
  Extreme least_edge_ratio;            ///< longest over shortest edge of an element
  Extreme largest_edge_ratio;          ///< the same
  Extreme largest_aspect_ratio;        ///< of an element
  std::size_t inverted_elements = 0;   ///< as in InversionCheck: the determinant is not positive at a corner or node
};

/// The measures of all elements, of those of each type, and the values of each element.
struct ElementQuality : ElementMeasures {
  static constexpr std::size_t bins = 20;  ///< of the histogram

  std::size_t points = 0;                              ///< number of points
  std::size_t left_handed = 0;                         ///< number of left-handed elements
  std::array<ElementMeasures, element_types> of_type;  ///< by ElementType
  std::array<std::size_t, bins> histogram{};           ///< scaled Jacobians from -1 to 1
  std::vector<std::size_t> worst;                      ///< ids of the elements of least scaled Jacobian, worst first, at most 100
  std::vector<double> scaled_jacobian;                 ///< of all elements
  std::vector<double> volume;                          ///< of all elements
};

/// Measures all elements over the points (n x 3), in parallel. The result does not depend on the number of threads. Throws
/// Error(invalid_argument) if there is no element or one refers to a point beyond n, cancelled, deadline_exceeded.
ElementQuality element_quality(std::span<const Vec3> points, const Elements& elements, const RunContext& context = {});

/// The same for a mesh with left-handed elements, as found by left_handed_cells() (one entry for each element, or empty). They
/// are measured as their mirror images, with determinants and volumes of the opposite sign.
ElementQuality element_quality(std::span<const Vec3> points, const Elements& elements, std::vector<char> left_handed,
                               const RunContext& context = {});

}  // namespace deform
