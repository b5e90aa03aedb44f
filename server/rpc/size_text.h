// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <string>

namespace deform::server {

/// "4GiB", "512 MiB", "1.5GB", "123456" -> bytes. Units: B; K, M, G, T or KiB, MiB, GiB, TiB, powers of 1024; kB, MB, GB, TB,
/// powers of 1000. Throws Error(invalid_argument).
std::size_t parse_bytes(const std::string& text);

}  // namespace deform::server
