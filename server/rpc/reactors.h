// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <unordered_map>
#include <vector>

#include "core/base/thread_pool.h"
#include "server/engine/engine.h"
#include "server/rpc/access.h"
#include "server/rpc/flood_guard.h"
#include "server/rpc/held_requests.h"
#include "server/rpc/log.h"
#include "server/rpc/metrics.h"
#include "server/rpc/overdue_calls.h"
#include "server/rpc/peers.h"
#include "server/rpc/request_rates.h"

namespace deform::server {

/// The mechanics of gRPC's callback interface, once: one read and one write in flight, half-close, cancel, finish exactly once
/// from every state (a call that never finishes would hang the server's shutdown). Calls derive from these and only convert. What
/// they throw ends the call with the error's status; nothing leaves a callback.
///
/// The pool is for engine calls that block (disk, hashing), so that gRPC's own threads never do.
///
/// A reactor owns itself between launch() and OnDone. Whoever may call back later (engine, pool) holds a weak_ptr or shared_ptr.

/// Counts the calls that have not ended, each of which takes memory that nobody else charges, about 24 KiB, while it is open and
/// does nothing. Thread-safe.
class LiveCalls {
 public:
  static constexpr std::size_t bytes_of_one = 24 << 10;

  /// `limit`: of all together; 0: none.
  explicit LiveCalls(std::size_t limit) : limit_(limit) {}

  /// Whether a server that stops waits for the call to end by itself.
  enum class Stop { waits, cuts_off };

  void enter(const std::string& client, Stop stop = Stop::waits);
  void leave(const std::string& client, Stop stop = Stop::waits);
  /// Throws Error(out_of_budget) with a retry hint when there are more than the limit, or of this client more than four times
  /// what is left, by the rule that connections and places in the queue have: so there is room for the next client.
  void check(const std::string& client) const;
  /// True when none that is waited for is left, false when the time is over first.
  bool wait_for_none(std::chrono::steady_clock::time_point deadline);

 private:
  const std::size_t limit_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  // under mutex_
  std::size_t count_ = 0;
  std::size_t awaited_ = 0;
  std::unordered_map<std::string, std::size_t> of_clients_;
};

/// A call as it comes in. All live until OnDone at least.
struct Incoming {
  grpc::CallbackServerContext* context = nullptr;
  Role needed = Role::operate;  ///< of the caller
  LiveCalls* live = nullptr;
  const Access* access = nullptr;
  const TrustedProxies* proxies = nullptr;
  const std::atomic<bool>* memory_full = nullptr;
  const std::atomic<bool>* draining = nullptr;
  OpenCalls* calls = nullptr;
  OverdueCalls* overdue = nullptr;
  Metrics* metrics = nullptr;
  HeldRequests* held = nullptr;
  FloodGuard* floods = nullptr;
  RequestRates* rates = nullptr;
  TenantMeters* in_flight = nullptr;
  std::chrono::milliseconds max_deadline{0};   ///< 0: none
  std::chrono::milliseconds stall_timeout{0};  ///< 0: none
  const grpc::ByteBuffer* request = nullptr;   ///< of a call with one
};

/// What every call has beside its mechanics. The record belongs to whoever has the turn of the call.
class CallScope {
 public:
  CallScope(const char* method, const Incoming& incoming);

  /// check_access(), check_rate(), check_draining(), check_memory() and LiveCalls::check(), but for operators, and the memory of
  /// the request is charged until the call ends: every launch() begins with it.
  void admit();
  /// Throws unless the caller may make this call. Cheap to ask again in a long call: the answer changes when the identities did.
  void check_access();
  /// Counts a request of the caller's tenant. Throws Error(out_of_budget) with a retry hint beyond its quota.
  void check_rate();
  /// What the caller's tenant may take, as it is now.
  Quota quota() const;
  TenantShare share() const { return {call_.tenant, call_.in_flight, quota().bytes_in_flight}; }
  /// Throws Error(unavailable) with a retry hint when this call computes or adds and the operator drains the server.
  void check_draining() const;
  /// Throws Error(out_of_budget) with a retry hint when this call computes or adds and the process occupies too much memory.
  void check_memory() const;
  /// Charges the memory of one message of a stream. Throws as HeldRequests::take() does.
  HeldRequests::Held hold(const grpc::ByteBuffer& message) const;
  /// The same for bytes that are known.
  HeldRequests::Held take(std::size_t bytes) const { return incoming_.held->take(bytes, share()); }
  /// Charges so many bytes more until the call ends. Throws as HeldRequests::take() does.
  void hold(std::size_t bytes);
  /// Stop token, deadline and caller, for the engine.
  const CallContext& call() const { return call_; }
  void cancel() { stop_.request_stop(); }
  /// Tells the operator which geometry and system the record names.
  void note_subject() const { call_.open->set_subject(record.geometry, record.system); }
  /// Ends the call in a moment, should it not have ended by itself.
  void cut_off_soon();
  /// The same when the client does not take the answer for as long as it may.
  void cut_off_when_stalled();
  /// The call waits for its client from now on, or no longer.
  void await(OpenCall::Client what) const { call_.open->await(what); }
  void came(OpenCall::Client what) const { call_.open->came(what); }
  /// Throws Error(cancelled) or Error(deadline_exceeded) when the answer has no reader any more.
  void check() const;
  /// Why a call ends that the transport or the operator gave up.
  Error given_up() const;
  /// Notes how the call ends and makes the status: an error of one that the operator has ended is the operator's; a retry hint
  /// goes into the trailing metadata. The operator sees the call no longer. Once, before Finish.
  grpc::Status finish(std::optional<Error> error);
  /// One line, and the call counts no longer. In OnDone.
  void leave();
  Metrics& metrics() const { return *incoming_.metrics; }

  CallRecord record;

 private:
  const google::protobuf::Descriptor& request_type() const;
  void cut_off_after(std::chrono::milliseconds time, Error why);
  Error too_long() const;

  const Incoming incoming_;
  std::vector<HeldRequests::Held> held_;
  const std::chrono::steady_clock::time_point started_;
  std::stop_source stop_;
  CallContext call_;
  std::optional<std::chrono::steady_clock::time_point> overdue_;  ///< when the call is cut off
  mutable std::mutex admission_mutex_;
  // under admission_mutex_
  Access::Admission admission_;  ///< a stream asks again while it may end
  bool left_ = false;
  std::optional<std::chrono::steady_clock::time_point> cut_off_;  ///< when, after cut_off_soon()
};

/// Copies what the engine tells about its work into the record; what it does not know stays.
void note_stats(const CallStats& stats, CallRecord& record);

/// A call with one request and one reply, answered on the pool or begun there.
class UnaryCall final : public grpc::ServerUnaryReactor, public std::enable_shared_from_this<UnaryCall> {
 public:
  /// Makes the reply; may throw.
  using Work = std::function<grpc::ByteBuffer(CallScope&)>;
  static grpc::ServerUnaryReactor* launch(ThreadPool& pool, const char* method, const Incoming& incoming, grpc::ByteBuffer* reply,
                                          Work work);
  /// Gives the answer, once, from any thread.
  using Answer = std::function<void(const Work&)>;
  /// Sees to it that the answer is given, also when the call is cancelled; throws where it never will be.
  using Begin = std::function<void(CallScope&, Answer)>;
  static grpc::ServerUnaryReactor* launch_later(ThreadPool& pool, const char* method, const Incoming& incoming,
                                                grpc::ByteBuffer* reply, Begin begin);

 private:
  UnaryCall(const char* method, const Incoming& incoming, grpc::ByteBuffer* reply);
  static grpc::ServerUnaryReactor* enter(ThreadPool& pool, std::shared_ptr<UnaryCall> call, ThreadPool::Task task);
  void answer(const Work& work);
  void OnCancel() override { scope_.cancel(); }
  void OnDone() override;

  CallScope scope_;
  grpc::ByteBuffer* const reply_;
  std::shared_ptr<UnaryCall> self_;
};

/// What a turn of a call that streams replies gives.
enum class ReplyTurn {
  write,  ///< the reply was filled
  wait,   ///< ReplyWriter::wake() will be called
  end     ///< all has been said
};

/// The writing half of a call that streams replies. Reactor: ServerWriteReactor or ServerBidiReactor of bytes.
///
///   working --next(): write--> writing --OnWriteDone--> working
///   working --next(): wait---> idle ----wake()-------> working
///   working --next(): end, error, cancel--> finished --OnDone--> destroyed
template <typename Reactor>
class ReplyWriter : public Reactor, public std::enable_shared_from_this<ReplyWriter<Reactor>> {
 public:
  /// The calling thread runs begin() and the first steps.
  static Reactor* launch(std::shared_ptr<ReplyWriter> call);
  /// The pool does. A full pool ends the call.
  static Reactor* launch(std::shared_ptr<ReplyWriter> call, ThreadPool& pool);

  /// There may be something to write. Any thread, any time while a shared_ptr is held.
  void wake();

 protected:
  using Next = ReplyTurn;
  ReplyWriter(const char* method, const Incoming& incoming) : scope_(method, incoming) {}

  /// First of all, once. May throw.
  virtual void begin() = 0;
  /// By one thread at a time, never while a write is in flight. Must not block. May throw: ends the call.
  virtual Next next(grpc::ByteBuffer& reply) = 0;
  /// The call ends before all was said: whatever works for it may stop. Once at most per reason; any thread.
  virtual void stop() noexcept = 0;
  /// The call has ended; its log line comes next, then destruction.
  virtual void done() noexcept {}

  CallScope scope_;

 private:
  enum class State { idle, working, writing, finished };

  void run();
  /// The operator may end it.
  void watch_operator();
  void advance();
  /// Has the caller, who is working, to stay at it (someone asked meanwhile), or is it idle now?
  bool rest();
  void end(std::optional<Error> error);
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

  std::shared_ptr<ReplyWriter> self_;
  std::atomic<bool> given_up_{false};  ///< cancelled, or the connection broke
  std::mutex mutex_;
  // under mutex_
  State state_ = State::working;
  bool asked_ = false;
  // of whoever is working
  grpc::ByteBuffer reply_;
  std::chrono::steady_clock::time_point write_started_;
};

extern template class ReplyWriter<grpc::ServerWriteReactor<grpc::ByteBuffer>>;
extern template class ReplyWriter<grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>>;

using ReplyStream = ReplyWriter<grpc::ServerWriteReactor<grpc::ByteBuffer>>;

/// A call that reads a stream of requests and answers once. Every step runs on the pool.
///
///   handling --message(): more--> reading --OnReadDone--> handling
///   reading --OnReadDone: no more--> handling --OnSendInitialMetadataDone: half_closed()
///   handling --later--> waiting --answer()--> finished;  any --error, cancel, the operator--> finished
class RequestStream : public grpc::ServerReadReactor<grpc::ByteBuffer>, public std::enable_shared_from_this<RequestStream> {
 public:
  static grpc::ServerReadReactor<grpc::ByteBuffer>* launch(std::shared_ptr<RequestStream> call);

  /// Ends a call that waits. A second answer, or one that comes after a cancel, is dropped. Any thread.
  void answer(std::optional<Error> error, const google::protobuf::Message* reply, const CallStats& stats = {});

 protected:
  enum class Then {
    read,  ///< the next message, please
    later  ///< answer() has been or will be called
  };
  RequestStream(const char* method, const Incoming& incoming, grpc::ByteBuffer* reply, ThreadPool& pool);

  /// One message of the client. May throw.
  virtual Then message(const grpc::ByteBuffer& bytes) = 0;
  /// The client has said all: must lead to an answer(). May throw.
  virtual void half_closed() = 0;

  CallScope scope_;

 private:
  enum class State { handling, reading, waiting, finished };
  enum class Came { message, all, lost };

  void handle(Came what);
  /// The operator may end it.
  void watch_operator();
  void OnReadDone(bool ok) override;
  void OnSendInitialMetadataDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

  ThreadPool& pool_;
  grpc::ByteBuffer* const reply_;
  grpc::ByteBuffer request_;
  std::shared_ptr<RequestStream> self_;
  std::mutex mutex_;
  State state_ = State::handling;  // under mutex_
};

}  // namespace deform::server
