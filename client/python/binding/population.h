// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "client/client.h"

namespace deform::python {

/// Evaluates any number of designs: in requests of some designs each, a few of them at a time, every design once. A request that
/// loses its connection after some of its designs have come is repeated for the others; until then the client itself repeats it.
/// Knows no Python. Any thread.
class Population {
 public:
  struct Options {
    v1::DeformRequest request;        ///< of every request, without designs
    std::vector<v1::Design> designs;  ///< m
    std::size_t batch = 1;            ///< designs of a request
    std::size_t requests = 1;         ///< at a time
    std::stop_source stop;            ///< ends what is under way
    client::CallOptions call;         ///< of the whole, stopped by `stop`
    /// Where the points of all designs go, m x n x 3; those without a deformation keep what is there. Empty: they stay with their
    /// designs, and no request begins while a batch of designs waits for next().
    std::span<Vec3> target;
  };
  struct Done {
    std::size_t design = 0;
    client::DeformedDesign deformed;
  };

  /// Begins. `client` must outlive it.
  Population(client::Client& client, Options options);
  /// Cancels what is under way and waits for its end.
  ~Population();

  /// The next finished design, after waiting at most so long; nothing when there is none yet or at_end(). Throws the Error that
  /// ended the population, once all that was finished before has been taken.
  std::optional<Done> next(std::chrono::milliseconds most);
  /// Every design was taken.
  bool at_end() const;
  /// Waits at most so long. True when nothing runs any more, after which next() does not wait.
  bool wait(std::chrono::milliseconds most);
  void cancel() { stop_.request_stop(); }

 private:
  void run();
  bool take_batch(std::size_t& first, std::size_t& end);
  void evaluate(std::size_t first, std::size_t end);
  void finish(std::size_t design, client::DeformedDesign&& deformed);
  std::span<Vec3> memory_of(std::size_t design) const;

  client::Client& client_;
  const Options options_;
  std::stop_source stop_;
  const RunContext::Clock::time_point started_ = RunContext::Clock::now();

  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  // under mutex_
  std::deque<Done> finished_;
  std::size_t next_design_ = 0;  ///< of the next batch
  std::size_t taken_ = 0;        ///< by next()
  std::size_t running_ = 0;      ///< threads
  std::exception_ptr error_;
  std::vector<std::thread> threads_;
};

}  // namespace deform::python
