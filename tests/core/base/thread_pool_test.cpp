// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/thread_pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <thread>

namespace deform::thread_pool_test {
namespace {

/// Occupies a thread of a pool until it goes.
struct Blockade {
  explicit Blockade(ThreadPool& pool) {
    std::promise<void> begun;
    pool.post([&begun, end = end_.get_future().share()] {
      begun.set_value();
      end.wait();
    });
    begun.get_future().wait();
  }
  ~Blockade() { end_.set_value(); }

 private:
  std::promise<void> end_;
};

TEST(ThreadPool, RunsEveryTaskBeforeItEnds) {
  std::atomic<int> ran{0};
  {
    ThreadPool pool(3);
    for (int k = 0; k < 1000; ++k) pool.post([&] { ++ran; });
  }
  EXPECT_EQ(ran, 1000);
}

TEST(ThreadPool, RefusesWhatIsTriedBeyondTheLimitOnly) {
  std::atomic<int> ran{0};
  {
    ThreadPool pool(1, 2);
    const Blockade blockade(pool);
    EXPECT_TRUE(pool.try_post([&] { ++ran; }));
    EXPECT_TRUE(pool.try_post([&] { ++ran; }));
    EXPECT_FALSE(pool.try_post([&] { ran += 100; }));
    pool.post([&] { ++ran; });
  }
  EXPECT_EQ(ran, 3);
}

TEST(ThreadPool, AProducerThatOutrunsTheThreadsDoesTheOldestTaskItself) {
  std::vector<int> order;
  const auto here = std::this_thread::get_id();  // outlives the pool, whose last tasks read it
  {
    ThreadPool pool(1, 2);
    const Blockade blockade(pool);
    for (int k = 0; k < 4; ++k) {
      pool.post_or_help([&, k] {
        if (std::this_thread::get_id() == here) order.push_back(k);
      });
    }
    EXPECT_EQ(order, (std::vector<int>{0, 1}));
  }
  EXPECT_EQ(order.size(), 2u);
}

TEST(ThreadPool, EndsWhileItsThreadsWaitForTasks) {
  ThreadPool pool(2);
  for (int k = 0; k < 2; ++k) {
    std::promise<void> done;
    pool.post([&] { done.set_value(); });
    done.get_future().wait();
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(50));  // until both wait
}

TEST(ThreadPool, KnowsItsLimit) {
  EXPECT_EQ(ThreadPool(3).queue_limit(), 12u);
  EXPECT_EQ(ThreadPool(3, 5).queue_limit(), 5u);
  EXPECT_GE(ThreadPool(0).queue_limit(), 4u);
}

}  // namespace
}  // namespace deform::thread_pool_test
