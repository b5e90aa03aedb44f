// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "server/store/file_system.h"

namespace deform::server {

/// A stored geometry is exactly the byte sequence its id is the SHA-256 of (core/codec/geometry_id.h), so the id is the checksum.

/// The bytes of the arrays of a mesh in memory, and about the size of its file.
std::size_t mesh_bytes(const Mesh& mesh);

/// The id and the file of a mesh are made in pieces of at most so many bytes. Between two of them the context may stop it, and is
/// informed of the stages "hash" and "write".
inline constexpr std::size_t content_piece = std::size_t{1} << 20;

std::string mesh_id(const Mesh& mesh, const RunContext& context = {});

/// Writes and syncs a new file. Throws as a File does, cancelled, deadline_exceeded; the file is removed then.
void write_geometry_file(const Mesh& mesh, const std::filesystem::path& file, FileSystem& files = system_files(),
                         const RunContext& context = {});

/// Reads and verifies. Throws Error(data_loss) when the content is not that of the id, Error(unavailable) when it cannot be read.
/// Memory: the arrays, whose sizes are checked against the size of the file first.
Mesh read_geometry_file(const std::filesystem::path& file, const std::string& id, FileSystem& files = system_files());

}  // namespace deform::server
