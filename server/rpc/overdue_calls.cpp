// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/overdue_calls.h"

#include <grpc/grpc.h>

#include "server/rpc/status.h"

namespace deform::server {

OverdueCalls::~OverdueCalls() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void OverdueCalls::watch(grpc::CallbackServerContext* context, Clock::time_point limit, Error why) {
  {
    const std::lock_guard lock(mutex_);
    if (!thread_.joinable()) thread_ = std::thread([this] { run(); });
    calls_.emplace(Entry{limit, context}, std::move(why));
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
    const auto [limit, context] = calls_.begin()->first;
    if (Clock::now() < limit) {
      changed_.wait_until(lock, limit);
      continue;
    }
    const grpc::Status status = to_status(calls_.begin()->second);
    calls_.erase(calls_.begin());
    cancelling_ = context;
    lock.unlock();
    // TryCancel() with a reason.
    grpc_call_cancel_with_status(context->c_call(), static_cast<grpc_status_code>(status.error_code()),
                                 status.error_message().c_str(), nullptr);
    lock.lock();
    cancelling_ = nullptr;
    changed_.notify_all();
  }
}

}  // namespace deform::server
