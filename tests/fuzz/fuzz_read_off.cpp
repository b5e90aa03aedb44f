// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/fuzz/read_and_write_back.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  deform::fuzz::read_and_write_back({reinterpret_cast<const char*>(data), size}, "fuzz.off");
  return 0;
}
