// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <limits>
#include <vector>

#include "core/base/types.h"
#include "core/codec/block.h"
#include "core/codec/delta_coder.h"
#include "core/codec/draco_coder.h"
#include "deform/v1/deformation.pb.h"
#include "tests/wire/vectors.h"

namespace deform::wire {

namespace {

using codec::Encoding;

v1::Encoding message_of(Encoding encoding) {
  switch (encoding) {
    case Encoding::raw_f64:
      return v1::RAW_F64;
    case Encoding::raw_f32:
      return v1::RAW_F32;
    case Encoding::draco:
      return v1::DRACO;
    case Encoding::delta_zstd:
      return v1::DELTA_ZSTD;
  }
  return v1::ENCODING_DEFAULT;
}

/// The registered and the deformed points of a block.
struct Field {
  std::string name;
  Points registered, deformed;
  double tolerance = 1e-4;
};

/// A patch of columns x rows points with a smooth bump on it.
Field bump(std::string name, std::size_t columns, std::size_t rows, const Vec3& origin, double height) {
  Field field{std::move(name), {}, {}};
  for (std::size_t i = 0; i < columns * rows; ++i) {
    const double u = static_cast<double>(i % columns) / static_cast<double>(columns);
    const double v = static_cast<double>(i / columns) / static_cast<double>(rows);
    const double bump = height / (1 + 16 * ((u - 0.5) * (u - 0.5) + (v - 0.5) * (v - 0.5)));
    const Vec3 p{origin[0] + 4 * u, origin[1] + 2 * v, origin[2] + u * (1 - u) * v};
    field.registered.push_back(p);
    field.deformed.push_back({p[0] + 0.25 * bump, p[1] - 0.5 * u * bump, p[2] + bump});
  }
  return field;
}

/// Points that have nothing to do with each other.
Field noise(std::string name, std::size_t count, double range) {
  Field field{std::move(name), {}, {}};
  std::uint32_t state = 12345;
  const auto next = [&state] {
    state = 1664525u * state + 1013904223u;
    return static_cast<double>(state >> 8) / 16777216.0 - 0.5;
  };
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3 p{next(), next(), next()};
    field.registered.push_back(p);
    field.deformed.push_back({p[0] + range * next(), p[1] + range * next(), p[2] + range * next()});
  }
  return field;
}

/// Displacements of both signs that jump from point to point by `steps` steps of the grid.
Field jumps(std::string name, double steps) {
  Field field{std::move(name), {}, {}};
  field.tolerance = 0.5;  // a step of nearly one
  for (int i = 0; i < 12; ++i) {
    const double sign = i % 2 == 0 ? 1 : -1;
    field.registered.push_back({0, 0, 0});
    field.deformed.push_back({i == 0 ? 0 : sign * steps, static_cast<double>(i), i == 5 ? -steps : 0});
  }
  return field;
}

Field extremes() {
  using Limits = std::numeric_limits<double>;
  using Floats = std::numeric_limits<float>;
  Field field{"extremes", {}, {}};
  field.deformed = {{0.0, -0.0, Limits::denorm_min()},
                    {Limits::max(), -Limits::max(), Limits::min()},
                    {Limits::epsilon(), 1 + Limits::epsilon(), -1.0 / 3},
                    {static_cast<double>(Floats::max()), static_cast<double>(Floats::denorm_min()), 16777217.0}};
  field.registered.assign(field.deformed.size(), Vec3{});
  return field;
}

/// What single precision can hold, with halves of its last digit: rounded to even.
Field single_precision() {
  Field field = extremes();
  field.name = "single_precision";
  field.deformed[1] = {0x1.fffffefffffffp+127, -16777219.0, 0x1p-149};
  field.deformed[3] = {0x1.8p-150, 0x1p-150, 0x1.000001p0};
  return field;
}

std::vector<Field> fields_for(Encoding encoding) {
  std::vector<Field> fields{bump("bump", 15, 8, {0, 0, 0}, 0.125),     bump("one_point", 1, 1, {1, 2, 3}, 0.5),
                            bump("two_points", 2, 1, {-1, 0, 1}, 0.5), bump("far_from_the_origin", 10, 6, {1e6, -2e6, 3e7}, 1000),
                            bump("at_rest", 5, 5, {0, 0, 0}, 0),       noise("noise", 257, 0.5)};
  fields[3].tolerance = 1e-3;
  Field coincident = bump("coincident", 4, 4, {0, 0, 0}, 0.25);
  std::fill(coincident.registered.begin(), coincident.registered.end(), coincident.registered[0]);
  fields.push_back(coincident);
  if (encoding == Encoding::raw_f64 || encoding == Encoding::raw_f32) {
    fields.push_back(extremes());  // falls back as RAW_F32
    if (encoding == Encoding::raw_f32) fields.push_back(single_precision());
    return fields;
  }
  fields.push_back(jumps("widest_jumps_of_draco", 262143));  // differences just below 2^19
  fields.push_back(jumps("too_wide_for_draco", 262144));
  fields.push_back(jumps("widest_range", 536869000));  // just below 2^29
  fields.push_back(jumps("too_wide", 536871000));
  Field strict = bump("too_strict", 5, 5, {1e6, 0, 0}, 0.25);
  strict.tolerance = 1e-10;
  fields.push_back(strict);
  return fields;
}

v1::Block message_of(const codec::Block& block) {
  v1::Block message;
  message.set_count(block.count);
  message.set_encoding(message_of(block.encoding));
  message.set_fell_back(block.fell_back);
  message.set_step(block.step);
  if (block.step != 0) message.mutable_offset()->Add(block.offset.begin(), block.offset.end());
  message.set_max_error(block.max_error);
  message.set_checksum(block.checksum);
  message.set_data(block.bytes);
  return message;
}

Points decoded(const codec::Block& block, std::span<const Vec3> registered) {
  Points points(registered.size());
  codec::decode(block, registered, points);
  return points;
}

Json block_vector(const Field& field, Encoding encoding) {
  const codec::Block block = codec::encode(field.registered, field.deformed, {encoding, field.tolerance});
  Json json;
  json["name"] = field.name;
  json["requested"] = v1::Encoding_Name(message_of(encoding));
  json["tolerance"] = field.tolerance;
  json["registered"] = base64_of<Vec3>(field.registered);
  json["computed"] = base64_of<Vec3>(field.deformed);
  json["block"] = base64(message_of(block).SerializeAsString());
  if (block.step != 0) {
    std::vector<std::int32_t> integers(3 * field.registered.size());
    block.encoding == Encoding::draco ? codec::decode_draco(block.bytes, integers) : codec::decode_delta(block.bytes, integers);
    json["integers"] = base64_of<std::int32_t>(integers);
  }
  json["decoded"] = base64_of<Vec3>(decoded(block, field.registered));
  return json;
}

}  // namespace

void add_block_vectors(Vectors& vectors) {
  const std::pair<const char*, Encoding> files[] = {{"blocks_raw_f64.json", Encoding::raw_f64},
                                                    {"blocks_raw_f32.json", Encoding::raw_f32},
                                                    {"blocks_draco.json", Encoding::draco},
                                                    {"blocks_delta_zstd.json", Encoding::delta_zstd}};
  for (const auto& [name, encoding] : files) {
    Json& file = vectors[name] = Json::array();
    for (const Field& field : fields_for(encoding)) file.push_back(block_vector(field, encoding));
  }
}

void add_reply_vectors(Vectors& vectors) {
  constexpr std::size_t block_points = 256;
  const Field rest = bump("rest", 30, 20, {0, 0, 0}, 0);
  const Points designs[] = {bump("first", 30, 20, {0, 0, 0}, 0.25).deformed, {}, bump("last", 30, 20, {0, 0, 0}, -0.5).deformed};
  std::vector<v1::DeformReply> replies(1);
  v1::DeformHeader& header = *replies[0].mutable_header();
  header.set_points(rest.registered.size());
  header.set_designs(3);
  header.set_block_points(block_points);
  header.set_geometry_id(std::string(64, 'a'));
  v1::DesignResult& failed = *replies.emplace_back().mutable_result();
  failed.set_design(1);
  failed.mutable_error()->set_code(3);
  failed.mutable_error()->set_message("variables[0] (\"up\"): 2 is outside of its bounds [-1, 1]");
  std::vector<std::uint64_t> checksums[3];
  double largest_error[3] = {};
  for (std::size_t first = 0; first < rest.registered.size(); first += block_points) {
    const std::size_t count = std::min(block_points, rest.registered.size() - first);
    for (const std::size_t design : {2, 0}) {  // designs interleave
      const auto registered = std::span(rest.registered).subspan(first, count);
      const codec::Block block =
          codec::encode(registered, std::span(designs[design]).subspan(first, count), {Encoding::delta_zstd, 1e-5});
      v1::Block& message = *replies.emplace_back().mutable_block();
      message = message_of(block);
      message.set_design(static_cast<std::uint32_t>(design));
      message.set_block(static_cast<std::uint32_t>(first / block_points));
      message.set_first(first);
      checksums[design].push_back(block.checksum);
      largest_error[design] = std::max(largest_error[design], block.max_error);
    }
  }
  for (const std::size_t design : {0, 2}) {
    v1::DesignResult& result = *replies.emplace_back().mutable_result();
    result.set_design(static_cast<std::uint32_t>(design));
    result.set_checksum(codec::fold_checksums(checksums[design]));
    result.set_max_error(largest_error[design]);
    result.set_path(v1::PATH_BASIS);
  }
  replies.emplace_back().mutable_summary()->set_bytes(1);

  Json& file = vectors["replies.json"];
  file["tolerance"] = 1e-5;
  file["registered"] = base64_of<Vec3>(rest.registered);
  for (const v1::DeformReply& reply : replies) file["replies"].push_back(base64(reply.SerializeAsString()));
  for (const Points& design : designs) file["computed"].push_back(base64_of<Vec3>(design));
}

}  // namespace deform::wire
