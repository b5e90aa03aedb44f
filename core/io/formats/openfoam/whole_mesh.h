// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/io/formats/openfoam/foam_mesh.h"
#include "core/io/formats/openfoam/openfoam_folder.h"

namespace deform::io {

/// One part of a decomposed case, and what its members are in the whole.
struct CasePart {
  FoamMesh mesh;
  std::string point_bytes;                          ///< of the file `points`
  std::filesystem::path points_path;                ///< from which they were read
  std::string points_name, faces_name, cells_name;  ///< the files of the addresses, for errors
  std::vector<PointId> points;                      ///< for every point
  std::vector<std::int64_t> faces;                  ///< for every face: f + 1, or -(f + 1) if it runs the other way round
  std::vector<std::uint32_t> cells;                 ///< for every cell

  /// Whether another part has this face too.
  bool shared(std::uint64_t face) const;
};

/// The bytes of pointProcAddressing, faceProcAddressing and cellProcAddressing.
struct CaseAddresses {
  FoamFiles::Part points, faces, cells;
};

/// Reads the addresses beside the faces. Throws Error(not_found) where one is missing.
CaseAddresses load_addresses(const FoamFolder& folder);
/// Throws Error(invalid_argument) if the numbers of the addresses are not those of the mesh.
CasePart parse_case_part(FoamFiles files, const CaseAddresses& addresses);
/// Reads the mesh and the addresses beside its faces.
CasePart read_case_part(FoamFolder folder);
/// The mesh before it was decomposed; see read_parts(). Of points that several parts have, the first part's are taken.
FoamMesh whole_mesh(const std::vector<CasePart>& parts);

}  // namespace deform::io
