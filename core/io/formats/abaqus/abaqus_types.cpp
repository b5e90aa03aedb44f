// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/abaqus/abaqus_types.h"

#include <algorithm>
#include <charconv>
#include <vector>

namespace deform::io {

namespace {

using Use = AbaqusType::Use;

// Abaqus counts the edges of the top before those between bottom and top (Analysis User's Guide, "Solid element library").
constexpr std::uint8_t prism15[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 13, 14, 9, 10, 11};
constexpr std::uint8_t hexahedron20[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 16, 17, 18, 19, 12, 13, 14, 15};

/// The letters that stand before the number of nodes.
struct Family {
  std::string_view letters;
  Use use;
};
constexpr Family families[] = {
    {"C3D", Use::volume},   {"DC3D", Use::volume}, {"AC3D", Use::volume}, {"DCC3D", Use::volume}, {"EMC3D", Use::volume},
    {"QC3D", Use::volume},  {"F3D", Use::volume},  {"FC3D", Use::volume}, {"SC", Use::volume},    {"CSS", Use::volume},
    {"COH3D", Use::volume}, {"S", Use::shell},     {"STRI", Use::shell},  {"DS", Use::shell},     {"M3D", Use::shell},
    {"SFM3D", Use::shell},  {"R3D", Use::shell},   {"F3DR", Use::shell},  {"CPS", Use::plane},    {"CPE", Use::plane},
    {"CPEG", Use::plane},   {"CAX", Use::plane},   {"CGAX", Use::plane},  {"DC2D", Use::plane},   {"DCAX", Use::plane},
    {"DCC2D", Use::plane},  {"DCCAX", Use::plane}, {"AC2D", Use::plane},  {"ACAX", Use::plane},   {"EMC2D", Use::plane},
    {"COH2D", Use::plane},  {"COHAX", Use::plane},
};

AbaqusType volume(std::size_t nodes) {
  switch (nodes) {
    case 4:
      return {Use::volume, nodes, ElementType::tetrahedron};
    case 5:
      return {Use::volume, nodes, ElementType::pyramid};
    case 6:
      return {Use::volume, nodes, ElementType::prism};
    case 8:
      return {Use::volume, nodes, ElementType::hexahedron};
    case 10:
      return {Use::volume, nodes, ElementType::tetrahedron10};
    case 13:
      return {Use::volume, nodes, ElementType::pyramid13};
    case 15:
      return {Use::volume, nodes, ElementType::prism15, prism15};
    case 20:
      return {Use::volume, nodes, ElementType::hexahedron20, hexahedron20};
    default:
      return {Use::unsupported};
  }
}

/// Corners, from 0, of the sides of elements with so many corners.
const std::vector<std::vector<std::uint8_t>>& side_corners(std::size_t corners) {
  static const std::vector<std::vector<std::uint8_t>> tetrahedron = {{0, 1, 2}, {0, 3, 1}, {1, 3, 2}, {2, 3, 0}},
                                                      pyramid = {{0, 1, 2, 3}, {0, 4, 1}, {1, 4, 2}, {2, 4, 3}, {3, 4, 0}},
                                                      prism = {{0, 1, 2}, {3, 5, 4}, {0, 3, 4, 1}, {1, 4, 5, 2}, {2, 5, 3, 0}},
                                                      hexahedron = {{0, 1, 2, 3}, {4, 7, 6, 5}, {0, 4, 5, 1},
                                                                    {1, 5, 6, 2}, {2, 6, 7, 3}, {3, 7, 4, 0}};
  return corners == 4 ? tetrahedron : corners == 5 ? pyramid : corners == 6 ? prism : hexahedron;
}

}  // namespace

AbaqusType abaqus_type(std::string_view name) {
  for (const Family& family : families) {
    if (!name.starts_with(family.letters)) continue;
    const std::string_view rest = name.substr(family.letters.size());
    std::size_t nodes = 0;
    const auto [end, status] = std::from_chars(rest.data(), rest.data() + rest.size(), nodes);
    if (status != std::errc{}) continue;
    if (family.use == Use::volume) {
      // The mid-face nodes of C3D15V may be left out.
      return nodes == 15 && end != rest.data() + rest.size() && *end == 'V' ? AbaqusType{Use::unsupported} : volume(nodes);
    }
    if (family.letters == "STRI" && nodes == 65) nodes = 6;
    if (nodes == 3 || nodes == 4 || nodes == 6 || nodes == 8 || nodes == 9) return {family.use, nodes};
  }
  return {};
}

std::optional<std::size_t> abaqus_side(ElementType type, std::int64_t side) {
  const ElementShape& form = shape(type);
  const auto& sides = side_corners(form.corners);
  if (side < 1 || static_cast<std::uint64_t>(side) > sides.size()) return std::nullopt;
  std::vector<std::uint8_t> wanted = sides[static_cast<std::size_t>(side - 1)];
  std::sort(wanted.begin(), wanted.end());
  for (std::size_t f = 0; f < form.faces.size(); ++f) {
    std::vector<std::uint8_t> corners;
    for (const std::uint8_t node : form.faces[f]) {
      if (node < form.corners) corners.push_back(node);
    }
    std::sort(corners.begin(), corners.end());
    if (corners == wanted) return f;
  }
  return std::nullopt;
}

}  // namespace deform::io
