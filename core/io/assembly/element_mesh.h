// SPDX-License-Identifier: Apache-2.0
#pragma once

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

/// What a reader of a finite-element format collects: points, elements, named surface elements and named sets of points.
struct ElementMesh {
  struct Face {
    std::vector<PointId> corners;  ///< around it; of a quadratic one with its mid nodes: corner, mid, corner, mid, ...
    std::string name;              ///< of the group it belongs to; none when empty
    std::optional<PointId> centre = std::nullopt;  ///< the mid-face node, where it has one
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
  std::vector<std::string> volume_names;  ///< of the elements' groups; one per element, or none
  std::vector<Face> faces;
  std::vector<FaceSet> face_sets;  ///< further groups of surface elements
  std::vector<PointSet> point_sets;

  /// A surface element of 3, 4, 6, 7, 8 or 9 nodes: corners, then its mid-edge nodes, then its mid-face node (CGNS, Gmsh,
  /// Exodus, Abaqus, VTK).
  void add_face(std::span<const PointId> nodes, const std::string& name);
};

/// Its mesh. The faces are those of the boundary of the elements or cells, or the surface elements where there are no others; a
/// surface element that is a face of the boundary belongs to its group as a face (as all the faces that one with a mid-face node
/// is split into), any other with its points. Groups of elements hold their points; they are left out when there is one only.
/// Throws Error(invalid_argument) naming the file.
std::shared_ptr<const Mesh> mesh_of(ElementMesh&& source, const std::string& name);

}  // namespace deform::io
