// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "core/codec/block.h"
#include "deform/v1/deformation.pb.h"

namespace deform::convert {

/// Replaces ENCODING_DEFAULT by its meaning; other encodings are unchanged.
v1::Encoding resolved(v1::Encoding encoding);

/// std::nullopt for an unknown encoding.
std::optional<codec::Encoding> encoding_from_proto(v1::Encoding encoding);
v1::Encoding encoding_to_proto(codec::Encoding encoding);

/// The options of an output. A tolerance of 0 becomes 1e-6 of the diagonal. Throws Error(invalid_argument)
/// "output.tolerance: ...".
codec::EncodeOptions encode_options(const v1::Output& output, double diagonal);

/// These functions move the bytes. The caller sets design and position.
void block_to_proto(codec::Block&& block, v1::Block& message);
/// Throws Error(data_loss) for an unknown encoding or an offset without three numbers.
codec::Block block_from_proto(v1::Block&& message);

}  // namespace deform::convert
