// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/io/assembly/element_mesh.h"
#include "core/io/assembly/face_groups.h"
#include "core/io/formats/cgns/cgns_tree.h"

namespace deform::io {

/// The entity into which an element of a zone was converted.
struct CgnsElement {
  enum class Kind : std::uint8_t { point, edge, face, polygon, cell, polyhedron };
  Kind kind;
  std::uint32_t index;  ///< in CgnsMesh: of points, edges, elements.faces, polygons, elements.elements, polyhedra
};

/// Consecutive elements of a zone, numbered as in the file.
struct CgnsSection {
  std::string name;
  std::int64_t first = 1;
  std::vector<CgnsElement> elements;
};

/// A list of lists as compressed rows.
template <typename T>
struct CgnsLists {
  std::vector<std::uint64_t> offsets{0};
  std::vector<T> entries;

  std::size_t size() const { return offsets.size() - 1; }
  std::span<const T> operator[](std::size_t i) const {
    return std::span(entries).subspan(offsets[i], static_cast<std::size_t>(offsets[i + 1] - offsets[i]));
  }
  void add(std::span<const T> list) {
    entries.insert(entries.end(), list.begin(), list.end());
    offsets.push_back(entries.size());
  }
};

/// A face of a polyhedron: a polygon, and whether its normal points out of the cell.
struct CgnsSide {
  std::uint32_t polygon;
  bool outward;
};

struct CgnsNamedSet {
  FaceGroups::Kind kind;
  std::string name;
  std::vector<CgnsElement> elements;  ///< points too
};

/// All zones of a file.
struct CgnsMesh {
  ElementMesh elements;                       ///< its points are all points
  std::vector<std::array<PointId, 3>> edges;  ///< end points, and the mid-edge node or the second end point again
  CgnsLists<PointId> polygons;                ///< NGON_n
  CgnsLists<CgnsSide> polyhedra;              ///< NFACE_n
  std::vector<CgnsNamedSet> sets;
};

/// A zone being read.
struct CgnsZone {
  CgnsTree::Node node;
  std::string name;
  std::vector<std::int64_t> vertices;  ///< points along each index; unstructured: the number of points
  bool structured = false;
  PointId first_point = 0;
  std::size_t points = 0;
  std::vector<CgnsSection> sections;
  mutable std::size_t recent_section = 0;  ///< section of the last result of element()

  /// Point `number` of the file, from 1. Throws naming the node.
  PointId point(std::int64_t number, const CgnsTree& tree, const CgnsTree::Node& where) const;
  /// Element `number`, or null.
  const CgnsElement* element(std::int64_t number) const;
};

/// Reads the Elements_t nodes of an unstructured zone, and makes groups of named surface sections.
void read_cgns_sections(const CgnsTree& tree, CgnsZone& zone, CgnsMesh& mesh);

/// Reads the hexahedra (three indices) or quads (two) of a structured zone.
void read_cgns_lattice(const CgnsTree& tree, CgnsZone& zone, CgnsMesh& mesh);
/// The corners of the lattice face perpendicular to `axis` at cell (i, j, k), counted from 0; empty if out of range.
std::vector<PointId> cgns_lattice_face(const CgnsZone& zone, std::size_t axis, const std::array<std::int64_t, 3>& cell);

/// Reads the BC_t nodes of a zone and their families.
void read_cgns_conditions(const CgnsTree& tree, const CgnsZone& zone, CgnsMesh& mesh);

/// Builds the mesh of a file of polyhedra: its cells, their boundary and its groups. `name` is used in errors.
std::shared_ptr<const Mesh> cgns_polyhedra(CgnsMesh&& mesh, const std::string& name);

}  // namespace deform::io
