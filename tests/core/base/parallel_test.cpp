// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/parallel.h"

#include <gtest/gtest.h>
#include <oneapi/tbb/task_arena.h>

#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

#include "core/base/error.h"

namespace deform::parallel_test {
namespace {

TEST(ParallelFor, CoversEveryIndexOnceInFixedRanges) {
  std::vector<std::atomic<int>> hits(1003);
  parallel_for({}, hits.size(), 10, [&](std::size_t begin, std::size_t end) {
    EXPECT_EQ(begin % 10, 0u);
    EXPECT_LE(end - begin, 10u);
    for (std::size_t i = begin; i < end; ++i) ++hits[i];
  });
  for (const auto& h : hits) EXPECT_EQ(h.load(), 1);
}

TEST(ParallelFor, CoversEveryIndexWithFewerThreadsThanThereAre) {
  // As if the machine had more cores than the call may use.
  oneapi::tbb::task_arena wide(thread_count({}) + 2);
  for (int threads = 1; threads <= 3; ++threads) {
    RunContext context;
    context.threads = threads;
    std::vector<std::atomic<int>> hits(103);
    wide.execute([&] {
      parallel_for(context, hits.size(), 10, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) ++hits[i];
      });
    });
    for (const auto& h : hits) EXPECT_EQ(h.load(), 1) << threads;
  }
}

TEST(ParallelFor, OneRangeOrOneThreadRunsInTheThreadOfTheCallerInOrder) {
  RunContext one;
  one.threads = 1;
  const auto caller = std::this_thread::get_id();
  oneapi::tbb::task_arena wide(thread_count({}) + 2);
  struct Row {
    RunContext context;
    std::size_t count;
  };
  for (const Row& row : {Row{{}, 10}, Row{one, 1003}}) {
    for (const bool inside : {false, true}) {
      std::size_t next = 0;
      const auto loop = [&] {
        parallel_for(row.context, row.count, 10, [&](std::size_t begin, std::size_t end) {
          EXPECT_EQ(std::this_thread::get_id(), caller);
          EXPECT_EQ(begin, next);
          next = end;
        });
      };
      if (inside) {
        wide.execute(loop);
      } else {
        loop();
      }
      EXPECT_EQ(next, row.count);
    }
  }
}

TEST(ParallelFor, NothingToDo) {
  parallel_for({}, 0, 10, [](std::size_t, std::size_t) { FAIL(); });
}

TEST(ParallelFor, FirstExceptionLeaves) {
  EXPECT_THROW(parallel_for({}, 100, 1,
                            [](std::size_t begin, std::size_t) {
                              if (begin == 37) throw Error(ErrorCode::internal, "37");
                            }),
               Error);
}

TEST(ParallelFor, CancelStopsBetweenRanges) {
  for (int threads : {1, 2}) {
    RunContext context;
    context.threads = threads;
    std::stop_source stop;
    context.stop = stop.get_token();
    std::atomic<int> runs = 0;
    try {
      parallel_for(context, 100000, 1, [&](std::size_t, std::size_t) {
        if (++runs == 5) stop.request_stop();
      });
      FAIL() << "not cancelled";
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::cancelled);
    }
    EXPECT_LT(runs.load(), 1000);
  }
}

TEST(ParallelFor, AnInnerLoopRunsAllRangesThoughTheOuterOneFails) {
  RunContext context;
  context.threads = 2;
  for (int round = 0; round < 20; ++round) {
    std::atomic<bool> began{false}, thrown{false};
    std::atomic<int> runs{0};
    bool ended = false;
    const auto wait_for = [](const std::atomic<bool>& flag) {
      for (int i = 0; i < 1000 && !flag; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    };
    EXPECT_THROW(parallel_for(context, 2, 1,
                              [&](std::size_t k, std::size_t) {
                                if (k == 1) {
                                  wait_for(began);
                                  thrown = true;
                                  throw Error(ErrorCode::cancelled, "cancelled");
                                }
                                began = true;
                                wait_for(thrown);
                                std::this_thread::sleep_for(std::chrono::milliseconds(2));
                                parallel_for(context, 50, 1, [&](std::size_t, std::size_t) { ++runs; });
                                ended = true;
                              }),
                 Error);
    if (ended) {
      EXPECT_EQ(runs, 50);
    }
  }
}

TEST(ParallelFor, DeadlineStops) {
  RunContext context;
  context.deadline = RunContext::Clock::now();
  EXPECT_THROW(parallel_for(context, 10, 1, [](std::size_t, std::size_t) {}), Error);
}

}  // namespace
}  // namespace deform::parallel_test
