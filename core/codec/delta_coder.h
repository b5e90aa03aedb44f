// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace deform::codec {

/// Encodes integer triples as DELTA_ZSTD, described in deformation.proto: difference to the previous triple, zigzag, one plane
/// per axis and byte, one zstd frame.
std::string encode_delta(std::span<const std::int32_t> triples);

/// Decodes exactly triples.size() numbers; throws Error(data_loss) for anything else. Memory: 4 bytes per number plus what zstd
/// needs for one frame of that size.
void decode_delta(const std::string& bytes, std::span<std::int32_t> triples);

}  // namespace deform::codec
