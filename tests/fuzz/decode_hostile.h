// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <string>

#include "core/base/error.h"
#include "core/codec/block.h"

namespace deform::fuzz {

/// Decodes arbitrary bytes as a block of `count` points. Anything but a result or Error(data_loss) is a finding.
inline void decode_hostile(codec::Encoding encoding, std::uint32_t count, std::string bytes) {
  codec::Block block;
  block.encoding = encoding;
  block.count = count;
  block.step = 1e-6;
  block.bytes = std::move(bytes);
  const Points registered(count);
  Points out(count);
  try {
    codec::decode(block, registered, out);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::data_loss) __builtin_trap();
  }
}

/// The number of points from the first two bytes: mostly few, sometimes many.
inline std::uint32_t count_from(const std::uint8_t* data) {
  return data[0] % 8 == 7 ? std::uint32_t{data[1]} * 16 : data[1] % 64;
}

}  // namespace deform::fuzz
