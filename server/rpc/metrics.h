// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "deform/v1/service.pb.h"
#include "server/engine/engine.h"
#include "server/rpc/log.h"

namespace deform::server {

/// What the server says about itself in figures: what is counted while calls come and go, and what is looked at when somebody
/// asks. The names, units and labels are those of docs/operations.md. Thread-safe.
class Metrics {
 public:
  Metrics();
  ~Metrics();
  Metrics(const Metrics&) = delete;
  Metrics& operator=(const Metrics&) = delete;

  /// A call came in.
  void call_begins();
  /// It ended as its log line says.
  void call_ends(const CallRecord& record);
  /// A request of a DeformStream ended; counted as the method DeformStream.request.
  void request_ends(const CallRecord& record);

  /// What is looked at when somebody asks.
  struct Levels {
    v1::ServerInfo server;
    Engine::StoredBasisCounts bases;
    bool memory_full = false;
    std::size_t held_request_bytes = 0;
    SyncTimes syncs;
    std::size_t open_connections = 0;
    std::uint64_t refused_connections = 0;
    std::uint64_t cut_off_connections = 0;
    std::size_t max_connections = 0;  ///< 0: no limit of the server's own
  };
  /// Everything in the text format of Prometheus, version 0.0.4.
  std::string text(const Levels& levels) const;

 private:
  struct Counted;
  const std::unique_ptr<Counted> counted_;
};

}  // namespace deform::server
