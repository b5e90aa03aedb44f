#include "server/rpc/service_pool.h"

#include <string>
#include <utility>

#include "core/base/error.h"

namespace deform::server {

namespace {
constexpr std::uint32_t busy_retry_ms = 200;
}

CallPool::CallPool(int threads, std::size_t queue_limit) : queue_limit_(queue_limit) {
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { run(); });
}

CallPool::~CallPool() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void CallPool::post(std::function<void()> task) {
  {
    const std::lock_guard lock(mutex_);
    tasks_.push_back(std::move(task));
  }
  changed_.notify_one();
}

void CallPool::try_post(std::function<void()> task) {
  {
    const std::lock_guard lock(mutex_);
    if (tasks_.size() >= queue_limit_) {
      throw Error(ErrorCode::out_of_budget,
                  "too many calls are waiting (limit " + std::to_string(queue_limit_) + "), try again later", busy_retry_ms);
    }
    tasks_.push_back(std::move(task));
  }
  changed_.notify_one();
}

void CallPool::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [this] { return stopping_ || !tasks_.empty(); });
    if (tasks_.empty()) return;
    std::function<void()> task = std::move(tasks_.front());
    tasks_.pop_front();
    lock.unlock();
    task();
    task = nullptr;  // what it kept alive goes before the lock is taken
    lock.lock();
  }
}

}  // namespace deform::server
