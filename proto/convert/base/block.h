// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "core/codec/block.h"
#include "deform/v1/deformation.pb.h"

namespace deform::convert {

/// What ENCODING_DEFAULT means; any other encoding is itself.
v1::Encoding resolved(v1::Encoding encoding);

/// Nothing for a number that is no encoding.
std::optional<codec::Encoding> encoding_from_proto(v1::Encoding encoding);
v1::Encoding encoding_to_proto(codec::Encoding encoding);

/// tolerance 0 becomes 1e-6 of the diagonal. Throws Error(invalid_argument) "output.tolerance: ...".
codec::EncodeOptions encode_options(const v1::Output& output, double diagonal);

/// Both move the bytes. Design and position are the caller's.
void block_to_proto(codec::Block&& block, v1::Block& message);
/// Throws Error(data_loss) for an unknown encoding or an offset without three numbers.
codec::Block block_from_proto(v1::Block&& message);

}  // namespace deform::convert
