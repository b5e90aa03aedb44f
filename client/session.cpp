// SPDX-License-Identifier: Apache-2.0
#include "client/session.h"

#include <algorithm>
#include <utility>

#include "client/call_error.h"
#include "client/request_splitter.h"
#include "client/spread_session.h"
#include "proto/convert/base/error.h"

namespace deform::client {

StreamSession::StreamSession(std::shared_ptr<Connection> connection, Server& server, const CallOptions& options,
                             const std::string& geometry)
    : connection_(std::move(connection)),
      limits_(limits_of(options)),
      attempt_(*connection_, limits_, server, {geometry, connection_->new_request_id()}),
      stream_(attempt_.stub().DeformStream(&attempt_.context)) {
  reader_ = std::thread([this] { read(); });
  writer_ = std::thread([this] { write(); });
}

StreamSession::~StreamSession() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
    if (!broken_) attempt_.cancel();
  }
  changed_.notify_all();
  reader_.join();
  writer_.join();
  // Decoders may still be at work on what had arrived.
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return open_.empty(); });
}

std::future<DeformOutcome> StreamSession::submit(const v1::DeformRequest& request, DesignSink sink, DesignMemory memory) {
  auto promise = std::make_shared<std::promise<DeformOutcome>>();
  auto future = promise->get_future();
  submit(std::make_shared<const v1::DeformRequest>(connection_->named(request)), std::move(sink), std::move(memory),
         [promise](DeformOutcome&& outcome, const std::exception_ptr& error) {
           error ? promise->set_exception(error) : promise->set_value(std::move(outcome));
         });
  return future;
}

void StreamSession::submit(std::shared_ptr<const v1::DeformRequest> request, DesignSink sink, DesignMemory memory,
                           Answer answer) {
  auto open = std::make_shared<Open>();
  open->request = std::move(request);
  open->sink = std::move(sink);
  open->memory = std::move(memory);
  open->answer = std::move(answer);
  const auto most = static_cast<std::size_t>(connection_->options.max_in_flight);
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return open_.size() < most || broken_ || closing_; });
  if (closing_) throw Error(ErrorCode::failed_precondition, "session: submit() after finish()");
  if (const std::exception_ptr error = broken_) {
    lock.unlock();
    return open->answer({}, error);
  }
  open->id = ++last_id_;
  open->retry = std::make_unique<RetryPolicy>(RetryPolicy::Options{connection_->options.max_attempts,
                                                                   connection_->options.retry_seed + open->id,
                                                                   Retry::when_refused, connection_->patience()});
  make_decoder(open);
  open_.emplace(open->id, open);
  commands_.push_back({open, 0, RunContext::Clock::now()});
  lock.unlock();
  changed_.notify_all();
}

bool StreamSession::broken() const {
  const std::lock_guard lock(mutex_);
  return broken_ != nullptr;
}

void StreamSession::make_decoder(const OpenPtr& open) {
  ReplyDecoder::Options options;
  options.designs = static_cast<std::size_t>(open->request->designs_size());
  options.encoding = open->request->output().encoding();
  options.failures = open->request->failures();
  options.sink = open->sink;
  options.memory = open->memory;
  options.points_of = [this](const std::string& id) { return connection_->registered_points(id, limits_); };
  const std::uint64_t id = open->id;
  options.on_failed = [this, id] { enqueue({nullptr, id, RunContext::Clock::now()}); };
  options.on_done = [this, weak = std::weak_ptr<Open>(open)](DeformOutcome&& outcome, const std::exception_ptr& error) {
    if (const OpenPtr done = weak.lock()) answered(done, std::move(outcome), error);
  };
  open->decoder = std::make_shared<ReplyDecoder>(std::move(options), connection_->pool);
}

void StreamSession::answered(const OpenPtr& open, DeformOutcome&& outcome, const std::exception_ptr& error) {
  const std::chrono::duration<double, std::milli> wall = RunContext::Clock::now() - open->started;
  outcome.wall_ms = wall.count();
  open->answer(std::move(outcome), error);
  // Under the lock to the end: the destructor waits for an empty map and then everything is gone.
  const std::lock_guard lock(mutex_);
  open_.erase(open->id);
  changed_.notify_all();
}

void StreamSession::read() {
  v1::DeformReply reply;
  while (stream_->Read(&reply)) route(std::move(reply));
  const grpc::Status status = stream_->Finish();
  std::exception_ptr error;
  try {
    attempt_.check(status);
    throw Error(ErrorCode::unavailable, "session: the server ended the stream");
  } catch (...) {
    error = std::current_exception();
  }
  fail_all(error);
}

void StreamSession::fail_all(const std::exception_ptr& error) {
  std::vector<OpenPtr> open;
  {
    const std::lock_guard lock(mutex_);
    broken_ = error;
    commands_.clear();
    for (const auto& entry : open_) open.push_back(entry.second);
  }
  changed_.notify_all();
  for (const auto& one : open) one->decoder->fail(error);
}

void StreamSession::route(v1::DeformReply&& reply) {
  OpenPtr open;
  {
    const std::lock_guard lock(mutex_);
    const auto found = open_.find(reply.request_id());
    if (found == open_.end()) return;  // failed on this side; what was under way still arrives
    open = found->second;
  }
  if (reply.part_case() == v1::DeformReply::kError) return refused(open, reply.error());
  try {
    open->decoder->add(std::move(reply));
  } catch (...) {
    enqueue({nullptr, open->id, RunContext::Clock::now()});
    open->decoder->fail(std::current_exception());
  }
}

void StreamSession::refused(const OpenPtr& open, const v1::RequestError& message) {
  const CallError error(convert::error_from_proto(message), attempt_.request_id());
  const auto wait = open->retry->next_wait(error);
  const auto then = RunContext::Clock::now() + wait.value_or(std::chrono::milliseconds(0));
  const bool too_late = limits_.deadline && then >= *limits_.deadline;
  if (!wait || too_late || open->decoder->started()) {
    open->decoder->fail(std::make_exception_ptr(error));
    return;
  }
  enqueue({open, 0, then});
}

void StreamSession::enqueue(Command command) {
  {
    const std::lock_guard lock(mutex_);
    if (broken_) return;
    commands_.push_back(std::move(command));
  }
  changed_.notify_all();
}

/// The first command that is due, in order; false when the session is over.
bool StreamSession::next_command(Command& command) {
  std::unique_lock lock(mutex_);
  while (true) {
    if (broken_ || (closing_ && open_.empty())) return false;
    const auto now = RunContext::Clock::now();
    auto earliest = RunContext::Clock::time_point::max();
    for (auto it = commands_.begin(); it != commands_.end(); ++it) {
      if (it->not_before <= now) {
        command = std::move(*it);
        commands_.erase(it);
        return true;
      }
      earliest = std::min(earliest, it->not_before);
    }
    if (commands_.empty()) {
      changed_.wait(lock);
    } else {
      changed_.wait_until(lock, earliest);
    }
  }
}

void StreamSession::write() {
  Command command;
  while (next_command(command)) {
    if (command.send) {
      if (!send(command.send)) return;
    } else {
      v1::DeformStreamRequest message;
      message.set_request_id(command.cancel_id);
      message.set_cancel(true);
      if (!stream_->Write(message)) return;
    }
    command.send.reset();
  }
  stream_->WritesDone();
}

bool StreamSession::send(const OpenPtr& open) {
  RequestSplitter splitter(*open->request, open->id);
  v1::DeformStreamRequest message;
  try {
    while (splitter.next(message)) {
      if (!stream_->Write(message)) return false;
    }
  } catch (...) {
    enqueue({nullptr, open->id, RunContext::Clock::now()});
    open->decoder->fail(std::current_exception());
  }
  return true;
}

void StreamSession::finish() {
  std::unique_lock lock(mutex_);
  closing_ = true;
  changed_.notify_all();
  // The stream has ended too, so that the server has seen a clean end.
  changed_.wait(lock, [this] { return open_.empty() && broken_; });
}

std::unique_ptr<RequestSession> open_requests(std::shared_ptr<Connection> connection, const CallOptions& options) {
  if (connection->keeps_copies()) return std::make_unique<SpreadSession>(std::move(connection), options);
  Server& server = *connection->servers.all().front();
  return std::make_unique<StreamSession>(std::move(connection), server, options);
}

Session::Session(std::unique_ptr<RequestSession> requests) : requests_(std::move(requests)) {}
Session::~Session() = default;

std::future<DeformOutcome> Session::submit(const v1::DeformRequest& request) { return requests_->submit(request); }

void Session::finish() { requests_->finish(); }

}  // namespace deform::client
