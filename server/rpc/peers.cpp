// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/peers.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <optional>

#include "server/rpc/option_text.h"

namespace deform::server {

namespace {

std::string v4_host(const in_addr& address) {
  char text[INET_ADDRSTRLEN];
  return std::string("ipv4:") + inet_ntop(AF_INET, &address, text, sizeof(text));
}

std::string v6_host(in6_addr address) {
  if (IN6_IS_ADDR_V4MAPPED(&address)) {
    in_addr v4{};
    std::memcpy(&v4, &address.s6_addr[12], sizeof(v4));
    return v4_host(v4);
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

constexpr int bits_before_v4 = 96;
constexpr int bits_of_v6 = 128;

/// An address in digits; of IPv4 in the form of IPv6.
std::optional<in6_addr> parse_address(const std::string& text) {
  in6_addr v6{};
  if (inet_pton(AF_INET6, text.c_str(), &v6) == 1) return v6;
  in_addr v4{};
  if (inet_pton(AF_INET, text.c_str(), &v4) != 1) return std::nullopt;
  v6.s6_addr[10] = v6.s6_addr[11] = 0xff;
  std::memcpy(&v6.s6_addr[12], &v4, sizeof(v4));
  return v6;
}

std::string without_blanks(const std::string& text) {
  const auto from = text.find_first_not_of(" \t");
  return from == std::string::npos ? std::string() : text.substr(from, text.find_last_not_of(" \t") - from + 1);
}

}  // namespace

TrustedProxies::TrustedProxies(const std::string& list) : text_(list) {
  for (std::size_t from = 0; from < list.size();) {
    const std::size_t end = std::min(list.find(',', from), list.size());
    const std::string item = without_blanks(list.substr(from, end - from));
    from = end + 1;
    const std::size_t slash = std::min(item.find('/'), item.size());
    const auto address = parse_address(item.substr(0, slash));
    if (!address)
      throw Error(ErrorCode::invalid_argument, "\"" + item + "\" is no address and no network, as 10.1.0.0/16 is one");
    const int before = IN6_IS_ADDR_V4MAPPED(&*address) ? bits_before_v4 : 0;
    const int bits = slash == item.size() ? bits_of_v6 - before : parse_number<int>(item.substr(slash + 1));
    if (bits < 0 || bits > bits_of_v6 - before) {
      throw Error(ErrorCode::invalid_argument,
                  "\"" + item + "\": a network there has 0 to " + std::to_string(bits_of_v6 - before) + " bits");
    }
    networks_.push_back({*address, before + bits});
  }
}

bool TrustedProxies::contains(const in6_addr& address) const {
  return std::any_of(networks_.begin(), networks_.end(), [&](const Network& network) {
    for (int bit = 0; bit < network.bits; ++bit) {
      const int mask = 0x80 >> (bit % 8);
      if (((address.s6_addr[bit / 8] ^ network.address.s6_addr[bit / 8]) & mask) != 0) return false;
    }
    return true;
  });
}

std::string TrustedProxies::host_of(const std::string& peer, const std::string& forwarded_for) const {
  if (networks_.empty()) return server::host_of(peer);
  const auto proxy = parse_address(written_address(peer));
  if (!proxy || !contains(*proxy)) return server::host_of(peer);
  const std::size_t comma = forwarded_for.rfind(',');
  const auto client = parse_address(without_blanks(comma == std::string::npos ? forwarded_for : forwarded_for.substr(comma + 1)));
  return client ? v6_host(*client) : server::host_of(peer);
}

std::string TrustedProxies::host_of(const grpc::ServerContextBase& context) const {
  const auto [first, end] = context.client_metadata().equal_range("x-forwarded-for");
  const auto last = first == end ? end : std::prev(end);
  return host_of(context.peer(), last == end ? std::string() : std::string(last->second.data(), last->second.size()));
}

std::string host_of(const std::string& peer) {
  if (peer.starts_with("ipv4:")) {
    in_addr v4{};
    if (inet_pton(AF_INET, written_address(peer).c_str(), &v4) == 1) return v4_host(v4);
  }
  if (peer.starts_with("ipv6:")) {
    in6_addr v6{};
    if (inet_pton(AF_INET6, written_address(peer).c_str(), &v6) == 1) return v6_host(v6);
  }
  return peer;
}

std::string host_of(const sockaddr_storage& address) {
  if (address.ss_family == AF_INET) return v4_host(reinterpret_cast<const sockaddr_in&>(address).sin_addr);
  if (address.ss_family == AF_INET6) return v6_host(reinterpret_cast<const sockaddr_in6&>(address).sin6_addr);
  return {};
}

}  // namespace deform::server
