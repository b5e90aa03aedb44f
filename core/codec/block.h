// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
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

/// Options of encode().
struct EncodeOptions {
  Encoding encoding = Encoding::draco;  ///< requested encoding; a block may fall back to raw_f64
  /// Largest absolute error per coordinate, model units; > 0 for draco and delta_zstd, ignored by the raw encodings.
  double tolerance = 0;
};

/// A range of consecutive points of one design that can be decoded on its own. deformation.proto describes the bytes.
struct Block {
  Encoding encoding = Encoding::raw_f64;  ///< encoding in use
  bool fell_back = false;                 ///< whether raw_f64 replaces the requested encoding, because the integers did not fit
  std::uint32_t count = 0;                ///< number of points
  double step = 0;                        ///< grid spacing of the integers, model units; 0 for the raw encodings
  std::array<std::int64_t, 3> offset{};   ///< added to the decoded integers, in steps
  double max_error = 0;                   ///< true largest |decoded - deformed| over points and coordinates, model units
  std::uint64_t checksum = 0;             ///< XXH64 (seed 0) of the raw bytes, or of the decoded int32 triples, little endian
  std::string bytes;                      ///< payload in this encoding
};

/// Encodes one block of points, where registered.size() == deformed.size() <= max_block_points. Blocks with non-finite
/// coordinates fall back to raw_f64, which keeps them. Throws Error(invalid_argument) if the sizes or the tolerance are out of
/// range. May be called from any thread.
Block encode(std::span<const Vec3> registered, std::span<const Vec3> deformed, const EncodeOptions& options);

/// Decodes a block into `out`, where out.size() == registered.size() == block.count, and verifies the checksum. Throws
/// Error(data_loss) for bytes that are not a valid encoding of that many points; sizes that the bytes claim are checked against
/// block.count before anything is allocated, so memory is bounded for hostile input.
void decode(const Block& block, std::span<const Vec3> registered, std::span<Vec3> out);

/// Folds block checksums (in block order) into the checksum of a design: XXH64 over the 8-byte little-endian checksums.
std::uint64_t fold_checksums(std::span<const std::uint64_t> block_checksums);

/// The same for checksums that come one by one, in constant memory. Not thread-safe.
class ChecksumFold {
 public:
  ChecksumFold();
  ~ChecksumFold();
  ChecksumFold(ChecksumFold&&) noexcept;             ///< the other may only be assigned to or destroyed
  ChecksumFold& operator=(ChecksumFold&&) noexcept;  ///< the other may only be assigned to or destroyed
  /// The next block's, in their order.
  void add(std::uint64_t block_checksum);
  /// The checksum of the blocks so far.
  std::uint64_t value() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace deform::codec
