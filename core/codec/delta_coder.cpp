// SPDX-License-Identifier: Apache-2.0
#include "core/codec/delta_coder.h"

#include <zstd.h>

#include <algorithm>
#include <memory>

#include "core/base/error.h"

namespace deform::codec {

namespace {

constexpr int level = 1;  // higher levels gain a few percent and cost several times the time

struct FreeContext {
  void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};

// Scratch memory of zstd, kept per thread: making it costs more than compressing a small block.
ZSTD_CCtx* compressor() {
  thread_local const std::unique_ptr<ZSTD_CCtx, FreeContext> context(ZSTD_createCCtx());
  return context.get();
}
ZSTD_DCtx* decompressor() {
  thread_local const std::unique_ptr<ZSTD_DCtx, FreeContext> context(ZSTD_createDCtx());
  return context.get();
}

std::uint32_t zigzag(std::uint32_t v) { return (v << 1) ^ (0u - (v >> 31)); }
std::uint32_t unzigzag(std::uint32_t v) { return (v >> 1) ^ (0u - (v & 1)); }

/// Every third of `from` into four planes of `count` bytes, lowest byte first.
void split_bytes(const std::uint32_t* __restrict from, std::size_t count, std::uint8_t* __restrict planes) {
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t r = from[3 * i];
    planes[i] = static_cast<std::uint8_t>(r);
    planes[count + i] = static_cast<std::uint8_t>(r >> 8);
    planes[2 * count + i] = static_cast<std::uint8_t>(r >> 16);
    planes[3 * count + i] = static_cast<std::uint8_t>(r >> 24);
  }
}

}  // namespace

std::string encode_delta(std::span<const std::int32_t> triples) {
  const std::size_t count = triples.size() / 3;
  const std::size_t size = triples.size_bytes();
  // Two passes of simple loops, which the compiler turns into vector code; one loop that does both is slower.
  const auto residuals = std::make_unique_for_overwrite<std::uint32_t[]>(triples.size());
  for (std::size_t i = 0; i < std::min<std::size_t>(3, triples.size()); ++i) {
    residuals[i] = zigzag(static_cast<std::uint32_t>(triples[i]));
  }
  for (std::size_t i = 3; i < triples.size(); ++i) {
    residuals[i] = zigzag(static_cast<std::uint32_t>(triples[i]) - static_cast<std::uint32_t>(triples[i - 3]));
  }
  const auto planes = std::make_unique_for_overwrite<std::uint8_t[]>(size);
  for (std::size_t k = 0; k < 3; ++k) {
    split_bytes(residuals.get() + k, count, planes.get() + 4 * k * count);
  }
  const std::size_t bound = ZSTD_compressBound(size);
  const auto compressed = std::make_unique_for_overwrite<char[]>(bound);
  const std::size_t written = ZSTD_compressCCtx(compressor(), compressed.get(), bound, planes.get(), size, level);
  if (ZSTD_isError(written)) throw Error(ErrorCode::internal, std::string("zstd: ") + ZSTD_getErrorName(written));
  return {compressed.get(), written};
}

void decode_delta(const std::string& bytes, std::span<std::int32_t> triples) {
  const std::size_t count = triples.size() / 3;
  const std::size_t expected = 4 * triples.size();
  const unsigned long long claimed = ZSTD_getFrameContentSize(bytes.data(), bytes.size());
  if (claimed == ZSTD_CONTENTSIZE_ERROR || claimed == ZSTD_CONTENTSIZE_UNKNOWN || claimed != expected ||
      ZSTD_findFrameCompressedSize(bytes.data(), bytes.size()) != bytes.size()) {
    throw Error(ErrorCode::data_loss, "delta block: not one zstd frame of " + std::to_string(expected) + " bytes (" +
                                          std::to_string(count) + " points)");
  }
  const auto planes = std::make_unique_for_overwrite<std::uint8_t[]>(expected);
  const std::size_t size = ZSTD_decompressDCtx(decompressor(), planes.get(), expected, bytes.data(), bytes.size());
  if (ZSTD_isError(size) || size != expected) throw Error(ErrorCode::data_loss, "delta block: the zstd frame is damaged");
  for (std::size_t k = 0; k < 3; ++k) {
    const std::uint8_t* plane = planes.get() + 4 * k * count;
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t r = plane[i] | std::uint32_t{plane[count + i]} << 8 | std::uint32_t{plane[2 * count + i]} << 16 |
                              std::uint32_t{plane[3 * count + i]} << 24;
      value += unzigzag(r);
      triples[3 * i + k] = static_cast<std::int32_t>(value);
    }
  }
}

}  // namespace deform::codec
