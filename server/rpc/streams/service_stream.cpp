// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/streams/service_stream.h"

#include <string>
#include <utility>

#include "proto/convert/base/error.h"
#include "server/engine/warm_starts.h"
#include "server/rpc/service_calls.h"
#include "server/rpc/service_messages.h"
#include "server/rpc/status.h"

namespace deform::server {

namespace {

/// Refusals that a slow reader may leave unread before the stream stops reading.
constexpr std::size_t max_waiting_refusals = 1024;

v1::DeformReply error_reply(std::uint64_t id, const Error& error) {
  v1::DeformReply reply;
  reply.set_request_id(id);
  *reply.mutable_error() = convert::error_to_proto(error);
  return reply;
}

CallContext with_warm_starts(CallContext call) {
  call.warm_starts = std::make_shared<WarmStarts>();
  return call;
}

/// The log line of one request.
void log_request(StreamRequests::Request& request, const std::optional<Error>& error, Metrics& metrics) {
  request.record.error = error;
  request.record.wall_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - request.opened).count();
  metrics.request_ends(request.record);
  log_call(request.record);
}

}  // namespace

DeformStreamCall::DeformStreamCall(Engine& engine, const StreamLimits& limits, const Incoming& incoming,
                                   std::function<void(DeformStreamCall*)> on_done)
    : ReplyWriter("DeformStream", incoming),
      engine_(engine),
      on_done_(std::move(on_done)),
      requests_(limits, with_warm_starts(scope_.call()), scope_.record) {}

void DeformStreamCall::begin() { StartRead(&message_); }

void DeformStreamCall::drain() {
  {
    const std::lock_guard lock(mutex_);
    draining_ = true;
  }
  wake();
}

// ---- reading ----

void DeformStreamCall::OnReadDone(bool ok) {
  scope_.came(OpenCall::Client::sends);
  {
    const std::lock_guard lock(mutex_);
    reading_ = ok ? Reading::handling : Reading::closed;
    if (!ok) {
      const auto unfinished = requests_.half_close();
      refused_.insert(refused_.end(), unfinished.begin(), unfinished.end());
    }
  }
  if (ok) {
    auto error = caught([this] { take(message_); });
    message_.Clear();  // the next one may never come, and this one is charged no longer
    if (error) {
      const std::lock_guard lock(mutex_);
      failure_ = std::move(error);
      reading_ = Reading::closed;
    } else {
      const std::lock_guard lock(mutex_);
      reading_ = Reading::paused;
    }
    start_requests();
    read_on();
  }
  wake();
}

void DeformStreamCall::take(const grpc::ByteBuffer& bytes) {
  scope_.check_access();  // the caller may have been struck out since the stream was opened
  v1::DeformStreamRequest message;
  HeldRequests::Held held;
  std::optional<Error> refusal = caught([&] {
    scope_.check_draining();
    held = scope_.hold(bytes);
  });
  if (refusal) {
    message = without_request(bytes);
  } else {
    parse(bytes, message);
  }
  StreamRequests::Effect effect;
  {
    const std::lock_guard lock(mutex_);
    effect = requests_.accept(std::move(message), bytes.Length(), std::move(held), std::move(refusal));
    if (effect.answered) refused_.push_back(effect.answered);
  }
  if (effect.cancelled) effect.cancelled->cancel();
}

void DeformStreamCall::read_on() {
  {
    const std::lock_guard lock(mutex_);
    const bool room = requests_.may_read() && refused_.size() < max_waiting_refusals;
    if (reading_ != Reading::paused || !room) return;
    reading_ = Reading::under_way;
    // Between requests the stream may rest as long as it likes.
    if (requests_.waits_for_more()) scope_.await(OpenCall::Client::sends);
  }
  StartRead(&message_);
}

// ---- requests ----

void DeformStreamCall::start_requests() {
  for (;;) {
    RequestPtr request;
    {
      const std::lock_guard lock(mutex_);
      request = requests_.start();
    }
    if (!request) return;
    start_request(request);
  }
}

void DeformStreamCall::start_request(const RequestPtr& request) {
  std::shared_ptr<DeformJob> job;
  auto error = caught([&] {
    scope_.check();
    scope_.check_access();  // it may have waited for long
    scope_.check_rate();
    scope_.check_memory();
    request->call.quota = scope_.quota();  // as it is now: streams stay open for long
    job = engine_.deform(std::move(request->message), request->id, request->call,
                         [weak = weak_self(), waiting = std::weak_ptr(request)] {
                           const auto self = weak.lock();
                           const auto ready = waiting.lock();
                           if (!self || !ready) return;
                           self->queue_turn(ready);
                           self->wake();
                         });
  });
  bool wanted = false;
  {
    const std::lock_guard lock(mutex_);
    wanted = request->state == StreamRequests::State::running;  // not cancelled meanwhile
    if (wanted && error) {
      requests_.close(request);
      request->refusal = std::move(error);
      refused_.push_back(request);
    } else if (wanted) {
      request->job = job;
    }
  }
  if (!wanted && job) job->cancel();
  if (wanted && job) {
    if (scope_.call().stop.stop_requested()) job->cancel();  // stop() may have come before the job was there
    queue_turn(request);
  }
}

void DeformStreamCall::queue_turn(const RequestPtr& request) {
  const std::lock_guard lock(mutex_);
  // Without its job yet, the starter queues it.
  if (!request->job || request->in_turn) return;
  request->in_turn = true;
  turns_.push_back(request);
}

// ---- writing ----

DeformStreamCall::Next DeformStreamCall::next(grpc::ByteBuffer& reply) {
  for (;;) {
    RequestPtr refused;
    RequestPtr ready;
    {
      const std::lock_guard lock(mutex_);
      if (failure_) throw *failure_;
      if (!refused_.empty()) {
        refused = std::move(refused_.front());
        refused_.pop_front();
      } else if (!turns_.empty()) {
        ready = std::move(turns_.front());
        turns_.pop_front();
        ready->in_turn = false;
      } else if (!requests_.empty()) {
        return Next::wait;
      } else if (reading_ == Reading::closed) {
        return Next::end;
      } else if (draining_) {
        throw Error(ErrorCode::unavailable, "the server is shutting down").refused_for(Refusal::draining);
      } else {
        return Next::wait;
      }
    }
    std::optional<v1::DeformReply> message;
    if (refused) {
      log_request(*refused, refused->refusal, scope_.metrics());
      message = error_reply(refused->id, *refused->refusal);
      read_on();
    } else {
      message = turn(ready);
    }
    if (!message) continue;
    const bool summed_up = message->has_summary();
    reply = serialized(std::move(*message));
    if (ready) {
      ready->record.messages_out += 1;
      ready->record.bytes_out += reply.Length();
      if (summed_up) log_request(*ready, std::nullopt, scope_.metrics());
    }
    return Next::write;
  }
}

std::optional<v1::DeformReply> DeformStreamCall::turn(const RequestPtr& request) {
  std::shared_ptr<DeformJob> job;
  {
    const std::lock_guard lock(mutex_);
    job = request->job;
  }
  if (!job) return std::nullopt;  // refused meanwhile
  v1::DeformReply message;
  switch (job->poll(message)) {
    case DeformJob::Poll::pending:
      return std::nullopt;
    case DeformJob::Poll::done:
      return finished(request, *job);
    case DeformJob::Poll::reply:
      break;
  }
  // A request ends with its summary. Closed before that is written: who reads it may use the id again, and a cancel that crosses
  // it finds no such request.
  if (message.has_summary()) return end_request(request, *job) ? std::optional(std::move(message)) : std::nullopt;
  queue_turn(request);
  {
    const std::lock_guard lock(mutex_);
    if (request->state != StreamRequests::State::running) return std::nullopt;  // its error is the last word
  }
  return message;
}

std::optional<v1::DeformReply> DeformStreamCall::finished(const RequestPtr& request, const DeformJob& job) {
  if (!end_request(request, job)) return std::nullopt;
  const std::optional<Error> error = job.error();
  log_request(*request, error, scope_.metrics());
  if (error) return error_reply(request->id, *error);
  return std::nullopt;
}

bool DeformStreamCall::end_request(const RequestPtr& request, const DeformJob& job) {
  {
    const std::lock_guard lock(mutex_);
    if (request->state != StreamRequests::State::running) return false;
    requests_.close(request);
    request->job = nullptr;
  }
  note_stats(job.stats(), request->record);
  scope_.record.designs += request->record.designs;
  start_requests();
  read_on();
  return true;
}

void DeformStreamCall::stop() noexcept {
  caught([this] {
    std::deque<std::pair<std::stop_source, std::shared_ptr<DeformJob>>> open;
    {
      const std::lock_guard lock(mutex_);
      for (const RequestPtr& request : requests_.all()) open.emplace_back(request->stop, request->job);
    }
    for (auto& [source, job] : open) {
      source.request_stop();
      if (job) job->cancel();
    }
  });
}

void DeformStreamCall::done() noexcept {
  stop();  // a request that came in while the stream ended
  on_done_(this);
}

}  // namespace deform::server
