// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/channel.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "deform/v1/service.grpc.pb.h"

namespace deform::client {

/// One deformd of those that a Client talks to. Thread-safe.
class Server {
 public:
  /// Over a channel that exists; nothing is sent.
  Server(std::string address_in, std::shared_ptr<grpc::ChannelInterface> channel_in);

  const std::string address;                                     ///< as given
  const std::shared_ptr<grpc::ChannelInterface> channel;         ///< to it
  const std::unique_ptr<v1::DeformService::StubInterface> stub;  ///< over that channel
  std::timed_mutex restoring;                                    ///< held while one call brings it what it lacks

  /// It could not be reached, or takes no work: for a while, and until there is a connection again, others are asked first.
  void avoid();
  /// False from avoid() on until it may be asked again.
  bool usable();

 private:
  using Clock = std::chrono::steady_clock;
  std::atomic<Clock::rep> avoided_until_{0};  ///< 0: it is not avoided
};

/// The servers of a Client, at least one. Thread-safe.
class Servers {
 public:
  /// In the order of the options.
  explicit Servers(std::vector<std::unique_ptr<Server>> servers);

  /// More than one.
  bool several() const { return servers_.size() > 1; }
  /// All, in the order of the options.
  const std::vector<std::unique_ptr<Server>>& all() const { return servers_; }

  /// The order in which to ask for `key`, the same in every process that names the same servers: each of them is the first for an
  /// equal share of the keys, and when one goes only its own keys move (rendezvous hashing: Thaler and Ravishankar, "Using
  /// name-based mappings to increase hit rates", IEEE/ACM Trans. Networking 6(1), 1998). Those to be avoided stand at the end. An
  /// empty key: the order of the options.
  std::vector<Server*> ranked(const std::string& key) const;

 private:
  const std::vector<std::unique_ptr<Server>> servers_;
};

}  // namespace deform::client
