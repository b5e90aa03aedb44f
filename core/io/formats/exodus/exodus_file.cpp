// SPDX-License-Identifier: Apache-2.0
// Exodus II: a netCDF file with the dimensions and variables of Sjaardema, EXODUS: A Finite Element Data Model (2023). Hostile
// files are parsed by libnetcdf and libhdf5 themselves; this reader checks sizes and ranges of all they hand over, and that
// classic files are whole. Several thousand classic files with flipped bits caused no harm; of as many netCDF-4 files one crashed
// libhdf5 1.10.8 (in H5DSget_num_scales), so they can be read in a separate process, see container_mesh.h.

#include <limits>

#include "core/base/error.h"
#include "core/io/assembly/coordinate_records.h"
#include "core/io/assembly/element_mesh.h"
#include "core/io/formats/containers/container_mesh.h"
#include "core/io/formats/exodus/exodus_elements.h"
#include "core/io/formats/exodus/netcdf_classic.h"
#include "core/io/formats/exodus/netcdf_file.h"

namespace deform::io {

namespace {

using Kind = ExodusForm::Kind;

constexpr const char* axis_variables[] = {"coordx", "coordy", "coordz"};

/// Where the coordinates stand: one variable `coord`, of all x, then all y, all z; or one for each.
struct Layout {
  std::size_t axes = 3;
  bool together = false;

  std::size_t variables() const { return together ? 1 : axes; }
  const char* variable(std::size_t i) const { return together ? "coord" : axis_variables[i]; }

  std::string text() const { return std::to_string(axes) + (together ? " together" : " apart"); }
  static Layout from(const std::string& text) {
    for (const Layout& layout : {Layout{2, true}, Layout{2, false}, Layout{3, true}, Layout{3, false}}) {
      if (layout.text() == text) return layout;
    }
    throw Error(ErrorCode::internal, "unknown layout of an Exodus file: " + text);
  }
};

/// A block of elements, numbered from `first` in the whole file.
struct Block {
  ExodusForm form{Kind::points};
  std::int64_t first = 1;
  std::size_t count = 0, nodes = 0;
  std::size_t index = 0;          ///< of the first: in ElementMesh::elements or ::faces
  std::vector<PointId> points{};  ///< of edges and faces, by element; cells are in the mesh
};

class ExodusReader {
 public:
  explicit ExodusReader(const NetcdfFile& file) : file_(file) {}

  void read() {
    read_points();
    const std::size_t blocks = file_.dimension("num_el_blk").value_or(0);
    const auto names = names_of("eb_names", "eb_prop1", "block_", blocks);
    for (std::size_t b = 0; b < blocks; ++b) read_block(std::to_string(b + 1), names[b]);
    const std::size_t sides = file_.dimension("num_side_sets").value_or(0);
    const auto side_names = names_of("ss_names", "ss_prop1", "side_set_", sides);
    for (std::size_t s = 0; s < sides; ++s) read_side_set(std::to_string(s + 1), side_names[s]);
    const std::size_t nodes = file_.dimension("num_node_sets").value_or(0);
    const auto node_names = names_of("ns_names", "ns_prop1", "node_set_", nodes);
    for (std::size_t s = 0; s < nodes; ++s) read_node_set("node_ns" + std::to_string(s + 1), node_names[s]);
  }

  ElementMesh take() { return std::move(mesh_); }
  Layout layout() const { return layout_; }

 private:
  void read_points() {
    const auto axes = file_.dimension("num_dim"), count = file_.dimension("num_nodes");
    if (!axes || !count) file_.fail("", "expected an Exodus file: the dimension num_dim or num_nodes is missing");
    if (*axes != 2 && *axes != 3)
      file_.fail("num_dim", std::to_string(*axes) + " dimensions of space, only 2 and 3 are supported");
    if (*count > std::numeric_limits<PointId>::max()) file_.fail("num_nodes", "more than 2^32 - 1 nodes");
    layout_ = {*axes, file_.has("coord")};
    for (std::size_t v = 0; v < layout_.variables(); ++v) {
      const char* variable = layout_.variable(v);
      if (!file_.has(variable)) file_.fail(variable, "the variable is missing, and so is coord");
      const std::vector<double> values = file_.reals(variable);
      const std::size_t expected = *count * (layout_.together ? *axes : 1);
      if (values.size() != expected) {
        file_.fail(variable, std::to_string(values.size()) + " coordinates, expected " + std::to_string(expected));
      }
      mesh_.points.resize(*count);
      for (std::size_t i = 0; i < values.size(); ++i) mesh_.points[i % *count][layout_.together ? i / *count : v] = values[i];
    }
  }

  /// A name for each of `count`: its own, or the prefix and its id.
  std::vector<std::string> names_of(const char* names, const char* ids, const char* prefix, std::size_t count) const {
    std::vector<std::string> result;
    if (file_.has(names)) result = file_.texts(names);
    std::vector<std::int64_t> numbers;
    if (file_.has(ids)) numbers = file_.integers(ids);
    // One variable or dimension at least belongs to each.
    if (count > mesh_.points.size() + (1U << 20)) file_.fail(names, std::to_string(count) + " sets or blocks");
    result.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      if (result[i].empty())
        result[i] = prefix + std::to_string(i < numbers.size() ? numbers[i] : static_cast<std::int64_t>(i + 1));
    }
    return result;
  }

  PointId point(std::int64_t number, const std::string& variable) const {
    if (number < 1 || static_cast<std::uint64_t>(number) > mesh_.points.size()) {
      file_.fail(variable, "node " + std::to_string(number) + " is out of range 1.." + std::to_string(mesh_.points.size()));
    }
    return static_cast<PointId>(number - 1);
  }

  void read_block(const std::string& number, const std::string& name) {
    const std::string variable = "connect" + number;
    if (!file_.has(variable)) {  // an empty block, or one of polyhedra
      if (file_.has("facconn" + number) || file_.has("fbconn" + number))
        file_.fail(variable, "blocks of polyhedra are not supported");
      return skip(number);
    }
    const auto sizes = file_.lengths(variable);
    if (sizes.size() != 2) file_.fail(variable, "expected a table of elements and their nodes");
    const std::string type = file_.attribute(variable, "elem_type");
    const auto form = exodus_form(type, sizes[1]);
    if (!form) {
      file_.fail(variable,
                 "elements \"" + type + "\" of " + std::to_string(sizes[1]) +
                     " nodes are not supported; there are linear and quadratic TRI, QUAD, SHELL, TETRA, PYRAMID, WEDGE and "
                     "HEX, BAR, BEAM, TRUSS and SPHERE");
    }
    const auto numbers = file_.integers(variable);
    Block block{*form, next_element_, sizes[0], sizes[1]};
    next_element_ += static_cast<std::int64_t>(sizes[0]);
    block.index = form->kind == Kind::cell ? mesh_.elements.size() : mesh_.faces.size();
    ElementMesh::FaceSet faces{name, {}, FaceGroups::Kind::section};
    ElementMesh::PointSet points{name, {}, FaceGroups::Kind::section};
    std::vector<PointId> nodes(block.nodes);
    for (std::size_t e = 0; e < block.count; ++e) {
      for (std::size_t k = 0; k < block.nodes; ++k) nodes[k] = point(numbers[e * block.nodes + k], variable);
      if (form->kind == Kind::cell) {
        exodus_to_cgns(form->type, nodes);
        mesh_.elements.add(form->type, nodes);
        mesh_.volume_names.push_back(name);
        continue;
      }
      block.points.insert(block.points.end(), nodes.begin(), nodes.end());
      if (form->kind == Kind::face) {
        faces.faces.push_back(mesh_.faces.size());
        mesh_.add_face(nodes, "");
      } else {
        points.points.insert(points.points.end(), nodes.begin(), nodes.end());
      }
    }
    mesh_.face_sets.push_back(std::move(faces));
    mesh_.point_sets.push_back(std::move(points));
    blocks_.push_back(std::move(block));
  }

  /// Elements that are counted but not read.
  void skip(const std::string& number) {
    next_element_ += static_cast<std::int64_t>(file_.dimension("num_el_in_blk" + number).value_or(0));
  }

  void read_side_set(const std::string& number, const std::string& name) {
    const std::string variable = "elem_ss" + number;
    if (!file_.has(variable)) return;
    const auto elements = file_.integers(variable), sides = file_.integers("side_ss" + number);
    if (elements.size() != sides.size()) {
      file_.fail(variable, std::to_string(elements.size()) + " elements for " + std::to_string(sides.size()) + " sides");
    }
    ElementMesh::FaceSet faces{name, {}, FaceGroups::Kind::group};
    ElementMesh::PointSet points{name, {}, FaceGroups::Kind::group};
    for (std::size_t i = 0; i < elements.size(); ++i) {
      if (!add_side(elements[i], sides[i], faces, points)) {
        file_.fail(variable, "there is no side " + std::to_string(sides[i]) + " of element " + std::to_string(elements[i]));
      }
    }
    mesh_.face_sets.push_back(std::move(faces));
    mesh_.point_sets.push_back(std::move(points));
  }

  bool add_side(std::int64_t element, std::int64_t side, ElementMesh::FaceSet& faces, ElementMesh::PointSet& points) {
    for (const Block& block : blocks_) {
      if (element < block.first || element - block.first >= static_cast<std::int64_t>(block.count)) continue;
      const auto place = static_cast<std::size_t>(element - block.first);
      if (block.form.kind == Kind::cell) return add_cell_side(block.index + place, block.form.type, side, faces);
      const auto nodes = std::span(block.points).subspan(place * block.nodes, block.nodes);
      if (block.form.kind == Kind::face) {
        // In space sides 1 and 2 are the element itself and its edges come third; in the plane there are edges only.
        const std::int64_t before_edges = layout_.axes == 3 ? 2 : 0;
        if (side >= 1 && side <= before_edges) {
          faces.faces.push_back(block.index + place);
          return true;
        }
        if (side <= before_edges) return false;
        const auto edge = exodus_face_edge(nodes, static_cast<std::size_t>(side - before_edges - 1));
        points.points.insert(points.points.end(), edge.begin(), edge.end());
        return !edge.empty();
      }
      points.points.insert(points.points.end(), nodes.begin(), nodes.end());
      return true;
    }
    return false;
  }

  bool add_cell_side(std::size_t element, ElementType type, std::int64_t side, ElementMesh::FaceSet& faces) {
    const auto face = exodus_cell_side(type, side);
    if (!face) return false;
    const auto nodes = mesh_.elements.nodes(element);
    ElementMesh::Face surface;
    for (const std::uint8_t node : shape(type).faces[*face]) surface.corners.push_back(nodes[node]);
    const std::uint8_t centre = shape(type).face_centre(*face);
    if (centre != ElementShape::no_node) surface.centre = nodes[centre];
    faces.faces.push_back(mesh_.faces.size());
    mesh_.faces.push_back(std::move(surface));
    return true;
  }

  void read_node_set(const std::string& variable, const std::string& name) {
    if (!file_.has(variable)) return;
    ElementMesh::PointSet points{name, {}, FaceGroups::Kind::point_zone};
    for (const std::int64_t number : file_.integers(variable)) points.points.push_back(point(number, variable));
    mesh_.point_sets.push_back(std::move(points));
  }

  const NetcdfFile& file_;
  ElementMesh mesh_;
  Layout layout_;
  std::vector<Block> blocks_;
  std::int64_t next_element_ = 1;
};

ContainerMesh read(ContainerFile& file, std::size_t bytes, const std::string& name) {
  ElementMesh source;
  Layout layout;
  {
    const NetcdfFile netcdf(file, bytes, name, NetcdfFile::Access::read);
    ExodusReader reader(netcdf);
    reader.read();
    source = reader.take();
    layout = reader.layout();
  }
  return {mesh_of(std::move(source), name), layout.text(), layout.axes == 2};
}

void overwrite(ContainerFile& file, std::size_t bytes, const std::string& name, const std::string& layout_text,
               std::span<const Vec3> points) {
  const Layout layout = Layout::from(layout_text);
  NetcdfFile netcdf(file, bytes, name, NetcdfFile::Access::modify);
  for (std::size_t v = 0; v < layout.variables(); ++v) {
    const bool narrow = netcdf.is_float(layout.variable(v));
    std::vector<double> values;
    for (std::size_t axis = layout.together ? 0 : v; axis < (layout.together ? layout.axes : v + 1); ++axis) {
      for (std::size_t i = 0; i < points.size(); ++i) {
        values.push_back(points[i][axis]);
        if (narrow) as_float(points[i][axis], i, static_cast<int>(axis));
      }
    }
    netcdf.overwrite(layout.variable(v), values);
  }
  netcdf.close();
}

/// All of the header of a classic file is checked before the library sees it.
bool is_checked_classic(std::string_view bytes, const std::string& name) {
  if (!is_classic_netcdf(bytes)) return false;
  check_classic_netcdf(bytes, name);
  return true;
}

/// Undoes the growth of classic netCDF files, where the library makes room for results that do not exist yet.
void keep_size(const std::string& original, std::string& written) {
  if (is_classic_netcdf(original)) written.resize(original.size());
}

constexpr ContainerLibrary library{
    .name = "the netCDF library", .read = read, .overwrite = overwrite, .is_harmless = is_checked_classic, .restore = keep_size};

}  // namespace

Reader exodus_reader() {
  return {.format = Format::exodus, .name = "Exodus", .extensions = {".e", ".exo", ".ex2", ".g"}, .library = &library};
}

}  // namespace deform::io
