// SPDX-License-Identifier: Apache-2.0
#include "core/base/parallel.h"

#include "core/base/control_group.h"

#include <algorithm>

#if defined(__SANITIZE_THREAD__)
#define DEFORM_THREAD_SANITIZER
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define DEFORM_THREAD_SANITIZER
#endif
#endif

#ifdef DEFORM_THREAD_SANITIZER
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>
#else
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>
#include <oneapi/tbb/task_arena.h>
#include <oneapi/tbb/task_group.h>
#endif

namespace deform {

namespace {

using RunRange = std::function<void(std::size_t)>;

#ifdef DEFORM_THREAD_SANITIZER

// The packaged oneTBB is not instrumented, so the thread sanitizer cannot see its synchronization. Under the sanitizer plain
// threads are used instead, so that the bodies of all loops are checked.
void run_ranges(std::size_t ranges, int threads, const RunRange& run) {
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::exception_ptr first_error;
  const auto work = [&] {
    try {
      for (std::size_t k = next++; k < ranges; k = next++) run(k);
    } catch (...) {
      next = ranges;
      const std::lock_guard lock(mutex);
      if (!first_error) first_error = std::current_exception();
    }
  };
  std::vector<std::thread> helpers;
  for (int t = 1; t < threads; ++t) helpers.emplace_back(work);
  work();
  for (auto& helper : helpers) helper.join();
  if (first_error) std::rethrow_exception(first_error);
}

#else

void run_ranges(std::size_t ranges, int threads, const RunRange& run) {
  // The limit of all loops together: more threads than the quota allows would stand still together when it is used up.
  static const oneapi::tbb::global_control at_most(oneapi::tbb::global_control::max_allowed_parallelism,
                                                   static_cast<std::size_t>(available_cores()));
  // In a group of its own: a loop that is inside a range of another one must not end without a word, with ranges that never ran,
  // because that other one is cancelled by an exception.
  oneapi::tbb::task_group_context group(oneapi::tbb::task_group_context::isolated);
  const auto loop = [&] {
    // Isolated: a thread that waits here must not pick up an unrelated outer task, which could hold this one up for seconds.
    oneapi::tbb::this_task_arena::isolate([&] {
      oneapi::tbb::parallel_for(
          oneapi::tbb::blocked_range<std::size_t>(0, ranges, 1),
          [&](const oneapi::tbb::blocked_range<std::size_t>& range) {
            for (std::size_t k = range.begin(); k != range.end(); ++k) run(k);
          },
          oneapi::tbb::simple_partitioner(), group);
    });
  };
  if (threads >= oneapi::tbb::this_task_arena::max_concurrency()) {
    loop();
  } else {
    oneapi::tbb::task_arena arena(threads);
    arena.execute(loop);
  }
}

#endif

}  // namespace

int thread_count(const RunContext& context) {
  const int cores = available_cores();
  return context.threads > 0 ? std::min(context.threads, cores) : cores;
}

void parallel_for(const RunContext& context, std::size_t count, std::size_t grain,
                  const std::function<void(std::size_t, std::size_t)>& body) {
  grain = std::max<std::size_t>(grain, 1);
  const std::size_t ranges = (count + grain - 1) / grain;
  const auto run = [&](std::size_t k) {
    context.check();
    body(k * grain, std::min(count, (k + 1) * grain));
  };
  const int threads = thread_count(context);
  if (ranges <= 1 || threads == 1) {
    for (std::size_t k = 0; k < ranges; ++k) run(k);
    return;
  }
  run_ranges(ranges, threads, run);
}

}  // namespace deform
