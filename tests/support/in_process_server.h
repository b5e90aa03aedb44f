// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <string>

#include "server/rpc/server.h"

namespace deform::support {

/// A folder of its own, removed with everything in it.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

enum class Transport {
  in_process,  ///< no sockets
  loopback     ///< a free port of 127.0.0.1
};

/// The real service for tests: true wire behaviour, no fixed ports, no sleeps for start-up. Logs nothing.
///
///   support::InProcessServer server;
///   auto stub = v1::DeformService::NewStub(server.channel());
class InProcessServer {
 public:
  /// The real engine with its store in a temporary folder (options.engine.data_dir is set when empty).
  explicit InProcessServer(Transport transport = Transport::in_process, server::ServerOptions options = {});
  /// Another engine behind the real service.
  InProcessServer(Transport transport, std::unique_ptr<server::Engine> engine, const server::ServiceOptions& service = {});

  /// A new connection.
  std::shared_ptr<grpc::Channel> channel();
  /// HOST:PORT; empty in-process.
  std::string address() const { return running_->address(); }
  server::Engine& engine() { return running_->engine(); }
  server::RunningServer& running() { return *running_; }
  const server::ServerOptions& options() const { return options_; }

  /// Stops and starts again on the same data directory (and another port). Only with the real engine.
  void restart();

 private:
  TemporaryFolder folder_;
  Transport transport_;
  server::ServerOptions options_;
  std::unique_ptr<server::RunningServer> running_;
};

}  // namespace deform::support
