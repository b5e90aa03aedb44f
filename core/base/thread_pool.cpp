// SPDX-License-Identifier: Apache-2.0
#include "core/base/thread_pool.h"

#include <algorithm>
#include <utility>

#include "core/base/control_group.h"

namespace deform {

namespace {

std::size_t resolved(int threads) {
  if (threads > 0) return static_cast<std::size_t>(threads);
  return static_cast<std::size_t>(available_cores());
}

}  // namespace

ThreadPool::ThreadPool(int threads, std::size_t queue_limit)
    : thread_count_(resolved(threads)), queue_limit_(queue_limit > 0 ? queue_limit : 4 * thread_count_) {}

ThreadPool::~ThreadPool() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  for (auto& thread : threads_) thread.join();
}

// Requires mutex_.
void ThreadPool::enqueue(Task task) {
  if (threads_.size() < thread_count_) threads_.emplace_back([this] { run(); });
  queue_.push_back(std::move(task));
  changed_.notify_one();
}

void ThreadPool::post(Task task) {
  const std::lock_guard lock(mutex_);
  enqueue(std::move(task));
}

bool ThreadPool::try_post(Task task) {
  const std::lock_guard lock(mutex_);
  if (queue_.size() >= queue_limit_) return false;
  enqueue(std::move(task));
  return true;
}

void ThreadPool::post_or_help(Task task) {
  Task own;
  {
    const std::lock_guard lock(mutex_);
    enqueue(std::move(task));
    if (queue_.size() <= queue_limit_) return;
    own = std::move(queue_.front());
    queue_.pop_front();
  }
  own();
}

void ThreadPool::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return stopping_ || !queue_.empty(); });
    if (queue_.empty()) return;
    Task task = std::move(queue_.front());
    queue_.pop_front();
    lock.unlock();
    task();
    task = nullptr;  // destroys captured objects before the mutex is locked again
    lock.lock();
  }
}

}  // namespace deform
