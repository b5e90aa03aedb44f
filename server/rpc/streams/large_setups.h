// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/server_context.h>

#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "server/rpc/reactors.h"
#include "server/rpc/service_calls.h"
#include "server/rpc/streams/service_stream.h"

namespace deform::server {

/// Joins the pieces of a setup. What has come is charged piece by piece, never what the header claims, and what the message takes
/// is charged before it is parsed. Not thread-safe.
class SetupPieces {
 public:
  /// `most`: bytes of a setup.
  explicit SetupPieces(std::size_t most) : most_(most) {}

  /// Throws Error(invalid_argument) for a size of 0 or above the limit, and Error(out_of_budget) when there is no room for it
  /// now.
  void begin(const v1::LargeSetupHeader& header, const CallScope& scope);
  bool begun() const { return expected_ > 0; }
  /// Throws Error(invalid_argument) for more bytes than the header says, and as HeldRequests::take() does.
  void add(std::string&& piece, const CallScope& scope);
  /// The whole setup; the pieces are let go of. What it takes stays charged until the call ends. Throws Error(invalid_argument)
  /// when bytes are missing, when they are no setup, and when it would take more than eight times `most` in memory.
  void take(v1::Setup& setup, CallScope& scope);

 private:
  const std::size_t most_;
  std::size_t expected_ = 0, received_ = 0;
  std::vector<std::string> pieces_;
  std::vector<HeldRequests::Held> held_;
};

/// EstimateLarge.
class LargeEstimateCall final : public RequestStream {
 public:
  LargeEstimateCall(Engine& engine, std::size_t most_bytes, const Incoming& incoming, grpc::ByteBuffer* reply, ThreadPool& pool);

 private:
  Then message(const grpc::ByteBuffer& bytes) override;
  void half_closed() override;

  Engine& engine_;
  v1::EstimateRequest request_;
  SetupPieces pieces_;
};

/// PrepareLarge: reads all pieces, asks the engine, then writes as Prepare does.
///
///   reading --header, pieces--> reading --half-close--> pool: wake() --next()--> Engine::prepare --PrepareNews--> written
class LargePrepareCall final : public ReplyWriter<BidiReactor> {
 public:
  LargePrepareCall(Engine& engine, std::size_t most_bytes, const Incoming& incoming, ThreadPool& pool);

 private:
  void begin() override;
  void read();
  Next next(grpc::ByteBuffer& reply) override;
  void stop() noexcept override {}  // the stop token tells
  void done() noexcept override;
  void OnReadDone(bool ok) override;

  void take(const grpc::ByteBuffer& bytes);
  void half_closed();
  void ask();

  Engine& engine_;
  ThreadPool& pool_;
  PrepareNews news_;
  // of whoever reads, and when all was read, of whoever is working
  grpc::ByteBuffer message_;
  v1::PrepareRequest request_;
  SetupPieces pieces_;
  std::size_t messages_in_ = 0, bytes_in_ = 0;
  std::mutex mutex_;
  // under mutex_
  std::optional<Error> failure_;
  bool all_read_ = false;
  // of whoever is working
  bool asked_ = false;
};

}  // namespace deform::server
