// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/io/binary/byte_stream.h"
#include "core/mesh/mesh.h"

namespace deform::io {

/// All of a mesh, with its groups and cells.
void write_mesh(const Mesh& mesh, ByteWriter& to);

/// Validated. Throws Error(data_loss) for what no write_mesh() wrote, Error(invalid_argument) for what is no mesh.
Mesh read_mesh(ByteReader& from);

}  // namespace deform::io
