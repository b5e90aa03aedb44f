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

/// Numbers for every point or every cell.
struct VtkArray {
  enum class Type { float64, int32, uint8 };  ///< of integers the values are whole and in range
  std::string name;
  std::size_t components = 1;  ///< 3: a vector
  std::vector<double> values;  ///< components x points or cells
  Type type = Type::float64;
};

/// Texts about the mesh as a whole, such as the names of the values of an array. UTF-8.
struct VtkTexts {
  std::string name;
  std::vector<std::string> values;
};

/// What a file shows besides the mesh.
struct VtkArrays {
  std::vector<VtkArray> points, cells;
  std::vector<VtkTexts> texts{};  ///< field data
};

/// Files of ParaView and VTK (XML, version 1.0: appended raw data, header of UInt64, little-endian; coordinates as Float64,
/// ids as Int64). Points and cells keep their order. All throw Error(invalid_argument) when the extension is not the one
/// named here, an array has the wrong size, or the mesh names points it does not have.

/// .vtp: the faces of a surface as polygons. A face of one or two corners is a vertex or a line, which VTK wants first: only then
/// the cells have another order, and an array `face` says which face each is.
void write_vtp(const Mesh& mesh, const VtkArrays& arrays, const std::filesystem::path& path);

/// .vtu: finite elements, linear and quadratic, their nodes in the order of VTK. VTK has no pyramid of 14 nodes: the mid-face
/// node of its base stays a point without a cell.
void write_vtu(std::span<const Vec3> points, const Elements& elements, const VtkArrays& arrays,
               const std::filesystem::path& path);

/// .vtu: polyhedra with their faces, outward.
void write_vtu(std::span<const Vec3> points, const PolyhedralCells& cells, const VtkArrays& arrays,
               const std::filesystem::path& path);

/// The same as bytes; `name` stands in errors.
std::string vtp_bytes(const Mesh& mesh, const VtkArrays& arrays, const std::string& name);
std::string vtu_bytes(std::span<const Vec3> points, const Elements& elements, const VtkArrays& arrays, const std::string& name);
std::string vtu_bytes(std::span<const Vec3> points, const PolyhedralCells& cells, const VtkArrays& arrays,
                      const std::string& name);

}  // namespace deform::io
