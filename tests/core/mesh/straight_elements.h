// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <map>

#include "core/mesh/elements.h"

namespace deform {

/// A straight element of every type, edges 2, in the order of CGNS: written down node by node from the pictures there,
/// independently of the shapes.
inline const std::map<ElementType, Points>& straight_elements() {
  static const Points tetrahedron{{0, 0, 0}, {2, 0, 0}, {0, 2, 0}, {0, 0, 2}, {1, 0, 0},
                                  {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}};
  static const Points pyramid{{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}, {0, 0, 2}, {1, 0, 0}, {2, 1, 0},
                              {1, 2, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}, {1, 1, 0}};
  static const Points prism{{0, 0, 0}, {2, 0, 0}, {0, 2, 0}, {0, 0, 2}, {2, 0, 2}, {0, 2, 2}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                            {0, 0, 1}, {2, 0, 1}, {0, 2, 1}, {1, 0, 2}, {1, 1, 2}, {0, 1, 2}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
  static const Points hexahedron{{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}, {0, 0, 2}, {2, 0, 2}, {2, 2, 2},
                                 {0, 2, 2}, {1, 0, 0}, {2, 1, 0}, {1, 2, 0}, {0, 1, 0}, {0, 0, 1}, {2, 0, 1},
                                 {2, 2, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 2}, {1, 2, 2}, {0, 1, 2}, {1, 1, 0},
                                 {1, 0, 1}, {2, 1, 1}, {1, 2, 1}, {0, 1, 1}, {1, 1, 2}, {1, 1, 1}};
  const auto first = [](const Points& points, std::size_t n) {
    return Points(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(n));
  };
  static const std::map<ElementType, Points> all{{ElementType::tetrahedron, first(tetrahedron, 4)},
                                                 {ElementType::tetrahedron10, tetrahedron},
                                                 {ElementType::pyramid, first(pyramid, 5)},
                                                 {ElementType::pyramid13, first(pyramid, 13)},
                                                 {ElementType::pyramid14, pyramid},
                                                 {ElementType::prism, first(prism, 6)},
                                                 {ElementType::prism15, first(prism, 15)},
                                                 {ElementType::prism18, prism},
                                                 {ElementType::hexahedron, first(hexahedron, 8)},
                                                 {ElementType::hexahedron20, first(hexahedron, 20)},
                                                 {ElementType::hexahedron27, hexahedron}};
  return all;
}

}  // namespace deform
