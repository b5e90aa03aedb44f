// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/engine/engine.h"
#include "server/rpc/service.h"
#include "server/rpc/tls.h"

namespace grpc {
class Channel;
}

namespace deform::server {

/// Where plain text may travel; with TLS there is none.
enum class TransportSecurity {
  loopback_only,  ///< refuses to listen in plain text where other machines could connect
  insecure        ///< plain text, everywhere
};

/// Whether clients may ask the server for its contract (gRPC server reflection).
enum class Reflection { on, off };

struct ServerOptions {
  /// HOST:PORT, [IPV6]:PORT or unix:PATH (a socket of mode 0660). Port 0: a free one. Empty: only in-process channels.
  std::string address = "127.0.0.1:50051";
  /// HOST:PORT or [IPV6]:PORT of /metrics, /livez and /readyz (OperationsPort), plain HTTP. Port 0: a free one. Empty: none.
  std::string metrics_address;
  TransportSecurity security = TransportSecurity::loopback_only;
  TlsFiles tls;
  Reflection reflection = Reflection::on;
  std::chrono::seconds keep_alive{60};          ///< a silent connection is asked whether it lives
  std::chrono::seconds keep_alive_timeout{20};  ///< and closed when it does not answer
  int max_calls_per_connection = 1024;
  std::size_t max_connections = 0;                ///< open at once; 0: what open files allow, at most 4096
  std::chrono::seconds connection_idle{600};      ///< a connection without a call for so long is closed; 0: never
  std::chrono::seconds connection_age{0};         ///< a connection so old takes no new calls; 0: never
  std::chrono::seconds connection_age_grace{60};  ///< and is cut off after so long; 0: never
  EngineOptions engine;
  ServiceOptions service;
  /// Names and values of further limits, to show to the operator; those that change while the server runs are known anyway.
  std::vector<std::pair<std::string, std::string>> limits;
  /// Called once, by a thread of the server, when no connection can be accepted any more, with the reason: to be started again is
  /// all that helps. Empty: only /readyz and the log say so.
  std::function<void(const std::string& why)> on_failure;

  /// Throws Error(invalid_argument) naming the option and its limits.
  void validate() const;
};

/// A server that runs from start_server() to stop(). Thread-safe.
class RunningServer {
 public:
  /// Stops without grace unless stopped.
  virtual ~RunningServer() = default;
  /// The address with the port that is really used; empty without one.
  virtual std::string address() const = 0;
  virtual int port() const = 0;
  virtual Engine& engine() = 0;
  /// Takes over what an option says now, where that needs no restart: what was in force before. Nothing for all other options.
  /// Throws Error(invalid_argument) for a value that is wrong, and nothing changes.
  virtual std::optional<std::string> take_over(const std::string& option, const std::string& value) = 0;
  /// A connection without a network.
  virtual std::shared_ptr<grpc::Channel> in_process_channel() = 0;
  /// Health turns to NOT_SERVING, new work is refused, what is under way may end within `grace`, the rest is cancelled. True when
  /// nothing had to be. Idempotent; a second caller waits for the first.
  virtual bool stop(std::chrono::milliseconds grace) = 0;
};

/// Opens the engine and serves it. Throws Error(invalid_argument) for options, Error(unavailable) when the address or the data
/// directory is taken.
std::unique_ptr<RunningServer> start_server(const ServerOptions& options);
/// Serves an engine made elsewhere; options.engine is not looked at.
std::unique_ptr<RunningServer> start_server(const ServerOptions& options, std::unique_ptr<Engine> engine);

}  // namespace deform::server
