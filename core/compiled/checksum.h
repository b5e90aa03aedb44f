// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace deform::compiled {

/// XXH64 with seed 0, as the blocks of the wire contract have it (Collet, xxHash fast digest algorithm, specification 0.1.1).
std::uint64_t checksum(std::span<const std::byte> bytes);

}  // namespace deform::compiled
