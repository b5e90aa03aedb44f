// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>

namespace deform::server {

/// Bytes that a TCP connection has received so far; 0 for anything else.
std::uint64_t received_bytes(int socket);

}  // namespace deform::server
