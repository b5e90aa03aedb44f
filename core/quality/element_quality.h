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

/// Measures of finite elements.
///
/// Scaled Jacobian of a linear element: the least, over the corners, of the determinant of the three edges over the product of
/// their lengths (Knupp 2000). 1 for cubes, 1 / sqrt(2) for the regular tetrahedron; Verdict multiplies that of tetrahedra by
/// sqrt(2). Of a pyramid only the corners of the base count.
/// Of a quadratic element: the same of the Jacobian of its quadratic map (QuadraticMap) at all its nodes: the determinant of the
/// derivatives along the three edges of a corner over the product of their lengths; at corners along their own edges, at other
/// nodes, and in the limit along the axis at a pyramid's apex, the least over the edges of every corner (but an apex). An affine
/// element has that of its linear part.
///
/// Volume, signed: of linear elements with faces of four corners as fans around their mean; of quadratic ones the integral of the
/// determinant by Gauss quadrature that is exact. With straight edges both are the same.
///
/// Length of an edge: of quadratic elements over its mid node.
///
/// Aspect ratio: longest edge over smallest height, infinite where the volume is not positive. The height over a face is its true
/// height in the reference element, k volume / area with k = 3 for tetrahedra and the base of a pyramid, 3/2 for its sides, 2 for
/// the quads of a prism, 1 for its triangles and for hexahedra; areas are those of the faces' vector areas. 1 for cubes,
/// sqrt(3/2) for the regular tetrahedron.
struct ElementMeasures {
  std::size_t elements = 0;
  Extreme least_scaled_jacobian;
  double average_scaled_jacobian = 0;
  Extreme least_volume, largest_volume;
  double total_volume = 0;
  Extreme least_edge_ratio, largest_edge_ratio;  ///< longest over shortest edge of an element
  Extreme largest_aspect_ratio;
  std::size_t inverted_elements = 0;  ///< as InversionCheck has it: the determinant is not positive at a corner or a node
};

struct ElementQuality : ElementMeasures {
  static constexpr std::size_t bins = 20;

  std::size_t points = 0;
  std::size_t left_handed = 0;                         ///< elements
  std::array<ElementMeasures, element_types> of_type;  ///< by ElementType
  std::array<std::size_t, bins> histogram{};           ///< of the scaled Jacobian, from -1 to 1
  std::vector<std::size_t> worst;               ///< ids of the elements with the least scaled Jacobian, worst first, at most 100
  std::vector<double> scaled_jacobian, volume;  ///< of every element
};

/// points: n x 3. Parallel; the result does not depend on the number of threads. Throws Error(invalid_argument) when elements
/// name points beyond n or there is none, cancelled, deadline_exceeded.
ElementQuality element_quality(std::span<const Vec3> points, const Elements& elements, const RunContext& context = {});

/// The same where elements are left-handed, as left_handed_cells() has them (one entry each, or none at all): their determinants
/// and volumes have the other sign, as those of their mirror images.
ElementQuality element_quality(std::span<const Vec3> points, const Elements& elements, std::vector<char> left_handed,
                               const RunContext& context = {});

}  // namespace deform
