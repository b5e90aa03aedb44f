// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/server_context.h>

#include <memory>
#include <mutex>
#include <optional>

#include "server/rpc/reactors.h"
#include "server/rpc/streams/service_stream.h"

namespace deform::server {

/// Evaluate: one design at points as they come. Reading and writing go on side by side; reading pauses while the job has no room,
/// which it has again when answers were taken.
///
///   reading --header--> Engine::evaluate;  --block--> EvaluateJob::add;  --half-close--> EvaluateJob::finish
///   EvaluateJob --on_ready--> poll() --> written
class EvaluateStreamCall final : public ReplyWriter<BidiReactor> {
 public:
  EvaluateStreamCall(Engine& engine, const Incoming& incoming);

 private:
  enum class Reading { under_way, handling, paused, closed };

  void begin() override;
  void read();
  Next next(grpc::ByteBuffer& reply) override;
  void stop() noexcept override;
  void done() noexcept override;
  void OnReadDone(bool ok) override;

  void take(const grpc::ByteBuffer& bytes);
  void half_closed();
  void read_on();
  std::shared_ptr<EvaluateJob> job();

  Engine& engine_;
  grpc::ByteBuffer message_;  // being read
  std::mutex mutex_;
  // under mutex_
  std::shared_ptr<EvaluateJob> job_;
  Reading reading_ = Reading::under_way;
  std::size_t messages_in_ = 0, bytes_in_ = 0;
  std::string system_;
  std::optional<Error> failure_;
};

}  // namespace deform::server
