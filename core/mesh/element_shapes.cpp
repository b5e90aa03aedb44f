// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <numeric>

#include "core/mesh/elements.h"

namespace deform {

namespace {

using Edges = std::vector<std::array<std::uint8_t, 2>>;

const ElementShape tetrahedron{"tetrahedron",
                               4,
                               4,
                               {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}},
                               {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}},
                               {{0, 1, 2, 3}, {1, 2, 0, 3}, {2, 0, 1, 3}, {3, 0, 2, 1}},
                               {}};
const ElementShape pyramid{"pyramid",
                           5,
                           5,
                           {{0, 3, 2, 1}, {0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}},
                           {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {0, 4}, {1, 4}, {2, 4}, {3, 4}},
                           {{0, 1, 3, 4}, {1, 2, 0, 4}, {2, 3, 1, 4}, {3, 0, 2, 4}},
                           {}};
const ElementShape prism{"prism",
                         6,
                         6,
                         {{0, 2, 1}, {3, 4, 5}, {0, 1, 4, 3}, {1, 2, 5, 4}, {2, 0, 3, 5}},
                         {{0, 1}, {1, 2}, {2, 0}, {3, 4}, {4, 5}, {5, 3}, {0, 3}, {1, 4}, {2, 5}},
                         {{0, 1, 2, 3}, {1, 2, 0, 4}, {2, 0, 1, 5}, {3, 5, 4, 0}, {4, 3, 5, 1}, {5, 4, 3, 2}},
                         {}};
const ElementShape hexahedron{
    "hexahedron",
    8,
    8,
    {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}},
    {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {4, 5}, {5, 6}, {6, 7}, {7, 4}, {0, 4}, {1, 5}, {2, 6}, {3, 7}},
    {{0, 1, 3, 4}, {1, 2, 0, 5}, {2, 3, 1, 6}, {3, 0, 2, 7}, {4, 7, 5, 0}, {5, 4, 6, 1}, {6, 5, 7, 2}, {7, 6, 4, 3}},
    {}};

/// The order of CGNS, where it is not that of the linear element.
const Edges prism_edges{{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 4}, {2, 5}, {3, 4}, {4, 5}, {5, 3}};
const Edges hexahedron_edges{{0, 1}, {1, 2}, {2, 3}, {3, 0}, {0, 4}, {1, 5}, {2, 6}, {3, 7}, {4, 5}, {5, 6}, {6, 7}, {7, 4}};

/// `faces` of the linear element get mid-face nodes, in this order; `inner` nodes lie in the middle of the element.
ElementShape quadratic(const char* name, const ElementShape& linear, const Edges& edges,
                       const std::vector<std::size_t>& faces = {}, std::size_t inner = 0) {
  ElementShape form = linear;
  form.name = name;
  form.edges = edges;
  form.nodes = form.corners + edges.size() + faces.size() + inner;
  for (auto& around : form.faces) {
    const std::vector<std::uint8_t> corners = std::move(around);
    around.clear();
    for (std::size_t c = 0; c < corners.size(); ++c) {
      const std::uint8_t a = corners[c], b = corners[(c + 1) % corners.size()];
      const auto edge = std::find_if(edges.begin(), edges.end(),
                                     [&](const auto& ends) { return std::minmax(ends[0], ends[1]) == std::minmax(a, b); });
      around.push_back(a);
      around.push_back(static_cast<std::uint8_t>(form.corners + static_cast<std::size_t>(edge - edges.begin())));
    }
  }
  if (!faces.empty()) form.face_centres.assign(form.faces.size(), ElementShape::no_node);
  for (std::size_t i = 0; i < faces.size(); ++i) {
    form.face_centres[faces[i]] = static_cast<std::uint8_t>(form.corners + edges.size() + i);
  }
  return form;
}

const ElementShape tetrahedron10 = quadratic("tetrahedron10", tetrahedron, tetrahedron.edges);
const ElementShape pyramid13 = quadratic("pyramid13", pyramid, pyramid.edges);
const ElementShape pyramid14 = quadratic("pyramid14", pyramid, pyramid.edges, {0});
const ElementShape prism15 = quadratic("prism15", prism, prism_edges);
const ElementShape prism18 = quadratic("prism18", prism, prism_edges, {2, 3, 4});
const ElementShape hexahedron20 = quadratic("hexahedron20", hexahedron, hexahedron_edges);
const ElementShape hexahedron27 = quadratic("hexahedron27", hexahedron, hexahedron_edges, {0, 2, 3, 4, 5, 1}, 1);

}  // namespace

const ElementShape& shape(ElementType type) {
  static const std::array<const ElementShape*, element_types> all{&tetrahedron,   &pyramid,      &prism,       &hexahedron,
                                                                  &tetrahedron10, &pyramid13,    &pyramid14,   &prism15,
                                                                  &prism18,       &hexahedron20, &hexahedron27};
  return *all[static_cast<std::size_t>(type)];
}

}  // namespace deform
