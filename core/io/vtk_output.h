// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"

namespace deform::io {

/// An array of values for each point or each cell.
struct VtkArray {
  /// The type of the values in the file; for the integers they must be integral and in range.
  enum class Type { float64, int32, uint8 };
  std::string name;            ///< name of the array
  std::size_t components = 1;  ///< 3 for vectors
  std::vector<double> values;  ///< components x points or cells
  Type type = Type::float64;   ///< type in the file
};

/// UTF-8 texts about the mesh as a whole, such as the names of the values of an array.
struct VtkTexts {
  std::string name;                 ///< name of the array
  std::vector<std::string> values;  ///< the texts
};

/// The arrays of a file in addition to the mesh.
struct VtkArrays {
  std::vector<VtkArray> points;   ///< arrays for each point
  std::vector<VtkArray> cells;    ///< arrays for each cell
  std::vector<VtkTexts> texts{};  ///< field data
};

/// Files of ParaView and VTK (XML, version 1.0: appended raw data, header of UInt64, little-endian; coordinates as Float64, ids
/// as Int64). Points and cells keep their order. All functions throw Error(invalid_argument) if the extension is not the one
/// named here, an array has the wrong size, or the mesh refers to points that do not exist.

/// .vtp: the faces of a surface as polygons. A face with one or two corners is a vertex or a line, which VTK stores first; only
/// then the order of the cells differs from that of the faces, and an array `face` holds the face of each cell.
void write_vtp(const Mesh& mesh, const VtkArrays& arrays, const std::filesystem::path& path);

/// .vtu: linear and quadratic finite elements, with nodes in the order of VTK. VTK has no pyramid with 14 nodes; the mid-face
/// node of its base remains a point without a cell.
void write_vtu(std::span<const Vec3> points, const Elements& elements, const VtkArrays& arrays,
               const std::filesystem::path& path);

/// .vtu: polyhedra with their faces, oriented outwards.
void write_vtu(std::span<const Vec3> points, const PolyhedralCells& cells, const VtkArrays& arrays,
               const std::filesystem::path& path);

/// The same as bytes; `name` is used in errors.
std::string vtp_bytes(const Mesh& mesh, const VtkArrays& arrays, const std::string& name);
std::string vtu_bytes(std::span<const Vec3> points, const Elements& elements, const VtkArrays& arrays, const std::string& name);
std::string vtu_bytes(std::span<const Vec3> points, const PolyhedralCells& cells, const VtkArrays& arrays,
                      const std::string& name);

}  // namespace deform::io
