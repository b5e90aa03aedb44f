// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/vtk/vtk_cells.h"

#include <algorithm>
#include <array>
#include <set>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/io/assembly/cell_faces.h"

namespace deform::io {

namespace {

/// A volume cell: node k of ours (CGNS) is node order[k] of VTK's.
struct Volume {
  std::uint8_t type;
  ElementType element;
  std::vector<std::uint8_t> order;
  std::vector<std::uint8_t> other_order = {};  ///< of a wedge whose base is seen from inside; else empty
};

// VTK lists the edges of the top before the vertical ones, CGNS after them.
const Volume volumes[] = {
    {10, ElementType::tetrahedron, {0, 1, 2, 3}},
    {11, ElementType::hexahedron, {0, 1, 3, 2, 4, 5, 7, 6}},  // voxel
    {12, ElementType::hexahedron, {0, 1, 2, 3, 4, 5, 6, 7}},
    {13, ElementType::prism, {0, 2, 1, 3, 5, 4}, {0, 1, 2, 3, 4, 5}},
    {14, ElementType::pyramid, {0, 1, 2, 3, 4}},
    {24, ElementType::tetrahedron10, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9}},
    {25, ElementType::hexahedron20, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 16, 17, 18, 19, 12, 13, 14, 15}},
    {26,
     ElementType::prism15,
     {0, 2, 1, 3, 5, 4, 8, 7, 6, 12, 14, 13, 11, 10, 9},
     {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 13, 14, 9, 10, 11}},
    {27, ElementType::pyramid13, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}},
    {29, ElementType::hexahedron27, {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 16, 17,
                                     18, 19, 12, 13, 14, 15, 24, 22, 21, 23, 20, 25, 26}},
    {32,
     ElementType::prism18,
     {0, 2, 1, 3, 5, 4, 8, 7, 6, 12, 14, 13, 11, 10, 9, 17, 16, 15},
     {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 13, 14, 9, 10, 11, 15, 16, 17}},
};

const Volume* find_volume(std::uint8_t type) {
  static const auto table = [] {
    std::array<const Volume*, 256> by_type{};
    for (const Volume& volume : volumes) by_type[volume.type] = &volume;
    return by_type;
  }();
  return table[type];
}

/// A surface cell: the points around it, then its mid-face node.
struct Surface {
  std::uint8_t type;
  std::vector<std::uint8_t> around;
  bool centre = false;
};
const Surface surfaces[] = {
    {5, {0, 1, 2}},
    {8, {0, 1, 3, 2}},  // pixel
    {9, {0, 1, 2, 3}},
    {22, {0, 3, 1, 4, 2, 5}},
    {23, {0, 4, 1, 5, 2, 6, 3, 7}},
    {28, {0, 4, 1, 5, 2, 6, 3, 7}, true},
    {30, {0, 4, 1, 2, 5, 3}},  // quadratic along two sides only
    {34, {0, 3, 1, 4, 2, 5}, true},
};

class CellReader {
 public:
  CellReader(const VtkCells& cells, const std::string& name, ElementMesh& mesh)
      : cells_(cells), name_(name), mesh_(mesh), labelled_(!cells.labels.empty() && cells.labels.size() == cells.size()) {}

  void read() {
    for (cell_ = 0; cell_ < cells_.size(); ++cell_) check_nodes();
    const bool other_wedges = more_wedges_the_other_way(), inward = more_faces_inward();
    const bool by_faces = std::find(cells_.types.begin(), cells_.types.end(), VtkCells::polyhedron) != cells_.types.end();
    for (cell_ = 0; cell_ < cells_.size(); ++cell_) {
      if (const Volume* volume = find_volume(cells_.types[cell_])) {
        const auto& order = other_wedges && !volume->other_order.empty() ? volume->other_order : volume->order;
        by_faces ? add_faces_of(*volume, order) : add_volume(*volume, order);
      } else if (cells_.types[cell_] == VtkCells::polyhedron) {
        for_each_face([&](std::span<const PointId> corners) { add_cell_face(corners, inward); });
        faces_.end_cell();
      } else {
        add_surface();
      }
    }
    if (!by_faces) return;
    try {
      mesh_.cells = joined(faces_);
    } catch (const Error& error) {
      throw Error(error.code(), name_ + ": volume " + error.what());
    }
  }

 private:
  std::span<const PointId> nodes() const {
    return std::span(cells_.points)
        .subspan(cells_.offsets[cell_], static_cast<std::size_t>(cells_.offsets[cell_ + 1] - cells_.offsets[cell_]));
  }

  [[noreturn]] void fail(const std::string& message) const {
    throw Error(ErrorCode::invalid_argument, name_ + ": cells[" + std::to_string(cell_) + "]: " + message);
  }

  void check(std::span<const PointId> points) const {
    for (const PointId point : points) {
      if (point < mesh_.points.size()) continue;
      fail("point " + std::to_string(point) + " is out of range, there are " + std::to_string(mesh_.points.size()) + " points");
    }
  }

  void check_nodes() const {
    if (cells_.types[cell_] == VtkCells::polyhedron) return check_polyhedron();
    check(nodes());
    if (const Volume* volume = find_volume(cells_.types[cell_])) expect_nodes(volume->order.size());
  }

  void check_polyhedron() const {
    const auto stream = nodes();
    std::size_t at = 1;
    if (stream.empty() || stream[0] < 4) fail("a polyhedron of less than 4 faces");
    for (PointId face = 0; face < stream[0]; ++face) {
      if (at >= stream.size() || stream[at] >= stream.size() - at) {
        fail("face " + std::to_string(face) + " of " + std::to_string(stream[0]) + " is beyond the numbers given for the faces");
      }
      const std::size_t corners = stream[at];
      if (corners < 3)
        fail("face " + std::to_string(face) + " has " + std::to_string(corners) + " points, at least 3 are needed");
      check(stream.subspan(at + 1, corners));
      at += corners + 1;
    }
    if (at != stream.size()) fail(std::to_string(stream.size() - at) + " numbers too many for its faces");
  }

  template <typename Use>
  void for_each_face(const Use& use) const {
    const auto stream = nodes();
    std::size_t at = 1;
    for (PointId face = 0; face < stream[0]; ++face) {
      use(stream.subspan(at + 1, stream[at]));
      at += stream[at] + 1;
    }
  }

  void expect_nodes(std::size_t count) const {
    if (nodes().size() == count) return;
    fail("type " + std::to_string(cells_.types[cell_]) + " has " + std::to_string(count) + " points, found " +
         std::to_string(nodes().size()));
  }

  /// Six times the volume of a tetrahedron.
  static double signed_volume(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
    return dot(b - a, cross(c - a, d - a));
  }

  Vec3 mean(std::span<const PointId> points) const {
    Vec3 sum{};
    for (const PointId point : points) {
      sum = sum + mesh_.points[point] / static_cast<double>(points.size());
    }
    return sum;
  }

  bool more_wedges_the_other_way() {
    std::int64_t votes = 0;
    for (cell_ = 0; cell_ < cells_.size(); ++cell_) {
      const Volume* volume = find_volume(cells_.types[cell_]);
      if (volume == nullptr || volume->other_order.empty()) continue;
      const auto n = nodes();
      const double size = signed_volume(mesh_.points[n[0]], mesh_.points[n[1]], mesh_.points[n[2]], mean(n.subspan(3, 3)));
      votes += size > 0 ? 1 : size < 0 ? -1 : 0;
    }
    return votes > 0;
  }

  bool more_faces_inward() {
    std::int64_t votes = 0;
    std::vector<PointId> all;
    for (cell_ = 0; cell_ < cells_.size(); ++cell_) {
      if (cells_.types[cell_] != VtkCells::polyhedron) continue;
      all.clear();
      for_each_face([&](std::span<const PointId> corners) { all.insert(all.end(), corners.begin(), corners.end()); });
      const Vec3 inside = mean(all);
      for_each_face([&](std::span<const PointId> corners) {
        const Vec3 centre = mean(corners);
        double size = 0;  // of the pyramid over the face
        for (std::size_t i = 0; i < corners.size(); ++i) {
          size += signed_volume(centre, mesh_.points[corners[i]], mesh_.points[corners[(i + 1) % corners.size()]], inside);
        }
        votes += size > 0 ? 1 : size < 0 ? -1 : 0;
      });
    }
    return votes > 0;
  }

  std::string group() const { return labelled_ ? cells_.label + "_" + std::to_string(cells_.labels[cell_]) : std::string(); }

  void add_volume(const Volume& volume, const std::vector<std::uint8_t>& order) {
    const auto from = nodes();
    nodes_.clear();
    for (const std::uint8_t k : order) nodes_.push_back(from[k]);
    mesh_.elements.add(volume.element, nodes_);
    if (labelled_) mesh_.volume_names.push_back(group());
  }

  void add_cell_face(std::span<const PointId> corners, bool reversed) {
    nodes_.assign(corners.begin(), corners.end());
    if (reversed) std::reverse(nodes_.begin(), nodes_.end());
    faces_.add_face(nodes_);
  }

  void add_faces_of(const Volume& volume, const std::vector<std::uint8_t>& order) {
    const ElementShape& form = shape(volume.element);
    if (form.quadratic()) fail("quadratic cells beside polyhedra are not supported");
    for (const auto& face : form.faces) {
      nodes_.clear();
      for (const std::uint8_t corner : face) nodes_.push_back(nodes()[order[corner]]);
      faces_.add_face(nodes_);
    }
    faces_.end_cell();
  }

  void add_surface() {
    const auto from = nodes();
    const std::uint8_t type = cells_.types[cell_];
    for (const Surface& surface : surfaces) {
      if (surface.type != type) continue;
      expect_nodes(surface.around.size() + (surface.centre ? 1 : 0));
      std::vector<PointId> around;
      for (const std::uint8_t k : surface.around) around.push_back(from[k]);
      mesh_.faces.push_back({std::move(around), group()});
      if (surface.centre) mesh_.faces.back().centre = from.back();
      return;
    }
    switch (type) {
      case vtk::empty_cell:
        return;
      case vtk::vertex:
      case vtk::poly_vertex:
      case vtk::line:
      case vtk::poly_line:
      case vtk::quadratic_edge:
      case vtk::cubic_edge:
        if (labelled_ && !from.empty()) mesh_.point_sets.push_back({group(), {from.begin(), from.end()}});
        return;
      case vtk::polygon:
      case vtk::quadratic_polygon:
      case vtk::strip:
        return add_polygons(type);
      default:
        fail("cells of type " + std::to_string(type) + " are not supported");
    }
  }

  void add_polygons(std::uint8_t type) {
    const auto from = nodes();
    const std::size_t least = type == vtk::quadratic_polygon ? 6 : 3;
    if (from.size() < least || (type == vtk::quadratic_polygon && from.size() % 2 != 0)) {
      fail("type " + std::to_string(type) + " of " + std::to_string(from.size()) + " points, at least " + std::to_string(least) +
           " are needed");
    }
    if (type == vtk::polygon) {
      mesh_.faces.push_back({{from.begin(), from.end()}, group()});
    } else if (type == vtk::quadratic_polygon) {
      std::vector<PointId> around;
      for (std::size_t i = 0; i < from.size() / 2; ++i) around.insert(around.end(), {from[i], from[from.size() / 2 + i]});
      mesh_.faces.push_back({std::move(around), group()});
    } else {
      for (std::size_t i = 0; i + 2 < from.size(); ++i) {  // every second one turns the other way
        mesh_.faces.push_back({{from[i], from[i + 1 + i % 2], from[i + 2 - i % 2]}, group()});
      }
    }
  }

  const VtkCells& cells_;
  const std::string& name_;
  ElementMesh& mesh_;
  const bool labelled_;
  std::size_t cell_ = 0;
  std::vector<PointId> nodes_;
  CellFaces faces_;
};

bool is_name_of_parts(const std::string& name) {
  static const std::set<std::string> names = {"CellEntityIds", "gmsh:physical", "RegionId", "material", "Material",
                                              "MaterialIds",   "BoundaryId",    "PatchId",  "patch_id", "cell_tags"};
  return names.contains(name);
}

}  // namespace

void VtkCells::add(std::uint8_t type, std::span<const PointId> nodes) {
  types.push_back(type);
  points.insert(points.end(), nodes.begin(), nodes.end());
  offsets.push_back(points.size());
}

void VtkCells::offer_labels(const std::string& name, std::vector<std::int64_t> values) {
  constexpr std::size_t most = 256;
  if (name.empty() || (!labels.empty() && (is_name_of_parts(label) || !is_name_of_parts(name)))) return;
  std::set<std::int64_t> different;
  for (const std::int64_t value : values) {
    different.insert(value);
    if (different.size() > most) return;
  }
  label = name;
  labels = std::move(values);
}

void add_vtk_cells(const VtkCells& cells, const std::string& name, ElementMesh& mesh) { CellReader(cells, name, mesh).read(); }

const VtkElement& vtk_element(ElementType type) {
  static const auto table = [] {
    constexpr std::uint8_t voxel = 11;
    std::array<VtkElement, element_types> elements;
    for (const Volume& volume : volumes) {
      if (volume.type == voxel) continue;
      VtkElement& element = elements[static_cast<std::size_t>(volume.element)];
      element.type = volume.type;
      element.nodes.resize(volume.order.size());
      for (std::size_t k = 0; k < volume.order.size(); ++k) element.nodes[volume.order[k]] = static_cast<std::uint8_t>(k);
    }
    elements[static_cast<std::size_t>(ElementType::pyramid14)] = elements[static_cast<std::size_t>(ElementType::pyramid13)];
    return elements;
  }();
  return table[static_cast<std::size_t>(type)];
}

}  // namespace deform::io
