#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace deform::client {

/// A few threads with a short queue. A full queue makes the submitting thread do the oldest task itself, so that what was
/// received but not decoded stays bounded, and a stream that outruns the decoders helps them. Thread-safe; tasks must not throw.
class DecodePool {
 public:
  /// 0 = all cores. Threads start with the first task.
  explicit DecodePool(int threads);
  /// Waits for every task.
  ~DecodePool();
  DecodePool(const DecodePool&) = delete;
  DecodePool& operator=(const DecodePool&) = delete;

  /// Runs the task on a thread of the pool, or, when the queue is full, the oldest one on this thread.
  void submit(std::function<void()> task);

 private:
  void run();

  const std::size_t thread_count_;
  const std::size_t queue_limit_;
  std::mutex mutex_;
  // under mutex_
  std::condition_variable changed_;
  std::deque<std::function<void()>> queue_;
  std::vector<std::thread> threads_;
  bool stopping_ = false;
};

}  // namespace deform::client
