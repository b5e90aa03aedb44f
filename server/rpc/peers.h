// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/server_context.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <string>
#include <vector>

namespace deform::server {

/// By what strangers are distinguished, however many connections they open: the address of IPv4, and the network of 64 bits of an
/// address of IPv6, of which whoever has one has all. Of a peer as gRPC writes it ("ipv4:10.0.0.7:4242", "ipv6:%5B::1%5D:4242" or
/// with plain brackets); what has no address, as unix sockets, stays as it is.
std::string host_of(const std::string& peer);

/// The same of an address of a socket; empty for what is neither IPv4 nor IPv6. An address of IPv4 in the form of IPv6 is one of
/// IPv4.
std::string host_of(const sockaddr_storage& address);

/// Proxies that are believed when they say who calls through them.
class TrustedProxies {
 public:
  /// Nobody is.
  TrustedProxies() = default;
  /// Addresses and networks with commas between ("10.0.0.7, 10.1.0.0/16, fd00::/8"). Throws Error(invalid_argument) that shows
  /// what is neither.
  explicit TrustedProxies(const std::string& list);
  /// As it was given.
  const std::string& text() const { return text_; }
  /// host_of(peer); of a peer that is one of these, that of the last address in `forwarded_for` (metadata x-forwarded-for), which
  /// is the one that this proxy has seen. Where that is none, the proxy itself.
  std::string host_of(const std::string& peer, const std::string& forwarded_for) const;
  /// The same for a call. The last header counts: those before it may be the client's own.
  std::string host_of(const grpc::ServerContextBase& context) const;

 private:
  struct Network {
    in6_addr address;  ///< of IPv4 in the form of IPv6
    int bits;          ///< that count, of 128
  };
  bool contains(const in6_addr& address) const;

  std::string text_;
  std::vector<Network> networks_;
};

}  // namespace deform::server
