// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/base/cells_view.h"
#include "core/base/types.h"

namespace deform {

struct Elements;
struct PolyhedralCells;

/// A named set of points and faces. As a region it selects its points and all points of its faces.
struct Group {
  std::string name;             ///< as in the file
  std::vector<PointId> points;  ///< points named by themselves
  std::vector<FaceId> faces;    ///< faces of the group
};

/// Points, polygonal faces of any degree and named groups, in file order: no point is ever merged, dropped or reordered. Isolated
/// points, coincident points, degenerate faces and non-manifold faces are all legal. Immutable by convention once validated: any
/// thread may read.
struct Mesh {
  Points points;                          ///< n x 3
  std::vector<std::uint32_t> face_sizes;  ///< f; number of corners of each face, >= 1
  std::vector<PointId> face_points;       ///< sum of face_sizes; corners, face by face
  std::vector<Group> groups;              ///< names are unique and not empty
  /// The cells of a volume mesh over the same points, by their nodes or by their faces; at most one of the two is set.
  std::shared_ptr<const Elements> elements;
  std::shared_ptr<const PolyhedralCells> cells;  ///< cells by their faces

  std::size_t point_count() const { return points.size(); }     ///< n
  std::size_t face_count() const { return face_sizes.size(); }  ///< f
  std::size_t cell_count() const;                               ///< number of elements or polyhedral cells
  CellsView cells_view() const;                                 ///< valid as long as this mesh

  /// f + 1 prefix sums of face_sizes: face i has corners face_points[offsets[i] .. offsets[i+1]).
  std::vector<std::uint64_t> face_offsets() const;

  /// The group with this name, or nullptr.
  const Group* find_group(const std::string& name) const;

  /// Throws Error(invalid_argument) naming the field, index and limit: NaN or infinite coordinate or one beyond the limits of
  /// coordinate_limits.h, no point, corner or group entry out of range, sizes that do not add up, empty or repeated group name,
  /// more than 2^32-1 points or faces, invalid cells (see Elements::validate() and PolyhedralCells::validate()).
  void validate() const;
};

}  // namespace deform
