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

/// A fixed number of threads that run tasks in the order in which they were posted. Tasks must not throw. Thread-safe.
class ThreadPool {
 public:
  using Task = std::function<void()>;  ///< a unit of work

  /// threads = 0 means one per core, queue_limit = 0 four tasks per thread. Threads are started with the first tasks.
  explicit ThreadPool(int threads, std::size_t queue_limit = 0);
  /// Runs the tasks that are still queued, then joins the threads.
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  /// Queues the task, even beyond queue_limit.
  void post(Task task);
  /// Queues the task; returns false and drops it if queue_limit tasks are waiting already.
  bool try_post(Task task);
  /// Queues the task. If more than queue_limit tasks would wait, the calling thread runs the oldest one itself, which slows down
  /// a producer that is faster than the threads.
  void post_or_help(Task task);

  std::size_t queue_limit() const { return queue_limit_; }  ///< largest number of waiting tasks

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
