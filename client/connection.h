// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/client_context.h>

#include <atomic>
#include <exception>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "client/client.h"
#include "client/held_copies.h"
#include "client/id_map.h"
#include "client/points_cache.h"
#include "client/route.h"
#include "client/servers.h"
#include "client/status.h"
#include "core/base/thread_pool.h"
#include "deform/v1/service.grpc.pb.h"

namespace deform::client {

/// What the calls of one Client share; sessions keep it alive. Thread-safe.
struct Connection {
  /// Over channels that exist; nothing is sent.
  Connection(std::vector<std::unique_ptr<Server>> servers_in, const ClientOptions& options_in);

  const ClientOptions options;                ///< as given, but that `encoding` is named
  const Servers servers;                      ///< at least one
  const std::string traceparent;              ///< of the environment when the client was made, for every call
  const std::string client_id;                ///< at random, as no two clients may have the same
  PointsCache points;                         ///< registered points that decoding needs
  HeldCopies held;                            ///< where keeps_copies()
  std::atomic<bool> own_channel{false};       ///< made for the addresses of the options
  std::atomic<std::uint64_t> calls{0};        ///< so far; gives each call a seed of its own
  std::atomic<std::uint64_t> request_ids{0};  ///< given so far
  std::atomic<bool> answered{false};          ///< a server has answered some call
  IdMap<std::string> geometry_of;             ///< of systems, as far as it is known
  IdMap<Server*> found_at;                    ///< ids that a server knew and one that is asked before it did not
  ThreadPool pool;                            ///< for decoding; last, so that its tasks end first

  /// Another server may answer the next call.
  bool keeps_copies() const { return servers.several() || options.replicas; }
  /// For another call, to be found by in logs: CLIENT-NUMBER.
  std::string new_request_id() { return client_id + "-" + std::to_string(++request_ids); }
  /// With the encoding named.
  v1::DeformRequest named(v1::DeformRequest request) const;
  /// The encoding itself, or that of the options in place of the default.
  v1::Encoding named(v1::Encoding encoding) const;
  /// Waits for the connection that gRPC tries to make, one attempt long: until then calls would fail by the error of the attempt
  /// before. A stop or the deadline ends it by its Error.
  void wait_for_answer(Server& server, const RunContext& limits) const;
  /// Waits for the server's return: `longest`, or until there is a connection again where there was none. While no call waits
  /// so, gRPC goes on with connecting only every 5 s. A stop or the deadline ends it by its Error.
  void wait_for_return(Server& server, std::chrono::milliseconds longest, const RunContext& limits) const;
  /// The patience of ClientOptions, as it is now.
  std::chrono::milliseconds patience() const;
  /// Cached, or fetched once.
  std::shared_ptr<const Points> registered_points(const std::string& geometry_id, const RunContext& limits);

  /// Notes the geometry of a system, and keeps its setup where copies are kept.
  void note(const v1::SystemInfo& system, v1::Setup setup);
  /// Servers::ranked(), after the one that turned out to know the id.
  std::vector<Server*> ranked(const std::string& key) const;
  /// Whether there is something that bring() could bring.
  bool holds(const Subject& subject, const std::string& geometry) const;
  /// Registers the geometry at this server and prepares the system, as far as they are held and it lacks them. One attempt;
  /// throws its Error.
  void bring(Server& server, const Subject& subject, const std::string& geometry, const RunContext& limits);
};

/// What a Client holds.
struct Client::Impl : Connection {
  using Connection::Connection;
};

/// Time and cancellation of a call with all its attempts.
RunContext limits_of(const CallOptions& options);
/// What is left of it, for a call inside.
CallOptions remaining(const RunContext& limits);

/// What the metadata of an attempt say for proxies and logs.
struct AttemptMarks {
  std::string geometry;    ///< id; empty: not known
  std::string request_id;  ///< of the call
};

/// One attempt of a call at one server: its gRPC context with the deadline, cancelled at once when the caller stops it.
class Attempt {
 public:
  /// Sets the deadline and adds the token and the marks; a stop of `limits` cancels the context on the thread that asks for it.
  Attempt(Connection& connection, const RunContext& limits, Server& server, AttemptMarks marks);
  Attempt(const Attempt&) = delete;
  Attempt& operator=(const Attempt&) = delete;

  /// To call the server by.
  v1::DeformService::StubInterface& stub() const { return *server_.stub; }
  /// That is asked.
  Server& server() const { return server_; }
  /// The id of the call.
  const std::string& request_id() const { return request_id_; }
  /// Ends the call: who waits for it gets Error(cancelled).
  void cancel();
  /// Another one of the same call at the same server.
  Attempt another() const { return {connection_, limits_, server_, {geometry_, request_id_}}; }
  /// Throws the Error of a status that is not OK. Where no connection came about, says why TLS failed if it did. What was not
  /// cancelled here was cut off by a server that shuts down: Error(unavailable).
  void check(const grpc::Status& status) const;

  grpc::ClientContext context;  ///< of this attempt alone

 private:
  Connection& connection_;
  const RunContext limits_;
  Server& server_;
  const std::string geometry_, request_id_;
  std::atomic<bool> cancelled_{false};
  const std::stop_callback<std::function<void()>> stopped_;  ///< last: no longer runs when the context goes
};

/// Runs body(attempt, limits) until it returns, its error allows no further attempt, or repeat() says no.
template <typename Body, typename MayRepeat>
auto with_retries(Connection& connection, const Subject& subject, const CallOptions& options, Retry retry, const Body& body,
                  const MayRepeat& repeat) {
  const RunContext limits = limits_of(options);
  const std::string request_id = connection.new_request_id();
  Route route(connection, subject, retry);
  while (true) {
    try {
      route.go(limits);
      Attempt attempt(connection, limits, route.server(), {route.geometry(), request_id});
      auto result = body(attempt, limits);
      route.arrived();
      return result;
    } catch (const Error& error) {
      route.failed(error, limits, repeat());
    }
  }
}

/// The same where every attempt may be repeated.
template <typename Body>
auto with_retries(Connection& connection, const Subject& subject, const CallOptions& options, Retry retry, const Body& body) {
  return with_retries(connection, subject, options, retry, body, [] { return Repeat::yes; });
}

/// A method with one request and one reply.
template <typename Request, typename Reply>
using UnaryMethod = grpc::Status (v1::DeformService::StubInterface::*)(grpc::ClientContext*, const Request&, Reply*);

/// One attempt of it.
template <typename Request, typename Reply>
Reply ask(Attempt& attempt, UnaryMethod<Request, Reply> method, const Request& request) {
  Reply reply;
  attempt.check((attempt.stub().*method)(&attempt.context, request, &reply));
  return reply;
}

/// A call of it.
template <typename Request, typename Reply>
Reply unary(Connection& connection, const Subject& subject, const CallOptions& options, Retry retry,
            UnaryMethod<Request, Reply> method, const Request& request) {
  return with_retries(connection, subject, options, retry,
                      [&](Attempt& attempt, const RunContext&) { return ask(attempt, method, request); });
}

/// Takes every reply of a stream. What take() throws cancels the call and is thrown when the stream has ended; else `status` is
/// how it ended.
template <typename Reply, typename Stream, typename Take>
void read_to_end(Attempt& attempt, Stream& stream, grpc::Status& status, const Take& take) {
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
  status = stream.Finish();
  if (error) std::rethrow_exception(error);
}

/// The same, and throws the Error of a status that is not OK.
template <typename Reply, typename Stream, typename Take>
void read_all(Attempt& attempt, Stream& stream, const Take& take) {
  grpc::Status status;
  read_to_end<Reply>(attempt, stream, status, take);
  attempt.check(status);
}

/// Writes messages as long as next(message) fills them and the server wants them: it may have heard enough, its status tells.
template <typename Request, typename Next>
grpc::Status write_to_end(grpc::ClientWriterInterface<Request>& stream, const Next& next) {
  Request message;
  while (next(message) && stream.Write(message)) {
  }
  stream.WritesDone();
  return stream.Finish();
}

/// The same, and throws the Error of a status that is not OK.
template <typename Request, typename Next>
void write_all(Attempt& attempt, grpc::ClientWriterInterface<Request>& stream, const Next& next) {
  attempt.check(write_to_end(stream, next));
}

/// One attempt of uploading a geometry. on_progress: fraction sent; may be empty.
v1::GeometryInfo upload(Attempt& attempt, const GeometryArrays& arrays, const std::string& id,
                        const std::function<void(double)>& on_progress);

}  // namespace deform::client
