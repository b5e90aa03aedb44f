// SPDX-License-Identifier: Apache-2.0
#include "core/base/error.h"
#include "core/io/assembly/coordinate_records.h"
#include "core/io/formats/vtk/vtk_cells.h"
#include "core/io/readers.h"
#include "core/io/text/text_scanner.h"

namespace deform::io {

namespace {

/// 0 for types that SU2 does not support.
std::size_t node_count(std::int64_t type) {
  switch (type) {
    case vtk::vertex:
      return 1;
    case vtk::line:
      return 2;
    case vtk::triangle:
      return 3;
    case vtk::quad:
    case vtk::tetrahedron:
      return 4;
    case vtk::pyramid:
      return 5;
    case vtk::wedge:
      return 6;
    case vtk::hexahedron:
      return 8;
    default:
      return 0;
  }
}

struct Statement {
  std::string_view keyword;
  std::size_t line, value;  ///< byte offsets of the line and of the text after the =
};

class Su2Reader {
 public:
  Su2Reader(std::string_view bytes, const std::string& name) : scanner_(bytes, name, Syntax::percent), size_(bytes.size()) {}

  void read(const std::string& name) {
    find_statements();
    for (const Statement& statement : statements_) read_header(statement);
    if (dimension_ == 0) scanner_.fail("expected a SU2 mesh, but there is no NDIME=");
    if (point_count_ == 0) scanner_.fail("the file has no NPOIN=");
    for (const Statement& statement : statements_) {
      scanner_.move_to(statement.value);
      if (statement.keyword == "NPOIN") {
        read_points(statement);
      } else if (statement.keyword == "NELEM") {
        read_elements(statement);
      } else if (statement.keyword == "MARKER_TAG") {
        read_tag();
      } else if (statement.keyword == "MARKER_ELEMS") {
        read_marker(statement);
      }
    }
    add_vtk_cells(cells_, name, mesh_);
  }

  ElementMesh take() { return std::move(mesh_); }
  TextRecords take_records() { return std::move(records_); }

 private:
  /// Sections come in any order, and elements are checked against the number of points.
  void find_statements() {
    for (; scanner_.next_in_file(); scanner_.skip_line()) {
      const char c = scanner_.peek();
      if (!((c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z'))) continue;
      const std::size_t line = scanner_.position();
      std::string_view text = scanner_.rest_of_line();
      const std::size_t equals = text.find('=');
      if (equals == std::string_view::npos) continue;
      std::string_view keyword = text.substr(0, equals);
      while (!keyword.empty() && (keyword.back() == ' ' || keyword.back() == '\t')) keyword.remove_suffix(1);
      statements_.push_back({keyword, line, line + equals + 1});
    }
  }

  void read_header(const Statement& statement) {
    scanner_.move_to(statement.value);
    if (statement.keyword == "NDIME") {
      if (dimension_ != 0) scanner_.fail_at(statement.line, "a second NDIME=, meshes of several zones are not supported");
      const std::int64_t dimension = value("NDIME");
      if (dimension != 2 && dimension != 3) {
        scanner_.fail_at(statement.line, "NDIME= " + std::to_string(dimension) + ", only 2 and 3 are supported");
      }
      dimension_ = static_cast<int>(dimension);
    } else if (statement.keyword == "NZONE") {
      const std::int64_t zones = value("NZONE");
      if (zones != 1) scanner_.fail_at(statement.line, "NZONE= " + std::to_string(zones) + ", only one zone is supported");
    } else if (statement.keyword == "NPOIN") {
      if (point_count_ != 0) scanner_.fail_at(statement.line, "a second NPOIN=, meshes of several zones are not supported");
      point_count_ = count("NPOIN", 4);
      if (point_count_ == 0) scanner_.fail_at(statement.line, "NPOIN= 0, at least one point is needed");
    }
  }

  std::int64_t value(const char* what) {
    if (!scanner_.next_in_line()) scanner_.fail(std::string("expected a number behind ") + what + "=");
    return scanner_.whole_integer(what);
  }

  std::size_t count(const char* what, std::size_t least_bytes) {
    const std::size_t at = scanner_.position();
    const std::int64_t count = value(what);
    const std::size_t left = size_ - scanner_.position();
    if (count < 0 || static_cast<std::uint64_t>(count) > left / least_bytes + 1) {
      scanner_.fail_at(at, std::string(what) + "= " + std::to_string(count) + ", the file has only " + std::to_string(left) +
                               " bytes left for them");
    }
    return static_cast<std::size_t>(count);
  }

  /// Moves to the next line of a section; the rest of the previous one is its index, which is ignored.
  void next_line(const Statement& section, std::size_t read, std::size_t count) {
    scanner_.skip_line();
    if (scanner_.next_in_file()) return;
    scanner_.fail("the file ends in " + std::string(section.keyword) + "= " + std::to_string(count) + " behind " +
                  std::to_string(read) + " lines");
  }

  void end_section(const Statement& section, std::size_t count) {
    scanner_.skip_line();
    if (!scanner_.next_in_file()) return;
    const char c = scanner_.peek();
    if ((c >= '0' && c <= '9') || c == '-' || c == '+' || c == '.') {
      scanner_.fail("expected a keyword behind the " + std::to_string(count) + " lines of " + std::string(section.keyword) +
                    "=, found " + scanner_.quoted());
    }
  }

  void read_points(const Statement& section) {
    mesh_.points.resize(point_count_);
    records_.tokens.resize(point_count_);
    records_.dimensions = dimension_;
    for (std::size_t i = 0; i < point_count_; ++i) {
      next_line(section, i, point_count_);
      std::size_t positions[3] = {0, 0, 0};
      for (int k = 0; k < dimension_; ++k) {
        if (!scanner_.next_in_line()) scanner_.fail("expected " + std::to_string(dimension_) + " coordinates of a point");
        positions[k] = scanner_.position();
        mesh_.points[i][k] = scanner_.number("a coordinate");
      }
      if (dimension_ == 2) positions[2] = positions[0];
      records_.tokens[i] = CoordinateTokens::at(positions, scanner_);
    }
    end_section(section, point_count_);
  }

  /// Type and nodes of the element at the cursor.
  std::uint8_t read_element(std::size_t number, const Statement& section) {
    const std::size_t at = scanner_.position();
    const std::int64_t type = scanner_.whole_integer("the type of an element");
    const std::size_t nodes = node_count(type);
    const std::string element = std::string(section.keyword) + "[" + std::to_string(number) + "]: ";
    if (nodes == 0) {
      scanner_.fail_at(at, element + "type " + std::to_string(type) + " is none of 1, 3, 5, 9, 10, 12, 13 and 14");
    }
    if (dimension_ == 2 && type >= vtk::tetrahedron) {
      scanner_.fail_at(at, element + "type " + std::to_string(type) + " is a volume, but NDIME= 2");
    }
    nodes_.resize(nodes);
    for (PointId& node : nodes_) {
      if (!scanner_.next_in_line()) scanner_.fail(element + "expected " + std::to_string(nodes) + " points");
      const std::size_t place = scanner_.position();
      const std::int64_t index = scanner_.whole_integer("a point of an element");
      if (index < 0 || static_cast<std::uint64_t>(index) >= point_count_) {
        scanner_.fail_at(place,
                         element + "point " + std::to_string(index) + " is out of range 0.." + std::to_string(point_count_ - 1));
      }
      node = static_cast<PointId>(index);
    }
    return static_cast<std::uint8_t>(type);
  }

  void read_elements(const Statement& section) {
    if (cells_.size() != 0) scanner_.fail_at(section.line, "a second NELEM=, meshes of several zones are not supported");
    const std::size_t elements = count("NELEM", 4);
    for (std::size_t e = 0; e < elements; ++e) {
      next_line(section, e, elements);
      const std::uint8_t type = read_element(e, section);
      cells_.add(type, nodes_);
    }
    end_section(section, elements);
  }

  void read_tag() {
    if (!scanner_.next_in_line()) scanner_.fail("MARKER_TAG= without a name");
    tag_ = scanner_.name();
  }

  /// Markers that are the seams of partitions name their partner (SEND_RECV=) between the count and the elements.
  void skip_partner() {
    const std::size_t at = scanner_.position();
    scanner_.skip_line();
    if (!scanner_.next_in_file() || !scanner_.rest_of_line().starts_with("SEND_")) scanner_.move_to(at);
  }

  void read_marker(const Statement& section) {
    if (tag_.empty()) scanner_.fail_at(section.line, "MARKER_ELEMS= without a MARKER_TAG= before it");
    const std::size_t elements = count("MARKER_ELEMS", 4);
    skip_partner();
    ElementMesh::PointSet set{tag_, {}};
    for (std::size_t e = 0; e < elements; ++e) {
      next_line(section, e, elements);
      const std::size_t at = scanner_.position();
      const std::uint8_t type = read_element(e, section);
      if (type >= vtk::tetrahedron)
        scanner_.fail_at(at, "MARKER_ELEMS[" + std::to_string(e) + "]: a volume cannot bound the mesh");
      if (type == vtk::triangle || type == vtk::quad) {
        if (dimension_ == 2) scanner_.fail_at(at, "MARKER_ELEMS[" + std::to_string(e) + "]: a surface, but NDIME= 2");
        mesh_.faces.push_back({nodes_, tag_});
      } else {
        set.points.insert(set.points.end(), nodes_.begin(), nodes_.end());
      }
    }
    if (!set.points.empty()) mesh_.point_sets.push_back(std::move(set));
    end_section(section, elements);
    tag_.clear();
  }

  TextScanner scanner_;
  const std::size_t size_;
  std::vector<Statement> statements_;
  int dimension_ = 0;
  std::size_t point_count_ = 0;
  std::string tag_;
  std::vector<PointId> nodes_;  // of the element just read
  VtkCells cells_;
  ElementMesh mesh_;
  TextRecords records_;
};

std::unique_ptr<MeshFile> parse_su2(std::string bytes, const std::string& name) {
  Su2Reader reader(bytes, name);
  reader.read(name);
  return make_text_mesh_file(Format::su2, std::move(bytes), mesh_of(reader.take(), name), reader.take_records());
}

}  // namespace

Reader su2_reader() { return {.format = Format::su2, .name = "SU2", .extensions = {".su2"}, .parse = parse_su2}; }

}  // namespace deform::io
