// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/io/binary/byte_stream.h"
#include "core/mesh/mesh.h"

namespace deform::io {

/// Writes a whole mesh, with its groups and cells.
void write_mesh(const Mesh& mesh, ByteWriter& to);

/// Reads and validates a mesh. Throws Error(data_loss) for bytes not written by write_mesh(), Error(invalid_argument) for an
/// invalid mesh.
Mesh read_mesh(ByteReader& from);

}  // namespace deform::io
