// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/call.h"

#include <time.h>

#include <string>
#include <vector>

namespace deform::server {

namespace {

constexpr std::uint32_t retry_quota_ms = 200;

}  // namespace

std::optional<Error> Call::overdue(RunContext::Clock::time_point now) const {
  if (context_.stop.stop_requested()) {
    const auto ended = context_.open ? context_.open->ended() : std::nullopt;
    return ended.value_or(Error(ErrorCode::cancelled, "cancelled by the caller"));
  }
  if (context_.deadline && now >= *context_.deadline) return Error(ErrorCode::deadline_exceeded, "deadline exceeded");
  return std::nullopt;
}

RunContext Call::run_context(int threads) const {
  RunContext context;
  context.stop = stop_.get_token();
  context.deadline = context_.deadline;
  context.threads = threads;
  return context;
}

CallRegistry::CallRegistry() {
  watcher_ = std::thread([this] { watch(); });
}

CallRegistry::~CallRegistry() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    changed_.notify_all();
  }
  watcher_.join();
}

void CallRegistry::add(const std::shared_ptr<Call>& call) {
  const std::lock_guard lock(mutex_);
  if (closed_) throw Error(ErrorCode::unavailable, "the server is shutting down").refused_for(Refusal::draining);
  const std::string& tenant = call->context().tenant;
  const std::uint64_t limit = call->context().quota.calls;
  const auto own = of_tenants_.find(tenant);
  if (limit != 0 && own != of_tenants_.end() && own->second >= limit) {
    throw Error(ErrorCode::out_of_budget,
                "quota calls of tenant \"" + tenant + "\": " + std::to_string(own->second) + " wait or run, the limit is " +
                    std::to_string(limit) + "; try again later",
                retry_quota_ms)
        .refused_for(Refusal::quota);
  }
  calls_.emplace(call.get(), call);
  ++of_tenants_[tenant];
  if (calls_.size() == 1) changed_.notify_all();
}

void CallRegistry::remove(const Call* call) {
  std::shared_ptr<Call> gone;  // destroyed after the lock
  const std::lock_guard lock(mutex_);
  const auto found = calls_.find(call);
  if (found == calls_.end()) return;
  gone = std::move(found->second);
  const auto own = of_tenants_.find(gone->context().tenant);
  if (--own->second == 0) of_tenants_.erase(own);
  calls_.erase(found);
  if (calls_.empty()) changed_.notify_all();
}

void CallRegistry::close() {
  const std::lock_guard lock(mutex_);
  closed_ = true;
}

bool CallRegistry::closed() const {
  const std::lock_guard lock(mutex_);
  return closed_;
}

bool CallRegistry::wait_until_empty(RunContext::Clock::time_point limit) {
  std::unique_lock lock(mutex_);
  return changed_.wait_until(lock, limit, [&] { return calls_.empty(); });
}

void CallRegistry::fail_all(const Error& error) {
  std::vector<std::shared_ptr<Call>> calls;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [key, call] : calls_) calls.push_back(call);
  }
  for (const auto& call : calls) call->fail(error);
}

void CallRegistry::watch() {
  constexpr auto period = std::chrono::milliseconds(10);
  std::vector<std::pair<std::shared_ptr<Call>, Error>> ended;
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    if (calls_.empty()) {
      changed_.wait(lock);
      continue;
    }
    changed_.wait_for(lock, period, [&] { return stopping_; });
    const auto now = RunContext::Clock::now();
    for (const auto& [key, call] : calls_) {
      if (const auto error = call->overdue(now)) ended.emplace_back(call, *error);
    }
    if (ended.empty()) continue;
    lock.unlock();
    for (const auto& [call, error] : ended) call->fail(error);
    ended.clear();
    lock.lock();
  }
}

RunContext context_of(const CallContext& call) {
  RunContext context;
  context.stop = call.stop;
  context.deadline = call.deadline;
  return context;
}

double elapsed_ms(RunContext::Clock::time_point from, RunContext::Clock::time_point to) {
  return std::chrono::duration<double, std::milli>(to - from).count();
}

double thread_cpu_ms() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
}

}  // namespace deform::server
