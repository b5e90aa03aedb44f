// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace deform::codec {

/// Whether Draco compresses these triples well. The symbol table of its entropy coder is as long as the largest difference
/// between neighbours, so it becomes inefficient beyond about 20 bits.
bool suits_draco(std::span<const std::int32_t> triples);

/// Encodes integer triples as DRACO, described in deformation.proto: one generic attribute of a Draco point cloud, sequential
/// encoder, difference prediction.
std::string encode_draco(std::span<const std::int32_t> triples);

/// Decodes exactly triples.size() numbers; throws Error(data_loss) for anything else. Everything that the header claims and that
/// makes Draco allocate (points, attributes, components, symbols) is checked first.
void decode_draco(const std::string& bytes, std::span<std::int32_t> triples);

}  // namespace deform::codec
