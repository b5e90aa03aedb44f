// SPDX-License-Identifier: GPL-3.0-or-later
// The bytes of DRACO against the encoder and decoder of the Draco library, which released clients and servers use.
#include "core/codec/draco_coder.h"

#include <draco/compression/point_cloud/point_cloud_sequential_decoder.h>
#include <draco/compression/point_cloud/point_cloud_sequential_encoder.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <random>
#include <vector>

namespace deform::codec::draco_coder_test {
namespace {

constexpr std::size_t scheme_byte = 26;  // behind the header: 0 tagged, 1 raw

std::string library_encoded(std::span<const std::int32_t> triples) {
  const auto count = static_cast<std::uint32_t>(triples.size() / 3);
  draco::PointCloud cloud;
  cloud.set_num_points(count);
  draco::GeometryAttribute description;
  description.Init(draco::GeometryAttribute::GENERIC, nullptr, 3, draco::DT_INT32, false, 3 * sizeof(std::int32_t), 0);
  const int id = cloud.AddAttribute(description, true, count);
  cloud.attribute(id)->buffer()->Write(0, triples.data(), triples.size_bytes());
  draco::PointCloudSequentialEncoder encoder;
  encoder.SetPointCloud(cloud);
  draco::EncoderOptions options = draco::EncoderOptions::CreateDefaultOptions();
  options.SetSpeed(5, 5);
  draco::EncoderBuffer buffer;
  EXPECT_TRUE(encoder.Encode(options, &buffer).ok());
  return {buffer.data(), buffer.size()};
}

std::vector<std::int32_t> library_decoded(const std::string& bytes, std::size_t size) {
  draco::DecoderBuffer buffer;
  buffer.Init(bytes.data(), bytes.size());
  draco::PointCloudSequentialDecoder decoder;
  draco::PointCloud cloud;
  std::vector<std::int32_t> triples(size, -1);
  const bool decoded = decoder.Decode(draco::DecoderOptions(), &buffer, &cloud).ok();
  EXPECT_TRUE(decoded);
  if (!decoded || cloud.attribute(0)->buffer()->data_size() < size * sizeof(std::int32_t)) return triples;
  std::memcpy(triples.data(), cloud.attribute(0)->buffer()->data(), size * sizeof(std::int32_t));
  return triples;
}

/// Numbers of up to so many bits: `noise` around zero, `walk` the sums of it, `calm` such a walk with few large steps.
enum class Kind { noise, walk, calm };
std::vector<std::int32_t> numbers(Kind kind, std::size_t points, int bits, std::mt19937& random) {
  constexpr std::int32_t largest = 1 << 29;
  const std::int32_t size = (1 << bits) - 1;
  std::vector<std::int32_t> triples(3 * points);
  for (std::size_t i = 0; i < triples.size(); ++i) {
    std::int32_t x = static_cast<std::int32_t>(random() % static_cast<std::uint32_t>(2 * size + 1)) - size;
    if (kind == Kind::calm && i % 50 != 0) x /= 1 + static_cast<std::int32_t>(random() % 1000);
    triples[i] = kind == Kind::noise ? x / 4 : std::clamp(x / 2 + (i < 3 ? 0 : triples[i - 3]), -largest, largest);
  }
  return triples;
}

TEST(DracoCoder, MakesTheBytesOfTheLibrary) {
  std::mt19937 random(3);
  int cases = 0, tagged = 0, raw_scheme = 0;
  for (const std::size_t points : {1, 2, 3, 7, 100, 1000, 8192}) {
    for (int bits = 0; bits <= 20; ++bits) {
      for (const Kind kind : {Kind::noise, Kind::walk, Kind::calm}) {
        const std::vector<std::int32_t> triples = numbers(kind, points, bits, random);
        if (!suits_draco(triples)) continue;
        const std::string bytes = encode_draco(triples);
        ++cases;
        ++(bytes.at(scheme_byte) == 0 ? tagged : raw_scheme);
        EXPECT_TRUE(bytes == library_encoded(triples)) << points << " points, " << bits << " bits";
        EXPECT_TRUE(library_decoded(bytes, triples.size()) == triples) << points << " points, " << bits << " bits";
        std::vector<std::int32_t> decoded(triples.size(), -1);
        decode_draco(bytes, decoded);
        EXPECT_TRUE(decoded == triples) << points << " points, " << bits << " bits";
      }
    }
  }
  EXPECT_GT(cases, 300);
  EXPECT_GT(tagged, 50);
  EXPECT_GT(raw_scheme, 50);
}

// A range that does not contain zero, and differences that are wrapped around a narrow one.
TEST(DracoCoder, RangesAwayFromZeroAndWrappedDifferences) {
  std::mt19937 random(4);
  for (const std::int32_t base : {-400'000, 300'000, 0}) {
    std::vector<std::int32_t> triples(3 * 500);
    for (std::size_t i = 0; i < triples.size(); ++i) triples[i] = base + (random() % 2 == 0 ? 0 : 999);
    const std::string bytes = encode_draco(triples);
    EXPECT_TRUE(bytes == library_encoded(triples)) << base;
    std::vector<std::int32_t> decoded(triples.size());
    decode_draco(bytes, decoded);
    EXPECT_TRUE(decoded == triples) << base;
  }
}

// Scratch memory is kept per thread: what was coded before leaves no trace.
TEST(DracoCoder, BlocksDoNotDependOnThoseBefore) {
  std::mt19937 random(5);
  const auto small = numbers(Kind::calm, 20, 12, random), large = numbers(Kind::walk, 5000, 19, random);
  const std::string first = encode_draco(small);
  ASSERT_TRUE(suits_draco(large));
  const std::string between = encode_draco(large);
  EXPECT_TRUE(encode_draco(small) == first);
  EXPECT_TRUE(encode_draco(large) == between);
}

}  // namespace
}  // namespace deform::codec::draco_coder_test
