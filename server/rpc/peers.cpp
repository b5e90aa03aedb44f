// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/peers.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <iterator>

namespace deform::server {

namespace {

std::string host_of(const in_addr& address) {
  char text[INET_ADDRSTRLEN];
  return std::string("ipv4:") + inet_ntop(AF_INET, &address, text, sizeof(text));
}

std::string host_of(in6_addr address) {
  if (IN6_IS_ADDR_V4MAPPED(&address)) {
    in_addr v4{};
    std::memcpy(&v4, &address.s6_addr[12], sizeof(v4));
    return host_of(v4);
  }
  constexpr int network_bytes = 8;
  std::fill(address.s6_addr + network_bytes, std::end(address.s6_addr), std::uint8_t{0});
  char text[INET6_ADDRSTRLEN];
  return std::string("ipv6:") + inet_ntop(AF_INET6, &address, text, sizeof(text)) + "/64";
}

/// What stands between the scheme and the port, without brackets and the name of an interface.
std::string written_address(const std::string& peer) {
  const std::size_t from = peer.find(':') + 1;
  std::string host = peer.substr(from, peer.rfind(':') - std::min(from, peer.rfind(':')));
  for (const char* bracket : {"%5B", "%5D", "[", "]"}) {
    if (const auto at = host.find(bracket); at != std::string::npos) host.erase(at, std::strlen(bracket));
  }
  return host.substr(0, host.find('%'));
}

}  // namespace

std::string host_of(const std::string& peer) {
  if (peer.starts_with("ipv4:")) {
    in_addr v4{};
    if (inet_pton(AF_INET, written_address(peer).c_str(), &v4) == 1) return host_of(v4);
  }
  if (peer.starts_with("ipv6:")) {
    in6_addr v6{};
    if (inet_pton(AF_INET6, written_address(peer).c_str(), &v6) == 1) return host_of(v6);
  }
  return peer;
}

std::string host_of(const sockaddr_storage& address) {
  if (address.ss_family == AF_INET) return host_of(reinterpret_cast<const sockaddr_in&>(address).sin_addr);
  if (address.ss_family == AF_INET6) return host_of(reinterpret_cast<const sockaddr_in6&>(address).sin6_addr);
  return {};
}

}  // namespace deform::server
