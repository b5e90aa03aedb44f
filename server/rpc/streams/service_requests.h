// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <stop_token>
#include <unordered_map>
#include <vector>

#include "server/engine/engine.h"
#include "server/rpc/held_requests.h"
#include "server/rpc/log.h"

namespace deform::server {

/// Limits of one DeformStream.
struct StreamLimits {
  std::size_t open_requests = 4096;           ///< more are refused
  std::size_t running_requests = 16;          ///< in the engine at once; the others wait here, in order of their last message
  std::chrono::milliseconds max_deadline{0};  ///< of a request, from its first message on; 0: none
  std::size_t buffered_bytes = std::size_t{64} << 20;  ///< of requests being received, waiting or running: reading pauses
};

/// The bookkeeping of one DeformStream without its transport: joins the messages of each request, refuses what is wrong, says
/// what may start. A request is answered after its last message at the earliest, so that an id never means two things.
///
///   assembling --last message--> waiting --start()--> running --close()--> gone
///   assembling --bad message--> refused --last message or cancel--> gone
///
/// Not thread-safe; the stream's lock guards it.
class StreamRequests {
 public:
  enum class State { assembling, waiting, running, refused };

  struct Request {
    std::uint64_t id = 0;
    State state = State::assembling;
    v1::DeformRequest message;
    std::size_t bytes = 0;  ///< counted against the limit
    std::vector<HeldRequests::Held> held;
    std::optional<Error> refusal;
    std::stop_source stop;  ///< of `call`
    CallContext call;       ///< with a stop token of its own
    std::shared_ptr<DeformJob> job;
    bool in_turn = false;  ///< stands in the list of those with something to send
    CallRecord record;
    std::chrono::steady_clock::time_point opened;
  };
  using RequestPtr = std::shared_ptr<Request>;

  /// A request that ends without having run, or a job that has to be cancelled.
  struct Effect {
    RequestPtr answered;                   ///< its refusal is to be sent; it is closed
    std::shared_ptr<DeformJob> cancelled;  ///< call cancel() on it
  };

  /// `stream` says who calls; each request's record says so, too.
  StreamRequests(const StreamLimits& limits, CallContext call, const CallRecord& stream = {})
      : limits_(limits), call_(std::move(call)), client_(stream.client), identity_(stream.identity), tenant_(stream.tenant) {}

  /// One message of `bytes` bytes, which take `held` in memory. With a refusal it is refused, of its fields only request_id, more
  /// and cancel count. Throws Error(out_of_budget) when the client floods the stream with broken requests: ends it.
  Effect accept(v1::DeformStreamRequest&& message, std::size_t bytes, HeldRequests::Held held = {},
                std::optional<Error> refusal = std::nullopt);

  /// The client says no more: requests whose last message never came are refused. They are closed.
  std::deque<RequestPtr> half_close();

  /// The next request to give to the engine, marked running; null when none may start.
  RequestPtr start();
  /// An ended request.
  void close(const RequestPtr& request);
  /// All open requests, to cancel them.
  std::deque<RequestPtr> all() const;

  bool empty() const { return open_.empty(); }
  /// Whether the last message of some request has not come.
  bool waits_for_more() const { return open_.size() > complete_; }
  std::size_t size() const { return open_.size(); }
  /// False while too many bytes are buffered and some request that holds them will end by itself.
  bool may_read() const { return bytes_ < limits_.buffered_bytes || complete_ == 0; }

 private:
  RequestPtr open(std::uint64_t id);
  Effect cancel(std::uint64_t id);
  void append(Request& request, v1::DeformStreamRequest&& message, std::size_t bytes, HeldRequests::Held held);
  void refuse(Request& request, Error error);
  void release_bytes(Request& request);

  const StreamLimits limits_;
  const CallContext call_;
  const std::string client_, identity_, tenant_;
  std::unordered_map<std::uint64_t, RequestPtr> open_;
  std::deque<RequestPtr> waiting_;
  std::size_t running_ = 0;
  std::size_t complete_ = 0;  ///< waiting or running
  std::size_t bytes_ = 0;
};

}  // namespace deform::server
