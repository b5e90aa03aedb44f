// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <exception>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "client/connection.h"
#include "client/decoder.h"
#include "client/retry.h"

namespace deform::client {

/// What a Session does.
class RequestSession {
 public:
  virtual ~RequestSession() = default;
  /// As Session::submit().
  virtual std::future<DeformOutcome> submit(const v1::DeformRequest& request) = 0;
  /// As Session::finish().
  virtual void finish() = 0;
};

/// Over the servers of the connection: a StreamSession where one server answers all calls, else a SpreadSession.
std::unique_ptr<RequestSession> open_requests(std::shared_ptr<Connection> connection, const CallOptions& options);

/// The mechanics of DeformStream. One thread reads and hands replies to the decoder of their request, one thread writes: it cuts
/// requests into messages, and repeats refused ones when the server said they may be.
///
///   submit -> waiting -> (writer) -> open -> replies (reader) -> decoder -> on_done -> answer
///                ^---- refused, after the hint ----'
class StreamSession final : public RequestSession {
 public:
  /// Takes the outcome of a request or its error, once. On any thread, no lock held; must not throw.
  using Answer = std::function<void(DeformOutcome&& outcome, const std::exception_ptr& error)>;

  /// Opens the stream.
  StreamSession(std::shared_ptr<Connection> connection, Server& server, const CallOptions& options,
                const std::string& geometry = {});
  /// Cancels what is open and waits for its end.
  ~StreamSession() override;

  std::future<DeformOutcome> submit(const v1::DeformRequest& request) override { return submit(request, {}); }
  void finish() override;
  /// A sink takes the designs one by one, memory their points.
  std::future<DeformOutcome> submit(const v1::DeformRequest& request, DesignSink sink, DesignMemory memory = {});
  /// With the encoding named; shared, because it may be sent to another server later.
  void submit(std::shared_ptr<const v1::DeformRequest> request, DesignSink sink, DesignMemory memory, Answer answer);
  /// The stream has ended: what is submitted fails.
  bool broken() const;

 private:
  struct Open {
    std::uint64_t id = 0;
    std::shared_ptr<const v1::DeformRequest> request;  // until it is answered: it may have to be sent again
    DesignSink sink;
    DesignMemory memory;
    Answer answer;
    std::shared_ptr<ReplyDecoder> decoder;
    std::unique_ptr<RetryPolicy> retry;
    RunContext::Clock::time_point started = RunContext::Clock::now();
  };
  using OpenPtr = std::shared_ptr<Open>;
  struct Command {
    OpenPtr send;                 ///< or
    std::uint64_t cancel_id = 0;  ///< tell the server that this answer is not wanted any more
    RunContext::Clock::time_point not_before;
  };

  void read();
  void write();
  void route(v1::DeformReply&& reply);
  void refused(const OpenPtr& open, const v1::RequestError& error);
  void enqueue(Command command);
  bool next_command(Command& command);
  bool send(const OpenPtr& open);
  void make_decoder(const OpenPtr& open);
  void answered(const OpenPtr& open, DeformOutcome&& outcome, const std::exception_ptr& error);
  void fail_all(const std::exception_ptr& error);

  const std::shared_ptr<Connection> connection_;
  const RunContext limits_;
  Attempt attempt_;
  const std::unique_ptr<grpc::ClientReaderWriterInterface<v1::DeformStreamRequest, v1::DeformReply>> stream_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  // under mutex_
  std::map<std::uint64_t, OpenPtr> open_;
  std::vector<Command> commands_;
  std::uint64_t last_id_ = 0;
  bool closing_ = false;
  std::exception_ptr broken_;  ///< why the stream ended

  std::thread reader_, writer_;
};

}  // namespace deform::client
