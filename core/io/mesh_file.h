// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"

namespace deform::io {

enum class Format { obj, off, ply, stl, openfoam, medit, cgns, exodus, su2, vtk, vtu, vtp, gmsh, abaqus, nastran };

/// A mesh read from a file, with the data to write the same file with other coordinates. Immutable; any thread may read.
class MeshFile {
 public:
  virtual ~MeshFile() = default;
  /// The format of the file, which is also the only one in which it can be written.
  Format format() const { return format_; }
  /// Every point in file order (STL: coincident corners of the whole file welded into one point each, in order of first
  /// appearance). Face groups: OBJ groups, objects and materials by their names; an object or material with the name of a group
  /// with different faces is called "object:NAME" or "material:NAME". STL: solids by name, the n-th solid of the file "solid_n"
  /// if it has none; solids of the same name form one group. OpenFOAM: the faces are those of the boundary; patches, patch groups
  /// and point, face and cell zones by their names (see FaceGroups). CGNS: the zones in order; boundary conditions, families,
  /// sections of surface elements and, if there are several, sections of cells and zones. Exodus: side sets, node sets, blocks.
  /// SU2: markers. VTK: "NAME_VALUE" for the values of an integer array of the cells. Groups without members are left out.
  std::shared_ptr<const Mesh> mesh() const { return mesh_; }
  /// The elements of a volume mesh in a finite-element format over the same points, else null.
  std::shared_ptr<const Elements> elements() const { return mesh_->elements; }
  /// The cells of a volume mesh stored by faces over the same points, else null.
  std::shared_ptr<const PolyhedralCells> cells() const { return mesh_->cells; }

  /// The original file with the coordinates of `points` (size mesh()->point_count()). Nothing else changes: comments, spacing,
  /// line ends, other properties, vertex normals and face lines are kept byte for byte. Only the normals of STL facets with moved
  /// corners are recomputed, unless they are zero or not finite. With ReadOptions::turn_normals, a vertex normal of an OBJ file
  /// is turned by the smallest rotation that takes the area-weighted mean normal of its faces to that of the deformed faces.
  /// Text: the shortest decimal that parses to the same double; unchanged coordinates keep their tokens. Binary floats: the
  /// nearest float. Abaqus and Nastran: if the shortest decimal is longer than the field, the nearest one that fits: 20
  /// characters in Abaqus, 8 or 16 columns in Nastran, and in free format as much, or the length of the longest number in free
  /// format in the file. Throws Error(invalid_argument) for a wrong size, non-finite coordinates, and a z outside the plane of a
  /// two-dimensional file.
  virtual std::string with_points(std::span<const Vec3> points) const = 0;

  /// One file of a mesh that consists of several: Abaqus decks with *INCLUDE, and decomposed OpenFOAM cases. with_points()
  /// returns the first one, and throws Error(failed_precondition) if points in another one would change.
  struct FilePart {
    std::filesystem::path
        path;  ///< as named in the first file, relative to it; empty for the first. OpenFOAM: processorN, processorsN
    std::filesystem::path original;  ///< where it was read from
    std::string bytes;               ///< its new content
  };
  /// The first file and all files that it includes, with new coordinates.
  virtual std::vector<FilePart> parts_with_points(std::span<const Vec3> points) const { return {{{}, {}, with_points(points)}}; }

  /// Whether the file has no z to store, so that points must stay in their plane.
  virtual bool two_dimensional() const { return false; }

  /// The number of parts of a decomposed OpenFOAM case, of which each has a file of points; 0 for all other files.
  virtual std::size_t case_parts() const { return 0; }

  bool compressed = false;  ///< whether the file was gzipped
  /// The geometrical entity of each face of the mesh, as the file has it: of Gmsh the tag of the surface, 0: none. Empty where
  /// the format has no entities.
  std::vector<std::int32_t> face_entities;

 protected:
  MeshFile(Format format, std::shared_ptr<const Mesh> mesh) : format_(format), mesh_(std::move(mesh)) {}  ///< mesh: as read
  const Points& original_points() const { return mesh_->points; }                                         ///< as read

 private:
  const Format format_;
  const std::shared_ptr<const Mesh> mesh_;
};

/// The usual extensions of the files that read_mesh_file() reads, for help texts.
std::string mesh_file_names();

/// How to read files that may be damaged. CGNS and netCDF-4 files are parsed by libraries that are not hardened: a damaged file
/// may crash them together with their process.
struct ReadOptions {
  /// A command that only calls serve_isolated_reader(), such as {"/proc/self/exe", "read-isolated"}. Those files are then read
  /// and written in a separate process, whose memory, time and file sizes are limited according to the size of the file. If it
  /// crashes or reaches a limit, Error(invalid_argument) names the signal. If empty, they are read in this process.
  std::vector<std::string> isolated_reader;
  /// Ends that process when stopped; the call then throws Error(cancelled).
  std::stop_token stop;
  /// Whether with_points() turns the vertex normals of OBJ files with their faces. A normal then takes 60 bytes and a corner 4
  /// until the mesh file is destroyed.
  bool turn_normals = false;
  /// An OpenFOAM mesh that lends faces, cells, patches and zones to points which have none, neither beside them nor in their
  /// case, such as a result of `deform sweep`. Empty or not that of an OpenFOAM mesh: nothing is lent.
  std::filesystem::path faces_of = {};
};

/// The main function of such a process: reads a request from standard input and answers on standard output. Returns the exit
/// code, which is 2 if there was no request.
int serve_isolated_reader();

/// Reads .obj .off .ply .stl, Medit's .mesh, SU2's .su2, VTK's .vtk, .vtu and .vtp, each also as .gz (recognised by content), and
/// OpenFOAM meshes: a folder that holds constant/polyMesh, polyMesh or the files of one, the path of its `points`, or a time
/// folder of a case or the folder of a region in one. Files are searched as OpenFOAM does: in this folder, then in the last
/// earlier time folder that has them, then in constant. A decomposed case is put together by the addresses of its parts: a case
/// without a mesh of its own, and CASE/processor*/PLACE, which stands for the same place in every part, as does a CASE/PLACE that
/// is nowhere else. Throws Error(invalid_argument) naming file, line (or byte offset) and what was expected; Error(not_found) if
/// the file cannot be opened. Gmsh (.msh): physical groups of surfaces contain faces, all others points; a group without a name
/// is called "physical_2d_7". Abaqus (.inp): sets and surfaces, those of parts as "PART.NAME" if there are several parts or the
/// assembly has the same name; the points of an instance are those of its part, without the transformation of the instance.
/// Included files are relative to the folder of `path`. Nastran (.bdf .nas .dat): "pid_N" for the elements of property N.
std::unique_ptr<MeshFile> read_mesh_file(const std::filesystem::path& path, const ReadOptions& options = {});

/// The same from memory. The extension of `name` selects the format; `name` is also used in errors. Counts in the file are
/// checked against its size before anything is allocated.
std::unique_ptr<MeshFile> parse_mesh(std::string bytes, const std::string& name, const ReadOptions& options = {});

/// Writes `source` with new coordinates to `path` (gzipped if it ends in .gz), by a temporary file and rename. The extension must
/// be that of the format of `source`. For an OpenFOAM mesh only `points` is written, with its parent folders: to `path` if that
/// is called points or points.gz, otherwise to polyMesh/points in the time folder `path`; a file of both names is then removed
/// under the other one. The points of a decomposed case are written for every part, with processorN after the folder of the case
/// in `path` (or for processor* there), or at its end. The files included by
/// an Abaqus deck are written next to `path` under the names used in the deck, even those without nodes. The files that were read
/// are never overwritten: throws Error(failed_precondition) if other points would have to be written there.
void write_mesh_file(const MeshFile& source, std::span<const Vec3> points, const std::filesystem::path& path);

/// The file of the mesh at `source` that write_mesh_file() to `output` would replace, under any name (hard and symbolic links,
/// with or without .gz), or that would no longer be read once `output` exists. For an OpenFOAM case these are its mesh in
/// constant and the time folder `source`. std::nullopt if the two are independent. Only existing files are considered.
std::optional<std::filesystem::path> replaced_source(const std::filesystem::path& source, const std::filesystem::path& output);

/// Throws Error(invalid_argument) if a mesh written to `output` would not be found there again: for an OpenFOAM mesh a case
/// instead of one of its time folders, a time folder instead of the region of `source` in it, a region where `source` has none,
/// or another part (processorN) of a decomposed case.
void check_output(const std::filesystem::path& source, const std::filesystem::path& output);

/// Whether there is a file or folder of that name, or parts that it stands for.
bool mesh_exists(const std::filesystem::path& path);

/// The file with the coordinates of the mesh at `source`, with all links resolved; that of a decomposed case with processor*.
std::filesystem::path source_file(const std::filesystem::path& source);

/// Writes a new file from a mesh (samples, conversions): OBJ or STL by extension, with groups as g or solid names. STL must
/// consist of triangles; it is text if the mesh has groups (binary STL has no names) and binary otherwise.
void write_new_file(const Mesh& mesh, const std::filesystem::path& path);

/// Reads a whole file and decompresses it if it is gzipped. Throws Error(out_of_budget) if the result has more than max_bytes.
std::string read_file(const std::filesystem::path& path, bool* was_gzip = nullptr, std::size_t max_bytes = std::size_t{1} << 36);
/// Writes a file by a temporary file in the same folder and rename; gzipped if the name ends in .gz.
void write_file(const std::filesystem::path& path, std::string_view bytes);

}  // namespace deform::io
