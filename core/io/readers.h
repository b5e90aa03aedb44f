// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/io/mesh_file.h"

namespace deform::io {

struct ContainerLibrary;

/// What is known of one format. Each folder of core/io/formats defines those of its formats; readers() lists all of them.
struct Reader {
  Format format{};
  std::string name;                     ///< in messages: "OBJ"
  std::vector<std::string> extensions;  ///< in lower case, the usual one first; none: a mesh is a folder

  /// This one or `library` reads a mesh. `bytes` are unpacked already, `name` stands in errors. Errors as parse_mesh().
  std::unique_ptr<MeshFile> (*parse)(std::string bytes, const std::string& name) = nullptr;
  /// The same, with vertex normals that ReadOptions::turn_normals is about, in formats that have any.
  std::unique_ptr<MeshFile> (*parse_turning_normals)(std::string bytes, const std::string& name) = nullptr;
  const ContainerLibrary* library = nullptr;  ///< what parses a format that is left to a library

  /// Reads a file whose includes are relative to its folder, in formats that have any.
  std::unique_ptr<MeshFile> (*parse_with_includes)(std::string bytes, const std::filesystem::path& path) = nullptr;
  /// The bytes of a new file, in formats that write_new_file() writes. The mesh is valid.
  std::string (*new_file)(const Mesh& mesh, const std::string& name) = nullptr;
};

/// Every format, in the order of help texts. Any thread.
const std::vector<Reader>& readers();
const Reader& reader_of(Format format);

/// The one for the extension in any case, a final .gz not counted; `points` is a file of OpenFOAM. Throws Error(invalid_argument)
/// for any other name.
const Reader& reader_of(const std::string& name);

}  // namespace deform::io
