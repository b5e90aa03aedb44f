// SPDX-License-Identifier: Apache-2.0
#include <map>

#include "core/base/error.h"
#include "core/io/assembly/coordinate_records.h"
#include "core/io/assembly/element_mesh.h"
#include "core/io/assembly/label_index.h"
#include "core/io/formats/gmsh/gmsh_elements.h"
#include "core/io/formats/gmsh/gmsh_source.h"
#include "core/io/readers.h"

namespace deform::io {

namespace {

using Version = GmshSource::Version;

class GmshReader {
 public:
  GmshReader(std::string_view bytes, const std::string& name) : source_(bytes, name) {}

  void read() {
    while (source_.next_section()) {
      const std::string& section = source_.section();
      if (section == "PhysicalNames") {
        read_names();
      } else if (section == "Entities" && source_.version() != Version::v2) {
        read_entities(Entities::whole);
      } else if (section == "PartitionedEntities" && source_.version() != Version::v2) {
        read_entities(Entities::partitioned);
      } else if (section == "Nodes" || section == "ParametricNodes") {
        read_nodes();
      } else if (section == "Elements") {
        read_elements();
      } else {
        source_.skip_section();
      }
    }
    if (points_.empty()) source_.fail("the file has no nodes");
  }

  bool binary() const { return source_.binary(); }
  ElementMesh take() { return elements_.take(std::move(points_)); }
  TextRecords take_text_records() { return std::move(text_); }
  BinaryRecords take_binary_records() {
    binary_.count = binary_.offsets.size() / 3;
    binary_.scalar_bytes = 8;
    binary_.order = source_.order();
    return std::move(binary_);
  }

 private:
  enum class Entities { whole, partitioned };
  struct Block {
    int dimension;
    std::int64_t entity, parametric_or_type;
  };

  /// DIMENSION TAG "NAME", in version 2.0 without the dimension.
  void read_names() {
    TextScanner& text = source_.text();
    const std::size_t count = source_.count("the number of physical names", 5, 1);
    for (std::size_t i = 0; i < count; ++i) {
      std::int64_t numbers[2], found = 0;
      while (text.next_in_file() && text.peek() != '"' && found < 2) {
        numbers[found++] = text.integer("the dimension or tag of a physical name");
      }
      if (text.peek() != '"' || found == 0) text.fail("expected a physical name in quotes, found " + text.quoted());
      const std::string_view line = text.rest_of_line();
      const std::size_t end = line.rfind('"');
      if (end == 0) text.fail("a physical name has no closing quote");
      const std::string name(line.substr(1, end - 1));
      for (int dimension = 0; dimension <= 3; ++dimension) {
        if (found == 1 || numbers[0] == dimension) elements_.name_group(dimension, numbers[found - 1], name);
      }
    }
    source_.end_section();
  }

  /// Only the physical tags are of interest.
  void read_entities(Entities kind) {
    source_.begin_values();
    if (kind == Entities::partitioned) {
      source_.size("the number of partitions");
      const std::size_t ghosts = source_.count("the number of ghost entities", 4, 8);
      for (std::size_t i = 0; i < 2 * ghosts; ++i) source_.integer("a ghost entity");
    }
    std::size_t counts[4];
    for (std::size_t& count : counts) count = source_.count("the number of entities", 8, 28);
    for (int dimension = 0; dimension <= 3; ++dimension) {
      for (std::size_t i = 0; i < counts[dimension]; ++i) read_entity(dimension, kind);
    }
    source_.end_section();
  }

  void read_entity(int dimension, Entities kind) {
    const std::int64_t entity = source_.integer("the tag of an entity");
    if (kind == Entities::partitioned) {
      source_.integer("the dimension of a parent");
      parents_[{dimension, entity}] = source_.integer("the tag of a parent");
      read_integers("the partitions of an entity");
    }
    const int coordinates = dimension == 0 && source_.version() == Version::v4_1 ? 3 : 6;
    for (int k = 0; k < coordinates; ++k) source_.number("the box of an entity");
    entities_[{dimension, entity}] = read_integers("the physical tags of an entity");
    if (dimension > 0) read_integers("the boundary of an entity");
  }

  std::vector<std::int64_t> read_integers(const char* what) {
    std::vector<std::int64_t> values(source_.count(what, 2, 4));
    for (std::int64_t& value : values) value = source_.integer(what);
    return values;
  }

  void read_nodes() {
    if (!points_.empty()) source_.fail("a second section of nodes");
    if (source_.version() == Version::v2) {
      read_nodes_2();
    } else {
      read_nodes_4();
    }
    source_.end_section();
  }

  void reserve(std::size_t count) {
    points_.reserve(count);
    if (source_.binary()) {
      binary_.offsets.reserve(3 * count);
    } else {
      text_.tokens.reserve(count);
    }
  }

  void read_nodes_2() {
    const std::size_t count = source_.count("the number of nodes", 8, 28);
    source_.begin_values();
    reserve(count);
    const bool parametric = source_.section() == "ParametricNodes";
    for (std::size_t i = 0; i < count; ++i) {
      read_label();
      read_point();
      if (!parametric) continue;
      const std::int64_t dimension = source_.integer("the dimension of a node's entity");
      source_.integer("the tag of a node's entity");
      for (std::int64_t k = 0; k < dimension && dimension < 3; ++k) source_.number("a parameter of a node");
    }
  }

  void read_nodes_4() {
    source_.begin_values();
    const std::size_t blocks = source_.count("the number of entity blocks", 8, 12 + source_.size_bytes());
    const std::size_t count = source_.count("the number of nodes", 8, 24 + source_.tag_bytes());
    reserve(count);
    if (source_.version() == Version::v4_1) skip_range();
    for (std::size_t b = 0; b < blocks; ++b) {
      const Block block = read_block("whether nodes are parametric");
      const std::size_t size = source_.count("the number of nodes of a block", 8, 24 + source_.tag_bytes());
      const int parameters = block.parametric_or_type != 0 ? block.dimension : 0;
      if (source_.version() == Version::v4_1) {
        for (std::size_t i = 0; i < size; ++i) read_label();
      }
      for (std::size_t i = 0; i < size; ++i) {
        if (source_.version() == Version::v4_0) read_label();
        read_point();
        for (int k = 0; k < parameters; ++k) source_.number("a parameter of a node");
      }
    }
    check_total("nodes", points_.size(), count);
  }

  void skip_range() {
    source_.size("the smallest tag");
    source_.size("the largest tag");
  }

  Block read_block(const char* third) {
    const bool dimension_first = source_.version() == Version::v4_1;
    const std::size_t at = source_.value_position();
    std::int64_t first = source_.integer("an entity of a block"), second = source_.integer("an entity of a block");
    if (!dimension_first) std::swap(first, second);
    if (first < 0 || first > 3) source_.fail_at(at, "an entity of dimension " + std::to_string(first) + ", expected 0..3");
    return {static_cast<int>(first), second, source_.integer(third)};
  }

  void check_total(const char* what, std::size_t found, std::size_t claimed) {
    if (found == claimed) return;
    source_.fail("the blocks have " + std::to_string(found) + " " + what + ", $" + source_.section() +
                 " begins with the number " + std::to_string(claimed));
  }

  void read_label() {
    const std::size_t at = source_.value_position();
    const std::int64_t label = source_.tag("the tag of a node");
    if (!labels_.add(label)) source_.fail_at(at, "node " + std::to_string(label) + " is there already");
  }

  void read_point() {
    std::size_t positions[3];
    Vec3 point;
    for (int k = 0; k < 3; ++k) {
      positions[k] = source_.value_position();
      point[static_cast<std::size_t>(k)] = source_.number("a coordinate of a node");
    }
    points_.push_back(point);
    if (source_.binary()) {
      binary_.offsets.insert(binary_.offsets.end(), positions, positions + 3);
    } else {
      text_.tokens.push_back(CoordinateTokens::at(positions, source_));
    }
  }

  void read_elements() {
    if (points_.empty()) source_.fail("elements before the nodes");
    if (source_.version() != Version::v2) {
      read_elements_4();
    } else if (source_.binary()) {
      read_binary_elements_2();
    } else {
      const std::size_t count = source_.count("the number of elements", 6, 1);
      for (std::size_t e = 0; e < count; ++e) {
        source_.tag("the number of an element");
        const GmshElementType& type = read_type();
        read_element_2(type, source_.count("the number of tags of an element", 2, 1));
      }
    }
    source_.end_section();
  }

  /// Runs of elements of one type, each with its own header.
  void read_binary_elements_2() {
    const std::size_t count = source_.count("the number of elements", 1, 8);
    source_.begin_values();
    for (std::size_t e = 0; e < count;) {
      const GmshElementType& type = read_type();
      const std::size_t at = source_.value_position();
      const std::int64_t run = source_.integer("the number of elements of a header");
      const std::int64_t tags = source_.integer("the number of tags of an element");
      if (run < 1 || static_cast<std::uint64_t>(run) > count - e) {
        source_.fail_at(at, "a header of " + std::to_string(run) + " elements, " + std::to_string(count - e) + " are left");
      }
      if (tags < 0) source_.fail_at(at, "elements with " + std::to_string(tags) + " tags");
      for (std::int64_t i = 0; i < run; ++i, ++e) {
        source_.tag("the number of an element");
        read_element_2(type, static_cast<std::uint64_t>(tags));
      }
    }
  }

  /// Tags (the first is the physical group, the second the entity), then nodes.
  void read_element_2(const GmshElementType& type, std::uint64_t tags) {
    std::int64_t physical = 0, entity = 0;
    for (std::uint64_t t = 0; t < tags; ++t) {
      const std::int64_t tag = source_.integer("a tag of an element");
      if (t == 0) physical = tag;
      if (t == 1) entity = tag;
    }
    elements_.add_or_repeat(type, read_element_nodes(type), elements_.groups_of(type.dimension, {&physical, 1}), entity);
  }

  void read_elements_4() {
    source_.begin_values();
    const std::size_t blocks = source_.count("the number of entity blocks", 8, 12 + source_.size_bytes());
    const std::size_t count = source_.count("the number of elements", 4, 2 * source_.tag_bytes());
    if (source_.version() == Version::v4_1) skip_range();
    std::size_t total = 0;
    for (std::size_t b = 0; b < blocks; ++b) {
      const std::size_t at = source_.value_position();
      const Block block = read_block("the type of elements");
      const GmshElementType& type = known_type(block.parametric_or_type, at);
      const std::size_t size =
          source_.count("the number of elements of a block", 2 * type.nodes + 2, (type.nodes + 1) * source_.tag_bytes());
      // The dimension of the group is that of the entity, which is that of its elements.
      const auto physical = entities_.find({block.dimension, block.entity});
      const auto groups =
          physical == entities_.end() ? std::vector<std::size_t>() : elements_.groups_of(type.dimension, physical->second);
      const auto parent = parents_.find({block.dimension, block.entity});
      for (std::size_t i = 0; i < size; ++i) {
        source_.tag("the tag of an element");
        elements_.add(type, read_element_nodes(type), groups, parent == parents_.end() ? block.entity : parent->second);
      }
      total += size;
    }
    check_total("elements", total, count);
  }

  const GmshElementType& read_type() {
    const std::size_t at = source_.value_position();
    return known_type(source_.integer("the type of an element"), at);
  }

  const GmshElementType& known_type(std::int64_t number, std::size_t at) {
    const GmshElementType* type = gmsh_element_type(number);
    if (type == nullptr) {
      source_.fail_at(at,
                      "elements of type " + std::to_string(number) +
                          " are not supported, only lines, triangles, quadrangles, tetrahedra, pyramids, prisms and hexahedra "
                          "of first and second order");
    }
    return *type;
  }

  std::span<const PointId> read_element_nodes(const GmshElementType& type) {
    for (std::size_t k = 0; k < type.nodes; ++k) {
      const std::size_t at = source_.value_position();
      const std::int64_t tag = source_.tag("a node of an element");
      const auto point = labels_.find(tag);
      if (!point) source_.fail_at(at, "an element has the node " + std::to_string(tag) + ", which the file does not have");
      nodes_[k] = *point;
    }
    return {nodes_, type.nodes};
  }

  GmshSource source_;
  std::map<std::pair<int, std::int64_t>, std::vector<std::int64_t>> entities_;  // physical tags by dimension and tag
  std::map<std::pair<int, std::int64_t>, std::int64_t> parents_;                // tags of entities that were partitioned
  std::vector<Vec3> points_;
  LabelIndex labels_;
  TextRecords text_;
  BinaryRecords binary_;
  GmshElements elements_;
  PointId nodes_[27];
};

std::unique_ptr<MeshFile> parse_gmsh(std::string bytes, const std::string& name) {
  GmshReader reader(bytes, name);
  reader.read();
  std::vector<std::int32_t> entities;
  std::shared_ptr<const Mesh> mesh = mesh_of(reader.take(), name, &entities);
  auto file = reader.binary()
                  ? make_binary_mesh_file(Format::gmsh, std::move(bytes), std::move(mesh), reader.take_binary_records())
                  : make_text_mesh_file(Format::gmsh, std::move(bytes), std::move(mesh), reader.take_text_records());
  file->face_entities = std::move(entities);
  return file;
}

}  // namespace

Reader gmsh_reader() { return {.format = Format::gmsh, .name = "Gmsh", .extensions = {".msh"}, .parse = parse_gmsh}; }

}  // namespace deform::io
