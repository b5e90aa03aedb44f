// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "core/base/error.h"
#include "core/io/assembly/coordinate_records.h"
#include "core/io/formats/ply/ply_header.h"
#include "core/io/formats/ply/ply_source.h"
#include "core/io/readers.h"

namespace deform::io {

namespace {

/// Number of the property of each axis in the vertex element.
std::array<int, 3> coordinate_properties(const PlyElement& vertex, const std::string& name) {
  const auto fail = [&](const std::string& message) {
    throw Error(ErrorCode::invalid_argument, name + ": line " + std::to_string(vertex.line) + ": " + message);
  };
  std::array<int, 3> found{};
  for (int axis = 0; axis < 3; ++axis) {
    const std::string property(1, "xyz"[axis]);
    found[axis] = vertex.find(property);
    if (found[axis] < 0) fail("element vertex has no property " + property);
    const PlyProperty& coordinate = vertex.properties[found[axis]];
    if (coordinate.counted) fail("property " + property + " of element vertex is a list, expected float or double");
    if (is_integer(coordinate.type)) {
      fail("property " + property + " of element vertex is of type " + to_string(coordinate.type) +
           ", which cannot hold deformed coordinates; expected float or double");
    }
    if (coordinate.type != vertex.properties[found[0]].type) fail("the properties x, y, z of element vertex differ in type");
  }
  return found;
}

/// Reads all elements from a text or binary source.
template <typename Source>
class PlyReader {
 public:
  PlyReader(const PlyHeader& header, const PlyElement& vertex, const std::array<int, 3>& coordinates, Source source)
      : header_(header), vertex_(vertex), coordinates_(coordinates), source_(std::move(source)) {}

  void read() {
    for (const PlyElement& element : header_.elements) {
      check_count(element);
      if (&element == &vertex_) {
        read_vertices();
      } else if (element.name == "face") {
        read_lists(element, {"vertex_indices", "vertex_index"}, &PlyReader::add_face);
      } else if (element.name == "tristrips") {
        read_lists(element, {"vertex_indices", "vertex_index"}, &PlyReader::add_strip);
      } else {
        skip_element(element);
      }
    }
    if (!source_.at_end()) source_.fail("expected the end of the file after the declared elements");
  }

  std::shared_ptr<const Mesh> mesh() { return mesh_; }
  /// 3 per vertex: byte offsets of x, y, z.
  const std::vector<std::uint64_t>& offsets() const { return offsets_; }

 private:
  void check_count(const PlyElement& element) {
    const bool is_vertex = &element == &vertex_;
    if (is_vertex && element.count == 0) fail_element(element, "there are no vertices, at least one is needed");
    if ((is_vertex || element.name == "face") && element.count > most_ids) {
      fail_element(element, std::to_string(element.count) + " records, the limit is " + std::to_string(most_ids));
    }
    const std::uint64_t record = Source::smallest_record(element);
    if (record > 0 && element.count > (source_.left() + Source::slack) / record) {
      fail_element(element, std::to_string(element.count) + " records need at least " + std::to_string(record) +
                                " bytes each, but only " + std::to_string(source_.left()) + " bytes are left");
    }
  }

  [[noreturn]] void fail_element(const PlyElement& element, const std::string& message) {
    source_.fail("element " + element.name + ": " + message);
  }

  void skip_property(const PlyProperty& property) {
    if (property.counted) {
      source_.skip(property.type, list_length(property));
    } else {
      source_.skip(property.type, 1);
    }
  }

  std::uint64_t list_length(const PlyProperty& property) {
    const std::size_t at = source_.next(*property.counted);
    const std::int64_t length = source_.integer("the length of a list");
    if (length < 0 ||
        static_cast<std::uint64_t>(length) > (source_.left() + Source::slack) / Source::smallest_value(property.type)) {
      source_.fail_at(at, "list " + property.name + " claims " + std::to_string(length) + " entries, but only " +
                              std::to_string(source_.left()) + " bytes are left");
    }
    return static_cast<std::uint64_t>(length);
  }

  void skip_element(const PlyElement& element) {
    if (element.properties.empty()) return;  // its records have no bytes, whatever their number
    for (std::uint64_t i = 0; i < element.count; ++i) {
      for (const PlyProperty& property : element.properties) skip_property(property);
      source_.end_record();
    }
  }

  void read_vertices() {
    std::vector<int> axis_of(vertex_.properties.size(), -1);
    for (int axis = 0; axis < 3; ++axis) axis_of[coordinates_[axis]] = axis;
    mesh_->points.resize(vertex_.count);
    offsets_.resize(3 * vertex_.count);
    for (std::uint64_t i = 0; i < vertex_.count; ++i) {
      for (std::size_t k = 0; k < axis_of.size(); ++k) {
        const PlyProperty& property = vertex_.properties[k];
        if (axis_of[k] < 0) {
          skip_property(property);
          continue;
        }
        offsets_[3 * i + axis_of[k]] = source_.next(property.type);
        mesh_->points[i][axis_of[k]] = source_.number("vertex coordinate");
      }
      source_.end_record();
    }
  }

  void read_lists(const PlyElement& element, std::initializer_list<const char*> names,
                  void (PlyReader::*add)(const PlyElement&, std::uint64_t)) {
    int list = -1;
    for (const char* candidate : names) {
      if (list < 0) list = element.find(candidate);
    }
    if (list < 0) return skip_element(element);
    const PlyProperty& indices = element.properties[list];
    if (!indices.counted || !is_integer(indices.type)) {
      fail_element(element, "property " + indices.name + " must be a list of integers");
    }
    for (std::uint64_t i = 0; i < element.count; ++i) {
      for (int k = 0; k < static_cast<int>(element.properties.size()); ++k) {
        if (k != list) {
          skip_property(element.properties[k]);
          continue;
        }
        read_indices(indices);
        (this->*add)(element, i);
      }
      source_.end_record();
    }
  }

  void read_indices(const PlyProperty& property) {
    indices_.resize(list_length(property));
    for (std::int64_t& index : indices_) {
      index_at_ = source_.next(property.type);
      index = source_.integer("vertex index");
      if (index < -1 || index >= static_cast<std::int64_t>(vertex_.count)) fail_index(index);
    }
  }

  [[noreturn]] void fail_index(std::int64_t index) {
    source_.fail_at(index_at_,
                    "vertex index " + std::to_string(index) + " is out of range 0.." + std::to_string(vertex_.count - 1));
  }

  void add_face(const PlyElement& element, std::uint64_t record) {
    if (indices_.empty()) fail_element(element, "face " + std::to_string(record) + " has no corners, at least 1 is needed");
    for (const std::int64_t index : indices_) {
      if (index < 0) fail_index(index);
      mesh_->face_points.push_back(static_cast<PointId>(index));
    }
    mesh_->face_sizes.push_back(static_cast<std::uint32_t>(indices_.size()));
  }

  /// Triangle strips, separated by -1; every other triangle runs backwards, and those that repeat a point only turn the strip.
  void add_strip(const PlyElement&, std::uint64_t) {
    std::size_t start = 0;
    for (std::size_t i = 0; i < indices_.size(); ++i) {
      if (indices_[i] < 0) start = i + 1;
      if (i < start + 2) continue;
      const auto a = static_cast<PointId>(indices_[i - 2]), b = static_cast<PointId>(indices_[i - 1]);
      const auto c = static_cast<PointId>(indices_[i]);
      if (a == b || b == c || c == a) continue;
      const bool backwards = (i - start) % 2 == 1;
      mesh_->face_points.insert(mesh_->face_points.end(), {backwards ? b : a, backwards ? a : b, c});
      mesh_->face_sizes.push_back(3);
    }
  }

  const PlyHeader& header_;
  const PlyElement& vertex_;
  const std::array<int, 3> coordinates_;
  Source source_;
  std::shared_ptr<Mesh> mesh_ = std::make_shared<Mesh>();
  std::vector<std::uint64_t> offsets_;
  std::vector<std::int64_t> indices_;  // of the list read last
  std::size_t index_at_ = 0;
};

TextRecords text_records(const std::vector<std::uint64_t>& offsets, const std::array<int, 3>& coordinates,
                         const std::string& name) {
  TextRecords records;
  std::sort(records.axes.begin(), records.axes.end(), [&](int a, int b) { return coordinates[a] < coordinates[b]; });
  records.tokens.reserve(offsets.size() / 3);
  for (std::size_t i = 0; i < offsets.size(); i += 3) {
    const std::uint64_t first = offsets[i + records.axes[0]];
    const std::uint64_t second = offsets[i + records.axes[1]] - first, third = offsets[i + records.axes[2]] - first;
    if (third > most_ids) {
      throw Error(ErrorCode::invalid_argument,
                  name + ": the coordinates of vertex " + std::to_string(i / 3) + " are more than 4 GiB apart");
    }
    records.tokens.push_back({first, static_cast<std::uint32_t>(second), static_cast<std::uint32_t>(third)});
  }
  return records;
}

BinaryRecords binary_records(std::vector<std::uint64_t> offsets, const PlyHeader& header, const PlyElement& vertex,
                             PlyType type) {
  BinaryRecords records;
  records.count = vertex.count;
  records.order = header.order;
  records.scalar_bytes = static_cast<int>(size_of(type));
  if (vertex.fixed_size()) {
    records.block_stride = vertex.smallest_bytes();
    records.axis_offsets = {offsets[0], offsets[1], offsets[2]};
  } else {
    records.offsets = std::move(offsets);
  }
  return records;
}

std::unique_ptr<MeshFile> parse_ply(std::string bytes, const std::string& name) {
  const PlyHeader header = read_ply_header(bytes, name);
  const auto vertex =
      std::find_if(header.elements.begin(), header.elements.end(), [](const PlyElement& e) { return e.name == "vertex"; });
  if (vertex == header.elements.end())
    throw Error(ErrorCode::invalid_argument, name + ": line 1: the header declares no element vertex");
  const std::array<int, 3> coordinates = coordinate_properties(*vertex, name);
  if (header.binary) {
    PlyReader reader(header, *vertex, coordinates, PlyBinarySource(bytes, name, header));
    reader.read();
    BinaryRecords records = binary_records(reader.offsets(), header, *vertex, vertex->properties[coordinates[0]].type);
    return make_binary_mesh_file(Format::ply, std::move(bytes), reader.mesh(), std::move(records));
  }
  PlyReader reader(header, *vertex, coordinates, PlyTextSource(bytes, name, header));
  reader.read();
  TextRecords records = text_records(reader.offsets(), coordinates, name);
  return make_text_mesh_file(Format::ply, std::move(bytes), reader.mesh(), std::move(records));
}

}  // namespace

Reader ply_reader() { return {.format = Format::ply, .name = "PLY", .extensions = {".ply"}, .parse = parse_ply}; }

}  // namespace deform::io
