// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/streams/service_requests.h"

#include <algorithm>
#include <string>
#include <utility>

namespace deform::server {

namespace {

constexpr std::uint32_t full_retry_ms = 50;

/// Joins a motion of the next message to one that ended the previous message, when it goes on with the same handle.
void join_motions(v1::Design& design, v1::Design& more) {
  design.mutable_variables()->MergeFrom(more.variables());
  int first = 0;
  if (design.motions_size() > 0 && more.motions_size() > 0) {
    v1::Motion& last = *design.mutable_motions(design.motions_size() - 1);
    v1::Motion& next = *more.mutable_motions(0);
    const bool same = last.handle() == next.handle() && last.affine_size() == 0 && next.affine_size() == 0;
    if (same) {
      for (v1::Displacements& part : *next.mutable_displacements()) *last.add_displacements() = std::move(part);
      first = 1;
    }
  }
  for (int i = first; i < more.motions_size(); ++i) *design.add_motions() = std::move(*more.mutable_motions(i));
}

/// Appends designs in order, those that continue to the one before.
void join_designs(v1::DeformRequest& request, google::protobuf::RepeatedPtrField<v1::Design>& designs) {
  for (int i = 0; i < designs.size(); ++i) {
    v1::Design& design = *designs.Mutable(i);
    if (!design.continues()) {
      *request.add_designs() = std::move(design);
    } else if (request.designs_size() == 0) {
      throw Error(ErrorCode::invalid_argument,
                  "designs[" + std::to_string(i) + "].continues: there is no design before it in this request");
    } else {
      join_motions(*request.mutable_designs(request.designs_size() - 1), design);
    }
  }
}

}  // namespace

StreamRequests::RequestPtr StreamRequests::open(std::uint64_t id) {
  auto request = std::make_shared<Request>();
  request->id = id;
  request->call = call_;
  request->call.stop = request->stop.get_token();
  if (call_.open) request->call.open = call_.open->open_request(id, request->stop);
  request->opened = std::chrono::steady_clock::now();
  if (limits_.max_deadline.count() > 0) {
    const auto limit = request->opened + limits_.max_deadline;
    request->call.deadline = std::min(limit, request->call.deadline.value_or(limit));
  }
  request->record.method = "DeformStream";
  request->record.client = client_;
  request->record.identity = identity_;
  request->record.tenant = tenant_;
  request->record.request_id = id;
  if (open_.size() >= limits_.open_requests) {
    refuse(*request, Error(ErrorCode::out_of_budget,
                           "request " + std::to_string(id) + ": " + std::to_string(open_.size()) +
                               " requests are open on this stream, the limit is " + std::to_string(limits_.open_requests),
                           full_retry_ms)
                         .refused_for(Refusal::queue));
  }
  // Broken requests are remembered until their last message; an honest client has few.
  if (open_.size() >= 2 * limits_.open_requests) {
    throw Error(ErrorCode::out_of_budget, "too many refused requests are still being sent on this stream")
        .refused_for(Refusal::queue);
  }
  open_.emplace(id, request);
  return request;
}

StreamRequests::Effect StreamRequests::accept(v1::DeformStreamRequest&& message, std::size_t bytes, HeldRequests::Held held,
                                              std::optional<Error> refusal) {
  const std::uint64_t id = message.request_id();
  if (message.cancel()) return cancel(id);
  Effect effect;
  const auto found = open_.find(id);
  const RequestPtr request = found != open_.end() ? found->second : open(id);
  request->record.messages_in += 1;
  request->record.bytes_in += bytes;
  if (request->state == State::waiting || request->state == State::running) {
    // Two answers with one id could not be distinguished, so both end, with one error.
    effect.cancelled = request->job;
    request->stop.request_stop();
    refuse(*request, Error(ErrorCode::invalid_argument,
                           "request_id " + std::to_string(id) + ": already used by an open request, which is cancelled by this"));
  } else if (request->state == State::assembling && refusal) {
    refuse(*request, std::move(*refusal));
  } else if (request->state == State::assembling) {
    append(*request, std::move(message), std::max(bytes, held.bytes()), std::move(held));
  }
  if (message.more()) return effect;
  if (request->state == State::refused) {
    close(request);
    effect.answered = request;
  } else {
    request->state = State::waiting;
    ++complete_;
    waiting_.push_back(request);
  }
  return effect;
}

void StreamRequests::append(Request& request, v1::DeformStreamRequest&& message, std::size_t bytes, HeldRequests::Held held) {
  try {
    if (bytes_ + bytes > limits_.buffered_bytes && complete_ == 0) {
      // Nothing that holds bytes would end by itself: pausing would wait for ever.
      throw Error(ErrorCode::out_of_budget, "request " + std::to_string(request.id) +
                                                ": the requests being sent on this stream " + "take more than " +
                                                std::to_string(limits_.buffered_bytes) + " bytes")
          .refused_for(Refusal::held);
    }
    bytes_ += bytes;
    request.bytes += bytes;
    request.held.push_back(std::move(held));
    if (request.call.open) request.call.open->set_request_bytes(request.bytes);
    v1::DeformRequest& part = *message.mutable_request();
    if (request.record.messages_in == 1) {
      google::protobuf::RepeatedPtrField<v1::Design> designs;
      designs.Swap(part.mutable_designs());
      request.message = std::move(part);
      request.record.system = request.message.system_id();
      if (request.call.open) request.call.open->set_subject("", request.record.system);
      join_designs(request.message, designs);
    } else {
      join_designs(request.message, *part.mutable_designs());
    }
  } catch (const Error& error) {
    refuse(request, error);
  }
}

void StreamRequests::refuse(Request& request, Error error) {
  if (request.state == State::waiting || request.state == State::running) --complete_;
  if (request.state == State::running) --running_;
  if (request.state == State::waiting) std::erase_if(waiting_, [&](const RequestPtr& other) { return other.get() == &request; });
  request.state = State::refused;
  request.refusal = std::move(error);
  release_bytes(request);
  request.message.Clear();
  request.job = nullptr;
}

StreamRequests::Effect StreamRequests::cancel(std::uint64_t id) {
  Effect effect;
  const auto found = open_.find(id);
  if (found == open_.end()) return effect;  // ended while the message was under way
  const RequestPtr request = found->second;
  request->record.messages_in += 1;
  request->stop.request_stop();
  effect.cancelled = request->job;
  const bool bad = request->state == State::refused;
  if (!bad) refuse(*request, Error(ErrorCode::cancelled, "request " + std::to_string(id) + " was cancelled"));
  close(request);
  effect.answered = request;
  return effect;
}

std::deque<StreamRequests::RequestPtr> StreamRequests::half_close() {
  std::deque<RequestPtr> unfinished;
  for (const auto& [id, request] : open_) {
    if (request->state == State::assembling) {
      refuse(*request, Error(ErrorCode::invalid_argument,
                             "request " + std::to_string(id) + ": the stream was closed before its last message"));
    }
    if (request->state == State::refused) unfinished.push_back(request);
  }
  for (const RequestPtr& request : unfinished) close(request);
  return unfinished;
}

StreamRequests::RequestPtr StreamRequests::start() {
  if (waiting_.empty() || running_ >= limits_.running_requests) return nullptr;
  RequestPtr request = std::move(waiting_.front());
  waiting_.pop_front();
  request->state = State::running;
  ++running_;
  return request;
}

void StreamRequests::close(const RequestPtr& request) {
  if (request->state == State::running) --running_;
  if (request->state == State::waiting || request->state == State::running) --complete_;
  if (request->state == State::waiting) std::erase(waiting_, request);
  release_bytes(*request);
  open_.erase(request->id);
}

void StreamRequests::release_bytes(Request& request) {
  bytes_ -= request.bytes;
  request.bytes = 0;
  request.held.clear();
}

std::deque<StreamRequests::RequestPtr> StreamRequests::all() const {
  std::deque<RequestPtr> out;
  for (const auto& [id, request] : open_) out.push_back(request);
  return out;
}

}  // namespace deform::server
