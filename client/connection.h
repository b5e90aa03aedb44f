// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/channel.h>

#include <atomic>
#include <exception>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>

#include "client/client.h"
#include "client/points_cache.h"
#include "client/retry.h"
#include "client/status.h"
#include "core/base/thread_pool.h"
#include "deform/v1/service.grpc.pb.h"

namespace deform::client {

/// What the calls of one Client share; sessions keep it alive. Thread-safe.
struct Connection {
  /// Over a channel that exists; nothing is sent.
  Connection(std::shared_ptr<grpc::ChannelInterface> channel_in, const ClientOptions& options_in);

  const ClientOptions options;                                   ///< as given, but that `encoding` is named
  const std::shared_ptr<grpc::ChannelInterface> channel;         ///< to the server
  const std::unique_ptr<v1::DeformService::StubInterface> stub;  ///< over that channel
  const std::string traceparent;                                 ///< of the environment when the client was made, for every call
  PointsCache points;                                            ///< registered points that decoding needs
  std::atomic<bool> own_channel{false};                          ///< made for the address of the options
  std::atomic<std::uint64_t> calls{0};                           ///< so far; gives each call a seed of its own
  ThreadPool pool;                                               ///< for decoding; last, so that its tasks end first

  /// With the encoding named.
  v1::DeformRequest named(v1::DeformRequest request) const;
  /// The encoding itself, or that of the options in place of the default.
  v1::Encoding named(v1::Encoding encoding) const;
  /// Waits for the connection that gRPC tries to make, one attempt long: until then calls would fail by the error of the attempt
  /// before. A stop or the deadline ends it by its Error.
  void wait_for_answer(const RunContext& limits) const;
  /// Cached, or fetched once.
  std::shared_ptr<const Points> registered_points(const std::string& geometry_id, const RunContext& limits);
};

/// What a Client holds.
struct Client::Impl : Connection {
  using Connection::Connection;
};

/// Time and cancellation of a call with all its attempts.
RunContext limits_of(const CallOptions& options);
/// What is left of it, for a call inside.
CallOptions remaining(const RunContext& limits);

/// One attempt of a call: its gRPC context with the deadline, cancelled at once when the caller stops it.
class Attempt {
 public:
  /// Sets the deadline and adds the token; a stop of `limits` cancels the context on the thread that asks for it.
  Attempt(Connection& connection, const RunContext& limits);
  Attempt(const Attempt&) = delete;
  Attempt& operator=(const Attempt&) = delete;

  /// Throws the Error of a status that is not OK. Where no connection came about, says why TLS failed if it did.
  void check(const grpc::Status& status) const;

  grpc::ClientContext context;  ///< of this attempt alone

 private:
  Connection& connection_;
  const std::stop_callback<std::function<void()>> stopped_;  ///< last: no longer runs when the context goes
};

/// Runs body(attempt, limits) until it returns, its error allows no further attempt, or may_repeat() says no.
template <typename Body, typename MayRepeat>
auto with_retries(Connection& connection, const CallOptions& options, Retry retry, const Body& body,
                  const MayRepeat& may_repeat) {
  const RunContext limits = limits_of(options);
  RetryPolicy policy({connection.options.max_attempts, connection.options.retry_seed + connection.calls++, retry});
  while (true) {
    std::chrono::milliseconds wait{};
    bool silent = false;
    try {
      limits.check();
      Attempt attempt(connection, limits);
      return body(attempt, limits);
    } catch (const Error& error) {
      const auto next = policy.next_wait(error);
      if (!next || !may_repeat()) throw;
      if (limits.deadline && RunContext::Clock::now() + *next >= *limits.deadline) throw;
      wait = *next;
      const auto* none = dynamic_cast<const NotConnected*>(&error);
      silent = none != nullptr && none->silent();
    }
    RetryPolicy::wait(wait, limits);
    if (silent) connection.wait_for_answer(limits);
  }
}

/// The same where every attempt may be repeated.
template <typename Body>
auto with_retries(Connection& connection, const CallOptions& options, Retry retry, const Body& body) {
  return with_retries(connection, options, retry, body, [] { return true; });
}

/// A call with one request and one reply.
template <typename Request, typename Reply>
Reply unary(Connection& connection, const CallOptions& options, Retry retry,
            grpc::Status (v1::DeformService::StubInterface::*method)(grpc::ClientContext*, const Request&, Reply*),
            const Request& request) {
  return with_retries(connection, options, retry, [&](Attempt& attempt, const RunContext&) {
    Reply reply;
    attempt.check((connection.stub.get()->*method)(&attempt.context, request, &reply));
    return reply;
  });
}

/// Takes every reply of a stream. What take() throws cancels the call and is thrown when the stream has ended; then the Error of
/// a status that is not OK.
template <typename Reply, typename Take>
void read_all(Attempt& attempt, grpc::ClientReaderInterface<Reply>& stream, const Take& take) {
  Reply reply;
  std::exception_ptr error;
  while (stream.Read(&reply)) {
    if (error) continue;  // to the end: Finish() wants nothing unread
    try {
      take(std::move(reply));
    } catch (...) {
      error = std::current_exception();
      attempt.context.TryCancel();
    }
  }
  const grpc::Status status = stream.Finish();
  if (error) std::rethrow_exception(error);
  attempt.check(status);
}

/// Writes messages as long as next(message) fills them and the server wants them: it may have heard enough, its status tells.
template <typename Request, typename Next>
void write_all(Attempt& attempt, grpc::ClientWriterInterface<Request>& stream, const Next& next) {
  Request message;
  while (next(message) && stream.Write(message)) {
  }
  stream.WritesDone();
  attempt.check(stream.Finish());
}

}  // namespace deform::client
