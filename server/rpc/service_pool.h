#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace deform::server {

/// A few threads for engine calls that block (disk, hashing), so that gRPC's own threads never do. Tasks must not throw.
/// Thread-safe. Destruction runs what is still queued.
class CallPool {
 public:
  /// try_post refuses when `queue_limit` tasks wait.
  CallPool(int threads, std::size_t queue_limit);
  ~CallPool();
  CallPool(const CallPool&) = delete;
  CallPool& operator=(const CallPool&) = delete;

  /// For the next step of a call that has been let in.
  void post(std::function<void()> task);
  /// For a new call: throws Error(out_of_budget) with a retry hint when too many wait.
  void try_post(std::function<void()> task);

 private:
  void run();

  const std::size_t queue_limit_;
  std::mutex mutex_;
  // under mutex_
  std::condition_variable changed_;
  std::deque<std::function<void()>> tasks_;
  bool stopping_ = false;
  // constant after construction
  std::vector<std::thread> threads_;
};

}  // namespace deform::server
