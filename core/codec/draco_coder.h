// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace deform::codec {

/// Whether Draco codes these triples well: its entropy coder counts symbols in a table as long as the largest difference between
/// neighbours, so it collapses beyond about 20 bits.
bool suits_draco(std::span<const std::int32_t> triples);

/// Integer triples to the bytes of DRACO, which deformation.proto describes: one generic attribute of a Draco point cloud,
/// sequential encoder, differences predicted.
std::string encode_draco(std::span<const std::int32_t> triples);

/// Decodes exactly triples.size() numbers; throws Error(data_loss) for anything else. Everything that the header claims and that
/// makes Draco allocate (points, attributes, components, symbols) is checked first.
void decode_draco(const std::string& bytes, std::span<std::int32_t> triples);

}  // namespace deform::codec
