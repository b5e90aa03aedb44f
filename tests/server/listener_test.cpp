// SPDX-License-Identifier: GPL-3.0-or-later
// Connections that flood the server, as the listener closes them. Nobody reads or closes the descriptors here, as when gRPC is
// busy.
#include "server/rpc/listener.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>
#include <vector>

namespace deform::server {
namespace {

constexpr char why[] = "it is too loud";

class ListenerConnections : public testing::Test {
 protected:
  ListenerConnections() {
    listener_.start([this](int fd) {
      const std::lock_guard lock(mutex_);
      taken_.push_back(fd);
      changed_.notify_all();
    });
    for (int i = 0; i < 2; ++i) connect_one();
    std::unique_lock lock(mutex_);
    if (!changed_.wait_for(lock, std::chrono::seconds(20), [this] { return taken_.size() == 2; }))
      ADD_FAILURE() << "not accepted";
  }
  ~ListenerConnections() override {
    listener_.stop();
    for (int fd : clients_) close(fd);
    for (int fd : taken_) close(fd);
  }

  void connect_one() {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(listener_.port()));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    clients_.push_back(socket(AF_INET, SOCK_STREAM, 0));
    ASSERT_EQ(connect(clients_.back(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  }
  /// This client sends more than the listener takes for little.
  void send_much(int client) {
    const std::string much(16 << 10, 'x');
    ASSERT_EQ(send(client, much.data(), much.size(), MSG_NOSIGNAL), static_cast<ssize_t>(much.size()));
  }
  /// Has the server ended this connection?
  static bool ended(int client) {
    char byte;
    return recv(client, &byte, 1, MSG_DONTWAIT) == 0;
  }

  Listener listener_{Listener::Options{"127.0.0.1:0", 10}};
  std::vector<int> clients_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<int> taken_;  // under mutex_
};

TEST_F(ListenerConnections, ClosesThatOfAPeerOnceHoweverOftenItIsAsked) {
  const std::string loud = listener_.connections().front().peer;
  for (int i = 0; i < 3; ++i) listener_.cut_off(loud, why);
  EXPECT_EQ(listener_.cut_off_count(), 1);
  EXPECT_NE(ended(clients_[0]), ended(clients_[1])) << "the other one goes on";
}

TEST_F(ListenerConnections, ClosesABusyOneOnceHoweverOftenItIsAsked) {
  send_much(clients_[1]);
  std::vector<Listener::Busy> busy;
  for (int i = 0; i < 2000 && busy.empty(); ++i) {
    usleep(1000);
    busy = listener_.busy();
  }
  ASSERT_EQ(busy.size(), 1);
  for (int i = 0; i < 3; ++i) listener_.cut_off(busy[0], why);
  listener_.cut_off(busy[0].peer, why);
  EXPECT_EQ(listener_.cut_off_count(), 1);
  EXPECT_TRUE(ended(clients_[1]));
  EXPECT_FALSE(ended(clients_[0]));
}

TEST_F(ListenerConnections, LeavesAnotherThatHasTheDescriptorOfAClosedOne) {
  Listener::Busy gone;
  gone.fd = taken_[0];
  gone.inode = 1;
  listener_.cut_off(gone, why);
  EXPECT_EQ(listener_.cut_off_count(), 0);
  EXPECT_FALSE(ended(clients_[0]));
  EXPECT_FALSE(ended(clients_[1]));
}

}  // namespace
}  // namespace deform::server
