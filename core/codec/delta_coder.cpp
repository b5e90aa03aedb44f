#include "core/codec/delta_coder.h"

#include <zstd.h>

#include <memory>
#include <vector>

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

}  // namespace

std::string encode_delta(std::span<const std::int32_t> triples) {
  const std::size_t count = triples.size() / 3;
  std::vector<std::uint8_t> planes(4 * triples.size());
  std::vector<std::uint32_t> residuals(triples.size());
  for (std::size_t k = 0; k < triples.size() && k < 3; ++k) residuals[k] = zigzag(static_cast<std::uint32_t>(triples[k]));
  for (std::size_t i = 3; i < triples.size(); ++i) {
    residuals[i] = zigzag(static_cast<std::uint32_t>(triples[i]) - static_cast<std::uint32_t>(triples[i - 3]));
  }
  for (std::size_t k = 0; k < 3; ++k) {
    std::uint8_t* plane = planes.data() + 4 * k * count;
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t r = residuals[3 * i + k];
      plane[i] = static_cast<std::uint8_t>(r);
      plane[count + i] = static_cast<std::uint8_t>(r >> 8);
      plane[2 * count + i] = static_cast<std::uint8_t>(r >> 16);
      plane[3 * count + i] = static_cast<std::uint8_t>(r >> 24);
    }
  }
  std::string bytes(ZSTD_compressBound(planes.size()), '\0');
  const std::size_t size = ZSTD_compressCCtx(compressor(), bytes.data(), bytes.size(), planes.data(), planes.size(), level);
  if (ZSTD_isError(size)) throw Error(ErrorCode::internal, std::string("zstd: ") + ZSTD_getErrorName(size));
  bytes.resize(size);
  return bytes;
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
  std::vector<std::uint8_t> planes(expected);
  const std::size_t size = ZSTD_decompressDCtx(decompressor(), planes.data(), planes.size(), bytes.data(), bytes.size());
  if (ZSTD_isError(size) || size != expected) throw Error(ErrorCode::data_loss, "delta block: the zstd frame is damaged");
  for (std::size_t k = 0; k < 3; ++k) {
    const std::uint8_t* plane = planes.data() + 4 * k * count;
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
