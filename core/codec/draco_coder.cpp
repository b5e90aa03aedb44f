// SPDX-License-Identifier: Apache-2.0
#include "core/codec/draco_coder.h"

#include <draco/compression/config/compression_shared.h>
#include <draco/compression/entropy/rans_symbol_encoder.h>
#include <draco/compression/entropy/symbol_decoding.h>
#include <draco/compression/entropy/symbol_encoding.h>
#include <draco/core/decoder_buffer.h>
#include <draco/core/encoder_buffer.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "core/base/error.h"

namespace deform::codec {

namespace {

constexpr std::int64_t largest_difference = 1 << 19;  // a symbol is twice that
// Symbols are predicted differences, zigzag coded: with their table they take 8 bytes each in Draco's decoder.
constexpr std::uint64_t most_symbols = 1u << 20;
constexpr int compression_level = 5;  // that of draco::PointCloudSequentialEncoder at speed 5
constexpr std::uint8_t tagged = draco::SYMBOL_CODING_TAGGED, raw = draco::SYMBOL_CODING_RAW;
constexpr int most_raw_bits = 18;                                // Draco never chooses the raw scheme for symbols of more bits
constexpr std::uint8_t generic_attribute = 4, int32_values = 5;  // GeometryAttribute::GENERIC and draco::DT_INT32

[[noreturn]] void damaged(const std::string& what) { throw Error(ErrorCode::data_loss, "draco block: " + what); }

// Reads the fields before the entropy-coded data, in the order of Draco 2.x bitstreams.
class Header {
 public:
  explicit Header(const std::string& bytes) : bytes_(bytes) {}

  std::uint8_t byte() {
    if (position_ >= bytes_.size()) damaged("truncated header");
    return static_cast<std::uint8_t>(bytes_[position_++]);
  }
  void expect(const char* field, std::uint8_t value) {
    const std::uint8_t found = byte();
    if (found != value) damaged(std::string(field) + ": expected " + std::to_string(value) + ", got " + std::to_string(found));
  }
  std::uint64_t little_endian(int size) {
    std::uint64_t value = 0;
    for (int i = 0; i < size; ++i) value |= std::uint64_t{byte()} << (8 * i);
    return value;
  }
  std::size_t position() const { return position_; }
  std::uint64_t varint() {
    std::uint64_t value = 0;
    for (int shift = 0; shift < 35; shift += 7) {
      const std::uint8_t next = byte();
      value |= std::uint64_t{next & 127u} << shift;
      if ((next & 128) == 0) return value;
    }
    damaged("a number in the header is too long");
  }

 private:
  const std::string& bytes_;
  std::size_t position_ = 0;
};

/// Where the entropy-coded data begins.
std::size_t check_header(const std::string& bytes, std::size_t points) {
  Header header(bytes);
  for (const char c : {'D', 'R', 'A', 'C', 'O'}) header.expect("magic", static_cast<std::uint8_t>(c));
  header.expect("major version", draco::kDracoPointCloudBitstreamVersionMajor);
  header.expect("minor version", draco::kDracoPointCloudBitstreamVersionMinor);
  header.expect("geometry type", draco::POINT_CLOUD);
  header.expect("encoding method", draco::POINT_CLOUD_SEQUENTIAL_ENCODING);
  if (header.little_endian(2) != 0) damaged("flags: expected none");
  const std::uint64_t claimed = header.little_endian(4);
  if (claimed != points) damaged("claims " + std::to_string(claimed) + " points, the block has " + std::to_string(points));
  header.expect("attribute coders", 1);
  header.expect("attributes", 1);
  header.expect("attribute type", generic_attribute);
  header.expect("data type", int32_values);
  header.expect("components", 3);
  header.expect("normalized", 0);
  header.expect("attribute id", 0);
  header.expect("attribute coder", draco::SEQUENTIAL_ATTRIBUTE_ENCODER_INTEGER);
  header.expect("prediction", draco::PREDICTION_DIFFERENCE);
  header.expect("prediction transform", draco::PREDICTION_TRANSFORM_WRAP);
  header.expect("compressed", 1);
  const std::size_t coded = header.position();
  const std::uint8_t scheme = header.byte();
  if (scheme > raw) damaged("symbol scheme: expected 0 or 1, got " + std::to_string(scheme));
  if (scheme == raw) {
    const std::uint8_t bits = header.byte();
    if (bits < 1 || bits > most_raw_bits) damaged("symbol bits: expected 1 to 18, got " + std::to_string(bits));
  }
  const std::uint64_t symbols = header.varint();
  if (symbols > most_symbols) {
    damaged("claims " + std::to_string(symbols) + " symbols, at most " + std::to_string(most_symbols) + " are possible");
  }
  return coded;
}

std::string header_for(std::size_t points) {
  std::string bytes("DRACO");
  const auto put = [&](std::uint64_t value, int size = 1) {
    for (int i = 0; i < size; ++i) bytes.push_back(static_cast<char>(value >> (8 * i)));
  };
  put(draco::kDracoPointCloudBitstreamVersionMajor);
  put(draco::kDracoPointCloudBitstreamVersionMinor);
  put(draco::POINT_CLOUD);
  put(draco::POINT_CLOUD_SEQUENTIAL_ENCODING);
  put(0, 2);  // flags
  put(points, 4);
  put(1);  // attribute coders
  put(1);  // attributes
  put(generic_attribute);
  put(int32_values);
  put(3);  // components
  put(0);  // not normalized
  put(0);  // attribute id
  put(draco::SEQUENTIAL_ATTRIBUTE_ENCODER_INTEGER);
  put(draco::PREDICTION_DIFFERENCE);
  put(draco::PREDICTION_TRANSFORM_WRAP);
  put(1);  // compressed
  return bytes;
}

/// The range of the values, around which Draco wraps differences (PredictionSchemeWrapTransformBase).
struct Wrap {
  std::int32_t least = 0, largest = 0;
  std::int32_t size = 1;                              ///< values in the range
  std::int32_t least_difference, largest_difference;  ///< range without wrapping

  /// Returns std::nullopt if the range does not fit into 32 bits.
  static std::optional<Wrap> around(std::int32_t least, std::int32_t largest) {
    const std::int64_t range = std::int64_t{largest} - least;
    if (range < 0 || range >= std::numeric_limits<std::int32_t>::max()) return std::nullopt;
    const auto size = static_cast<std::int32_t>(range + 1);
    return Wrap{least, largest, size, -(size / 2), size / 2 - (size % 2 == 0 ? 1 : 0)};
  }
};

std::uint32_t zigzag(std::int32_t v) { return (static_cast<std::uint32_t>(v) << 1) ^ static_cast<std::uint32_t>(v >> 31); }
std::uint32_t unzigzag(std::uint32_t v) { return (v >> 1) ^ (0u - (v & 1)); }

/// Differences to the point before, that before the first one being the value of the range that is nearest to zero.
void to_symbols(std::span<const std::int32_t> triples, const Wrap& wrap, std::uint32_t* __restrict symbols) {
  const std::int32_t low = wrap.least_difference, high = wrap.largest_difference, size = wrap.size;
  const auto symbol = [&](std::int32_t value, std::int32_t before) {
    std::int32_t difference = value - before;
    difference += difference < low ? size : 0;  // never both: what was too low is not too high then
    difference -= difference > high ? size : 0;
    return zigzag(difference);
  };
  const std::int32_t start = std::clamp(0, wrap.least, wrap.largest);
  for (std::size_t i = 0; i < 3; ++i) symbols[i] = symbol(triples[i], start);
  for (std::size_t i = 3; i < triples.size(); ++i) symbols[i] = symbol(triples[i], triples[i - 3]);
}

void from_symbols(std::span<std::int32_t> triples, const Wrap& wrap) {
  const std::int32_t start = std::clamp(0, wrap.least, wrap.largest);
  std::int32_t before[3] = {start, start, start};
  for (std::size_t i = 0; i < triples.size(); i += 3) {
    for (std::size_t k = 0; k < 3; ++k) {
      // Hostile bytes may overflow 32 bits.
      const std::uint32_t sum = static_cast<std::uint32_t>(before[k]) + unzigzag(static_cast<std::uint32_t>(triples[i + k]));
      auto value = static_cast<std::int32_t>(sum);
      if (value > wrap.largest) {
        value = static_cast<std::int32_t>(sum - static_cast<std::uint32_t>(wrap.size));
      } else if (value < wrap.least) {
        value = static_cast<std::int32_t>(sum + static_cast<std::uint32_t>(wrap.size));
      }
      triples[i + k] = value;
      before[k] = std::clamp(value, wrap.least, wrap.largest);
    }
  }
}

/// Writes a sequence of bits, lowest bit of each number first.
class BitWriter {
 public:
  explicit BitWriter(std::size_t most_bits) : bytes_(std::make_unique_for_overwrite<char[]>(most_bits / 8 + 16)) {}

  /// Appends at most 32 bits.
  void put(std::uint32_t value, int count) {
    pending_ |= std::uint64_t{value} << bits_;
    bits_ += count;
    std::memcpy(bytes_.get() + size_, &pending_, sizeof pending_);
    size_ += static_cast<std::size_t>(bits_ / 8);
    pending_ >>= bits_ & ~7;
    bits_ &= 7;
  }
  std::span<const char> bytes() const { return {bytes_.get(), size_ + (bits_ > 0 ? 1 : 0)}; }

 private:
  static_assert(std::endian::native == std::endian::little);
  std::unique_ptr<char[]> bytes_;
  std::size_t size_ = 0;
  std::uint64_t pending_ = 0;
  int bits_ = 0;  ///< number of bits in pending_, below 8 between calls
};

/// Draco's tagged scheme: the number of bits of the largest symbol of each point, entropy coded, then all symbols with that many
/// bits. Gives the same bytes as draco::EncodeSymbols(), which writes these bits one by one.
void encode_tagged(const std::uint32_t* symbols, std::size_t count, draco::EncoderBuffer& buffer) {
  constexpr int most_tags = 32;
  const std::size_t points = count / 3;
  const auto tags = std::make_unique_for_overwrite<std::uint8_t[]>(points);
  std::uint64_t frequencies[most_tags] = {};
  std::size_t bits = 0;
  for (std::size_t i = 0; i < points; ++i) {
    // The highest bit of the largest is that of all together.
    const int width = std::max(1, static_cast<int>(std::bit_width(symbols[3 * i] | symbols[3 * i + 1] | symbols[3 * i + 2])));
    tags[i] = static_cast<std::uint8_t>(width);
    ++frequencies[width];
    bits += 3 * static_cast<std::size_t>(width);
  }
  BitWriter values(bits);
  for (std::size_t i = 0; i < points; ++i) {
    for (std::size_t k = 0; k < 3; ++k) values.put(symbols[3 * i + k], tags[i]);
  }
  buffer.Encode(tagged);
  draco::RAnsSymbolEncoder<5> coder;
  if (!coder.Create(frequencies, most_tags, &buffer)) throw Error(ErrorCode::internal, "draco: the tags cannot be coded");
  coder.StartEncoding(&buffer);
  for (std::size_t i = points; i-- > 0;) coder.EncodeSymbol(tags[i]);
  coder.EndEncoding(&buffer);
  buffer.Encode(values.bytes().data(), values.bytes().size());
}

void encode_symbols(const std::uint32_t* symbols, std::size_t count, draco::EncoderBuffer& buffer) {
  std::uint32_t any = 0;
  for (std::size_t i = 0; i < count; ++i) any |= symbols[i];
  if (std::bit_width(any) > most_raw_bits) return encode_tagged(symbols, count, buffer);
  draco::Options options;
  draco::SetSymbolEncodingCompressionLevel(&options, compression_level);
  if (!draco::EncodeSymbols(symbols, static_cast<int>(count), 3, &options, &buffer)) {
    throw Error(ErrorCode::internal, "draco: the symbols cannot be coded");
  }
}

}  // namespace

bool suits_draco(std::span<const std::int32_t> triples) {
  std::int64_t largest = 0;
  for (std::size_t i = 0; i < triples.size(); ++i) {
    const std::int64_t difference = std::int64_t{triples[i]} - (i < 3 ? 0 : triples[i - 3]);
    largest |= difference < 0 ? -difference : difference;  // the highest bit is what counts
  }
  return largest < largest_difference;
}

// Header and prediction are written here and not by draco::PointCloudSequentialEncoder, which makes the same bytes: its copies of
// the points and calls per number take more time than coding the symbols does.
std::string encode_draco(std::span<const std::int32_t> triples) {
  if (triples.empty()) return {};
  std::int32_t least = triples[0], largest = triples[0];  // two plain minima: std::minmax_element is no vector code
  for (const std::int32_t value : triples) least = std::min(least, value);
  for (const std::int32_t value : triples) largest = std::max(largest, value);
  const std::optional<Wrap> wrap = Wrap::around(least, largest);
  if (!wrap) throw Error(ErrorCode::internal, "draco: the numbers differ by more than 31 bits");
  // Kept per thread, at most 2 MiB for the largest block: fresh pages for each cost a third of the time.
  thread_local std::vector<std::uint32_t> symbols;
  thread_local draco::EncoderBuffer buffer;
  symbols.resize(std::max(symbols.size(), triples.size()));
  to_symbols(triples, *wrap, symbols.data());
  buffer.Clear();
  const std::string header = header_for(triples.size() / 3);
  buffer.Encode(header.data(), header.size());
  encode_symbols(symbols.data(), triples.size(), buffer);
  buffer.Encode(wrap->least);
  buffer.Encode(wrap->largest);
  return {buffer.data(), buffer.size()};
}

void decode_draco(const std::string& bytes, std::span<std::int32_t> triples) {
  const std::size_t count = triples.size() / 3;
  if (count == 0) {
    if (!bytes.empty()) damaged("an empty block has no bytes");
    return;
  }
  const std::size_t coded = check_header(bytes, count);
  draco::DecoderBuffer buffer;
  buffer.Init(
      bytes.data() + coded, bytes.size() - coded,
      DRACO_BITSTREAM_VERSION(draco::kDracoPointCloudBitstreamVersionMajor, draco::kDracoPointCloudBitstreamVersionMinor));
  auto* const symbols = reinterpret_cast<std::uint32_t*>(triples.data());
  if (!draco::DecodeSymbols(static_cast<std::uint32_t>(triples.size()), 3, &buffer, symbols)) {
    damaged("the symbols cannot be decoded");
  }
  std::int32_t least = 0, largest = 0;
  if (!buffer.Decode(&least) || !buffer.Decode(&largest)) damaged("truncated range");
  const std::optional<Wrap> wrap = Wrap::around(least, largest);
  if (!wrap) damaged("the range of the numbers is impossible");
  from_symbols(triples, *wrap);
}

}  // namespace deform::codec
