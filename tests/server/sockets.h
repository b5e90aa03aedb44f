// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <arpa/inet.h>
#include <dirent.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>

namespace deform::server {

/// 127.0.0.N with this port.
inline sockaddr_in loopback(int port, std::uint32_t number = 1) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl((127u << 24) + number);
  return address;
}

/// A connection from 127.0.0.N to a port of 127.0.0.1, to be closed by whoever asks for it.
inline int connected_to(int port, std::uint32_t from = 1) {
  const int fd = socket(AF_INET, SOCK_STREAM, 0);
  const sockaddr_in own = loopback(0, from), other = loopback(port);
  EXPECT_EQ(bind(fd, reinterpret_cast<const sockaddr*>(&own), sizeof(own)), 0);
  EXPECT_EQ(connect(fd, reinterpret_cast<const sockaddr*>(&other), sizeof(other)), 0);
  return fd;
}

/// The socket of this process that listens on the port; -1 when there is none.
inline int listening_at(int port) {
  int found = -1;
  DIR* const files = opendir("/proc/self/fd");
  while (const dirent* const file = files == nullptr ? nullptr : readdir(files)) {
    const int fd = std::atoi(file->d_name);
    int listens = 0;
    socklen_t size = sizeof(listens);
    if (getsockopt(fd, SOL_SOCKET, SO_ACCEPTCONN, &listens, &size) != 0 || listens == 0) continue;
    sockaddr_in address{};
    size = sizeof(address);
    if (getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) == 0 && ntohs(address.sin_port) == port) found = fd;
  }
  if (files != nullptr) closedir(files);
  return found;
}

}  // namespace deform::server
