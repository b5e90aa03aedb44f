// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdlib>
#include <limits>

#include "core/io/formats/cgns/cgns_zone.h"

namespace deform::io {

namespace {

using Kind = CgnsElement::Kind;
using Node = CgnsTree::Node;

// Numbers of ElementType_t (CGNS SIDS, cgnslib.h).
constexpr std::int64_t mixed = 20, ngon = 22, nface = 23;

struct Form {
  std::int64_t number;
  const char* name;
  std::size_t nodes;
  Kind kind;
  ElementType type = ElementType::tetrahedron;  ///< of cells
};
constexpr Form forms[] = {
    {2, "NODE", 1, Kind::point},
    {3, "BAR_2", 2, Kind::edge},
    {4, "BAR_3", 3, Kind::edge},
    {5, "TRI_3", 3, Kind::face},
    {6, "TRI_6", 6, Kind::face},
    {7, "QUAD_4", 4, Kind::face},
    {8, "QUAD_8", 8, Kind::face},
    {9, "QUAD_9", 9, Kind::face},
    {10, "TETRA_4", 4, Kind::cell, ElementType::tetrahedron},
    {11, "TETRA_10", 10, Kind::cell, ElementType::tetrahedron10},
    {12, "PYRA_5", 5, Kind::cell, ElementType::pyramid},
    {13, "PYRA_14", 14, Kind::cell, ElementType::pyramid14},
    {14, "PENTA_6", 6, Kind::cell, ElementType::prism},
    {15, "PENTA_15", 15, Kind::cell, ElementType::prism15},
    {16, "PENTA_18", 18, Kind::cell, ElementType::prism18},
    {17, "HEXA_8", 8, Kind::cell, ElementType::hexahedron},
    {18, "HEXA_20", 20, Kind::cell, ElementType::hexahedron20},
    {19, "HEXA_27", 27, Kind::cell, ElementType::hexahedron27},
    {21, "PYRA_13", 13, Kind::cell, ElementType::pyramid13},
};

/// One Elements_t node.
struct Source {
  Node node;
  std::int64_t type = 0, first = 1, last = 0;
  std::vector<std::int64_t> connectivity;
  std::vector<std::int64_t> offsets;  ///< CGNS 4: ElementStartOffset; before: empty

  std::size_t count() const { return static_cast<std::size_t>(last - first + 1); }
};

class SectionReader {
 public:
  SectionReader(const CgnsTree& tree, CgnsZone& zone, CgnsMesh& mesh) : tree_(tree), zone_(zone), mesh_(mesh) {}

  void read() {
    std::vector<Source> cells;
    for (const Node& node : tree_.children(zone_.node, "Elements_t")) {
      Source source = open(node);
      if (source.type == nface) {
        cells.push_back(std::move(source));  // they name faces, which may come later
      } else if (source.type == ngon) {
        read_polygons(source);
      } else if (source.type == mixed) {
        read_mixed(source);
      } else {
        read_alike(source);
      }
    }
    const bool parents = cells.empty();
    for (const Source& source : cells) read_polyhedra(source);
    if (parents) read_parents();
  }

 private:
  Source open(const Node& node) {
    Source source{node, 0, 1, 0, {}, {}};
    const auto type = tree_.integers(node);
    if (type.empty()) tree_.fail(node, "the element type is missing");
    source.type = type[0];
    const auto range = tree_.child(node, "ElementRange"), connectivity = tree_.child(node, "ElementConnectivity");
    if (!range || !connectivity) tree_.fail(node, "ElementRange or ElementConnectivity is missing");
    const auto limits = tree_.integers(*range);
    source.connectivity = tree_.integers(*connectivity);
    if (limits.size() != 2 || limits[0] < 1 || limits[1] < limits[0] - 1 ||
        static_cast<std::uint64_t>(limits[1] - limits[0] + 1) > source.connectivity.size()) {
      tree_.fail(*range, "expected the first and last number of elements, of which there can be " +
                             std::to_string(source.connectivity.size()) + " at most");
    }
    source.first = limits[0];
    source.last = limits[1];
    if (const auto offsets = tree_.child(node, "ElementStartOffset")) {
      source.offsets = tree_.integers(*offsets);
      if (source.offsets.size() != source.count() + 1 || source.offsets.front() != 0 ||
          source.offsets.back() != static_cast<std::int64_t>(source.connectivity.size()) ||
          !std::is_sorted(source.offsets.begin(), source.offsets.end())) {
        tree_.fail(*offsets, "the offsets of " + std::to_string(source.count()) + " elements do not rise from 0 to " +
                                 std::to_string(source.connectivity.size()));
      }
    }
    return source;
  }

  const Form& form(const Source& source, std::int64_t type) const {
    for (const Form& known : forms) {
      if (known.number == type) return known;
    }
    tree_.fail(source.node, "elements of type " + std::to_string(type) +
                                " are not supported; there are NODE, BAR, linear and quadratic TRI, QUAD, TETRA, PYRA, PENTA and "
                                "HEXA, MIXED, NGON_n and NFACE_n");
  }

  CgnsSection& section(const Source& source) {
    zone_.sections.push_back({source.node.name, source.first, {}});
    zone_.sections.back().elements.reserve(source.count());
    return zone_.sections.back();
  }

  void read_alike(const Source& source) {
    const Form& what = form(source, source.type);
    if (source.connectivity.size() != source.count() * what.nodes) {
      tree_.fail(source.node, std::to_string(source.count()) + " elements " + what.name + " need " +
                                  std::to_string(source.count() * what.nodes) + " nodes, there are " +
                                  std::to_string(source.connectivity.size()));
    }
    CgnsSection& target = section(source);
    for (std::size_t e = 0; e < source.count(); ++e) {
      target.elements.push_back(add(source, what, std::span(source.connectivity).subspan(e * what.nodes, what.nodes)));
    }
    name_faces(target);
  }

  void read_mixed(const Source& source) {
    CgnsSection& target = section(source);
    std::span<const std::int64_t> rest = source.connectivity;
    for (std::size_t e = 0; e < source.count(); ++e) {
      if (rest.empty()) fail_short(source, e);
      const Form& what = form(source, rest[0]);
      if (rest.size() <= what.nodes) fail_short(source, e);
      target.elements.push_back(add(source, what, rest.subspan(1, what.nodes)));
      rest = rest.subspan(1 + what.nodes);
    }
    if (!rest.empty()) tree_.fail(source.node, std::to_string(rest.size()) + " entries of the connectivity belong to no element");
    name_faces(target);
  }

  [[noreturn]] void fail_short(const Source& source, std::size_t element) const {
    tree_.fail(source.node,
               "the connectivity ends within element " + std::to_string(source.first + static_cast<std::int64_t>(element)));
  }

  CgnsElement add(const Source& source, const Form& what, std::span<const std::int64_t> numbers) {
    nodes_.clear();
    for (const std::int64_t number : numbers) nodes_.push_back(zone_.point(number, tree_, source.node));
    switch (what.kind) {
      case Kind::point:
        return {Kind::point, nodes_[0]};
      case Kind::edge:
        mesh_.edges.push_back({nodes_[0], nodes_[1], nodes_.back()});
        return {Kind::edge, static_cast<std::uint32_t>(mesh_.edges.size() - 1)};
      case Kind::face:
        mesh_.elements.add_face(nodes_, "");
        return {Kind::face, static_cast<std::uint32_t>(mesh_.elements.faces.size() - 1)};
      default:
        mesh_.elements.elements.add(what.type, nodes_);
        mesh_.elements.volume_names.push_back(source.node.name);
        return {Kind::cell, static_cast<std::uint32_t>(mesh_.elements.elements.size() - 1)};
    }
  }

  /// Calls use(list) for every element of a section of lists of varying length.
  template <typename Use>
  void each_list(const Source& source, const Use& use) const {
    std::span<const std::int64_t> rest = source.connectivity;
    for (std::size_t e = 0; e < source.count(); ++e) {
      std::int64_t length = 0;
      if (source.offsets.empty()) {  // CGNS 3: the length stands before the list
        if (rest.empty()) fail_short(source, e);
        length = rest[0];
        rest = rest.subspan(1);
      } else {
        length = source.offsets[e + 1] - source.offsets[e];
      }
      if (length < 1 || static_cast<std::uint64_t>(length) > rest.size()) {
        tree_.fail(source.node, "element " + std::to_string(source.first + static_cast<std::int64_t>(e)) + " claims " +
                                    std::to_string(length) + " entries, the connectivity has " + std::to_string(rest.size()) +
                                    " left");
      }
      use(rest.first(static_cast<std::size_t>(length)));
      rest = rest.subspan(static_cast<std::size_t>(length));
    }
    if (!rest.empty()) tree_.fail(source.node, std::to_string(rest.size()) + " entries of the connectivity belong to no element");
  }

  void read_polygons(const Source& source) {
    CgnsSection& target = section(source);
    each_list(source, [&](std::span<const std::int64_t> numbers) {
      nodes_.clear();
      for (const std::int64_t number : numbers) nodes_.push_back(zone_.point(number, tree_, source.node));
      target.elements.push_back({Kind::polygon, static_cast<std::uint32_t>(mesh_.polygons.size())});
      mesh_.polygons.add(nodes_);
    });
    polygons_.push_back(source.node);
    name_faces(target);
  }

  void read_polyhedra(const Source& source) {
    CgnsSection target{source.node.name, source.first, {}};
    std::vector<CgnsSide> sides;
    each_list(source, [&](std::span<const std::int64_t> numbers) {
      sides.clear();
      for (const std::int64_t number : numbers) {
        // The lowest number has no positive one.
        const CgnsElement* face = number < -std::numeric_limits<std::int64_t>::max() ? nullptr : zone_.element(std::abs(number));
        if (face == nullptr || face->kind != Kind::polygon) {
          tree_.fail(source.node, "face " + std::to_string(number) + " is none of the zone's NGON_n");
        }
        sides.push_back({face->index, number > 0});
      }
      target.elements.push_back({Kind::polyhedron, static_cast<std::uint32_t>(mesh_.polyhedra.size())});
      mesh_.polyhedra.add(sides);
    });
    zone_.sections.push_back(std::move(target));
  }

  /// Faces that name their cells, where no cell names its faces: two columns, the cell that a face's normal leaves first.
  void read_parents() {
    std::vector<std::pair<std::int64_t, CgnsSide>> uses;
    for (const Node& node : polygons_) {
      const auto parents = tree_.child(node, "ParentElements");
      if (!parents) return;
      const auto cells = tree_.integers(*parents);
      const auto section =
          std::find_if(zone_.sections.begin(), zone_.sections.end(), [&](const CgnsSection& s) { return s.name == node.name; });
      const std::size_t count = section->elements.size();
      if (cells.size() != 2 * count) tree_.fail(*parents, "expected two cells for each of " + std::to_string(count) + " faces");
      for (std::size_t i = 0; i < cells.size(); ++i) {
        if (cells[i] < 0) tree_.fail(*parents, "cell " + std::to_string(cells[i]));
        if (cells[i] > 0) uses.push_back({cells[i], {section->elements[i % count].index, i < count}});
      }
    }
    std::stable_sort(uses.begin(), uses.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    std::vector<CgnsSide> sides;
    for (std::size_t i = 0; i < uses.size(); ++i) {
      sides.push_back(uses[i].second);
      if (i + 1 < uses.size() && uses[i + 1].first == uses[i].first) continue;
      mesh_.polyhedra.add(sides);
      sides.clear();
    }
  }

  /// A section of surface elements is a group, but for the polygons that make up cells.
  void name_faces(const CgnsSection& source) {
    CgnsNamedSet set{FaceGroups::Kind::section, source.name, {}};
    for (const CgnsElement& element : source.elements) {
      if (element.kind == Kind::face || element.kind == Kind::polygon) set.elements.push_back(element);
    }
    if (!set.elements.empty()) mesh_.sets.push_back(std::move(set));
  }

  const CgnsTree& tree_;
  CgnsZone& zone_;
  CgnsMesh& mesh_;
  std::vector<PointId> nodes_;
  std::vector<Node> polygons_;
};

}  // namespace

PointId CgnsZone::point(std::int64_t number, const CgnsTree& tree, const CgnsTree::Node& where) const {
  if (number < 1 || static_cast<std::uint64_t>(number) > points) {
    tree.fail(where, "point " + std::to_string(number) + " is out of range 1.." + std::to_string(points));
  }
  return first_point + static_cast<PointId>(number - 1);
}

const CgnsElement* CgnsZone::element(std::int64_t number) const {
  if (number < 1) return nullptr;
  for (std::size_t i = 0; i < sections.size(); ++i) {
    const std::size_t s = (recent_section + i) % sections.size();
    const std::int64_t place = number - sections[s].first;
    if (place < 0 || static_cast<std::uint64_t>(place) >= sections[s].elements.size()) continue;
    recent_section = s;
    return &sections[s].elements[static_cast<std::size_t>(place)];
  }
  return nullptr;
}

void read_cgns_sections(const CgnsTree& tree, CgnsZone& zone, CgnsMesh& mesh) { SectionReader(tree, zone, mesh).read(); }

}  // namespace deform::io
