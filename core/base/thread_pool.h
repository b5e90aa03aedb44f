// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace deform {

/// A few threads that take up tasks in the order in which they came. Tasks must not throw. Thread-safe.
class ThreadPool {
 public:
  using Task = std::function<void()>;  ///< what a thread runs

  /// threads: 0 = all cores; they start with the first tasks. queue_limit: 0 = 4 tasks for each thread.
  explicit ThreadPool(int threads, std::size_t queue_limit = 0);
  /// Runs what is still queued.
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  /// Whatever the limit.
  void post(Task task);
  /// False, without the task, when queue_limit tasks wait.
  bool try_post(Task task);
  /// When more than queue_limit tasks would wait, the calling thread does the oldest itself: a producer that outruns the threads
  /// helps them.
  void post_or_help(Task task);

  std::size_t queue_limit() const { return queue_limit_; }  ///< tasks that may wait

 private:
  void enqueue(Task task);
  void run();

  const std::size_t thread_count_;
  const std::size_t queue_limit_;
  std::mutex mutex_;
  // under mutex_
  std::condition_variable changed_;
  std::deque<Task> queue_;
  std::vector<std::thread> threads_;
  bool stopping_ = false;
};

}  // namespace deform
