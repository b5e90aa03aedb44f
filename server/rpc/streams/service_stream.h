// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/server_context.h>

#include <deque>
#include <functional>
#include <memory>
#include <mutex>

#include "server/rpc/reactors.h"
#include "server/rpc/streams/service_requests.h"

namespace deform::server {

using BidiReactor = grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>;

/// DeformStream: many requests over one stream. Reading and writing go on side by side; jobs that have something to send take
/// turns, one message each.
///
///   reading --message--> StreamRequests --start()--> Engine::deform --on_ready--> turns --poll()--> written
///
/// Reading pauses while too much is buffered or too many refusals wait for a slow reader. Ends when the client has half-closed
/// and every request has been answered, when it cancels, when it sends something that is no request, or when the server drains
/// and nothing is open.
class DeformStreamCall final : public ReplyWriter<BidiReactor> {
 public:
  DeformStreamCall(Engine& engine, const StreamLimits& limits, const Incoming& incoming,
                   std::function<void(DeformStreamCall*)> on_done);

  /// Answers what is open and ends. Any thread.
  void drain();

 private:
  using RequestPtr = StreamRequests::RequestPtr;
  enum class Reading { under_way, handling, paused, closed };

  void begin() override;
  Next next(grpc::ByteBuffer& reply) override;
  void stop() noexcept override;
  void done() noexcept override;
  void OnReadDone(bool ok) override;

  void take(const grpc::ByteBuffer& bytes);
  /// Gives waiting requests to the engine while there is room.
  void start_requests();
  void start_request(const RequestPtr& request);
  void read_on();
  /// Puts a request into the list of those with something to send.
  void queue_turn(const RequestPtr& request);
  /// The reply that a turn of this request gives, if any.
  std::optional<v1::DeformReply> turn(const RequestPtr& request);
  std::optional<v1::DeformReply> finished(const RequestPtr& request, const DeformJob& job);
  /// Closes a running request whose job has said its last word and lets others start; false when it has ended otherwise.
  bool end_request(const RequestPtr& request, const DeformJob& job);
  std::weak_ptr<DeformStreamCall> weak_self() { return std::static_pointer_cast<DeformStreamCall>(shared_from_this()); }

  Engine& engine_;
  const std::function<void(DeformStreamCall*)> on_done_;
  grpc::ByteBuffer message_;  // being read
  std::mutex mutex_;
  // under mutex_
  StreamRequests requests_;
  std::deque<RequestPtr> turns_;
  std::deque<RequestPtr> refused_;  ///< to be answered
  Reading reading_ = Reading::under_way;
  bool draining_ = false;
  std::optional<Error> failure_;  ///< of the whole stream
};

}  // namespace deform::server
