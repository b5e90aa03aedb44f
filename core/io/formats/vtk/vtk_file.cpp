// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>
#include <optional>

#include "core/base/error.h"
#include "core/io/assembly/coordinate_records.h"
#include "core/io/formats/vtk/vtk_cells.h"
#include "core/io/formats/vtk/vtk_scanner.h"
#include "core/io/readers.h"

namespace deform::io {

namespace {

constexpr VtkType plain_int{"int", 32, VtkType::Kind::signed_integer};

/// Nodes of cells, one list per keyword of the file.
struct CellLists {
  std::vector<std::uint64_t> offsets{0};
  std::vector<PointId> points;
  std::size_t size() const { return offsets.size() - 1; }
};

class VtkReader {
 public:
  VtkReader(std::string_view bytes, const std::string& name) : scanner_(bytes, name), name_(name) {}

  void read() {
    scanner_.read_header();
    const std::size_t at = scanner_.position();
    if (scanner_.keyword("DATASET") != "dataset") scanner_.fail_at(at, "expected DATASET");
    dataset_ = scanner_.keyword("the type of the data set");
    if (dataset_ != "unstructured_grid" && dataset_ != "polydata" && dataset_ != "structured_grid") {
      scanner_.fail_at(at, "DATASET \"" + dataset_.substr(0, 24) +
                               "\", only UNSTRUCTURED_GRID, POLYDATA and STRUCTURED_GRID have points to move");
    }
    while (!scanner_.at_end() && read_section()) {
    }
    if (mesh_.points.empty()) scanner_.fail_at(scanner_.position(), "the file has no POINTS");
    collect_cells();
    add_vtk_cells(cells_, name_, mesh_);
  }

  ElementMesh take() { return std::move(mesh_); }

  std::unique_ptr<MeshFile> make(std::string bytes, std::shared_ptr<const Mesh> mesh) {
    if (scanner_.binary()) return make_binary_mesh_file(Format::vtk, std::move(bytes), std::move(mesh), std::move(binary_));
    return make_text_mesh_file(Format::vtk, std::move(bytes), std::move(mesh), std::move(text_));
  }

 private:
  /// False where nothing follows that can be read.
  bool read_section() {
    const std::size_t at = scanner_.position();
    const std::string keyword = scanner_.keyword("a keyword");
    if (keyword == "points") {
      read_points(at);
    } else if (keyword == "cells") {
      read_lists(lists_[0], at);
    } else if (keyword == "vertices" || keyword == "lines" || keyword == "polygons" || keyword == "triangle_strips") {
      read_lists(lists_[keyword == "vertices" ? 0 : keyword == "lines" ? 1 : keyword == "polygons" ? 2 : 3], at);
    } else if (keyword == "cell_types") {
      read_types(at);
    } else if (keyword == "dimensions" && dataset_ == "structured_grid") {
      for (std::uint64_t& n : dimensions_) n = scanner_.count("a dimension");
    } else if (keyword == "point_data" || keyword == "cell_data") {
      attributes_of_cells_ = keyword == "cell_data";
      attributes_ = scanner_.count("the number of tuples");
    } else if (keyword == "field") {
      return read_field();
    } else if (keyword == "metadata") {
      scanner_.skip_metadata();
    } else if (attributes_) {
      return read_attribute(keyword, *attributes_);
    } else {
      scanner_.fail_at(at, "unknown keyword \"" + keyword.substr(0, 24) + "\"");
    }
    return true;
  }

  void read_points(std::size_t at) {
    if (!mesh_.points.empty()) scanner_.fail_at(at, "a second section of POINTS");
    const std::uint64_t count = scanner_.count("the number of points");
    const VtkType* type = scanner_.type();
    if (type == nullptr || type->kind != VtkType::Kind::floating) scanner_.fail_at(at, "POINTS must be of type float or double");
    scanner_.begin_array(*type, count, 3, "POINTS");
    if (count == 0 || count > most_ids) scanner_.fail_at(at, "POINTS " + std::to_string(count) + ", expected 1 to 4294967295");
    mesh_.points.resize(static_cast<std::size_t>(count));
    if (scanner_.binary()) {
      const std::uint64_t scalar = type->bits / 8;
      binary_.count = count;
      binary_.base = scanner_.position();
      binary_.record_stride = 3 * scalar;
      binary_.per_block = std::numeric_limits<std::uint32_t>::max();
      binary_.axis_offsets = {0, scalar, 2 * scalar};
      binary_.scalar_bytes = static_cast<int>(scalar);
      binary_.order = std::endian::big;
      for (Vec3& point : mesh_.points) {
        for (double& coordinate : point) coordinate = scanner_.number(*type, "a coordinate");
      }
      return;
    }
    text_.tokens.resize(mesh_.points.size());
    for (std::size_t i = 0; i < mesh_.points.size(); ++i) {
      std::size_t positions[3];
      for (int k = 0; k < 3; ++k) {
        scanner_.at_end();
        positions[k] = scanner_.position();
        mesh_.points[i][k] = scanner_.number(*type, "a coordinate");
      }
      text_.tokens[i] = CoordinateTokens::at(positions, scanner_);
    }
  }

  PointId read_id(const VtkType& type) {
    const std::size_t at = scanner_.position();
    const std::int64_t id = scanner_.integer(type, "a point of a cell");
    if (id < 0 || static_cast<std::uint64_t>(id) > most_ids)
      scanner_.fail_at(at, "point " + std::to_string(id) + " is out of range");
    return static_cast<PointId>(id);
  }

  void read_lists(CellLists& lists, std::size_t at) {
    if (lists.size() != 0) scanner_.fail_at(at, "a second section of the same cells");
    const std::uint64_t first = scanner_.count("the number of cells"), second = scanner_.count("the size of the list of cells");
    if (scanner_.major_version() >= 5) {
      if (first > 0) read_offsets(lists, first, second);
      return;
    }
    // One list: the number of points of a cell, then the points.
    scanner_.begin_array(plain_int, second, 1, "the list of cells");
    if (first > second)
      scanner_.fail_at(at, std::to_string(first) + " cells in a list of " + std::to_string(second) + " numbers");
    std::uint64_t left = second;
    for (std::uint64_t i = 0; i < first; ++i) {
      const std::size_t place = scanner_.position();
      const std::int64_t size = left > 0 ? scanner_.integer(plain_int, "the number of points of a cell") : 0;
      if (size < 0 || static_cast<std::uint64_t>(size) + 1 > left) {
        scanner_.fail_at(place, "cell " + std::to_string(i) + " of " + std::to_string(size) +
                                    " points, but the list of cells has only " + std::to_string(left) + " numbers left");
      }
      for (std::int64_t k = 0; k < size; ++k) lists.points.push_back(read_id(plain_int));
      lists.offsets.push_back(lists.points.size());
      left -= static_cast<std::uint64_t>(size) + 1;
    }
    if (left > 0) scanner_.fail_at(scanner_.position(), "the list of cells has " + std::to_string(left) + " numbers too many");
  }

  const VtkType& integer_type(std::string_view keyword) {
    scanner_.at_end();
    const std::size_t at = scanner_.position();
    if (scanner_.keyword("OFFSETS or CONNECTIVITY") != keyword) {
      scanner_.fail_at(at, "expected " + std::string(keyword == "offsets" ? "OFFSETS" : "CONNECTIVITY"));
    }
    const VtkType* type = scanner_.type();
    if (type == nullptr || type->bits < 8 || type->kind == VtkType::Kind::floating)
      scanner_.fail_at(at, "expected an integer type");
    return *type;
  }

  void read_offsets(CellLists& lists, std::uint64_t offsets, std::uint64_t points) {
    const VtkType& offset_type = integer_type("offsets");
    scanner_.begin_array(offset_type, offsets, 1, "OFFSETS");
    lists.offsets.clear();
    for (std::uint64_t i = 0; i < offsets; ++i) {
      const std::size_t at = scanner_.position();
      const std::int64_t offset = scanner_.integer(offset_type, "an offset");
      const std::int64_t least = i == 0 ? 0 : static_cast<std::int64_t>(lists.offsets.back());
      if (offset < least || static_cast<std::uint64_t>(offset) > points || (i == 0 && offset != 0)) {
        scanner_.fail_at(at, "OFFSETS[" + std::to_string(i) + "] is " + std::to_string(offset) +
                                 ", they must rise from 0 to the size of CONNECTIVITY, " + std::to_string(points));
      }
      lists.offsets.push_back(static_cast<std::uint64_t>(offset));
    }
    if (lists.offsets.back() != points) {
      scanner_.fail_at(scanner_.position(), "the last offset is " + std::to_string(lists.offsets.back()) +
                                                ", the size of CONNECTIVITY " + std::to_string(points));
    }
    const VtkType& id_type = integer_type("connectivity");
    scanner_.begin_array(id_type, points, 1, "CONNECTIVITY");
    lists.points.reserve(static_cast<std::size_t>(points));
    for (std::uint64_t i = 0; i < points; ++i) lists.points.push_back(read_id(id_type));
  }

  void read_types(std::size_t at) {
    const std::uint64_t count = scanner_.count("the number of cells");
    scanner_.begin_array(plain_int, count, 1, "CELL_TYPES");
    if (!types_.empty()) scanner_.fail_at(at, "a second section of CELL_TYPES");
    types_.reserve(static_cast<std::size_t>(count));
    for (std::uint64_t i = 0; i < count; ++i) {
      const std::size_t place = scanner_.position();
      const std::int64_t type = scanner_.integer(plain_int, "the type of a cell");
      if (type < 0 || type > 255) scanner_.fail_at(place, "cell type " + std::to_string(type) + " is out of range 0..255");
      types_.push_back(static_cast<std::uint8_t>(type));
    }
  }

  /// Past an array, whose values are kept when they may name groups of cells. False when its type is not known.
  bool read_values(const std::string& name, const VtkType* type, std::uint64_t tuples, std::uint64_t components) {
    if (type == nullptr) {
      if (!attributes_) scanner_.fail_at(scanner_.position(), "array \"" + name.substr(0, 24) + "\" is of an unknown type");
      return false;
    }
    scanner_.begin_array(*type, tuples, components, "an array");
    const bool integers = type->bits >= 8 && type->kind != VtkType::Kind::floating && type->kind != VtkType::Kind::text;
    if (!integers || !attributes_ || !attributes_of_cells_ || components != 1 || tuples != *attributes_) {
      scanner_.skip_array(*type, tuples * components);
      return true;
    }
    std::vector<std::int64_t> values(static_cast<std::size_t>(tuples));
    for (std::int64_t& value : values) value = scanner_.integer(*type, "a value");
    cells_.offer_labels(name, std::move(values));
    return true;
  }

  bool read_field() {
    scanner_.word("the name of a field");
    const std::uint64_t arrays = scanner_.count("the number of arrays");
    for (std::uint64_t i = 0; i < arrays; ++i) {
      std::string name = scanner_.word("the name of an array");
      while (name == "METADATA") {
        scanner_.skip_metadata();
        name = scanner_.word("the name of an array");
      }
      const std::uint64_t components = scanner_.count("the number of components");
      const std::uint64_t tuples = scanner_.count("the number of tuples");
      if (!read_values(name, scanner_.type(), tuples, components)) return false;
    }
    return true;
  }

  /// Returns false for an unknown keyword; the length of its data is then unknown too, and the data are not needed.
  bool read_attribute(const std::string& keyword, std::uint64_t tuples) {
    static const std::pair<std::string_view, std::uint64_t> fixed[] = {{"vectors", 3},    {"normals", 3},    {"tensors", 9},
                                                                       {"tensors6", 6},   {"global_ids", 1}, {"pedigree_ids", 1},
                                                                       {"edge_flags", 1}, {"process_ids", 1}};
    const std::string name = scanner_.at_end() ? std::string() : scanner_.word("the name of an array");
    for (const auto& [attribute, components] : fixed) {
      if (keyword == attribute) return read_values(name, scanner_.type(), tuples, components);
    }
    if (keyword == "scalars") {
      const VtkType* type = scanner_.type();
      const std::uint64_t components = scanner_.more_in_line() ? scanner_.count("the number of components") : 1;
      const std::size_t at = scanner_.position();
      if (scanner_.at_end() || scanner_.keyword("LOOKUP_TABLE") != "lookup_table") {
        scanner_.move_to(at);
      } else {
        scanner_.word("the name of a lookup table");
      }
      return read_values(name, type, tuples, components);
    }
    if (keyword == "texture_coordinates") {
      const std::uint64_t components = scanner_.count("the number of components");
      return read_values(name, scanner_.type(), tuples, components);
    }
    // Colours are bytes in binary files and fractions in text.
    static constexpr VtkType bytes{"unsigned_char", 8, VtkType::Kind::unsigned_integer},
        fractions{"float", 32, VtkType::Kind::floating};
    const VtkType* colour = scanner_.binary() ? &bytes : &fractions;
    if (keyword == "color_scalars") return skip_colours(colour, tuples, scanner_.count("the number of components"));
    if (keyword == "lookup_table") return skip_colours(colour, scanner_.count("the size of a lookup table"), 4);
    return false;
  }

  bool skip_colours(const VtkType* type, std::uint64_t tuples, std::uint64_t components) {
    scanner_.begin_array(*type, tuples, components, "colours");
    scanner_.skip_array(*type, tuples * components);
    return true;
  }

  void collect_cells() {
    if (dataset_ == "structured_grid") return add_lattice();
    if (dataset_ == "unstructured_grid") {
      if (types_.size() != lists_[0].size()) {
        scanner_.fail_at(scanner_.position(), "there are " + std::to_string(lists_[0].size()) + " CELLS, but " +
                                                  std::to_string(types_.size()) + " CELL_TYPES");
      }
      return add_lists(lists_[0], types_);
    }
    const std::uint8_t types[] = {vtk::poly_vertex, vtk::poly_line, vtk::polygon, vtk::strip};  // numbered in this order
    for (std::size_t i = 0; i < 4; ++i) add_lists(lists_[i], std::vector<std::uint8_t>(lists_[i].size(), types[i]));
  }

  void add_lists(const CellLists& lists, const std::vector<std::uint8_t>& types) {
    for (std::size_t i = 0; i < lists.size(); ++i) {
      const std::span points =
          std::span(lists.points).subspan(lists.offsets[i], static_cast<std::size_t>(lists.offsets[i + 1] - lists.offsets[i]));
      cells_.add(types[i], points);
    }
  }

  void add_lattice() {
    const auto [nx, ny, nz] = dimensions_;
    const std::uint64_t points = mesh_.points.size();
    if (nx == 0 || ny == 0 || nz == 0 || nx > points || ny > points || nz > points || nx * ny > points ||
        nx * ny * nz != points) {
      scanner_.fail_at(scanner_.position(), "DIMENSIONS " + std::to_string(nx) + " " + std::to_string(ny) + " " +
                                                std::to_string(nz) + " do not give the " + std::to_string(points) +
                                                " points of the file");
    }
    const std::uint64_t strides[3] = {1, nx, nx * ny};
    std::vector<std::uint64_t> wide;  // strides of the axes that have an extent
    for (std::size_t k = 0; k < 3; ++k) {
      if (dimensions_[k] > 1) wide.push_back(strides[k]);
    }
    if (wide.size() < 2) return;
    const auto cells = [](std::uint64_t n) { return std::max<std::uint64_t>(n, 2) - 1; };
    for (std::uint64_t k = 0; k < cells(nz); ++k) {
      for (std::uint64_t j = 0; j < cells(ny); ++j) {
        for (std::uint64_t i = 0; i < cells(nx); ++i) add_brick(i + j * strides[1] + k * strides[2], wide);
      }
    }
  }

  void add_brick(std::uint64_t corner, const std::vector<std::uint64_t>& strides) {
    std::vector<PointId> nodes;
    for (const std::uint64_t top : {std::uint64_t{0}, strides.size() == 3 ? strides[2] : 0}) {
      if (top == 0 && !nodes.empty()) break;
      for (const std::uint64_t step : {std::uint64_t{0}, strides[0], strides[0] + strides[1], strides[1]}) {
        nodes.push_back(static_cast<PointId>(corner + step + top));
      }
    }
    cells_.add(strides.size() == 3 ? vtk::hexahedron : vtk::quad, nodes);
  }

  VtkScanner scanner_;
  const std::string& name_;
  std::string dataset_;
  ElementMesh mesh_;
  TextRecords text_;
  BinaryRecords binary_;
  CellLists lists_[4];  // cells; or vertices, lines, polygons, strips
  std::vector<std::uint8_t> types_;
  std::array<std::uint64_t, 3> dimensions_{};
  std::optional<std::uint64_t> attributes_;  // tuples of the data now being read
  bool attributes_of_cells_ = false;
  VtkCells cells_;
};

std::unique_ptr<MeshFile> parse_vtk(std::string bytes, const std::string& name) {
  VtkReader reader(bytes, name);
  reader.read();
  std::shared_ptr<const Mesh> mesh = mesh_of(reader.take(), name);
  return reader.make(std::move(bytes), std::move(mesh));
}

}  // namespace

Reader vtk_reader() { return {.format = Format::vtk, .name = "VTK", .extensions = {".vtk"}, .parse = parse_vtk}; }

}  // namespace deform::io
