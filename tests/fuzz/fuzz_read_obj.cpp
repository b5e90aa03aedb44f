// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/fuzz/read_and_write_back.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  deform::fuzz::read_and_write_back(bytes, "fuzz.obj");
  deform::io::ReadOptions turning;
  turning.turn_normals = true;
  deform::fuzz::read_and_write_back(bytes, "fuzz.obj", deform::fuzz::FaceOrder::same, turning);
  return 0;
}
