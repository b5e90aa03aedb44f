// SPDX-License-Identifier: Apache-2.0
#pragma once

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

/// A mesh read from a file, together with what is needed to write the same file with other coordinates. Immutable; any thread may
/// read.
class MeshFile {
 public:
  virtual ~MeshFile() = default;
  /// The format that was read, in which alone it can be written.
  Format format() const { return format_; }
  /// Every point in file order (STL: coincident corners of the whole file welded into one point each, in order of first
  /// appearance). Face groups: OBJ groups, objects and materials by their names; where an object or material has the name of a
  /// group with other faces it is called "object:NAME" or "material:NAME". STL solids by name, the n-th solid of the file
  /// "solid_n" when it has none; solids of one name are one group. OpenFOAM: the faces are those of the boundary; patches, patch
  /// groups and point, face and cell zones by their names (see FaceGroups). CGNS: zones one after the other; boundary conditions,
  /// families, sections of surface elements, and where there are several also those of cells, and zones. Exodus: side sets, node
  /// sets, blocks. SU2: markers. VTK: "NAME_VALUE" for the values of an integer array of the cells. Groups without members are
  /// left out.
  std::shared_ptr<const Mesh> mesh() const { return mesh_; }
  /// The elements of a volume mesh in a finite-element format, over the same points; else null.
  std::shared_ptr<const Elements> elements() const { return mesh_->elements; }
  /// The cells of a volume mesh that is stored by faces, over the same points; else null.
  std::shared_ptr<const PolyhedralCells> cells() const { return mesh_->cells; }

  /// The original file with the coordinates of `points` (size mesh()->point_count()) and nothing else changed: comments, spacing,
  /// line ends, other properties, vertex normals, face lines stay byte for byte. The normals of STL facets whose corners moved
  /// become those of the new corners, unless they are zero or not finite. With ReadOptions::turn_normals a vertex normal of an
  /// OBJ file turns by the least rotation that takes the area-weighted mean normal of its faces to that of the deformed faces;
  /// one whose faces do not move, or have no mean normal, stays byte for byte. Text: shortest decimal that parses to the same
  /// double; a coordinate whose value did not change keeps its token. Binary floats: nearest float. Abaqus and Nastran: where the
  /// shortest decimal is longer than the field, the nearest one that fits: 20 characters in Abaqus, 8 or 16 columns in Nastran,
  /// between commas as much, or as the longest number between commas in the file. Throws Error(invalid_argument) for a wrong
  /// size, non-finite coordinates, and z that leaves the plane of a two-dimensional file.
  virtual std::string with_points(std::span<const Vec3> points) const = 0;

  /// The same for a mesh that is made of several files (Abaqus decks with *INCLUDE): this file first, then all others.
  /// with_points() gives the first, and throws Error(failed_precondition) when the points of another would change.
  struct FilePart {
    std::filesystem::path path;      ///< as the first file names it, relative to that; of the first empty
    std::filesystem::path original;  ///< where it was read from
    std::string bytes;               ///< its new content
  };
  /// The first file and all that it includes, see FilePart.
  virtual std::vector<FilePart> parts_with_points(std::span<const Vec3> points) const { return {{{}, {}, with_points(points)}}; }

  bool compressed = false;  ///< the bytes came gzipped

 protected:
  MeshFile(Format format, std::shared_ptr<const Mesh> mesh) : format_(format), mesh_(std::move(mesh)) {}  ///< mesh: as read
  const Points& original_points() const { return mesh_->points; }                                         ///< as read

 private:
  const Format format_;
  const std::shared_ptr<const Mesh> mesh_;
};

/// For help texts: the usual endings of the files that read_mesh_file() reads.
std::string mesh_file_names();

/// Where damaged files may do harm. CGNS and netCDF-4 files are parsed by libraries that nobody hardened: such a file may crash
/// them, and the process that they are in with them.
struct ReadOptions {
  /// A program and its arguments that does nothing but call serve_isolated_reader(), such as {"/proc/self/exe", "read-isolated"}:
  /// those files are read, and their points written, in a process of it, whose memory, time and files are limited by the size of
  /// the file. When it crashes or reaches a limit that is Error(invalid_argument) naming the signal. Empty: they are read in this
  /// process.
  std::vector<std::string> isolated_reader;
  /// Ends that process: Error(cancelled).
  std::optional<CancelFlag> cancel;
  /// Of OBJ: with_points() turns the vertex normals (vn) of faces whose corners move. They take 60 bytes each and every corner 4
  /// until the mesh file is destroyed. See MeshFile::with_points().
  bool turn_normals = false;
};

/// The main function of such a process: reads what it is to do from standard input and answers on standard output. Gives the exit
/// code: 2 when nobody asked for anything there.
int serve_isolated_reader();

/// Reads .obj .off .ply .stl, Medit's .mesh, SU2's .su2, VTK's .vtk, .vtu and .vtp, each also as .gz (recognised by content), and
/// OpenFOAM meshes: a folder that holds constant/polyMesh, polyMesh or the files of one, the path of its `points`, or a time
/// folder of a case or the folder of a region in one, whose files are looked for as OpenFOAM does: in it, else in the last time
/// folder before it that has them, else in constant. Throws Error(invalid_argument) naming file, line (or byte offset) and what
/// was expected; Error(not_found) when the file cannot be opened. Gmsh (.msh): physical groups of surfaces hold faces, all others
/// points; a group without a name is called "physical_2d_7". Abaqus (.inp): sets and surfaces, those of parts as "PART.NAME"
/// where there are several parts or the assembly has the name too; the points of an instance are those of its part, not moved to
/// where the instance is. Included files are relative to the folder of PATH. Nastran (.bdf .nas .dat): "pid_N" for the elements
/// of property N.
std::unique_ptr<MeshFile> read_mesh_file(const std::filesystem::path& path, const ReadOptions& options = {});

/// The same from memory; `name` gives the format by its extension and stands in errors. What the bytes claim (counts) is checked
/// against their number before anything is allocated.
std::unique_ptr<MeshFile> parse_mesh(std::string bytes, const std::string& name, const ReadOptions& options = {});

/// Writes source with new coordinates to `path` (gzipped when it ends in .gz), by temporary file and rename. The extension must
/// be the source's format. Of an OpenFOAM mesh only `points` is written, with the folders above it: to PATH when that is called
/// points or points.gz, otherwise to PATH/polyMesh/points, PATH being a time folder.
/// The files that an Abaqus deck includes are written beside PATH under the names that it includes them by, those that hold no
/// node too; the files that were read are never overwritten: Error(failed_precondition) when other points would have to go there.
void write_mesh_file(const MeshFile& source, std::span<const Vec3> points, const std::filesystem::path& path);

/// The file of the mesh at `source` that write_mesh_file() to `output` would replace, under whatever name (links of both kinds,
/// with or without .gz), or that would no longer be read once `output` is there. An OpenFOAM case: its mesh in constant, and the
/// time folder `source`. Nothing when the two are apart. Looks at files only; what is not there is nobody's.
std::optional<std::filesystem::path> replaced_source(const std::filesystem::path& source, const std::filesystem::path& output);

/// Throws Error(invalid_argument) where a mesh that is written to `output` would not be found again: of an OpenFOAM mesh a case
/// instead of one of its time folders, or a time folder instead of the region of `source` in it.
void check_output(const std::filesystem::path& source, const std::filesystem::path& output);

/// The file that holds the coordinates of the mesh at `source`, all links followed.
std::filesystem::path source_file(const std::filesystem::path& source);

/// A new file from a mesh (samples, conversions): OBJ or STL by extension, groups as g / solid names. STL is text when the mesh
/// has groups (binary STL has no names) and binary otherwise, triangles only.
void write_new_file(const Mesh& mesh, const std::filesystem::path& path);

/// Whole file, gunzipped when its content is gzip. At most max_bytes after decompression (Error(out_of_budget)).
std::string read_file(const std::filesystem::path& path, bool* was_gzip = nullptr, std::size_t max_bytes = std::size_t{1} << 36);
/// By temporary file in the same folder and rename; gzipped when the name ends in .gz.
void write_file(const std::filesystem::path& path, std::string_view bytes);

}  // namespace deform::io
