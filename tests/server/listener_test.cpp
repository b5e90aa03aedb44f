// SPDX-License-Identifier: GPL-3.0-or-later
// Connections that flood the server, as the listener closes them. Nobody reads or closes the descriptors here, as when gRPC is
// busy.
#include "server/rpc/listener.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>
#include <vector>

#include "tests/server/sockets.h"

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

  void connect_one() { clients_.push_back(connected_to(listener_.port())); }
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

/// A listener whose thread or socket fails.
class ListenerTrouble : public testing::Test {
 protected:
  ListenerTrouble() {
    listener_.start([this](int fd) {
      close(fd);
      std::unique_lock lock(mutex_);
      ++taken_;
      changed_.notify_all();
      changed_.wait(lock, [this] { return !hangs_; });
    });
  }
  ~ListenerTrouble() override {
    hang(false);
    listener_.stop();
  }
  void hang(bool hangs) {
    const std::lock_guard lock(mutex_);
    hangs_ = hangs;
    changed_.notify_all();
  }
  /// Waits until the listener has taken one more.
  void connect_one() {
    std::unique_lock lock(mutex_);
    const int before = taken_;
    const int client = connected_to(listener_.port());
    EXPECT_TRUE(changed_.wait_for(lock, std::chrono::seconds(20), [&] { return taken_ > before; })) << "not accepted";
    close(client);
  }
  std::string trouble_in_time() {
    std::string why;
    for (int i = 0; i < 20'000 && why.empty(); ++i) {
      usleep(1000);
      why = listener_.trouble();
    }
    return why;
  }

  Listener listener_{Listener::Options{"127.0.0.1:0", 10}};
  std::mutex mutex_;
  std::condition_variable changed_;
  // under mutex_
  int taken_ = 0;
  bool hangs_ = false;
};

TEST_F(ListenerTrouble, ThereIsNoneWhileConnectionsAreAccepted) {
  auto now = std::chrono::steady_clock::now();
  for (int i = 0; i < 50; ++i) {
    connect_one();
    EXPECT_EQ(listener_.trouble(now += std::chrono::seconds(1)), "");
  }
}

TEST_F(ListenerTrouble, AThreadThatHangsIsNoticedInTheTimeOfWhoeverAsks) {
  auto now = std::chrono::steady_clock::now();
  hang(true);
  connect_one();
  EXPECT_EQ(listener_.trouble(now), "");
  EXPECT_EQ(listener_.trouble(now += std::chrono::hours(1)), "") << "whoever asks was stopped, too";
  for (int i = 0; i < 9; ++i) EXPECT_EQ(listener_.trouble(now += std::chrono::seconds(1)), "") << i;
  EXPECT_EQ(listener_.trouble(now += std::chrono::seconds(1)), "the thread that accepts connections has not come round for 11 s");
  hang(false);
  connect_one();
  EXPECT_EQ(listener_.trouble(now += std::chrono::seconds(1)), "") << "it has come round again";
}

TEST_F(ListenerTrouble, ASocketThatIsShutDownIsNoticed) {
  connect_one();
  ASSERT_EQ(shutdown(listening_at(listener_.port()), SHUT_RDWR), 0);
  EXPECT_EQ(trouble_in_time(), "nothing can be accepted from a socket that is listened on: Invalid argument");
}

TEST_F(ListenerTrouble, ADescriptorThatMeansSomethingElseIsNoticed) {
  connect_one();
  const int nothing = open("/dev/null", O_RDONLY);
  ASSERT_GE(dup2(nothing, listening_at(listener_.port())), 0);
  close(nothing);
  EXPECT_EQ(trouble_in_time(), "nothing can be accepted from a socket that is listened on: Socket operation on non-socket");
}

TEST_F(ListenerTrouble, AClosedDescriptorIsNoticed) {
  connect_one();
  const int listening = listening_at(listener_.port());
  ASSERT_EQ(close(listening), 0);
  EXPECT_EQ(trouble_in_time(), "nothing can be accepted from a socket that is listened on: Bad file descriptor");
  const int nothing = open("/dev/null", O_RDONLY);  // which the listener closes
  if (nothing != listening) dup2(nothing, listening), close(nothing);
}

}  // namespace
}  // namespace deform::server
