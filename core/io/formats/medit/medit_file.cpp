// SPDX-License-Identifier: Apache-2.0
#include <limits>

#include "core/base/error.h"
#include "core/io/assembly/coordinate_records.h"
#include "core/io/assembly/element_mesh.h"
#include "core/io/readers.h"
#include "core/io/text/text_scanner.h"

namespace deform::io {

namespace {

struct Section {
  const char* keyword;
  std::size_t nodes;
  bool volume;
  ElementType type;
};
constexpr Section sections[] = {
    {"Triangles", 3, false, {}},
    {"Quadrilaterals", 4, false, {}},
    {"Tetrahedra", 4, true, ElementType::tetrahedron},
    {"Pyramids", 5, true, ElementType::pyramid},
    {"Prisms", 6, true, ElementType::prism},
    {"Hexahedra", 8, true, ElementType::hexahedron},
};

class MeditReader {
 public:
  MeditReader(std::string_view bytes, const std::string& name) : scanner_(bytes, name, Syntax::hash), size_(bytes.size()) {}

  void read() {
    if (!next_keyword() || scanner_.word() != "MeshVersionFormatted") {
      scanner_.fail_at(0, "expected a Medit file, which begins with MeshVersionFormatted");
    }
    while (next_keyword()) {
      const std::size_t at = scanner_.position();
      const std::string_view keyword = scanner_.word();
      if (keyword == "End") break;
      if (keyword == "Dimension") {
        read_dimension();
      } else if (keyword == "Vertices") {
        read_vertices(at);
      } else {
        for (const Section& section : sections) {
          if (keyword == section.keyword) read_elements(section);
        }
      }
    }
    if (mesh_.points.empty()) scanner_.fail("the file has no Vertices");
  }

  ElementMesh take() { return std::move(mesh_); }
  TextRecords take_records() { return std::move(records_); }

 private:
  /// Moves to the next word that begins with a letter; unknown content is skipped.
  bool next_keyword() {
    while (scanner_.next_in_file()) {
      const char c = scanner_.peek();
      if ((c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z')) return true;
      if (scanner_.word().empty()) scanner_.fail("unexpected " + scanner_.quoted());
    }
    return false;
  }

  void need(const char* what) {
    if (!scanner_.next_in_file()) scanner_.fail(std::string("the file ends where ") + what + " is expected");
  }

  void read_dimension() {
    need("the dimension");
    const std::size_t at = scanner_.position();
    const std::int64_t dimension = scanner_.whole_integer("the dimension");
    if (dimension != 3) scanner_.fail_at(at, "dimension " + std::to_string(dimension) + ", only 3 is supported");
  }

  std::size_t read_count(const char* what, std::size_t least_bytes) {
    need("a count");
    const std::size_t at = scanner_.position();
    const std::int64_t count = scanner_.whole_integer(what);
    if (count < 0 || static_cast<std::uint64_t>(count) > (size_ - scanner_.position()) / least_bytes + 1) {
      scanner_.fail_at(at, std::string(what) + " is " + std::to_string(count) + ", the file has only " +
                               std::to_string(size_ - scanner_.position()) + " bytes left for them");
    }
    return static_cast<std::size_t>(count);
  }

  void read_vertices(std::size_t at) {
    if (!mesh_.points.empty()) scanner_.fail_at(at, "a second section of Vertices");
    const std::size_t count = read_count("the number of vertices", 8);
    mesh_.points.resize(count);
    records_.tokens.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      std::size_t positions[3];
      for (std::size_t k = 0; k < 3; ++k) {
        need("a coordinate");
        positions[k] = scanner_.position();
        mesh_.points[i][k] = scanner_.number("vertex coordinate");
      }
      need("the reference of a vertex");
      scanner_.whole_integer("the reference of a vertex");
      records_.tokens[i] = CoordinateTokens::at(positions, scanner_);
    }
  }

  void read_elements(const Section& section) {
    const std::size_t count = read_count(section.keyword, 2 * section.nodes + 1);
    const auto points = static_cast<std::int64_t>(mesh_.points.size());
    PointId nodes[8];
    for (std::size_t e = 0; e < count; ++e) {
      for (std::size_t k = 0; k < section.nodes; ++k) {
        need("a vertex of an element");
        const std::size_t at = scanner_.position();
        const std::int64_t node = scanner_.whole_integer("a vertex of an element");
        if (node < 1 || node > points) {
          scanner_.fail_at(at, std::string(section.keyword) + "[" + std::to_string(e) + "]: vertex " + std::to_string(node) +
                                   " is out of range 1.." + std::to_string(points));
        }
        nodes[k] = static_cast<PointId>(node - 1);
      }
      need("the reference of an element");
      const std::string reference = std::to_string(scanner_.whole_integer("the reference of an element"));
      if (section.volume) {
        mesh_.elements.add(section.type, {nodes, section.nodes});
        mesh_.volume_names.push_back("volume_" + reference);
      } else {
        mesh_.faces.push_back({{nodes, nodes + section.nodes}, "ref_" + reference});
      }
    }
  }

  TextScanner scanner_;
  const std::size_t size_;
  ElementMesh mesh_;
  TextRecords records_;
};

std::unique_ptr<MeshFile> parse_medit(std::string bytes, const std::string& name) {
  MeditReader reader(bytes, name);
  reader.read();
  return make_text_mesh_file(Format::medit, std::move(bytes), mesh_of(reader.take(), name), reader.take_records());
}

}  // namespace

Reader medit_reader() { return {.format = Format::medit, .name = "Medit", .extensions = {".mesh"}, .parse = parse_medit}; }

}  // namespace deform::io
