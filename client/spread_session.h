// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>

#include "client/session.h"

namespace deform::client {

/// A session over several servers: a StreamSession to each one that requests go to, with `replicas` for each geometry. What is
/// lost with a server, or unknown to one, is sent again along the Route of its request, by one thread; what goes to healthy
/// servers does not wait for it.
///
///   submit -> Route -> StreamSession of its server -> outcome -> promise
///               ^---- (mender) <- lost or unknown ----'
class SpreadSession final : public RequestSession {
 public:
  /// Opens nothing yet.
  SpreadSession(std::shared_ptr<Connection> connection, const CallOptions& options);
  /// Cancels what is open and waits for its end.
  ~SpreadSession() override;

  std::future<DeformOutcome> submit(const v1::DeformRequest& request) override;
  void finish() override;

 private:
  struct Task {
    Task(Connection& connection, const v1::DeformRequest& given);

    const std::shared_ptr<const v1::DeformRequest> request;
    Route route;
    std::promise<DeformOutcome> promise;
    const RunContext::Clock::time_point started = RunContext::Clock::now();
  };
  using TaskPtr = std::shared_ptr<Task>;
  struct Failure {
    TaskPtr task;
    std::exception_ptr error;
  };

  std::shared_ptr<StreamSession> stream_to(const Task& task);
  void send(const TaskPtr& task);
  void answered(const TaskPtr& task, DeformOutcome&& outcome, const std::exception_ptr& error);
  void end(const TaskPtr& task, DeformOutcome&& outcome, const std::exception_ptr& error);
  void mend();
  void send_again(const TaskPtr& task, std::exception_ptr error);

  const std::shared_ptr<Connection> connection_;
  std::stop_source stop_;
  const RunContext limits_;                                  ///< its stop is that of stop_
  const std::stop_callback<std::function<void()>> stopped_;  ///< by the caller

  std::mutex mutex_;
  std::condition_variable changed_;
  // under mutex_
  using Streams = std::map<std::pair<Server*, std::string>, std::shared_ptr<StreamSession>>;
  Streams streams_;  ///< by server and, with `replicas`, geometry: a proxy chooses by it
  std::deque<Failure> failures_;
  std::size_t open_ = 0;
  bool closing_ = false;  ///< finish() was called
  bool ending_ = false;   ///< the destructor was

  std::thread mender_;
};

}  // namespace deform::client
