// SPDX-License-Identifier: Apache-2.0
#include "client/spread_session.h"

#include <utility>
#include <vector>

namespace deform::client {

namespace {

RunContext with_stop(RunContext limits, const std::stop_source& stop) {
  limits.stop = stop.get_token();
  return limits;
}

/// Whether other servers, or another try, may give another answer. What is refused was tried again by its stream.
bool may_be_mended(const std::exception_ptr& error) {
  try {
    std::rethrow_exception(error);
  } catch (const Error& known) {
    return known.code() == ErrorCode::unavailable || known.code() == ErrorCode::not_found;
  } catch (...) {
    return false;
  }
}

}  // namespace

SpreadSession::Task::Task(Connection& connection, const v1::DeformRequest& given)
    : request(std::make_shared<const v1::DeformRequest>(connection.named(given))),
      route(connection, of_system(request->system_id()), Retry::safe) {}

SpreadSession::SpreadSession(std::shared_ptr<Connection> connection, const CallOptions& options)
    : connection_(std::move(connection)),
      limits_(with_stop(limits_of(options), stop_)),
      stopped_(options.stop, [this] { stop_.request_stop(); }) {
  mender_ = std::thread([this] { mend(); });
}

SpreadSession::~SpreadSession() {
  Streams streams;
  stop_.request_stop();
  {
    const std::lock_guard lock(mutex_);
    closing_ = ending_ = true;
    streams.swap(streams_);
  }
  changed_.notify_all();
  mender_.join();
  streams.clear();  // cancels; every answer has come then
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return open_ == 0; });
}

std::future<DeformOutcome> SpreadSession::submit(const v1::DeformRequest& request) {
  auto task = std::make_shared<Task>(*connection_, request);
  auto future = task->promise.get_future();
  {
    const auto most = static_cast<std::size_t>(connection_->options.max_in_flight);
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return open_ < most || closing_; });
    if (closing_) throw Error(ErrorCode::failed_precondition, "session: submit() after finish()");
    ++open_;
  }
  try {
    send(task);
  } catch (...) {
    end(task, {}, std::current_exception());
  }
  return future;
}

/// The stream to the server of the task, opened when there is none. Streams are made and destroyed without the lock: both wait.
std::shared_ptr<StreamSession> SpreadSession::stream_to(const Task& task) {
  Server& server = task.route.server();
  const std::string geometry = connection_->options.replicas ? task.route.geometry() : std::string();
  const auto usable = [&]() -> std::shared_ptr<StreamSession> {
    if (ending_) throw Error(ErrorCode::cancelled, "cancelled");
    const auto found = streams_.find({&server, geometry});
    return found == streams_.end() || found->second->broken() ? nullptr : found->second;
  };
  {
    const std::lock_guard lock(mutex_);
    if (auto stream = usable()) return stream;
  }
  auto made = std::make_shared<StreamSession>(connection_, server, remaining(limits_), task.route.geometry());
  std::shared_ptr<StreamSession> ended;
  const std::lock_guard lock(mutex_);
  if (auto stream = usable()) {
    ended = std::exchange(made, stream);
  } else {
    ended = std::exchange(streams_[{&server, geometry}], made);
  }
  return made;
}

void SpreadSession::send(const TaskPtr& task) {
  stream_to(*task)->submit(task->request, {}, {}, [this, task](DeformOutcome&& outcome, const std::exception_ptr& error) {
    answered(task, std::move(outcome), error);
  });
}

void SpreadSession::answered(const TaskPtr& task, DeformOutcome&& outcome, const std::exception_ptr& error) {
  if (error && may_be_mended(error)) {
    const std::lock_guard lock(mutex_);
    if (!ending_) {
      failures_.push_back({task, error});
      changed_.notify_all();
      return;
    }
  }
  end(task, std::move(outcome), error);
}

void SpreadSession::end(const TaskPtr& task, DeformOutcome&& outcome, const std::exception_ptr& error) {
  if (error) {
    task->promise.set_exception(error);
  } else {
    task->route.arrived();
    const std::chrono::duration<double, std::milli> wall = RunContext::Clock::now() - task->started;
    outcome.wall_ms = wall.count();
    task->promise.set_value(std::move(outcome));
  }
  // Under the lock to the end: the destructor waits for the last one and then everything is gone.
  const std::lock_guard lock(mutex_);
  --open_;
  changed_.notify_all();
}

void SpreadSession::mend() {
  while (true) {
    Failure failure;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return ending_ || !failures_.empty(); });
      if (failures_.empty()) return;
      failure = std::move(failures_.front());
      failures_.pop_front();
    }
    send_again(failure.task, failure.error);
  }
}

void SpreadSession::send_again(const TaskPtr& task, std::exception_ptr error) {
  while (true) {
    try {
      try {
        std::rethrow_exception(error);
      } catch (const Error& known) {
        task->route.failed(known, limits_, Repeat::yes);
      }
    } catch (...) {
      return end(task, {}, std::current_exception());
    }
    try {
      task->route.go(limits_);
      return send(task);
    } catch (...) {
      error = std::current_exception();
    }
  }
}

void SpreadSession::finish() {
  std::vector<std::shared_ptr<StreamSession>> streams;
  {
    std::unique_lock lock(mutex_);
    closing_ = true;
    changed_.notify_all();
    changed_.wait(lock, [this] { return open_ == 0; });
    for (const auto& entry : streams_) streams.push_back(entry.second);
  }
  // The streams have ended too, so that the servers have seen a clean end.
  for (const auto& stream : streams) stream->finish();
}

}  // namespace deform::client
