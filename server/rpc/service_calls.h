// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/server_context.h>

#include <memory>
#include <string>
#include <utility>

#include "server/rpc/reactors.h"
#include "server/rpc/service_messages.h"

namespace deform::server {

/// The first steps of every call with one request: convert and record.
template <typename Request>
Request received(const grpc::ByteBuffer& bytes, CallRecord& record) {
  record.messages_in = 1;
  record.bytes_in = bytes.Length();
  Request request;
  parse(bytes, request);
  return request;
}

/// The value of an outcome, whose statistics are recorded; throws its error.
template <typename T>
T taken(Engine::Outcome<T>& outcome, CallRecord& record, const char* what) {
  note_stats(outcome.stats, record);
  if (outcome.error) throw Error(*outcome.error);
  if (!outcome.value) throw Error(ErrorCode::internal, std::string(what) + " ended with neither a result nor an error");
  return std::move(*outcome.value);
}

/// The streaming calls of the service, one class per shape of call; service.cpp launches them. Each follows the same five steps:
/// deadline (CallScope), call (the engine), convert (service_messages), record (CallScope::record), return (status).

/// Deform and JacobianVector: pulls the replies of one job.
class JobCall : public ReplyStream {
 public:
  using Ready = std::function<void()>;
  /// Parses, records and asks the engine; may throw.
  using Submit = std::function<std::shared_ptr<DeformJob>(CallScope&, Ready)>;
  JobCall(const char* method, const Incoming& incoming, Submit submit);

 private:
  void begin() override;
  Next next(grpc::ByteBuffer& reply) override;
  void stop() noexcept override;
  void done() noexcept override;

  const Submit submit_;
  std::mutex job_mutex_;
  std::shared_ptr<DeformJob> job_;  // under job_mutex_ until begin() is over, constant afterwards
};

/// What a preparation has to tell: the newest progress, then the system. Thread-safe; next() by one thread at a time.
class PrepareNews {
 public:
  /// False for progress that is not worth a message yet.
  bool note(const v1::Progress& progress);
  void note(Engine::Outcome<v1::SystemInfo> outcome);
  /// Fills the next reply, a v1::PrepareReply. Throws the error of the preparation.
  ReplyTurn next(grpc::ByteBuffer& reply, CallRecord& record);

 private:
  using Clock = std::chrono::steady_clock;

  std::mutex mutex_;
  // under mutex_
  std::optional<v1::Progress> progress_;  ///< not written yet
  std::string stage_;
  Clock::time_point last_progress_{};
  std::optional<Engine::Outcome<v1::SystemInfo>> outcome_;
  // of whoever is working
  bool reported_ = false;
};

/// Asks the engine, and wakes the call at news. The call may end before the engine does.
template <typename Call>
void prepare_for(const std::shared_ptr<Call>& call, PrepareNews Call::*news, Engine& engine, const v1::PrepareRequest& request,
                 const CallContext& context) {
  engine.prepare(
      request, context,
      [weak = std::weak_ptr<Call>(call), news](const v1::Progress& progress) {
        const auto self = weak.lock();
        if (self && ((*self).*news).note(progress)) self->wake();
      },
      [weak = std::weak_ptr<Call>(call), news](Engine::Outcome<v1::SystemInfo> outcome) {
        const auto self = weak.lock();
        if (!self) return;
        ((*self).*news).note(std::move(outcome));
        self->wake();
      });
}

/// Prepare.
class PrepareCall : public ReplyStream {
 public:
  PrepareCall(Engine& engine, const Incoming& incoming, const grpc::ByteBuffer* request);

 private:
  void begin() override;
  Next next(grpc::ByteBuffer& reply) override;
  void stop() noexcept override {}  // the stop token tells

  Engine& engine_;
  const grpc::ByteBuffer* const request_;
  PrepareNews news_;
};

/// Detect: all replies once they are there.
class DetectCall : public ReplyStream {
 public:
  DetectCall(Engine& engine, const Incoming& incoming, const grpc::ByteBuffer* request);

 private:
  void begin() override;
  Next next(grpc::ByteBuffer& reply) override;
  void stop() noexcept override {}  // the stop token tells
  void note_outcome(Engine::Outcome<Engine::DetectReplies> outcome);

  Engine& engine_;
  const grpc::ByteBuffer* const request_;
  std::mutex news_mutex_;
  std::optional<Engine::Outcome<Engine::DetectReplies>> outcome_;  // under news_mutex_
  // of whoever is working
  Engine::DetectReplies replies_;
  std::size_t sent_ = 0;
};

/// GetBasis: header, then records as fast as the reader takes them.
class BasisCall : public ReplyStream {
 public:
  BasisCall(Engine& engine, const Incoming& incoming, const grpc::ByteBuffer* request);

 private:
  using Records = std::shared_ptr<BasisRecords>;

  void begin() override;
  Next next(grpc::ByteBuffer& reply) override;
  void stop() noexcept override {}  // the stop token tells
  void note_outcome(Engine::Outcome<Records> outcome);

  Engine& engine_;
  const grpc::ByteBuffer* const request_;
  std::mutex news_mutex_;
  std::optional<Engine::Outcome<Records>> outcome_;  // under news_mutex_
  // of whoever is working
  Records records_;
};

/// GetSetup.
class SetupCall : public ReplyStream {
 public:
  SetupCall(Engine& engine, const Incoming& incoming, const grpc::ByteBuffer* request);

 private:
  void begin() override;
  Next next(grpc::ByteBuffer& reply) override;
  void stop() noexcept override {}

  Engine& engine_;
  const grpc::ByteBuffer* const request_;
  std::string setup_;
  std::size_t sent_ = 0;
};

/// GetPoints.
class PointsCall : public ReplyStream {
 public:
  PointsCall(Engine& engine, const Incoming& incoming, const grpc::ByteBuffer* request);

 private:
  void begin() override;
  Next next(grpc::ByteBuffer& reply) override;
  void stop() noexcept override {}

  Engine& engine_;
  const grpc::ByteBuffer* const request_;
  std::shared_ptr<const Points> points_;
  std::size_t sent_ = 0;
};

/// RegisterGeometry. Answers as soon as the geometry turns out to be there.
class RegisterCall : public RequestStream {
 public:
  RegisterCall(Engine& engine, const Incoming& incoming, grpc::ByteBuffer* reply, ThreadPool& pool);

 private:
  Then message(const grpc::ByteBuffer& bytes) override;
  void half_closed() override;

  Engine& engine_;
  std::unique_ptr<GeometryUpload> upload_;
};

/// VectorJacobian. The cotangent may have as many points as the geometry and no more.
class VectorJacobianCall : public RequestStream {
 public:
  VectorJacobianCall(Engine& engine, const Incoming& incoming, grpc::ByteBuffer* reply, ThreadPool& pool);

 private:
  Then message(const grpc::ByteBuffer& bytes) override;
  void half_closed() override;
  void begin(const v1::VectorJacobianHeader& header);
  void append(const std::string& bytes);

  Engine& engine_;
  std::optional<v1::VectorJacobianHeader> header_;
  std::size_t expected_points_ = 0;
  std::size_t received_ = 0;  ///< bytes of the cotangent
  Points cotangent_;
};

}  // namespace deform::server
