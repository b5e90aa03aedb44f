// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/fuzz/decode_hostile.h"

// Every other input stands behind the header that an encoder writes for so many points, so that what follows it is reached.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 2) return 0;
  const std::uint32_t count = deform::fuzz::count_from(data);
  std::string bytes;
  if (count > 0 && (data[0] & 128) != 0) {
    const deform::Points rest(count);
    bytes = deform::codec::encode(rest, rest, {deform::codec::Encoding::draco, 1e-6}).bytes;
    constexpr std::size_t header = 26;  // up to the symbol scheme
    bytes.resize(header);
  }
  bytes.append(reinterpret_cast<const char*>(data + 2), size - 2);
  deform::fuzz::decode_hostile(deform::codec::Encoding::draco, count, std::move(bytes));
  return 0;
}
