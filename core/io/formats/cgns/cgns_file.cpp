// SPDX-License-Identifier: Apache-2.0
// CGNS: libcgns's lowest layer reads the nodes, see cgns_tree.h; what they mean is written in the SIDS (cgns.org). Hostile files
// are parsed by libcgns and libhdf5 themselves; this reader checks sizes and ranges of all they hand over. Several thousand files
// with flipped bits caused no harm, but those parsers are not hardened: see container_mesh.h.

#include <algorithm>
#include <limits>

#include "core/base/error.h"
#include "core/io/assembly/coordinate_records.h"
#include "core/io/binary/byte_stream.h"
#include "core/io/formats/cgns/cgns_zone.h"
#include "core/io/formats/containers/container_mesh.h"

namespace deform::io {

namespace {

using Kind = CgnsElement::Kind;
using Node = CgnsTree::Node;

constexpr const char* coordinate_names[] = {"CoordinateX", "CoordinateY", "CoordinateZ"};

/// A coordinate of the points of a zone.
struct CoordinateArray {
  std::string path;
  std::size_t axis = 0;
  PointId first_point = 0;
  std::size_t points = 0;
  bool narrow = false;  ///< 32-bit floats
};

/// The arrays of a file as text, and back.
std::string text_of(const std::vector<CoordinateArray>& arrays) {
  std::string text;
  ByteWriter to([&](std::string_view bytes) { text += bytes; });
  to.number(arrays.size());
  for (const CoordinateArray& array : arrays) {
    to.text(array.path);
    for (const std::uint64_t number : {array.axis, std::size_t{array.first_point}, array.points, std::size_t{array.narrow}}) {
      to.number(number);
    }
  }
  to.flush();
  return text;
}

std::vector<CoordinateArray> arrays_of(std::string_view text, std::size_t points) {
  const std::size_t size = text.size();
  ByteReader from(
      [&](char* to, std::size_t most) {
        const std::size_t got = text.copy(to, most);
        text.remove_prefix(got);
        return got;
      },
      size);
  std::vector<CoordinateArray> arrays;
  for (std::uint64_t left = from.number(); left > 0; --left) {
    CoordinateArray array;
    array.path = from.text();
    array.axis = static_cast<std::size_t>(from.number());
    array.first_point = static_cast<PointId>(from.number());
    array.points = static_cast<std::size_t>(from.number());
    array.narrow = from.number() != 0;
    if (array.axis > 2 || array.first_point > points || array.points > points - array.first_point) {
      throw Error(ErrorCode::internal, array.path + ": coordinates of points that are not there");
    }
    arrays.push_back(std::move(array));
  }
  return arrays;
}

struct CgnsContent {
  CgnsMesh mesh;
  std::vector<CoordinateArray> arrays;
  bool flat = false;  ///< a zone is in the plane
};

class CgnsReader {
 public:
  explicit CgnsReader(const CgnsTree& tree) : tree_(tree) {}

  void read() {
    std::vector<std::pair<Node, std::size_t>> zones;  // and the dimension of space
    for (const Node& base : tree_.children(tree_.root(), "CGNSBase_t")) {
      const auto dimensions = tree_.integers(base);
      if (dimensions.size() != 2 || dimensions[1] < 2 || dimensions[1] > 3) {
        tree_.fail(base, "expected a base in 2 or 3 dimensions of space");
      }
      for (const Node& zone : tree_.children(base, "Zone_t")) zones.push_back({zone, static_cast<std::size_t>(dimensions[1])});
    }
    if (zones.empty()) tree_.fail({}, "the file has no Zone_t");
    for (const auto& [node, space] : zones) read_zone(node, space, zones.size() > 1);
    if (mesh_.elements.points.empty()) tree_.fail({}, "the file has no points");
  }

  CgnsContent take() { return std::move(content_); }

 private:
  void read_zone(const Node& node, std::size_t space, bool one_of_many) {
    CgnsZone zone;
    zone.node = node;
    zone.name = node.name;
    const auto type = tree_.child(node, "ZoneType");
    zone.structured = !type || tree_.text(*type) != "Unstructured";
    const auto sizes = tree_.integers(node);
    const std::size_t axes = zone.structured ? sizes.size() / 3 : 1;
    if (sizes.size() != 3 * axes || axes < 1 || axes > 3) {
      tree_.fail(node, "expected the numbers of vertices and cells along every index");
    }
    zone.vertices.assign(sizes.begin(), sizes.begin() + static_cast<std::ptrdiff_t>(axes));
    for (const std::int64_t vertices : zone.vertices) {
      if (vertices < 1) tree_.fail(node, std::to_string(vertices) + " vertices along an index");
    }
    zone.first_point = static_cast<PointId>(mesh_.elements.points.size());
    read_points(zone, space);
    if (zone.structured) {
      read_cgns_lattice(tree_, zone, mesh_);
    } else {
      read_cgns_sections(tree_, zone, mesh_);
    }
    read_cgns_conditions(tree_, zone, mesh_);
    if (!one_of_many) return;  // all points are no part that anybody would name
    CgnsNamedSet all{FaceGroups::Kind::cell_zone, zone.name, {}};
    for (std::size_t i = 0; i < zone.points; ++i) {
      all.elements.push_back({Kind::point, zone.first_point + static_cast<PointId>(i)});
    }
    mesh_.sets.push_back(all);
    all.kind = FaceGroups::Kind::family;
    for (const Node& family : tree_.children(node, "FamilyName_t")) {
      all.name = tree_.text(family);
      if (!all.name.empty()) mesh_.sets.push_back(all);
    }
  }

  void read_points(CgnsZone& zone, std::size_t space) {
    const auto grid = tree_.child(zone.node, "GridCoordinates");
    if (!grid) tree_.fail(zone.node, "the zone has no GridCoordinates");
    check_rind(*grid);
    double count = 1;
    for (const std::int64_t vertices : zone.vertices) count *= static_cast<double>(vertices);
    const std::vector<Node> arrays = tree_.children(*grid);
    for (std::size_t axis = 0; axis < space; ++axis) {
      const Node* array = nullptr;
      for (const Node& node : arrays) {
        if (node.name == coordinate_names[axis]) array = &node;
      }
      if (array == nullptr) {
        std::string found;
        for (const Node& node : arrays) found += (found.empty() ? "" : ", ") + node.name;
        tree_.fail(*grid, std::string(coordinate_names[axis]) + " is missing; there is: " + (found.empty() ? "nothing" : found) +
                              ". Only Cartesian coordinates are supported");
      }
      const std::vector<double> values = tree_.reals(*array);
      if (static_cast<double>(values.size()) != count) {
        tree_.fail(*array, std::to_string(values.size()) + " coordinates, the zone has " +
                               std::to_string(static_cast<std::uint64_t>(std::min(count, 1e18))) + " vertices");
      }
      if (mesh_.elements.points.size() + values.size() > std::numeric_limits<PointId>::max()) {
        tree_.fail(*array, "more than 2^32 - 1 points");
      }
      if (axis == 0) {
        zone.points = values.size();
        mesh_.elements.points.resize(zone.first_point + zone.points);
      }
      for (std::size_t i = 0; i < values.size(); ++i) mesh_.elements.points[zone.first_point + i][axis] = values[i];
      content_.arrays.push_back({array->path, axis, zone.first_point, zone.points, tree_.type(*array) == "R4"});
    }
    content_.flat |= space == 2;
  }

  /// Planes of points around a zone that belong to its neighbours.
  void check_rind(const Node& grid) {
    for (const Node& rind : tree_.children(grid, "Rind_t")) {
      for (const std::int64_t planes : tree_.integers(rind)) {
        if (planes != 0) tree_.fail(rind, "rind planes are not supported");
      }
    }
  }

  const CgnsTree& tree_;
  CgnsContent content_;
  CgnsMesh& mesh_ = content_.mesh;
};

/// Sets of faces and points, once it is known that there are no polyhedra.
void add_sets(CgnsMesh& mesh) {
  ElementMesh& target = mesh.elements;
  const std::size_t first_polygon = target.faces.size();
  for (std::size_t p = 0; p < mesh.polygons.size(); ++p) {
    const auto corners = mesh.polygons[p];
    target.faces.push_back({{corners.begin(), corners.end()}, ""});
  }
  for (const CgnsNamedSet& set : mesh.sets) {
    ElementMesh::FaceSet faces{set.name, {}, set.kind};
    ElementMesh::PointSet points{set.name, {}, set.kind};
    for (const CgnsElement& element : set.elements) {
      const auto add = [&](std::span<const PointId> ids) { points.points.insert(points.points.end(), ids.begin(), ids.end()); };
      if (element.kind == Kind::face) faces.faces.push_back(element.index);
      if (element.kind == Kind::polygon) faces.faces.push_back(first_polygon + element.index);
      if (element.kind == Kind::point) points.points.push_back(element.index);
      if (element.kind == Kind::edge) add(mesh.edges[element.index]);
      if (element.kind == Kind::cell) add(target.elements.nodes(element.index));
    }
    target.face_sets.push_back(std::move(faces));
    target.point_sets.push_back(std::move(points));
  }
}

ContainerMesh read(ContainerFile& file, std::size_t bytes, const std::string& name) {
  CgnsContent content;
  {
    const CgnsTree tree(file, bytes, name, CgnsTree::Access::read);
    CgnsReader reader(tree);
    reader.read();
    content = reader.take();
  }
  const std::string layout = text_of(content.arrays);
  if (content.mesh.polyhedra.size() > 0) {
    if (content.mesh.elements.elements.size() > 0) {
      throw Error(ErrorCode::invalid_argument, name + ": polyhedra (NFACE_n) beside elements of other types are not supported");
    }
    return {cgns_polyhedra(std::move(content.mesh), name), layout, content.flat};
  }
  add_sets(content.mesh);
  return {mesh_of(std::move(content.mesh.elements), name), layout, content.flat};
}

void overwrite(ContainerFile& file, std::size_t bytes, const std::string& name, const std::string& layout,
               std::span<const Vec3> points) {
  CgnsTree tree(file, bytes, name, CgnsTree::Access::modify);
  for (const CoordinateArray& array : arrays_of(layout, points.size())) {
    std::vector<double> values(array.points);
    for (std::size_t i = 0; i < array.points; ++i) {
      const std::size_t point = array.first_point + i;
      values[i] = points[point][array.axis];
      if (array.narrow) as_float(values[i], point, static_cast<int>(array.axis));
    }
    tree.overwrite(tree.at(array.path), values);
  }
  tree.close();
}

/// Restores the date of the last change, which ADF stores after the tag AdF1 of its first lines, because only coordinates
/// may differ.
void keep_date(const std::string& original, std::string& written) {
  constexpr std::size_t tag = 64, date = 68, length = 28;
  if (original.size() >= date + length && written.size() >= date + length && original.compare(tag, 4, "AdF1") == 0) {
    written.replace(date, length, original, date, length);
  }
}

constexpr ContainerLibrary library{.name = "the CGNS library", .read = read, .overwrite = overwrite, .restore = keep_date};

}  // namespace

Reader cgns_reader() { return {.format = Format::cgns, .name = "CGNS", .extensions = {".cgns"}, .library = &library}; }

}  // namespace deform::io
