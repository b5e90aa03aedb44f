// SPDX-License-Identifier: Apache-2.0
#include "core/codec/draco_coder.h"

#include <draco/compression/point_cloud/point_cloud_sequential_decoder.h>
#include <draco/compression/point_cloud/point_cloud_sequential_encoder.h>

#include <cstdlib>
#include <cstring>

#include "core/base/error.h"

namespace deform::codec {

namespace {

constexpr std::int64_t largest_difference = 1 << 19;  // a symbol is twice that
// Symbols are predicted differences, zigzag coded: with their table they take 8 bytes each in Draco's decoder.
constexpr std::uint64_t most_symbols = 1u << 20;

[[noreturn]] void damaged(const std::string& what) { throw Error(ErrorCode::data_loss, "draco block: " + what); }

// Reads what stands before the entropy-coded data, in the order in which Draco 2.x bitstreams have it.
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

void check_header(const std::string& bytes, std::size_t points) {
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
  header.expect("attribute type", draco::GeometryAttribute::GENERIC);
  header.expect("data type", draco::DT_INT32);
  header.expect("components", 3);
  header.expect("normalized", 0);
  header.expect("attribute id", 0);
  header.expect("attribute coder", draco::SEQUENTIAL_ATTRIBUTE_ENCODER_INTEGER);
  header.expect("prediction", draco::PREDICTION_DIFFERENCE);
  header.expect("prediction transform", draco::PREDICTION_TRANSFORM_WRAP);
  header.expect("compressed", 1);
  const std::uint8_t scheme = header.byte();
  if (scheme > 1) damaged("symbol scheme: expected 0 or 1, got " + std::to_string(scheme));
  if (scheme == 1) {
    const std::uint8_t bits = header.byte();
    if (bits < 1 || bits > 18) damaged("symbol bits: expected 1 to 18, got " + std::to_string(bits));
  }
  const std::uint64_t symbols = header.varint();
  if (symbols > most_symbols) {
    damaged("claims " + std::to_string(symbols) + " symbols, at most " + std::to_string(most_symbols) + " are possible");
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

std::string encode_draco(std::span<const std::int32_t> triples) {
  const std::size_t count = triples.size() / 3;
  if (count == 0) return {};
  draco::PointCloud cloud;
  cloud.set_num_points(static_cast<std::uint32_t>(count));
  draco::GeometryAttribute description;
  description.Init(draco::GeometryAttribute::GENERIC, nullptr, 3, draco::DT_INT32, false, 3 * sizeof(std::int32_t), 0);
  const int id = cloud.AddAttribute(description, true, static_cast<std::uint32_t>(count));  // identity: no deduplication
  cloud.attribute(id)->buffer()->Write(0, triples.data(), triples.size_bytes());

  draco::PointCloudSequentialEncoder encoder;
  encoder.SetPointCloud(cloud);
  draco::EncoderOptions options = draco::EncoderOptions::CreateDefaultOptions();
  options.SetSpeed(5, 5);
  draco::EncoderBuffer buffer;
  const draco::Status status = encoder.Encode(options, &buffer);
  if (!status.ok()) throw Error(ErrorCode::internal, "draco: " + status.error_msg_string());
  return {buffer.data(), buffer.size()};
}

void decode_draco(const std::string& bytes, std::span<std::int32_t> triples) {
  const std::size_t count = triples.size() / 3;
  if (count == 0) {
    if (!bytes.empty()) damaged("an empty block has no bytes");
    return;
  }
  check_header(bytes, count);
  draco::DecoderBuffer buffer;
  buffer.Init(bytes.data(), bytes.size());
  draco::PointCloudSequentialDecoder decoder;
  draco::PointCloud cloud;
  const draco::Status status = decoder.Decode(draco::DecoderOptions(), &buffer, &cloud);
  if (!status.ok()) damaged(status.error_msg_string());
  if (cloud.num_points() != count || cloud.num_attributes() != 1) damaged("points or attributes differ from the header");
  const draco::PointAttribute* attribute = cloud.attribute(0);
  if (attribute->size() != count || attribute->num_components() != 3 || attribute->data_type() != draco::DT_INT32 ||
      !attribute->is_mapping_identity() || attribute->buffer()->data_size() < triples.size_bytes()) {
    damaged("the attribute differs from the header");
  }
  std::memcpy(triples.data(), attribute->buffer()->data(), triples.size_bytes());
}

}  // namespace deform::codec
