// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/vtk/vtu_reader.h"

#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "core/io/binary/byte_order.h"
#include "core/io/readers.h"
#include "core/io/text/text_scanner.h"

namespace deform::io {

namespace {

using Integers = std::vector<std::int64_t>;

class VtuReader {
 public:
  VtuReader(std::string_view bytes, const std::string& name) : bytes_(bytes), name_(name) {}

  VtuContent read(std::string_view type) {
    const XmlNode root = parse_xml(bytes_, name_, "AppendedData");
    if (root.name != "VTKFile" || value_of(root, "type") != type) {
      fail(root, "expected <VTKFile type=\"" + std::string(type) + "\">");
    }
    content_.storage = read_storage(bytes_, name_, root);
    const XmlNode* grid = root.child(type);
    if (grid == nullptr) fail(root, "there is no <" + std::string(type) + ">");
    std::size_t pieces = 0;
    for (const XmlNode& piece : grid->children) {
      if (piece.name != "Piece") continue;
      ++pieces;
      read_points(piece);
      read_cells(piece, type);
    }
    if (pieces == 0) fail(*grid, "there is no <Piece>");
    if (content_.mesh.points.empty()) fail(*grid, "there are no points, at least one is needed");
    for (auto& [title, values] : labels_) {
      if (values.size() == cells_.size()) cells_.offer_labels(title, std::move(values));
    }
    find_offsets(root);
    check_appended_points();
    add_vtk_cells(cells_, name_, content_.mesh);
    return std::move(content_);
  }

 private:
  [[noreturn]] void fail(const XmlNode& node, const std::string& message) const {
    fail_in_line(bytes_, name_, node.place, message);
  }

  std::string_view value_of(const XmlNode& node, std::string_view attribute) const {
    const XmlNode::Attribute* found = node.find(attribute);
    return found == nullptr ? std::string_view() : bytes_.substr(found->begin, found->end - found->begin);
  }

  std::uint64_t count(const XmlNode& node, std::string_view attribute) const {
    return count_attribute(bytes_, name_, node, attribute, 0);
  }

  // ---- points ----

  void read_points(const XmlNode& piece) {
    VtuPoints points;
    const std::uint64_t points_of_piece = count(piece, "NumberOfPoints");
    points.first = content_.mesh.points.size();
    first_point_ = points.first;
    point_count_ = points_of_piece;
    const XmlNode* node = nullptr;
    if (const XmlNode* parent = piece.child("Points")) {
      for (const XmlNode& child : parent->children) {
        if (child.name != "DataArray") continue;
        if (node != nullptr) fail(child, "a second array of points, time steps are not supported");
        node = &child;
      }
    }
    if (points_of_piece == 0) return;
    if (node == nullptr)
      fail(piece, "NumberOfPoints is " + std::to_string(points_of_piece) + ", but there is no array in <Points>");
    points.array = find_array(bytes_, content_.storage, *node);
    if (points.array.kind != VtuArray::Kind::floating || points.array.components != 3) {
      fail(*node, "points must be Float32 or Float64 with 3 components");
    }
    if (points_of_piece > most_ids - points.first) fail(piece, "more than 4294967295 points");
    points.count = static_cast<std::size_t>(points_of_piece);
    if (points.array.form == VtuArray::Form::ascii) {
      read_text(points, *node);
    } else {
      read_binary(points, *node);
    }
    find_ranges(points, *node);
    content_.pieces.push_back(std::move(points));
  }

  [[noreturn]] void wrong_size(const XmlNode& node, std::uint64_t points, const std::string& found) const {
    fail(node, "points: " + std::to_string(points) + " points need " + std::to_string(3 * points) + " numbers, found " + found);
  }

  void read_text(VtuPoints& points, const XmlNode& node) {
    const std::size_t length = points.array.end - points.array.begin;
    if (points.count > length / 6 + 1) wrong_size(node, points.count, std::to_string(length) + " characters");
    TextScanner scanner(bytes_.substr(0, points.array.end), name_, Syntax::plain);
    scanner.move_to(points.array.begin);
    auto& all = content_.mesh.points;
    all.resize(points.first + points.count);
    points.tokens.resize(points.count);
    for (std::size_t i = 0; i < points.count; ++i) {
      std::size_t positions[3];
      for (int k = 0; k < 3; ++k) {
        if (!scanner.next_in_file()) wrong_size(node, points.count, std::to_string(3 * i + static_cast<std::size_t>(k)));
        positions[k] = scanner.position();
        all[points.first + i][k] = scanner.number("a coordinate");
      }
      points.tokens[i] = CoordinateTokens::at(positions, scanner);
    }
    if (scanner.next_in_file()) wrong_size(node, points.count, "more");
  }

  void read_binary(VtuPoints& points, const XmlNode& node) {
    const VtuData data = decoded(bytes_, content_.storage, points.array);
    const std::size_t stride = points.array.value_bytes;
    if (data.values.size() % (3 * stride) != 0 || data.values.size() / (3 * stride) != points.count) {
      wrong_size(node, points.count, std::to_string(data.values.size()) + " bytes of " + std::to_string(stride) + " for each");
    }
    points.array.end = data.end;
    auto& all = content_.mesh.points;
    all.resize(points.first + points.count);
    const char* at = data.values.data();
    for (std::size_t i = 0; i < points.count; ++i) {
      for (int k = 0; k < 3; ++k, at += stride) {
        const double value = load_coordinate(at, content_.storage, points.array);
        if (!std::isfinite(value)) {
          fail(node,
               "points: coordinate " + std::string(1, "xyz"[k]) + " of point " + std::to_string(i) + " is not a finite number");
        }
        all[points.first + i][k] = value;
      }
    }
  }

  /// Attributes, and the keys that VTK keeps beside them.
  void find_ranges(VtuPoints& points, const XmlNode& node) const {
    using Bound = VtuPoints::Range::Bound;
    const auto add = [&](std::size_t begin, std::size_t end, Bound bound) {
      if (begin != end) points.ranges.push_back({begin, end, bound});
    };
    if (const auto* least = node.find("RangeMin")) add(least->begin, least->end, Bound::least);
    if (const auto* largest = node.find("RangeMax")) add(largest->begin, largest->end, Bound::largest);
    for (const XmlNode& key : node.children) {
      const std::string_view title = value_of(key, "name");
      if (title != "L2_NORM_RANGE" && title != "L2_NORM_FINITE_RANGE") continue;
      for (const XmlNode& value : key.children) {
        const bool first = value_of(value, "index") == "0";
        if (value.text_begin == value.text_end || (!first && value_of(value, "index") != "1")) continue;
        add(value.text_begin, value.text_end, first ? Bound::least : Bound::largest);
      }
    }
  }

  void find_offsets(const XmlNode& node) {
    if (const auto* offset = node.find("offset"); offset != nullptr && value_of(node, "format") == "appended") {
      content_.offsets.push_back({offset->begin, offset->end, count(node, "offset")});
    }
    for (const XmlNode& child : node.children) find_offsets(child);
  }

  /// An array that shares its bytes with the points would change with them.
  void check_appended_points() const {
    for (const VtuPoints& points : content_.pieces) {
      if (points.array.form != VtuArray::Form::appended_raw && points.array.form != VtuArray::Form::appended_base64) continue;
      std::size_t users = 0;
      for (const VtuOffset& offset : content_.offsets) {
        const std::uint64_t at = content_.storage.appended + offset.value;
        users += at >= points.array.begin && at < points.array.end ? 1 : 0;
      }
      for (const VtuArray& other : read_) {
        users += other.begin < points.array.begin && other.end > points.array.begin && other.form == points.array.form ? 1 : 0;
      }
      if (users > 1) {
        fail_in_line(bytes_, name_, points.array.begin, points.array.title + ": another array shares its appended data");
      }
    }
  }

  // ---- cells ----

  Integers array(const XmlNode& parent, std::string_view title) {
    for (const XmlNode& node : parent.children) {
      if (node.name == "DataArray" && value_of(node, "Name") == title) {
        VtuArray place = find_array(bytes_, content_.storage, node);
        Integers values = integers(bytes_, content_.storage, place);
        read_.push_back(std::move(place));
        return values;
      }
    }
    fail(parent, "there is no DataArray \"" + std::string(title) + "\"");
  }

  bool has_array(const XmlNode& parent, std::string_view title) const {
    return std::any_of(parent.children.begin(), parent.children.end(),
                       [&](const XmlNode& node) { return value_of(node, "Name") == title; });
  }

  /// A point of the piece as one of the mesh.
  PointId point(std::int64_t id, const XmlNode& node) const {
    if (id < 0 || static_cast<std::uint64_t>(id) >= point_count_) {
      fail(node, "point " + std::to_string(id) + " is out of range, the piece has " + std::to_string(point_count_) + " points");
    }
    return static_cast<PointId>(first_point_ + static_cast<std::uint64_t>(id));
  }

  /// Checks that the ends rise to `size`, and gives them with a 0 in front.
  Integers offsets(const XmlNode& parent, std::string_view title, std::size_t size) {
    Integers ends = array(parent, title);
    // Only ends stand there; of lists of faces some programs write the 0 as well, and no face is empty.
    if (title != "face_offsets" || ends.empty() || ends.front() != 0) ends.insert(ends.begin(), 0);
    for (std::size_t i = 1; i < ends.size(); ++i) {
      if (ends[i] >= ends[i - 1] && static_cast<std::uint64_t>(ends[i]) <= size) continue;
      fail(parent, std::string(title) + "[" + std::to_string(i - 1) + "] is " + std::to_string(ends[i]) + ", expected " +
                       std::to_string(ends[i - 1]) + ".." + std::to_string(size));
    }
    return ends;
  }

  void read_cells(const XmlNode& piece, std::string_view type) {
    const std::size_t first = cells_.size();
    if (type == "UnstructuredGrid") {
      const XmlNode* node = piece.child("Cells");
      const std::uint64_t cells = count(piece, "NumberOfCells");
      if (cells > 0 && node == nullptr) fail(piece, "NumberOfCells is " + std::to_string(cells) + ", but there is no <Cells>");
      if (cells > 0) read_grid_cells(*node, cells);
    } else {
      // Numbered in this order.
      static constexpr std::pair<const char*, std::uint8_t> parts[] = {{"Verts", 2}, {"Lines", 4}, {"Polys", 7}, {"Strips", 6}};
      for (const auto& [part, cell_type] : parts) {
        const std::uint64_t cells = count(piece, std::string("NumberOf") + part);
        const XmlNode* node = piece.child(part);
        if (cells > 0 && node == nullptr) fail(piece, "there is no <" + std::string(part) + ">");
        if (cells > 0) read_list(*node, cells, {}, cell_type);
      }
    }
    read_labels(piece, cells_.size() - first);
  }

  /// `types` of the cells, or all of one type when there are none.
  void read_list(const XmlNode& node, std::uint64_t cells, const Integers& types, std::uint8_t type) {
    const Integers connectivity = array(node, "connectivity");
    const Integers ends = offsets(node, "offsets", connectivity.size());
    if (ends.size() != cells + 1) {
      fail(node,
           "offsets has " + std::to_string(ends.size() - 1) + " values, the piece claims " + std::to_string(cells) + " cells");
    }
    std::vector<PointId> nodes;
    for (std::size_t i = 0; i < cells; ++i) {
      nodes.clear();
      if (types.empty() || types[i] != VtkCells::polyhedron) {
        for (std::int64_t k = ends[i]; k < ends[i + 1]; ++k)
          nodes.push_back(point(connectivity[static_cast<std::size_t>(k)], node));
      } else {
        add_faces(i, nodes, node);
      }
      cells_.add(types.empty() ? type : static_cast<std::uint8_t>(types[i]), nodes);
    }
  }

  void read_grid_cells(const XmlNode& node, std::uint64_t cells) {
    const Integers types = array(node, "types");
    if (types.size() != cells) {
      fail(node, "types has " + std::to_string(types.size()) + " values, the piece claims " + std::to_string(cells) + " cells");
    }
    bool polyhedra = false;
    for (const std::int64_t type : types) {
      if (type < 0 || type > 255) fail(node, "cell type " + std::to_string(type) + " is out of range 0..255");
      polyhedra = polyhedra || type == VtkCells::polyhedron;
    }
    if (polyhedra) read_faces(node, cells);
    read_list(node, cells, types, 0);
  }

  // ---- polyhedra: one stream of all their faces, or (since VTK 9.4) lists of faces ----

  void read_faces(const XmlNode& node, std::uint64_t cells) {
    shared_faces_ = has_array(node, "face_connectivity");
    if (shared_faces_) {
      face_points_ = array(node, "face_connectivity");
      face_ends_ = offsets(node, "face_offsets", face_points_.size());
      cell_faces_ = array(node, "polyhedron_to_faces");
      cell_ends_ = offsets(node, "polyhedron_offsets", cell_faces_.size());
      if (cell_ends_.size() == cells + 2 && cell_ends_[1] == 0) cell_ends_.erase(cell_ends_.begin());  // the 0 stood there
    } else {
      cell_faces_ = array(node, "faces");
      cell_ends_ = array(node, "faceoffsets");
      cell_ends_.insert(cell_ends_.begin(), 0);
      // The offset of cells that are no polyhedra is -1.
      for (std::size_t i = 1; i < cell_ends_.size(); ++i) {
        if (cell_ends_[i] < 0) cell_ends_[i] = cell_ends_[i - 1];
        if (cell_ends_[i] >= cell_ends_[i - 1] && static_cast<std::uint64_t>(cell_ends_[i]) <= cell_faces_.size()) continue;
        fail(node, "faceoffsets[" + std::to_string(i - 1) + "] is " + std::to_string(cell_ends_[i]) + ", expected " +
                       std::to_string(cell_ends_[i - 1]) + ".." + std::to_string(cell_faces_.size()));
      }
    }
    if (cell_ends_.size() != cells + 1) {
      fail(node, "the faces are given for " + std::to_string(cell_ends_.size() - 1) + " of " + std::to_string(cells) + " cells");
    }
  }

  void add_faces(std::size_t cell, std::vector<PointId>& stream, const XmlNode& node) const {
    const auto first = static_cast<std::size_t>(cell_ends_[cell]), last = static_cast<std::size_t>(cell_ends_[cell + 1]);
    if (shared_faces_) {
      stream.push_back(static_cast<PointId>(last - first));
      for (std::size_t f = first; f < last; ++f) {
        if (cell_faces_[f] < 0 || static_cast<std::uint64_t>(cell_faces_[f]) + 1 >= face_ends_.size()) {
          fail(node, "polyhedron_to_faces[" + std::to_string(f) + "] is " + std::to_string(cell_faces_[f]) + ", there are " +
                         std::to_string(face_ends_.size() - 1) + " faces");
        }
        const auto face = static_cast<std::size_t>(cell_faces_[f]);
        stream.push_back(static_cast<PointId>(face_ends_[face + 1] - face_ends_[face]));
        for (std::int64_t k = face_ends_[face]; k < face_ends_[face + 1]; ++k) {
          stream.push_back(point(face_points_[static_cast<std::size_t>(k)], node));
        }
      }
      return;
    }
    // The counts in the stream are checked with the cell; here points are distinguished from counts.
    std::size_t corners = 0;
    for (std::size_t at = first; at < last; ++at) {
      const std::int64_t value = cell_faces_[at];
      if (at > first && corners > 0) {
        stream.push_back(point(value, node));
        --corners;
        continue;
      }
      if (value < 0 || static_cast<std::uint64_t>(value) > cell_faces_.size()) {
        fail(node, "faces[" + std::to_string(at) + "] is " + std::to_string(value) + ", expected a count");
      }
      if (at > first) corners = static_cast<std::size_t>(value);
      stream.push_back(static_cast<PointId>(value));
    }
  }

  // ---- groups ----

  void read_labels(const XmlNode& piece, std::size_t cells) {
    const XmlNode* data = piece.child("CellData");
    if (data == nullptr || cells == 0) return;
    for (const XmlNode& node : data->children) {
      if (!is_numeric(bytes_, node)) continue;
      VtuArray place = find_array(bytes_, content_.storage, node);
      if (place.kind == VtuArray::Kind::floating || place.components != 1) continue;
      const Integers values = integers(bytes_, content_.storage, place);
      if (values.size() != cells) {
        fail(node,
             place.title + ": " + std::to_string(values.size()) + " values, the piece has " + std::to_string(cells) + " cells");
      }
      read_.push_back(std::move(place));
      Integers& all = labels_of(xml_text(value_of(node, "Name")));
      all.insert(all.end(), values.begin(), values.end());
    }
  }

  Integers& labels_of(const std::string& title) {
    for (auto& [known, values] : labels_) {
      if (known == title) return values;
    }
    return labels_.emplace_back(title, Integers()).second;
  }

  const std::string_view bytes_;
  const std::string& name_;
  VtuContent content_;
  std::vector<VtuArray> read_;  // arrays of integers
  VtkCells cells_;
  std::vector<std::pair<std::string, Integers>> labels_;
  // of the piece being read
  std::uint64_t first_point_ = 0, point_count_ = 0;
  bool shared_faces_ = false;
  Integers cell_faces_, cell_ends_, face_points_, face_ends_;
};

}  // namespace

double load_coordinate(const char* at, const VtuStorage& storage, const VtuArray& array) {
  return array.value_bytes == 8 ? std::bit_cast<double>(load_scalar<std::uint64_t>(at, storage.order))
                                : static_cast<double>(std::bit_cast<float>(load_scalar<std::uint32_t>(at, storage.order)));
}

VtuContent read_vtu(std::string_view bytes, const std::string& name, std::string_view type) {
  return VtuReader(bytes, name).read(type);
}

}  // namespace deform::io
