// SPDX-License-Identifier: GPL-3.0-or-later
// Prints what encodings take on one core, DRACO beside what the Draco library alone takes for the same symbols.
//
// usage: codec_bench [--quick]
#include <draco/compression/entropy/symbol_decoding.h>
#include <draco/compression/entropy/symbol_encoding.h>
#include <draco/core/decoder_buffer.h>
#include <draco/core/encoder_buffer.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include "core/codec/block.h"
#include "core/codec/draco_coder.h"
#include "core/codec/grid.h"
#include "core/mesh/ahmed.h"

namespace deform::codec {
namespace {

constexpr int repetitions = 7, pairs = 15;

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double milliseconds_once(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

/// The second time, with buffers that are there.
double milliseconds_warm(const std::function<void()>& work) {
  work();
  return milliseconds_once(work);
}

double milliseconds(const std::function<void()>& work) {
  std::vector<double> times;
  for (int i = 0; i < repetitions; ++i) times.push_back(milliseconds_once(work));
  return median(times);
}

/// A body whose roof is lifted and whose nose is turned a little, smoothly.
struct Case {
  Points rest, deformed;
  double diagonal = 0;
};

Case body(std::size_t points) {
  AhmedOptions options;
  options.target_points = points;
  Case result;
  result.rest = ahmed_body(options).points;
  const Box box = bounding_box(result.rest);
  result.diagonal = box.diagonal();
  for (const Vec3& x : result.rest) {
    const double s = (x[0] - box.min[0]) / (box.max[0] - box.min[0]), t = (x[2] - box.min[2]) / (box.max[2] - box.min[2]);
    const double lift = 0.02 * t * std::sin(std::numbers::pi * s), turn = 0.01 * (1 - s) * (1 - s);
    result.deformed.push_back({x[0] + 0.3 * lift * x[1], x[1] + turn * x[2], x[2] + lift - turn * x[1]});
  }
  return result;
}

using Blocks = std::vector<std::pair<std::size_t, std::size_t>>;  ///< first, count

void encoding_rows(const Case& the, const Blocks& blocks, double tolerance, Encoding encoding, const char* name) {
  const auto part = [](auto& points, const auto& block) { return std::span(points).subspan(block.first, block.second); };
  std::vector<Block> coded(blocks.size());
  const double encoding_time = milliseconds([&] {
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      coded[b] = encode(part(the.rest, blocks[b]), part(the.deformed, blocks[b]), {encoding, tolerance});
    }
  });
  Points out(the.rest.size());
  const double decoding_time = milliseconds([&] {
    for (std::size_t b = 0; b < blocks.size(); ++b) decode(coded[b], part(the.rest, blocks[b]), part(out, blocks[b]));
  });
  std::size_t bytes = 0;
  for (const Block& block : coded) bytes += block.bytes.size();
  std::printf("%-12s encode %7.2f ms, decode %7.2f ms, %.3f MB\n", name, encoding_time, decoding_time,
              static_cast<double>(bytes) * 1e-6);
}

struct Times {
  double encode = 0, decode = 0;
};

Times coder_alone(const std::vector<Grid>& grids) {
  std::vector<std::string> bytes(grids.size());
  Times times;
  times.encode = milliseconds_warm([&] {
    for (std::size_t b = 0; b < grids.size(); ++b) bytes[b] = encode_draco(grids[b].values());
  });
  std::vector<std::int32_t> out(3 * max_block_points);
  times.decode = milliseconds_warm([&] {
    for (std::size_t b = 0; b < grids.size(); ++b) decode_draco(bytes[b], std::span(out).subspan(0, grids[b].size));
  });
  return times;
}

/// The entropy coder of the library on symbols that are there already, its buffers reused.
Times library_alone(const std::vector<Grid>& grids) {
  std::vector<std::vector<std::uint32_t>> symbols(grids.size());
  for (std::size_t b = 0; b < grids.size(); ++b) {
    const auto values = grids[b].values();
    for (std::size_t i = 0; i < values.size(); ++i) {
      const std::int32_t difference = values[i] - (i < 3 ? 0 : values[i - 3]);
      symbols[b].push_back((static_cast<std::uint32_t>(difference) << 1) ^ static_cast<std::uint32_t>(difference >> 31));
    }
  }
  draco::Options options;
  draco::SetSymbolEncodingCompressionLevel(&options, 5);
  std::vector<draco::EncoderBuffer> buffers(grids.size());
  Times times;
  times.encode = milliseconds_warm([&] {
    for (std::size_t b = 0; b < grids.size(); ++b) {
      buffers[b].Clear();
      draco::EncodeSymbols(symbols[b].data(), static_cast<int>(symbols[b].size()), 3, &options, &buffers[b]);
    }
  });
  std::vector<std::uint32_t> out(3 * max_block_points);
  times.decode = milliseconds_warm([&] {
    for (std::size_t b = 0; b < grids.size(); ++b) {
      draco::DecoderBuffer buffer;
      buffer.Init(buffers[b].data(), buffers[b].size(), DRACO_BITSTREAM_VERSION(2, 3));
      draco::DecodeSymbols(static_cast<std::uint32_t>(symbols[b].size()), 3, &buffer, out.data());
    }
  });
  return times;
}

void run(std::size_t points, double relative) {
  const Case the = body(points);
  const double tolerance = relative * the.diagonal;
  Blocks blocks;
  std::vector<Grid> grids;
  for (std::size_t first = 0; first < the.rest.size(); first += max_block_points) {
    blocks.emplace_back(first, std::min(max_block_points, the.rest.size() - first));
    const auto& [begin, count] = blocks.back();
    if (!to_grid(std::span(the.rest).subspan(begin, count), std::span(the.deformed).subspan(begin, count), tolerance,
                 grids.emplace_back())) {
      std::printf("the integers do not fit\n");
      return;
    }
  }
  std::printf("%zu points, tolerance %g of the diagonal, one core:\n", the.rest.size(), relative);
  encoding_rows(the, blocks, tolerance, Encoding::raw_f64, "RAW_F64");
  encoding_rows(the, blocks, tolerance, Encoding::delta_zstd, "DELTA_ZSTD");
  encoding_rows(the, blocks, tolerance, Encoding::draco, "DRACO");
  // In turns, so that both sides of a pair meet the same machine.
  std::vector<Times> ours, library;
  for (int i = 0; i < pairs; ++i) {
    ours.push_back(coder_alone(grids));
    library.push_back(library_alone(grids));
  }
  const auto row = [&](const char* what, double Times::*time) {
    std::vector<double> own, alone, ratios;
    for (std::size_t i = 0; i < ours.size(); ++i) {
      own.push_back(ours[i].*time);
      alone.push_back(library[i].*time);
      ratios.push_back(own.back() / alone.back());
    }
    const double ratio = median(ratios);
    std::printf("  DRACO, %s of the integers %.2f ms; library alone %.2f ms  <= 1.5x  %.2fx %s\n", what, median(own),
                median(alone), ratio, ratio <= 1.5 ? "PASS" : "MISS");
  };
  row("coding", &Times::encode);
  row("decoding", &Times::decode);
}

}  // namespace
}  // namespace deform::codec

int main(int argc, char** argv) {
  const bool quick = argc > 1 && std::string(argv[1]) == "--quick";
  for (const double tolerance : {1e-5, 1e-6, 1e-7}) deform::codec::run(quick ? 30'000 : 465'000, tolerance);
  return 0;
}
