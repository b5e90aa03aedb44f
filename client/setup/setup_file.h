// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/problems.h"
#include "core/io/mesh_file.h"
#include "deform/v1/setup.pb.h"

namespace deform::client {

/// A setup as a file describes it.
struct SetupFile {
  v1::Setup setup;                                     ///< `geometry` is an id, or empty when it is a file
  std::optional<std::filesystem::path> geometry_file;  ///< relative paths start at the setup file
  std::vector<std::filesystem::path> files{};          ///< the others that were read: cage, control points, lists of ids
};

/// A number may be given as an expression of L (the diagonal of the mesh) and Lx, Ly, Lz (the sides of its bounding box); only
/// then the mesh is read, with the options `reading`. Throws Error(invalid_argument) with file and line; Error(not_found) when a
/// file does not exist.
SetupFile read_setup_file(const std::filesystem::path& path, const io::ReadOptions& reading = {});

/// The same, with what is wrong going to `problems`: collecting, the setup lacks what could not be read. Where the file itself
/// cannot be read or is no YAML, an Error all the same.
SetupFile read_setup_file(const std::filesystem::path& path, Problems& problems, const io::ReadOptions& reading = {});

/// The method of a setup file that holds nothing else, for this mesh: of its lengths, and of cages that are generated. Throws
/// Error(invalid_argument) with the file: other keys, no method; and as read_setup_file().
v1::Method read_method_file(const std::filesystem::path& path, std::shared_ptr<const Mesh> mesh = nullptr);

/// What becomes of the geometry that a setup names.
enum class GeometryEntry {
  needed,    ///< a setup without one is refused
  left_out,  ///< the caller has another: it is neither looked at nor kept
};

/// The text of a setup.
struct SetupText {
  std::string text;                                ///< YAML
  std::string name;                                ///< for errors
  std::filesystem::path folder;                    ///< of the files that it names
  GeometryEntry geometry = GeometryEntry::needed;  ///< left out: expressions have no lengths of the mesh
  io::ReadOptions reading{};                       ///< of the mesh, if an expression needs its lengths
  std::shared_ptr<const Mesh> mesh{};              ///< the mesh where it is known already
};

/// The same from text.
SetupFile parse_setup(const SetupText& from, Problems& problems);

/// 8 to 64 hexadecimal digits: an id or the beginning of one.
bool looks_like_id(const std::string& text);

/// The length of a mesh with this bounding box that expressions of a setup call by that name: L, the diagonal, Lx, Ly and Lz, the
/// sides. std::nullopt for any other name.
std::optional<double> mesh_length(std::string_view name, const Box& box);

}  // namespace deform::client
