// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <unordered_map>
#include <unordered_set>

namespace deform::server {

/// Counts the calls that gRPC holds per connection, by its channelz. It remembers which connection is whose: asking costs about
/// 100 us for each peer, and 10 us once for each connection of the process. Not thread-safe.
class ConnectionCalls {
 public:
  /// For each of these peers, as gRPC writes them: the calls that gRPC has begun and not forgotten yet. Calls that were reset by
  /// their client count until gRPC has cleaned up after them, unlike in any limit of HTTP/2. Peers that gRPC knows nothing of are
  /// left out, those of unix sockets always: they have no address.
  std::unordered_map<std::string, std::uint64_t> of(const std::unordered_set<std::string>& peers);

 private:
  void look_for_new();
  std::unordered_map<std::string, std::int64_t> sockets_;  ///< numbers of channelz, by peer
  std::unordered_map<std::int64_t, std::int64_t> next_;    ///< by server: the least number that a new connection may have
  std::size_t known_ = 0;                                  ///< sockets_ that were open when all were looked at
};

}  // namespace deform::server
