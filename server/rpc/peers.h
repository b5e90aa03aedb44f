// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <sys/socket.h>

#include <string>

namespace deform::server {

/// By what strangers are distinguished, however many connections they open: the address of IPv4, and the network of 64 bits of an
/// address of IPv6, of which whoever has one has all. Of a peer as gRPC writes it ("ipv4:10.0.0.7:4242", "ipv6:%5B::1%5D:4242" or
/// with plain brackets); what has no address, as unix sockets, stays as it is.
std::string host_of(const std::string& peer);

/// The same of an address of a socket; empty for what is neither IPv4 nor IPv6. An address of IPv4 in the form of IPv6 is one of
/// IPv4.
std::string host_of(const sockaddr_storage& address);

}  // namespace deform::server
