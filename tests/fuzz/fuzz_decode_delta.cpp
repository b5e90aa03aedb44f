// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/fuzz/decode_hostile.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 2) return 0;
  deform::fuzz::decode_hostile(deform::codec::Encoding::delta_zstd, deform::fuzz::count_from(data),
                               {reinterpret_cast<const char*>(data + 2), size - 2});
  return 0;
}
