#include "client/decode_pool.h"

#include <algorithm>
#include <utility>

namespace deform::client {

namespace {

std::size_t resolved(int threads) {
  if (threads > 0) return static_cast<std::size_t>(threads);
  return std::max(1u, std::thread::hardware_concurrency());
}

}  // namespace

DecodePool::DecodePool(int threads) : thread_count_(resolved(threads)), queue_limit_(4 * thread_count_) {}

DecodePool::~DecodePool() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  for (auto& thread : threads_) thread.join();
}

void DecodePool::submit(std::function<void()> task) {
  std::function<void()> own;
  {
    const std::lock_guard lock(mutex_);
    if (threads_.size() < thread_count_) threads_.emplace_back([this] { run(); });
    queue_.push_back(std::move(task));
    if (queue_.size() > queue_limit_) {
      own = std::move(queue_.front());
      queue_.pop_front();
    }
  }
  if (own) {
    own();
  } else {
    changed_.notify_one();
  }
}

void DecodePool::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return stopping_ || !queue_.empty(); });
    if (queue_.empty()) return;
    auto task = std::move(queue_.front());
    queue_.pop_front();
    lock.unlock();
    task();
    task = nullptr;
    lock.lock();
  }
}

}  // namespace deform::client
