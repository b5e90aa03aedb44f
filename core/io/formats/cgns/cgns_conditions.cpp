// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <optional>

#include "core/io/formats/cgns/cgns_zone.h"

namespace deform::io {

namespace {

using Kind = CgnsElement::Kind;
using Node = CgnsTree::Node;

/// One BC_t node.
class Condition {
 public:
  Condition(const CgnsTree& tree, const CgnsZone& zone, CgnsMesh& mesh, const Node& node)
      : tree_(tree), zone_(zone), mesh_(mesh), node_(node) {}

  void read() {
    std::string location = "Vertex";
    std::vector<std::string> families;
    std::optional<Node> where;
    for (const Node& child : tree_.children(node_)) {
      if (child.label == "GridLocation_t") location = tree_.text(child);
      if (child.label == "FamilyName_t" || child.label == "AdditionalFamilyName_t") families.push_back(tree_.text(child));
      for (const char* name : {"PointRange", "PointList", "ElementRange", "ElementList"}) {
        if (child.name == name) where = child;
      }
    }
    if (!where) return;
    if (where->name.starts_with("Element")) location = "FaceCenter";  // the names of CGNS 2
    const bool range = where->name.ends_with("Range");
    if (zone_.structured) {
      read_structured(*where, range, location);
    } else {
      read_unstructured(*where, range, location);
    }
    for (const std::string& family : families) {
      if (!family.empty()) mesh_.sets.push_back({FaceGroups::Kind::family, family, members_});
    }
    mesh_.sets.push_back({FaceGroups::Kind::group, node_.name, std::move(members_)});
  }

 private:
  void read_unstructured(const Node& where, bool range, const std::string& location) {
    const auto add = [&](std::int64_t number) {
      if (location == "Vertex") return members_.push_back({Kind::point, zone_.point(number, tree_, where)});
      const CgnsElement* element = zone_.element(number);
      if (element == nullptr) tree_.fail(where, "there is no element " + std::to_string(number) + " in the zone");
      members_.push_back(*element);
    };
    const auto numbers = tree_.integers(where);
    if (!range) {
      for (const std::int64_t number : numbers) add(number);
      return;
    }
    if (numbers.size() != 2) tree_.fail(where, "expected a first and a last number");
    for (std::int64_t number = numbers[0]; number <= numbers[1]; ++number) add(number);
  }

  void read_structured(const Node& where, bool range, const std::string& location) {
    const auto numbers = tree_.integers(where);
    const std::size_t axes = zone_.vertices.size();
    if (axes == 0 || numbers.size() % axes != 0 || (range && numbers.size() != 2 * axes)) {
      tree_.fail(where, "expected indices of " + std::to_string(axes) + " numbers" + (range ? ", a first and a last" : ""));
    }
    std::vector<std::array<std::int64_t, 3>> places;  // from 0
    for (std::size_t i = 0; i < numbers.size(); i += axes) {
      std::array<std::int64_t, 3> place{};
      for (std::size_t k = 0; k < axes; ++k) {
        if (numbers[i + k] < 1 || numbers[i + k] > zone_.vertices[k]) {
          tree_.fail(where,
                     "index " + std::to_string(numbers[i + k]) + " is out of range 1.." + std::to_string(zone_.vertices[k]));
        }
        place[k] = numbers[i + k] - 1;
      }
      places.push_back(place);
    }
    if (range) {
      read_range(where, places[0], places[1], location);
    } else {
      read_list(where, places, location);
    }
  }

  void read_range(const Node& where, const std::array<std::int64_t, 3>& a, const std::array<std::int64_t, 3>& b,
                  const std::string& location) {
    std::array<std::int64_t, 3> low{}, high{};
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = std::min(a[k], b[k]);
      high[k] = std::max(a[k], b[k]);
    }
    const std::optional<std::size_t> axis = across(location, low, high);
    const bool at_vertices = location == "Vertex";
    const bool faces = zone_.vertices.size() == 3 && axis && !(at_vertices && flat_axes(low, high) > 1);
    for (std::int64_t k = low[2]; k <= high[2]; ++k) {
      for (std::int64_t j = low[1]; j <= high[1]; ++j) {
        for (std::int64_t i = low[0]; i <= high[0]; ++i) {
          if (!faces) {
            add_points({i, j, k}, at_vertices ? std::optional<std::size_t>{} : axis, !at_vertices);
            continue;
          }
          const std::array<std::int64_t, 3> cell{i, j, k};
          bool last = false;  // vertices i..j have a face less between them
          for (std::size_t n = 0; n < 3; ++n) last |= at_vertices && n != *axis && cell[n] == high[n];
          if (!last) add_face(where, *axis, cell);
        }
      }
    }
  }

  void read_list(const Node& where, const std::vector<std::array<std::int64_t, 3>>& places, const std::string& location) {
    if (places.empty()) return;
    std::array<std::int64_t, 3> low = places[0], high = low;
    for (const auto& place : places) {
      for (std::size_t k = 0; k < 3; ++k) {
        low[k] = std::min(low[k], place[k]);
        high[k] = std::max(high[k], place[k]);
      }
    }
    const bool at_vertices = location == "Vertex";
    const std::optional<std::size_t> axis = across(location, low, high);
    for (const auto& place : places) {
      if (at_vertices || zone_.vertices.size() < 3) {
        add_points(place, axis, !at_vertices);
      } else if (axis) {
        add_face(where, *axis, place);
      } else {
        tree_.fail(where,
                   "face centres that lie across no index; GridLocation should be IFaceCenter, JFaceCenter or KFaceCenter");
      }
    }
  }

  /// The index that faces at these places lie across.
  std::optional<std::size_t> across(const std::string& location, const std::array<std::int64_t, 3>& low,
                                    const std::array<std::int64_t, 3>& high) const {
    if (location == "IFaceCenter") return 0;
    if (location == "JFaceCenter") return 1;
    if (location == "KFaceCenter") return 2;
    for (std::size_t k = 0; k < zone_.vertices.size(); ++k) {
      if (low[k] == high[k]) return k;
    }
    return std::nullopt;
  }

  std::size_t flat_axes(const std::array<std::int64_t, 3>& low, const std::array<std::int64_t, 3>& high) const {
    std::size_t count = 0;
    for (std::size_t k = 0; k < zone_.vertices.size(); ++k) count += low[k] == high[k];
    return count;
  }

  void add_face(const Node& where, std::size_t axis, const std::array<std::int64_t, 3>& cell) {
    const auto corners = cgns_lattice_face(zone_, axis, cell);
    if (corners.empty()) {
      tree_.fail(where, "there is no face across index " + std::to_string(axis + 1) + " at " + std::to_string(cell[0] + 1) + " " +
                            std::to_string(cell[1] + 1) + " " + std::to_string(cell[2] + 1));
    }
    members_.push_back({Kind::face, static_cast<std::uint32_t>(mesh_.elements.faces.size())});
    mesh_.elements.add_face(corners, "");
  }

  /// The vertex at `place`, and where it counts edges of a 2D zone, the vertices one further along the others than `axis`.
  void add_points(const std::array<std::int64_t, 3>& place, std::optional<std::size_t> axis, bool edges) {
    for (std::size_t step = 0; step < (edges ? 2U : 1U); ++step) {
      std::int64_t number = 0;
      for (std::size_t k = zone_.vertices.size(); k-- > 0;) {
        const std::int64_t along = place[k] + (step == 1 && axis && k != *axis ? 1 : 0);
        number = number * zone_.vertices[k] + std::min(along, zone_.vertices[k] - 1);
      }
      members_.push_back({Kind::point, zone_.first_point + static_cast<PointId>(number)});
    }
  }

  const CgnsTree& tree_;
  const CgnsZone& zone_;
  CgnsMesh& mesh_;
  const Node& node_;
  std::vector<CgnsElement> members_;
};

}  // namespace

void read_cgns_conditions(const CgnsTree& tree, const CgnsZone& zone, CgnsMesh& mesh) {
  for (const Node& list : tree.children(zone.node, "ZoneBC_t")) {
    for (const Node& node : tree.children(list, "BC_t")) Condition(tree, zone, mesh, node).read();
  }
}

}  // namespace deform::io
