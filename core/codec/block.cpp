// SPDX-License-Identifier: Apache-2.0
#include "core/codec/block.h"

#define XXH_STATIC_LINKING_ONLY  // for the size of a state
#include <xxhash.h>

#include <cmath>
#include <cstring>
#include <memory>

#include "core/base/error.h"
#include "core/codec/delta_coder.h"
#include "core/codec/draco_coder.h"
#include "core/codec/grid.h"

namespace deform::codec {

namespace {

std::uint64_t checksum_of(const void* data, std::size_t size) { return XXH64(data, size, 0); }

void encode_raw_f64(std::span<const Vec3> deformed, Block& block) {
  block.encoding = Encoding::raw_f64;
  block.bytes.assign(reinterpret_cast<const char*>(deformed.data()), deformed.size_bytes());
  block.checksum = checksum_of(block.bytes.data(), block.bytes.size());
}

void encode_raw_f32(std::span<const Vec3> deformed, Block& block) {
  block.encoding = Encoding::raw_f32;
  block.bytes.resize(deformed.size() * 3 * sizeof(float));
  const double* values = deformed.empty() ? nullptr : deformed[0].data();
  char* to = block.bytes.data();
  for (std::size_t i = 0; i < 3 * deformed.size(); ++i) {
    const auto rounded = static_cast<float>(values[i]);
    std::memcpy(to + i * sizeof(float), &rounded, sizeof(float));
    // Differences of coordinates that are not finite, or become infinite in float, are not counted as errors.
    const double error = std::fabs(static_cast<double>(rounded) - values[i]);
    if (error > block.max_error && std::isfinite(error)) block.max_error = error;
  }
  block.checksum = checksum_of(block.bytes.data(), block.bytes.size());
}

bool finite_as_float(std::span<const Vec3> points) {
  for (const auto& p : points) {
    for (const double x : p) {
      if (!std::isfinite(static_cast<float>(x))) return false;
    }
  }
  return true;
}

void expect_size(const Block& block, std::size_t per_point) {
  if (block.bytes.size() == block.count * per_point) return;
  throw Error(ErrorCode::data_loss, "block: expected " + std::to_string(block.count * per_point) + " bytes for " +
                                        std::to_string(block.count) + " points, got " + std::to_string(block.bytes.size()));
}

void check_sum(const Block& block, const void* data, std::size_t size) {
  if (checksum_of(data, size) != block.checksum) throw Error(ErrorCode::data_loss, "block: the checksum does not match");
}

void decode_integers(const Block& block, std::span<const Vec3> registered, std::span<Vec3> out) {
  if (!plausible(block.step, block.offset)) throw Error(ErrorCode::data_loss, "block: step or offset out of range");
  const auto buffer = std::make_unique_for_overwrite<std::int32_t[]>(3 * out.size());
  const std::span<std::int32_t> values(buffer.get(), 3 * out.size());
  if (block.encoding == Encoding::draco) {
    decode_draco(block.bytes, values);
  } else {
    decode_delta(block.bytes, values);
  }
  check_sum(block, values.data(), values.size_bytes());
  Grid grid;
  grid.step = block.step;
  grid.offset = block.offset;
  from_grid(registered, values, grid, out);
}

}  // namespace

Block encode(std::span<const Vec3> registered, std::span<const Vec3> deformed, const EncodeOptions& options) {
  if (registered.size() != deformed.size() || registered.size() > max_block_points) {
    throw Error(ErrorCode::invalid_argument,
                "block: " + std::to_string(registered.size()) + " registered and " + std::to_string(deformed.size()) +
                    " deformed points, expected equal and at most " + std::to_string(max_block_points));
  }
  Block block;
  block.count = static_cast<std::uint32_t>(deformed.size());
  if (options.encoding == Encoding::raw_f64) {
    encode_raw_f64(deformed, block);
    return block;
  }
  if (options.encoding == Encoding::raw_f32) {
    block.fell_back = !finite_as_float(deformed);
    block.fell_back ? encode_raw_f64(deformed, block) : encode_raw_f32(deformed, block);
    return block;
  }
  if (!std::isfinite(options.tolerance) || !(options.tolerance > 0)) {
    throw Error(ErrorCode::invalid_argument, "tolerance: must be finite and greater than 0");
  }
  const bool draco = options.encoding == Encoding::draco;
  Grid grid;
  if (!to_grid(registered, deformed, options.tolerance, grid) || (draco && !suits_draco(grid.values()))) {
    block.fell_back = true;
    encode_raw_f64(deformed, block);
    return block;
  }
  block.encoding = options.encoding;
  block.step = grid.step;
  block.offset = grid.offset;
  block.max_error = grid.max_error;
  block.checksum = checksum_of(grid.buffer.get(), grid.size * sizeof(std::int32_t));
  block.bytes = draco ? encode_draco(grid.values()) : encode_delta(grid.values());
  return block;
}

void decode(const Block& block, std::span<const Vec3> registered, std::span<Vec3> out) {
  if (block.count > max_block_points || block.count != registered.size() || block.count != out.size()) {
    throw Error(ErrorCode::data_loss, "block: claims " + std::to_string(block.count) + " points, expected " +
                                          std::to_string(registered.size()) + ", at most " + std::to_string(max_block_points));
  }
  switch (block.encoding) {
    case Encoding::raw_f64:
      expect_size(block, sizeof(Vec3));
      check_sum(block, block.bytes.data(), block.bytes.size());
      if (!out.empty()) std::memcpy(out.data(), block.bytes.data(), block.bytes.size());
      return;
    case Encoding::raw_f32:
      expect_size(block, 3 * sizeof(float));
      check_sum(block, block.bytes.data(), block.bytes.size());
      for (std::size_t i = 0; i < 3 * out.size(); ++i) {
        float value;
        std::memcpy(&value, block.bytes.data() + i * sizeof(float), sizeof(float));
        out[i / 3][i % 3] = static_cast<double>(value);
      }
      return;
    case Encoding::draco:
    case Encoding::delta_zstd:
      decode_integers(block, registered, out);
      return;
  }
  throw Error(ErrorCode::data_loss, "block: unknown encoding " + std::to_string(static_cast<int>(block.encoding)));
}

std::uint64_t fold_checksums(std::span<const std::uint64_t> block_checksums) {
  return checksum_of(block_checksums.data(), block_checksums.size_bytes());
}

struct ChecksumFold::State {
  XXH64_state_t sum;
};

ChecksumFold::ChecksumFold() : state_(std::make_unique<State>()) { XXH64_reset(&state_->sum, 0); }
ChecksumFold::~ChecksumFold() = default;
ChecksumFold::ChecksumFold(ChecksumFold&&) noexcept = default;
ChecksumFold& ChecksumFold::operator=(ChecksumFold&&) noexcept = default;

void ChecksumFold::add(std::uint64_t block_checksum) { XXH64_update(&state_->sum, &block_checksum, sizeof block_checksum); }

std::uint64_t ChecksumFold::value() const { return XXH64_digest(&state_->sum); }

}  // namespace deform::codec
