// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>

#include "core/base/error.h"
#include "server/engine/engine.h"

namespace deform::server {

/// Asynchronous work of one client request, from its acceptance to its end. Held by shared_ptr.
class Call : public std::enable_shared_from_this<Call> {
 public:
  explicit Call(CallContext context) : context_(std::move(context)) {}
  virtual ~Call() = default;
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;

  /// Ends the call with this error unless it has ended. Any thread; quick.
  virtual void fail(const Error& error) = 0;

  const CallContext& context() const { return context_; }
  /// The error of a cancelled or overdue call.
  virtual std::optional<Error> overdue(RunContext::Clock::time_point now) const;
  /// With the call's deadline and a stop token of its own: the caller's may serve many calls, and the registry watches it.
  RunContext run_context(int threads) const;

 protected:
  /// Tells what is computing to stop.
  void stop() { stop_.request_stop(); }
  /// Why the call ends: what is computing may find out that it shall stop before the call has noted why.
  Error reason(const Error& error) const {
    const auto ended = context_.open ? context_.open->ended() : std::nullopt;
    return ended.value_or(error);
  }
  /// For the operator.
  void enter(v1::CallState state) const {
    if (context_.open) context_.open->enter(state);
  }

 private:
  const CallContext context_;
  std::stop_source stop_;
};

/// The calls under way. A thread of its own ends those that are cancelled or overdue, also while they wait in a queue or for
/// their reader, within about ten milliseconds. Thread-safe.
class CallRegistry {
 public:
  CallRegistry();
  ~CallRegistry();

  /// Throws Error(unavailable) after close(), Error(out_of_budget) with a retry hint beyond the quota of the call's tenant.
  void add(const std::shared_ptr<Call>& call);
  void remove(const Call* call);

  /// Nothing is added any more.
  void close();
  bool closed() const;
  /// True when no call is left before the time is over.
  bool wait_until_empty(RunContext::Clock::time_point limit);
  void fail_all(const Error& error);

 private:
  void watch();

  mutable std::mutex mutex_;
  // guarded by mutex_
  std::condition_variable changed_;
  std::map<const Call*, std::shared_ptr<Call>> calls_;
  std::map<std::string, std::size_t> of_tenants_;  // calls, of those who have any
  bool closed_ = false;
  bool stopping_ = false;
  // set by the constructor
  std::thread watcher_;
};

/// Stop token and deadline of a call, for work on the thread of its caller.
RunContext context_of(const CallContext& call);

/// Milliseconds between two times.
double elapsed_ms(RunContext::Clock::time_point from, RunContext::Clock::time_point to = RunContext::Clock::now());
/// Processor time of this thread, milliseconds.
double thread_cpu_ms();

}  // namespace deform::server
