// SPDX-License-Identifier: Apache-2.0
#include "proto/convert/base/block.h"

#include <string>
#include <utility>

#include "core/base/error.h"
#include "proto/convert/base/fields.h"

namespace deform::convert {

namespace {

constexpr double default_tolerance = 1e-6;  // of the diagonal

constexpr std::pair<v1::Encoding, codec::Encoding> encodings[] = {{v1::RAW_F64, codec::Encoding::raw_f64},
                                                                  {v1::RAW_F32, codec::Encoding::raw_f32},
                                                                  {v1::DRACO, codec::Encoding::draco},
                                                                  {v1::DELTA_ZSTD, codec::Encoding::delta_zstd}};

[[noreturn]] void broken(const std::string& what) { throw Error(ErrorCode::data_loss, what); }

}  // namespace

v1::Encoding resolved(v1::Encoding encoding) { return encoding == v1::ENCODING_DEFAULT ? v1::DRACO : encoding; }

std::optional<codec::Encoding> encoding_from_proto(v1::Encoding encoding) {
  for (const auto& [message, own] : encodings) {
    if (message == resolved(encoding)) return own;
  }
  return std::nullopt;
}

v1::Encoding encoding_to_proto(codec::Encoding encoding) {
  for (const auto& [message, own] : encodings) {
    if (own == encoding) return message;
  }
  return v1::ENCODING_DEFAULT;
}

codec::EncodeOptions encode_options(const v1::Output& output, double diagonal) {
  codec::EncodeOptions options;
  const auto encoding = encoding_from_proto(output.encoding());
  if (!encoding) refuse_unknown("output.encoding", output.encoding());
  options.encoding = *encoding;
  const double tolerance = finite(output.tolerance(), "output.tolerance");
  if (tolerance < 0) refuse_field("output.tolerance", "must not be negative");
  // A single point has no diagonal; any positive tolerance will do.
  options.tolerance = tolerance > 0 ? tolerance : diagonal > 0 ? default_tolerance * diagonal : default_tolerance;
  return options;
}

void block_to_proto(codec::Block&& block, v1::Block& message) {
  message.set_count(block.count);
  message.set_encoding(encoding_to_proto(block.encoding));
  message.set_fell_back(block.fell_back);
  message.set_step(block.step);
  if (block.step != 0) {
    for (const std::int64_t offset : block.offset) message.add_offset(offset);
  }
  message.set_max_error(block.max_error);
  message.set_checksum(block.checksum);
  message.set_data(std::move(block.bytes));
}

codec::Block block_from_proto(v1::Block&& message) {
  const auto encoding = encoding_from_proto(message.encoding());
  if (!encoding) broken("unknown encoding " + std::to_string(static_cast<int>(message.encoding())));
  if (message.offset_size() != 0 && message.offset_size() != 3) {
    broken("it has " + std::to_string(message.offset_size()) + " offsets");
  }
  codec::Block block;
  block.encoding = *encoding;
  block.fell_back = message.fell_back();
  block.count = message.count();
  block.step = message.step();
  for (int k = 0; k < message.offset_size(); ++k) block.offset[static_cast<std::size_t>(k)] = message.offset(k);
  block.max_error = message.max_error();
  block.checksum = message.checksum();
  block.bytes = std::move(*message.mutable_data());
  return block;
}

}  // namespace deform::convert
