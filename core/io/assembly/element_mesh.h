// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/io/assembly/face_groups.h"
#include "core/io/mesh_file.h"
#include "core/mesh/elements.h"

namespace deform::io {

/// The result of a reader of a finite-element format: points, elements, named surface elements and named sets of points.
struct ElementMesh {
  struct Face {
    std::vector<PointId> corners;                  ///< corners in order around the face; quadratic: corner, mid, corner, mid, ...
    std::string name;                              ///< name of its group; empty if it has none
    std::optional<PointId> centre = std::nullopt;  ///< mid-face node, if any
    std::int32_t entity = 0;                       ///< see MeshFile::face_entities
  };
  struct FaceSet {
    std::string name;
    std::vector<std::size_t> faces;  ///< indices of `faces`
    FaceGroups::Kind kind = FaceGroups::Kind::group;
  };
  struct PointSet {
    std::string name;
    std::vector<PointId> points;
    FaceGroups::Kind kind = FaceGroups::Kind::point_zone;
  };
  std::vector<Vec3> points;
  Elements elements;
  std::optional<PolyhedralCells> cells;   ///< instead of elements
  std::vector<std::string> volume_names;  ///< names of the groups of the elements; one for each element, or empty
  std::vector<Face> faces;
  std::vector<FaceSet> face_sets;  ///< further groups of surface elements
  std::vector<PointSet> point_sets;

  /// A surface element of 3, 4, 6, 7, 8 or 9 nodes: corners, then its mid-edge nodes, then its mid-face node (CGNS, Gmsh,
  /// Exodus, Abaqus, VTK).
  void add_face(std::span<const PointId> nodes, const std::string& name);
};

/// Builds the mesh. Its faces are the boundary of the elements or cells, or the surface elements if there are no volume elements.
/// A surface element on the boundary is added to its group as a face (or as the faces into which one with a mid-face node is
/// split), any other one by its points. Groups of volume elements contain their points; they are left out if there is only one.
/// entities: those of the faces of the mesh, where it is given. Throws Error(invalid_argument) naming the file.
std::shared_ptr<const Mesh> mesh_of(ElementMesh&& source, const std::string& name, std::vector<std::int32_t>* entities = nullptr);

}  // namespace deform::io
