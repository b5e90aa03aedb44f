// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/exodus/exodus_elements.h"

#include <algorithm>
#include <array>

namespace deform::io {

namespace {

using Kind = ExodusForm::Kind;

struct Row {
  const char* prefix;
  std::size_t nodes;
  ExodusForm form;
};
constexpr Row rows[] = {
    {"TET", 4, {Kind::cell, ElementType::tetrahedron}},  {"TET", 10, {Kind::cell, ElementType::tetrahedron10}},
    {"PYR", 5, {Kind::cell, ElementType::pyramid}},      {"PYR", 13, {Kind::cell, ElementType::pyramid13}},
    {"PYR", 14, {Kind::cell, ElementType::pyramid14}},   {"WED", 6, {Kind::cell, ElementType::prism}},
    {"WED", 15, {Kind::cell, ElementType::prism15}},     {"WED", 18, {Kind::cell, ElementType::prism18}},
    {"HEX", 8, {Kind::cell, ElementType::hexahedron}},   {"HEX", 20, {Kind::cell, ElementType::hexahedron20}},
    {"HEX", 27, {Kind::cell, ElementType::hexahedron27}}};
constexpr std::array<const char*, 3> face_types{"TRI", "QUA", "SHE"};
constexpr std::array<const char*, 5> edge_types{"BAR", "BEA", "TRU", "EDG", "ROD"};
constexpr std::array<const char*, 5> point_types{"SPH", "CIR", "NOD", "POI", "NUL"};

}  // namespace

std::optional<ExodusForm> exodus_form(const std::string& elem_type, std::size_t nodes) {
  std::string prefix = elem_type.substr(0, 3);
  for (char& c : prefix) {
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
  }
  for (const Row& row : rows) {
    if (prefix == row.prefix && nodes == row.nodes) return row.form;
  }
  const auto among = [&](const auto& names) { return std::find(names.begin(), names.end(), prefix) != names.end(); };
  if (among(face_types) && nodes >= 3 && nodes <= 9 && nodes != 5) return ExodusForm{Kind::face};
  if (among(edge_types) && nodes >= 2 && nodes <= 3) return ExodusForm{Kind::edge};
  if (among(point_types) && nodes <= 1) return ExodusForm{Kind::points};
  return std::nullopt;
}

void exodus_to_cgns(ElementType type, std::span<PointId> nodes) {
  if (type != ElementType::hexahedron27) return;
  // Exodus: middle, bottom, top, left, right, front, back. CGNS: bottom, front, right, back, left, top, middle.
  constexpr std::size_t from[] = {21, 25, 24, 26, 23, 22, 20};
  std::array<PointId, 7> last{};
  for (std::size_t i = 0; i < last.size(); ++i) last[i] = nodes[from[i]];
  std::copy(last.begin(), last.end(), nodes.begin() + 20);
}

std::optional<std::size_t> exodus_cell_side(ElementType type, std::int64_t side) {
  const auto pick = [&](std::initializer_list<std::size_t> of_sides) -> std::optional<std::size_t> {
    if (side < 1 || static_cast<std::uint64_t>(side) > of_sides.size()) return std::nullopt;
    return *(of_sides.begin() + (side - 1));
  };
  switch (shape(type).corners) {
    case 4:
      return pick({1, 2, 3, 0});
    case 5:
      return pick({1, 2, 3, 4, 0});
    case 6:
      return pick({2, 3, 4, 0, 1});
    default:
      return pick({2, 3, 4, 5, 0, 1});
  }
}

std::vector<PointId> exodus_face_edge(std::span<const PointId> nodes, std::size_t edge) {
  const std::size_t corners = nodes.size() == 3 || nodes.size() == 6 || nodes.size() == 7 ? 3 : 4;
  if (edge >= corners) return {};
  std::vector<PointId> result{nodes[edge], nodes[(edge + 1) % corners]};
  if (nodes.size() >= 2 * corners) result.push_back(nodes[corners + edge]);
  return result;
}

}  // namespace deform::io
