// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/streams/evaluate_stream.h"

#include <utility>

#include "server/rpc/service_messages.h"
#include "server/rpc/status.h"

namespace deform::server {

EvaluateStreamCall::EvaluateStreamCall(Engine& engine, const Incoming& incoming)
    : ReplyWriter("Evaluate", incoming), engine_(engine) {}

void EvaluateStreamCall::begin() { read(); }

void EvaluateStreamCall::read() {
  scope_.await(OpenCall::Client::sends);
  StartRead(&message_);
}

std::shared_ptr<EvaluateJob> EvaluateStreamCall::job() {
  const std::lock_guard lock(mutex_);
  return job_;
}

// ---- reading ----

void EvaluateStreamCall::OnReadDone(bool ok) {
  scope_.came(OpenCall::Client::sends);
  auto error = caught([&] { ok ? take(message_) : half_closed(); });
  message_.Clear();  // the next one may never come, and this one is charged no longer
  {
    const std::lock_guard lock(mutex_);
    reading_ = ok && !error ? Reading::paused : Reading::closed;
    if (error && !failure_) failure_ = std::move(error);
  }
  read_on();
  wake();
}

void EvaluateStreamCall::take(const grpc::ByteBuffer& bytes) {
  scope_.check_access();  // the caller may have been struck out since the stream was opened
  const auto held = scope_.hold(bytes);
  v1::EvaluateRequest message;
  parse(bytes, message);
  std::shared_ptr<EvaluateJob> job;
  {
    const std::lock_guard lock(mutex_);
    ++messages_in_;
    bytes_in_ += bytes.Length();
    job = job_;
    if (message.has_header()) system_ = message.header().system_id();
  }
  if ((job != nullptr) == message.has_header()) {
    throw Error(ErrorCode::invalid_argument,
                job ? "Evaluate: a second header" : "the first message of Evaluate must be its header");
  }
  if (job && !message.has_points()) throw Error(ErrorCode::invalid_argument, "Evaluate: a message without points");
  if (job) return job->add(std::move(*message.mutable_points()));
  scope_.check();
  auto begun = engine_.evaluate(std::move(*message.mutable_header()), scope_.call(), [weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->wake();
  });
  {
    const std::lock_guard lock(mutex_);
    job_ = begun;
  }
  if (scope_.call().stop.stop_requested()) begun->cancel();  // stop() may have come before the job was there
}

void EvaluateStreamCall::half_closed() {
  const auto job = this->job();
  if (!job) throw Error(ErrorCode::invalid_argument, "the stream ended before the header of Evaluate");
  job->finish();
}

void EvaluateStreamCall::read_on() {
  {
    const std::lock_guard lock(mutex_);
    if (reading_ != Reading::paused || !job_ || !job_->has_room()) return;
    reading_ = Reading::under_way;
  }
  read();
}

// ---- writing ----

EvaluateStreamCall::Next EvaluateStreamCall::next(grpc::ByteBuffer& reply) {
  std::shared_ptr<EvaluateJob> job;
  {
    const std::lock_guard lock(mutex_);
    if (failure_) throw *failure_;
    job = job_;
  }
  if (!job) return Next::wait;
  v1::EvaluateReply message;
  switch (job->poll(message)) {
    case DeformJob::Poll::pending:
      return Next::wait;
    case DeformJob::Poll::done:
      if (const auto error = job->error()) throw *error;
      return Next::end;
    case DeformJob::Poll::reply:
      break;
  }
  read_on();  // there is room again
  reply = serialized(message);
  return Next::write;
}

void EvaluateStreamCall::stop() noexcept {
  caught([this] {
    if (const auto job = this->job()) job->cancel();
  });
}

void EvaluateStreamCall::done() noexcept {
  caught([this] {
    const auto job = this->job();
    if (job) note_stats(job->stats(), scope_.record);
    const std::lock_guard lock(mutex_);
    scope_.record.messages_in = messages_in_;
    scope_.record.bytes_in = bytes_in_;
    if (scope_.record.system.empty()) scope_.record.system = system_;
  });
}

}  // namespace deform::server
