// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>

#include "core/base/error.h"
#include "core/io/assembly/element_mesh.h"
#include "core/io/assembly/label_index.h"
#include "core/io/formats/nastran/nastran_cards.h"
#include "core/io/readers.h"

namespace deform::io {

namespace {

/// Nodes are in the order of elements.h: Nastran's edges come in that of CGNS.
struct ElementCard {
  const char* name;
  bool volume;
  std::size_t corners;
  ElementType linear;
  std::size_t nodes;  ///< with mid-edge nodes; `corners` when the card has none
  ElementType quadratic;
};
constexpr ElementType none{};
constexpr ElementCard element_cards[] = {
    {"CTETRA", true, 4, ElementType::tetrahedron, 10, ElementType::tetrahedron10},
    {"CPYRAM", true, 5, ElementType::pyramid, 13, ElementType::pyramid13},
    {"CPYRA", true, 5, ElementType::pyramid, 13, ElementType::pyramid13},
    {"CPENTA", true, 6, ElementType::prism, 15, ElementType::prism15},
    {"CHEXA", true, 8, ElementType::hexahedron, 20, ElementType::hexahedron20},
    {"CTRIA3", false, 3, none, 3, none},
    {"CTRIAR", false, 3, none, 3, none},
    {"CTRIA6", false, 3, none, 6, none},
    {"CQUAD4", false, 4, none, 4, none},
    {"CQUADR", false, 4, none, 4, none},
    {"CQUAD8", false, 4, none, 8, none},
};

class NastranReader {
 public:
  NastranReader(std::string_view bytes, const std::string& name) : cards_(bytes, name) {}

  void read() {
    while (cards_.next()) {
      if (cards_.name() == "GRID") {
        read_grid();
      } else if (cards_.name() == "GRDSET") {
        cards_.read_fields();
        if (!cards_.blank(2)) default_system_ = cards_.integer(2, "a coordinate system");
      } else {
        for (const ElementCard& card : element_cards) {
          if (cards_.name() == card.name) read_element(card);
        }
      }
    }
    if (mesh_.points.empty()) cards_.fail_at(0, "the file has no GRID");
    if (default_system_ != 0 && first_without_system_) {
      cards_.fail_at(*first_without_system_, "GRDSET gives the grid points of this file the coordinate system " +
                                                 std::to_string(default_system_) + ", only 0, the basic one, is supported");
    }
    widen_free_fields();
    for (const Pending& element : pending_) finish(element);
    for (auto& [property, set] : surfaces_) mesh_.face_sets.push_back(std::move(set));
    for (auto& [property, set] : volumes_) mesh_.point_sets.push_back(std::move(set));
  }

  ElementMesh take() { return std::move(mesh_); }
  std::vector<FieldRecord> take_records() { return std::move(records_); }

 private:
  struct Pending {  // nodes may be defined later
    const ElementCard* card;
    std::int64_t label, property;
    std::size_t at, first;  // of its nodes
  };

  void read_grid() {
    cards_.read_fields();
    const std::int64_t label = cards_.integer(1, "the number of a grid point");
    if (cards_.blank(2)) {
      if (!first_without_system_) first_without_system_ = cards_.position();
    } else if (const std::int64_t system = cards_.integer(2, "a coordinate system"); system != 0) {
      cards_.fail("grid point " + std::to_string(label) + " is in coordinate system " + std::to_string(system) +
                  ", only 0, the basic one, is supported");
    }
    if (!labels_.add(label)) cards_.fail("grid point " + std::to_string(label) + " is there already");
    Vec3 point;
    FieldRecord record;
    record.point = static_cast<PointId>(mesh_.points.size());
    for (std::size_t k = 0; k < 3; ++k) {
      point[k] = cards_.number(3 + k, "a coordinate");
      record.axes[k] = cards_.place(3 + k);
      if (record.axes[k].kind == NumberField::Kind::free) longest_free_ = std::max(longest_free_, record.axes[k].length);
    }
    mesh_.points.push_back(point);
    records_.push_back(record);
  }

  /// A program that writes longer numbers in free format than the format allows also reads them.
  void widen_free_fields() {
    constexpr std::uint16_t longest_double = 24;
    const auto longest = static_cast<std::uint8_t>(std::min(longest_free_, longest_double));
    for (FieldRecord& record : records_) {
      for (NumberField& field : record.axes) {
        if (field.kind == NumberField::Kind::free) field.width = std::max(field.width, longest);
      }
    }
  }

  void read_element(const ElementCard& card) {
    cards_.read_fields();
    Pending element{&card, cards_.integer(1, "the number of an element"), 0, cards_.position(), nodes_.size()};
    element.property = cards_.blank(2) ? element.label : cards_.integer(2, "a property");
    for (std::size_t i = 0; i < card.nodes; ++i) {
      // 0 stands for blank.
      nodes_.push_back(i >= card.corners && cards_.blank(3 + i) ? 0 : cards_.integer(3 + i, "a grid point"));
    }
    pending_.push_back(element);
  }

  void finish(const Pending& element) {
    const ElementCard& card = *element.card;
    const auto fail = [&](const std::string& what) {
      cards_.fail_at(element.at, std::string(card.name) + " " + std::to_string(element.label) + " " + what);
    };
    PointId nodes[20];
    std::size_t count = 0;
    for (std::size_t i = 0; i < card.nodes; ++i) {
      const std::int64_t label = nodes_[element.first + i];
      if (i >= card.corners && label == 0) continue;
      const auto point = labels_.find(label);
      if (!point) fail("has the grid point " + std::to_string(label) + ", which the file does not have");
      nodes[count++] = *point;
    }
    if (count != card.corners && count != card.nodes) {
      fail("has " + std::to_string(count - card.corners) + " of its " + std::to_string(card.nodes - card.corners) +
           " mid-edge grid points, only all or none are supported");
    }
    const std::string name = "pid_" + std::to_string(element.property);
    if (card.volume) {
      mesh_.elements.add(count == card.corners ? card.linear : card.quadratic, {nodes, count});
      const auto set = volumes_.try_emplace(element.property, ElementMesh::PointSet{name, {}, FaceGroups::Kind::cell_zone}).first;
      set->second.points.insert(set->second.points.end(), nodes, nodes + count);
    } else {
      const auto set = surfaces_.try_emplace(element.property, ElementMesh::FaceSet{name, {}}).first;
      set->second.faces.push_back(mesh_.faces.size());
      mesh_.add_face({nodes, count}, "");
    }
  }

  NastranCards cards_;
  LabelIndex labels_;
  ElementMesh mesh_;
  std::vector<FieldRecord> records_;
  std::vector<Pending> pending_;
  std::vector<std::int64_t> nodes_;
  std::map<std::int64_t, ElementMesh::FaceSet> surfaces_;  // by property
  std::map<std::int64_t, ElementMesh::PointSet> volumes_;
  std::int64_t default_system_ = 0;
  std::optional<std::size_t> first_without_system_;
  std::uint16_t longest_free_ = 0;
};

std::unique_ptr<MeshFile> parse_nastran(std::string bytes, const std::string& name) {
  NastranReader reader(bytes, name);
  reader.read();
  return make_field_mesh_file(Format::nastran, std::move(bytes), mesh_of(reader.take(), name), reader.take_records(),
                              DecimalStyle::nastran);
}

}  // namespace

Reader nastran_reader() {
  return {.format = Format::nastran, .name = "Nastran", .extensions = {".bdf", ".nas", ".dat"}, .parse = parse_nastran};
}

}  // namespace deform::io
