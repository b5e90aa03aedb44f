// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/socket_traffic.h"

// The kernel's own header: the one of the C library has an older tcp_info, and both cannot be included.
#include <linux/tcp.h>
#include <sys/socket.h>

namespace deform::server {

std::uint64_t received_bytes(int socket) {
  constexpr int tcp_level = 6;
  tcp_info info{};
  socklen_t size = sizeof(info);
  return getsockopt(socket, tcp_level, TCP_INFO, &info, &size) == 0 ? info.tcpi_bytes_received : 0;
}

}  // namespace deform::server
