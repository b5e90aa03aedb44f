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
struct ElementQuality {
  static constexpr std::size_t bins = 20;

  std::size_t points = 0, elements = 0;
  std::array<std::size_t, 4> of_type{};  ///< number of elements by ElementType
  /// Least scaled Jacobian: the least, over the corners, of the determinant of the three edges over the product of their lengths
  /// (Knupp 2000). 1 for cubes, 1 / sqrt(2) for the regular tetrahedron; Verdict multiplies that of tetrahedra by sqrt(2). Of a
  /// pyramid only the corners of the base count.
  Extreme least_scaled_jacobian;
  double average_scaled_jacobian = 0;
  Extreme least_volume, largest_volume;  ///< signed; faces of four corners as fans around their mean
  double total_volume = 0;
  Extreme largest_edge_ratio;                 ///< longest over shortest edge of an element
  std::size_t inverted_elements = 0;          ///< scaled Jacobian <= 0 somewhere
  std::array<std::size_t, bins> histogram{};  ///< of the scaled Jacobian, from -1 to 1
  std::vector<std::size_t> worst;             ///< ids of the elements with the least scaled Jacobian, worst first, at most 100
};

/// points: n x 3. Parallel; the result does not depend on the number of threads. Throws Error(invalid_argument) when elements
/// name points beyond n or there is none, cancelled, deadline_exceeded.
ElementQuality element_quality(std::span<const Vec3> points, const Elements& elements, const RunContext& context = {});

}  // namespace deform
