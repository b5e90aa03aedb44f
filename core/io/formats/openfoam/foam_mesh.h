// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/io/assembly/coordinate_records.h"
#include "core/io/formats/openfoam/openfoam_folder.h"
#include "core/mesh/cells.h"
#include "core/mesh/mesh.h"

namespace deform::io {

struct FoamPatch {
  std::string name;
  std::vector<std::string> groups;
  bool empty = false;          ///< of type "empty": the mesh is two-dimensional
  bool between_parts = false;  ///< of type "processor": faces shared with another part of a decomposed case
  std::string cyclic;          ///< the cyclic patch of the whole case that these faces of a part belong to, else empty
  std::uint64_t first = 0, count = 0;
};

struct FoamZone {
  std::string name;
  std::vector<std::uint32_t> members;  ///< points, faces or cells
};

/// The points, and where the file has their coordinates.
struct FoamPoints {
  std::vector<Vec3> points;
  TextRecords text;
  BinaryRecords binary;
  bool is_binary = false;
};

/// What the files of a polyMesh contain.
struct FoamMesh {
  FoamPoints points;
  PolyhedralCells cells;
  std::vector<FoamPatch> patches;  ///< of boundary faces
  std::vector<FoamZone> point_zones, face_zones, cell_zones;
};

/// Throws Error(invalid_argument) naming file and line.
FoamMesh read_foam_mesh(const FoamFiles& files);
/// The mesh of the boundary with the cells; `name` is used in errors.
std::shared_ptr<const Mesh> assemble_mesh(FoamMesh mesh, const std::string& name);
/// The file `points` of these bytes; its record i is point record_points[i] of the mesh, or i if that is empty (see TextRecords).
std::unique_ptr<MeshFile> make_points_file(FoamPoints points, std::string bytes, std::shared_ptr<const Mesh> mesh,
                                           std::span<const PointId> record_points);

}  // namespace deform::io
