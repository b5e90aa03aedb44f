// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <string>
#include <unordered_map>
#include <unordered_set>

namespace deform::server {

/// For each of these peers, as gRPC writes them: the calls that gRPC has begun and not forgotten yet. Calls that were reset by
/// their client count until gRPC has cleaned up after them, unlike in any limit of HTTP/2. Peers that gRPC knows nothing of are
/// left out, those of unix sockets always: they have no address. From gRPC's channelz; takes about 10 us for each connection that
/// is open. Thread-safe.
std::unordered_map<std::string, std::uint64_t> live_calls(const std::unordered_set<std::string>& peers);

}  // namespace deform::server
