// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/io/mesh_file.h"

namespace deform::io {

struct ContainerLibrary;

/// The most points, faces and corners of a mesh.
inline constexpr std::uint64_t most_ids = std::numeric_limits<std::uint32_t>::max();

/// Describes one format. Each folder of core/io/formats defines the entries of its formats; readers() lists all of them.
struct Reader {
  Format format{};
  std::string name;                     ///< name in messages: "OBJ"
  std::vector<std::string> extensions;  ///< in lower case, the usual one first; empty if a mesh is a folder

  /// Reads a mesh, unless `library` does. `bytes` are uncompressed, `name` is used in errors. Throws as parse_mesh() does.
  std::unique_ptr<MeshFile> (*parse)(std::string bytes, const std::string& name) = nullptr;
  /// The same with ReadOptions::turn_normals, in formats that have vertex normals.
  std::unique_ptr<MeshFile> (*parse_turning_normals)(std::string bytes, const std::string& name) = nullptr;
  const ContainerLibrary* library = nullptr;  ///< parser of a format that only a library can read

  /// Reads a file with includes, which are relative to its folder, in formats that have them.
  std::unique_ptr<MeshFile> (*parse_with_includes)(std::string bytes, const std::filesystem::path& path) = nullptr;
  /// The bytes of a new file, in formats that write_new_file() writes. The mesh is valid.
  std::string (*new_file)(const Mesh& mesh, const std::string& name) = nullptr;
};

/// All formats, in the order of help texts. Any thread.
const std::vector<Reader>& readers();
const Reader& reader_of(Format format);

/// The reader for the extension of a file name, in any case and ignoring a final .gz; a file called `points` belongs to OpenFOAM.
/// nullptr for other names.
const Reader* find_reader(const std::string& name);
/// The same. Throws Error(invalid_argument) for other names.
const Reader& reader_of(const std::string& name);

}  // namespace deform::io
