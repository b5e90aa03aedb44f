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

#include "server/rpc/peers.h"
#include "tests/server/sockets.h"

namespace deform::server::listener_test {
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

TEST(Hosts, AreTheAddressesOfPeersWithoutTheirPorts) {
  EXPECT_EQ(host_of("ipv4:10.0.0.7:4242"), "ipv4:10.0.0.7");
  EXPECT_EQ(host_of("ipv4:10.0.0.7:1"), host_of("ipv4:10.0.0.7:65535"));
  EXPECT_NE(host_of("ipv4:10.0.0.7:1"), host_of("ipv4:10.0.0.70:1"));
  for (const char* peer :
       {"ipv6:[2001:db8:1:2:3:4:5:6]:4242", "ipv6:%5B2001:db8:1:2::1%5D:7", "ipv6:%5B2001:db8:1:2::%25eth0%5D:7"}) {
    EXPECT_EQ(host_of(peer), "ipv6:2001:db8:1:2::/64") << "one network, which is one host's";
  }
  EXPECT_NE(host_of("ipv6:[2001:db8:1:3::1]:4242"), "ipv6:2001:db8:1:2::/64");
  EXPECT_EQ(host_of("ipv6:[::ffff:10.0.0.7]:4242"), "ipv4:10.0.0.7");
  for (const char* peer :
       {"unix:", "unix:/run/deformd", "unix-abstract:name", "inproc", "", "ipv4:", "ipv4:somewhere:1", "ipv6:[]:1"}) {
    EXPECT_EQ(host_of(peer), peer);
  }
}

TEST(Hosts, AreThoseThatATrustedProxySpeaksOf) {
  const TrustedProxies proxies("10.0.0.5, 10.1.0.0/16,2001:db8::/32");
  EXPECT_EQ(proxies.text(), "10.0.0.5, 10.1.0.0/16,2001:db8::/32");
  for (const char* proxy : {"ipv4:10.0.0.5:1", "ipv4:10.1.255.9:1", "ipv6:%5B2001:db8:7::1%5D:1", "ipv6:[::ffff:10.0.0.5]:1"}) {
    EXPECT_EQ(proxies.host_of(proxy, "192.168.0.9"), "ipv4:192.168.0.9") << proxy;
  }
  for (const char* stranger : {"ipv4:10.0.0.4:1", "ipv4:10.2.0.0:1", "ipv6:[2001:db9::1]:1", "unix:/run/deformd"}) {
    EXPECT_EQ(proxies.host_of(stranger, "192.168.0.9"), host_of(stranger)) << "anybody could say so";
  }
  EXPECT_EQ(proxies.host_of("ipv4:10.0.0.5:1", "1.2.3.4, 192.168.0.9 "), "ipv4:192.168.0.9")
      << "the rest is what the client said";
  EXPECT_EQ(proxies.host_of("ipv4:10.0.0.5:1", "2001:db8:1:2:3::4"), "ipv6:2001:db8:1:2::/64");
  EXPECT_EQ(proxies.host_of("ipv4:10.0.0.5:1", "::ffff:192.168.0.9"), "ipv4:192.168.0.9");
  for (const char* none : {"", "unknown", "192.168.0.9:80", "192.168.0.9,"}) {
    EXPECT_EQ(proxies.host_of("ipv4:10.0.0.5:1", none), "ipv4:10.0.0.5") << none;
  }
  EXPECT_EQ(TrustedProxies().host_of("ipv4:10.0.0.5:1", "192.168.0.9"), "ipv4:10.0.0.5");
  EXPECT_EQ(TrustedProxies("0.0.0.0/0").host_of("ipv6:[2001:db8::1]:1", "192.168.0.9"), host_of("ipv6:[2001:db8::1]:1"));
  for (const char* wrong : {"proxy.example.org", "10.0.0.0/33", "::/129", "10.0.0.0/-1", "10.0.0.0/x", "10.0.0.5,,10.0.0.6"}) {
    EXPECT_THROW(TrustedProxies{wrong}, Error) << wrong;
  }
}

/// Connections of several hosts to a listener that takes fifty, and what becomes of them.
class ListenerHosts : public testing::Test {
 protected:
  ListenerHosts() {
    listener_.start([this](int fd) {
      const std::lock_guard lock(mutex_);
      taken_.push_back(fd);
    });
  }
  ~ListenerHosts() override {
    listener_.stop();
    for (int fd : clients_) close(fd);
    for (int fd : taken_) close(fd);
  }
  /// How many of `count` from 127.0.0.N are taken.
  std::size_t taken_of(std::size_t count, std::uint32_t number) {
    const auto decided = [this] {
      const std::lock_guard lock(mutex_);
      return taken_.size() + listener_.refused();
    };
    const std::uint64_t refused = listener_.refused(), target = decided() + count;
    for (std::size_t i = 0; i < count; ++i) clients_.push_back(connected_to(listener_.port(), number));
    for (int i = 0; i < 20'000 && decided() < target; ++i) usleep(1000);
    EXPECT_EQ(decided(), target);
    return count - (listener_.refused() - refused);
  }
  /// As gRPC does when clients have gone.
  void close_taken() {
    const std::lock_guard lock(mutex_);
    for (int fd : taken_) close(fd);
    taken_.clear();
    usleep(30'000);  // the listener looks 50 times a second at most
  }

  Listener listener_{Listener::Options{"127.0.0.1:0", 50}};
  std::vector<int> clients_;
  std::mutex mutex_;
  std::vector<int> taken_;  // under mutex_
};

TEST_F(ListenerHosts, OneTakesFourFifthsAndTheNextFourFifthsOfTheRest) {
  EXPECT_EQ(taken_of(100, 1), 41u);
  EXPECT_EQ(taken_of(10, 2), 8u);
  EXPECT_EQ(taken_of(1, 3), 1u);
  EXPECT_EQ(taken_of(1, 1), 0u) << "still too many";
  EXPECT_EQ(listener_.open_count(), 50u);
  EXPECT_EQ(taken_of(1, 4), 0u) << "all are taken";
}

TEST_F(ListenerHosts, OnesThatAreClosedAreNoLongerCounted) {
  EXPECT_EQ(taken_of(60, 1), 41u);
  close_taken();
  EXPECT_EQ(listener_.open_count(), 0u);
  EXPECT_EQ(taken_of(60, 2), 41u) << "their descriptors are taken again";
  close_taken();
  EXPECT_EQ(taken_of(60, 1), 41u);
}

TEST_F(ListenerHosts, TheShareIsThatOfTheLimitOfTheMoment) {
  listener_.set_limit(5);
  EXPECT_EQ(taken_of(10, 1), 5u) << "so few that none is kept";
  listener_.set_limit(20);
  EXPECT_EQ(taken_of(20, 1), 12u);
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
}  // namespace deform::server::listener_test
