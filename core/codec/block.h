// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "core/base/types.h"

namespace deform::codec {

enum class Encoding : std::uint8_t {
  raw_f64 = 1,    ///< deformed coordinates, 3 doubles per point, little endian, bit-exact
  raw_f32 = 2,    ///< deformed coordinates, 3 floats per point, little endian
  draco = 3,      ///< displacements from the registered points on an integer grid, Draco sequential point cloud
  delta_zstd = 4  ///< the same integers, difference to the previous point, byte shuffle, zstd
};

/// Largest number of points of a block that any decoder accepts.
inline constexpr std::size_t max_block_points = 1u << 16;

/// How to encode.
struct EncodeOptions {
  Encoding encoding = Encoding::draco;  ///< asked for; a block may fall back to raw_f64
  /// Largest absolute error per coordinate, model units; > 0 for draco and delta_zstd, ignored by the raw encodings.
  double tolerance = 0;
};

/// Points [first, first + count) of one design, each block decodable for itself. deformation.proto describes the bytes.
struct Block {
  Encoding encoding = Encoding::raw_f64;  ///< the one used: raw_f64 when the integers did not fit (fell_back is true then)
  bool fell_back = false;                 ///< to raw_f64, since the integers did not fit
  std::uint32_t count = 0;                ///< points
  double step = 0;                        ///< grid spacing of the integers, model units; 0 for the raw encodings
  std::array<std::int64_t, 3> offset{};   ///< added to the decoded integers
  double max_error = 0;                   ///< true largest |decoded - deformed| over points and coordinates, model units
  std::uint64_t checksum = 0;             ///< XXH64 (seed 0) of the raw bytes, or of the decoded int32 triples, little endian
  std::string bytes;                      ///< as `encoding` says
};

/// Encodes one block. registered.size() == deformed.size() <= max_block_points. A pure function: any thread. Throws
/// Error(invalid_argument) for sizes or a tolerance out of range. Non-finite coordinates are kept by falling back to raw_f64.
Block encode(std::span<const Vec3> registered, std::span<const Vec3> deformed, const EncodeOptions& options);

/// Decodes into out (same size as registered and block.count). Hostile bytes end as Error(data_loss) with bounded memory: what
/// the bytes claim is checked against block.count before anything is allocated. Verifies the checksum.
void decode(const Block& block, std::span<const Vec3> registered, std::span<Vec3> out);

/// Folds block checksums (in block order) into the checksum of a design: XXH64 over the 8-byte little-endian checksums.
std::uint64_t fold_checksums(std::span<const std::uint64_t> block_checksums);

}  // namespace deform::codec
