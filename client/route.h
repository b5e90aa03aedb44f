// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "client/retry.h"
#include "client/servers.h"
#include "core/base/run_context.h"

namespace deform::client {

struct Connection;

/// What a call is about, which decides who is asked.
struct Subject {
  std::string geometry;   ///< id; empty: none, or the one of `system`
  std::string system;     ///< id; empty: none
  bool elsewhere = true;  ///< a server that does not know the id is not the last word: it may be brought there, or others know it
  bool bring = true;      ///< bring there what this client holds
  Server* only = nullptr;  ///< not to be chosen
};

/// About a geometry.
Subject of_geometry(const std::string& id);
/// About a system.
Subject of_system(const std::string& id);
/// About what this server has; `geometry` for proxies.
Subject on_server(Server& server, const std::string& geometry = {});

/// The way of one call through the servers: who is asked next, and what comes before. With one that stands for itself: waiting
/// times alone.
///
///   UNAVAILABLE         the next server at once; after the last one all of them again, after a while
///   NOT_FOUND           the geometry and the setup that this client holds are brought there; without them the next server
///   RESOURCE_EXHAUSTED  the same server, when it said: what it has is of more use than an idle one
///
/// One thread.
class Route {
 public:
  /// The connection must outlive it.
  Route(Connection& connection, Subject subject, Retry retry);

  /// Waits and brings what failed() has found to be necessary.
  void go(const RunContext& limits);
  /// To ask now.
  Server& server() const { return *order_[at_]; }
  /// What the call is about, as far as it is known, for proxies: an id, or nothing.
  const std::string& geometry() const { return geometry_; }
  /// The server has answered.
  void arrived();
  /// Within a catch block: plans another attempt, or throws the error, with what other servers said.
  void failed(const Error& error, const RunContext& limits, Repeat repeat);

 private:
  void begin_round();
  bool next_server();
  bool unknown_there();
  bool out_of_reach(const Error& error);

  Connection& connection_;
  const Subject subject_;
  const std::string geometry_;
  const Retry retry_;
  RetryPolicy policy_;
  std::vector<Server*> order_;
  std::size_t at_ = 0;
  std::map<const Server*, int> brought_;  ///< how often, to each
  int guesses_ = 0;                       ///< of a proxy
  bool unknown_ = false;                  ///< to a server of this round
  std::string unreachable_;               ///< addresses of this round
  // before the next attempt
  std::chrono::milliseconds wait_{0};
  Server* connect_to_ = nullptr;
  Server* returning_ = nullptr;  ///< the wait may end when it is back
  bool bring_ = false;
};

}  // namespace deform::client
