// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/overdue_calls.h"

namespace deform::server {

OverdueCalls::~OverdueCalls() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void OverdueCalls::watch(grpc::CallbackServerContext* context, Clock::time_point limit) {
  {
    const std::lock_guard lock(mutex_);
    if (!thread_.joinable()) thread_ = std::thread([this] { run(); });
    calls_.emplace(limit, context);
  }
  changed_.notify_all();
}

void OverdueCalls::forget(grpc::CallbackServerContext* context, Clock::time_point limit) {
  std::unique_lock lock(mutex_);
  calls_.erase({limit, context});
  // The cancellation may itself end the call, on our thread.
  if (std::this_thread::get_id() == thread_.get_id()) return;
  changed_.wait(lock, [&] { return cancelling_ != context; });
}

void OverdueCalls::run() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    if (calls_.empty()) {
      changed_.wait(lock);
      continue;
    }
    const auto [limit, context] = *calls_.begin();
    if (Clock::now() < limit) {
      changed_.wait_until(lock, limit);
      continue;
    }
    calls_.erase(calls_.begin());
    cancelling_ = context;
    lock.unlock();
    context->TryCancel();
    lock.lock();
    cancelling_ = nullptr;
    changed_.notify_all();
  }
}

}  // namespace deform::server
