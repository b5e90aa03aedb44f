// SPDX-License-Identifier: GPL-3.0-or-later
// Single flight, failures, eviction, pins.
#include "server/engine/system_cache.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "server/engine/scheduler.h"
#include "tests/server/server_fakes.h"

namespace deform::server::system_cache_test {
namespace {

class SystemCacheTest : public testing::Test {
 protected:
  struct Answer {
    SystemCache::Handle handle;
    std::optional<Error> error;
  };
  /// What one asker heard.
  struct Listener {
    std::mutex mutex;
    std::vector<Answer> answers;
    std::vector<std::string> stages;
    std::size_t count() {
      const std::lock_guard lock(mutex);
      return answers.size();
    }
  };

  void open(std::size_t budget) {
    Scheduler::Options options;
    options.preparation_workers = 2;
    scheduler = std::make_unique<Scheduler>(options);
    cache = std::make_shared<SystemCache>(
        budget,
        [this](const std::string& client, const void* owner, double seconds, std::function<void()> work) {
          {
            const std::lock_guard lock(scheduled_mutex);
            scheduled.push_back(seconds);
          }
          scheduler->prepare(client, owner, seconds, std::move(work));
        },
        [this](const void* owner) { scheduler->remove(owner); });
  }
  void TearDown() override {
    gate.open();
    if (scheduler) scheduler->stop();
  }

  SystemCache::Prepare make(std::size_t bytes) {
    return [this, bytes](const RunContext&) {
      ++prepared;
      return fake_resident(10, bytes);
    };
  }
  /// Waits at the gate, looking at the stop token.
  SystemCache::Prepare make_slowly(std::size_t bytes) {
    return [this, bytes](const RunContext& context) {
      ++prepared;
      context.progress("factor", 0.5);
      gate.pass();
      try {
        context.check();
      } catch (const Error&) {
        ++cancelled;
        throw;
      }
      return fake_resident(10, bytes);
    };
  }
  static SystemCache::Asker ask(const std::shared_ptr<Listener>& listener) {
    SystemCache::Asker asker;
    asker.on_progress = [listener](const std::string& stage, double) {
      const std::lock_guard lock(listener->mutex);
      listener->stages.push_back(stage);
    };
    asker.on_done = [listener](SystemCache::Handle handle, const std::optional<Error>& error) {
      const std::lock_guard lock(listener->mutex);
      listener->answers.push_back({std::move(handle), error});
    };
    return asker;
  }
  /// Asks and waits.
  SystemCache::Handle get(const std::string& id, std::size_t bytes) {
    const auto listener = std::make_shared<Listener>();
    auto [handle, ticket] = cache->acquire(id, make(bytes), ask(listener));
    if (handle) return handle;
    EXPECT_TRUE(eventually([&] { return listener->count() == 1; }));
    const std::lock_guard lock(listener->mutex);
    return std::move(listener->answers[0].handle);
  }

  std::atomic<int> prepared{0}, cancelled{0};
  Gate gate;
  std::mutex scheduled_mutex;
  std::vector<double> scheduled;  // seconds; under scheduled_mutex
  std::unique_ptr<Scheduler> scheduler;
  std::shared_ptr<SystemCache> cache;
};

TEST_F(SystemCacheTest, one_thread_prepares_while_the_others_wait) {
  open(1000);
  std::vector<std::shared_ptr<Listener>> listeners;
  std::vector<SystemCache::Ticket> tickets;
  for (int i = 0; i < 20; ++i) {
    listeners.push_back(std::make_shared<Listener>());
    auto [handle, ticket] = cache->acquire("a", make_slowly(100), ask(listeners.back()));
    EXPECT_EQ(handle, nullptr);
    tickets.push_back(std::move(ticket));
  }
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; }));
  gate.open();
  for (const auto& listener : listeners) {
    ASSERT_TRUE(eventually([&] { return listener->count() == 1; }));
    EXPECT_NE(listener->answers[0].handle, nullptr);
    EXPECT_EQ(listener->answers[0].handle.get(), listeners[0]->answers[0].handle.get());
  }
  EXPECT_EQ(prepared, 1);
  EXPECT_EQ(listeners[0]->stages, std::vector<std::string>{"factor"});
}

TEST_F(SystemCacheTest, what_is_forgotten_while_it_is_prepared_goes_to_those_who_asked_before) {
  open(1000);
  const auto early = std::make_shared<Listener>(), left = std::make_shared<Listener>(), late = std::make_shared<Listener>();
  const auto first = cache->acquire("a", make_slowly(100), ask(early)).second;
  auto leaving = cache->acquire("b", make_slowly(100), ask(left)).second;
  ASSERT_TRUE(eventually([&] { return gate.waiting() >= 1; }));
  EXPECT_EQ(cache->forget({"a", "b", "unknown"}).bytes, 0u);
  const auto second = cache->acquire("a", make_slowly(100), ask(late)).second;
  const auto again = cache->acquire("b", make_slowly(100), ask(late)).second;
  leaving.leave();  // what is prepared anew stays
  gate.open();
  ASSERT_TRUE(eventually([&] { return early->count() == 1 && late->count() == 2; }));
  ASSERT_NE(early->answers[0].handle, nullptr);
  EXPECT_NE(late->answers[0].handle, nullptr);
  EXPECT_NE(late->answers[1].handle, nullptr);
  EXPECT_NE(early->answers[0].handle.get(), late->answers[0].handle.get());
  EXPECT_EQ(cache->stats().systems, 2u);
  EXPECT_EQ(cache->stats().bytes, 200u);
  EXPECT_EQ(left->count(), 0u);
  EXPECT_EQ(cache->forget({"a"}).bytes, 100u);
  EXPECT_FALSE(cache->contains("a"));
  EXPECT_EQ(cache->stats().bytes, 100u);
}

TEST_F(SystemCacheTest, a_tenant_prepares_as_much_at_once_as_it_may) {
  open(10'000);
  const auto listener = std::make_shared<Listener>();
  const auto ask_as = [&](const std::string& tenant, std::uint64_t most) {
    SystemCache::Asker asker = ask(listener);
    asker.tenant = tenant;
    asker.most_preparations = most;
    return asker;
  };
  auto first = cache->acquire("a", make_slowly(100), ask_as("acme", 2)).second;
  const auto second = cache->acquire("b", make_slowly(100), ask_as("acme", 2)).second;
  try {
    cache->acquire("c", make_slowly(100), ask_as("acme", 2));
    FAIL() << "a third was let in";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
    EXPECT_GT(error.retry_after_ms(), 0u);
    EXPECT_EQ(error.refusal(), Refusal::quota);
    EXPECT_NE(std::string(error.what()).find("quota preparations of tenant \"acme\": 2 "), std::string::npos) << error.what();
  }
  const auto joins = cache->acquire("a", make_slowly(100), ask_as("acme", 2)).second;  // adds no work
  const auto of_other = cache->acquire("d", make_slowly(100), ask_as("b", 2)).second;
  const auto more = cache->acquire("e", make_slowly(100), ask_as("acme", 3)).second;
  gate.open();
  EXPECT_TRUE(eventually([&] { return listener->count() == 5; }));
  const auto later = cache->acquire("c", make_slowly(100), ask_as("acme", 1)).second;
  EXPECT_TRUE(eventually([&] { return listener->count() == 6; }));
  EXPECT_NE(cache->acquire("a", make_slowly(100), ask_as("acme", 1)).first, nullptr) << "it is there";
}

TEST_F(SystemCacheTest, what_is_not_known_counts_as_half_of_what_is_short) {
  open(1000);
  const auto listener = std::make_shared<Listener>();
  const auto first = cache->acquire("a", make(100), ask(listener)).second;
  const SystemCache::Source nothing(make(100), [](const RunContext&) { return nullptr; });
  const auto second = cache->acquire("b", nothing, ask(listener)).second;
  EXPECT_TRUE(eventually([&] { return listener->count() == 2; }));
  EXPECT_EQ(scheduled, std::vector<double>(3, Scheduler::short_seconds / 2))
      << "of the second, to be restored and to be prepared";
}

TEST_F(SystemCacheTest, what_takes_long_waits_for_its_turn) {
  open(1000);
  const auto listener = std::make_shared<Listener>();
  const SystemCache::Prepare planned = [&](const RunContext&) -> SystemCache::Prepared {
    return SystemCache::Long{60, [&](const RunContext&) {
                               ++prepared;
                               return fake_resident(10, 100);
                             }};
  };
  // Both threads for long ones are busy, the one for short ones plans.
  int owner = 0;
  for (int i = 0; i < 2; ++i) scheduler->prepare("b", &owner, 60, [&] { gate.pass(); });
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 2; }));
  auto [handle, ticket] = cache->acquire("a", planned, ask(listener));
  const auto left = std::make_shared<Listener>();
  auto [none, leaving] = cache->acquire("c", planned, ask(left));
  const auto stages = [](Listener& of) {
    const std::lock_guard lock(of.mutex);
    return of.stages;
  };
  ASSERT_TRUE(eventually([&] { return stages(*listener).size() == 1 && stages(*left).size() == 1; }));
  EXPECT_EQ(stages(*listener), std::vector<std::string>{"queue"});
  leaving.leave();
  EXPECT_EQ(prepared, 0);
  gate.open();
  ASSERT_TRUE(eventually([&] { return listener->count() == 1; }));
  EXPECT_NE(listener->answers[0].handle, nullptr);
  EXPECT_NE(get("d", 100), nullptr);
  scheduler->stop();
  EXPECT_EQ(prepared, 2) << "\"a\" and \"d\": nobody wants \"c\" any more";
  EXPECT_EQ(left->count(), 0u);
}

TEST_F(SystemCacheTest, a_failure_reaches_all_and_is_not_kept) {
  open(1000);
  const SystemCache::Prepare fail = [&](const RunContext&) -> std::shared_ptr<ResidentSystem> {
    ++prepared;
    gate.pass();
    throw Error(ErrorCode::numerical_failure, "singular");
  };
  std::vector<std::shared_ptr<Listener>> listeners;
  std::vector<SystemCache::Ticket> tickets;
  for (int i = 0; i < 5; ++i) {
    listeners.push_back(std::make_shared<Listener>());
    tickets.push_back(cache->acquire("a", fail, ask(listeners.back())).second);
  }
  gate.open();
  for (const auto& listener : listeners) {
    ASSERT_TRUE(eventually([&] { return listener->count() == 1; }));
    ASSERT_TRUE(listener->answers[0].error);
    EXPECT_EQ(listener->answers[0].error->code(), ErrorCode::numerical_failure);
    EXPECT_EQ(listener->answers[0].handle, nullptr);
  }
  EXPECT_EQ(prepared, 1);
  EXPECT_NE(get("a", 100), nullptr);  // the next one tries again
  EXPECT_EQ(prepared, 2);
}

TEST_F(SystemCacheTest, foreign_exceptions_end_as_errors_too) {
  open(1000);
  const auto listener = std::make_shared<Listener>();
  const auto ticket = cache->acquire(
      "a", SystemCache::Prepare([](const RunContext&) -> std::shared_ptr<ResidentSystem> { throw std::bad_alloc(); }),
      ask(listener));
  ASSERT_TRUE(eventually([&] { return listener->count() == 1; }));
  EXPECT_EQ(listener->answers[0].error->code(), ErrorCode::out_of_budget);
}

TEST_F(SystemCacheTest, an_asker_that_leaves_leaves_alone) {
  open(1000);
  const auto stays = std::make_shared<Listener>();
  const auto leaves = std::make_shared<Listener>();
  auto first = cache->acquire("a", make_slowly(100), ask(leaves)).second;
  const auto second = cache->acquire("a", make_slowly(100), ask(stays)).second;
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; }));
  first.leave();
  gate.open();
  ASSERT_TRUE(eventually([&] { return stays->count() == 1; }));
  EXPECT_NE(stays->answers[0].handle, nullptr);
  EXPECT_EQ(leaves->count(), 0u);
  EXPECT_EQ(cancelled, 0);
}

TEST_F(SystemCacheTest, when_all_have_left_the_preparation_is_cancelled_and_the_next_asker_begins_anew) {
  open(1000);
  const auto left = std::make_shared<Listener>();
  {
    const auto first = cache->acquire("a", make_slowly(100), ask(left)).second;
    const auto second = cache->acquire("a", make_slowly(100), ask(left)).second;
    ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; }));
  }
  const auto late = std::make_shared<Listener>();
  const auto ticket = cache->acquire("a", make_slowly(100), ask(late)).second;
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 2; }));  // the cancelled one is still on its way out
  gate.open();
  ASSERT_TRUE(eventually([&] { return late->count() == 1; }));
  EXPECT_NE(late->answers[0].handle, nullptr);
  EXPECT_TRUE(eventually([&] { return cancelled == 1; }));
  EXPECT_EQ(left->count(), 0u);
  EXPECT_EQ(prepared, 2);
  EXPECT_EQ(cache->stats().systems, 1u);
}

TEST_F(SystemCacheTest, a_preparation_that_nobody_waits_for_any_more_leaves_the_queue) {
  open(1000);
  const auto listener = std::make_shared<Listener>();
  const auto a = cache->acquire("a", make_slowly(1), ask(listener)).second;
  const auto b = cache->acquire("b", make_slowly(1), ask(listener)).second;
  const auto c = cache->acquire("c", make_slowly(1), ask(listener)).second;
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 3; }));  // all threads
  cache->acquire("d", make_slowly(1), ask(listener)).second.leave();
  gate.open();
  ASSERT_TRUE(eventually([&] { return listener->count() == 3; }));
  scheduler->stop();
  EXPECT_EQ(prepared, 3);
}

TEST_F(SystemCacheTest, the_least_recently_used_goes_first) {
  open(300);
  get("a", 100);
  get("b", 100);
  get("c", 100);
  get("a", 100);  // used again
  get("d", 100);
  EXPECT_TRUE(cache->contains("a"));
  EXPECT_FALSE(cache->contains("b"));
  EXPECT_TRUE(cache->contains("c"));
  EXPECT_TRUE(cache->contains("d"));
  const SystemCache::Stats stats = cache->stats();
  EXPECT_EQ(stats.evictions, 1u);
  EXPECT_EQ(stats.bytes, 300u);
  EXPECT_EQ(stats.hits, 1u);
  EXPECT_EQ(stats.misses, 4u);
}

TEST_F(SystemCacheTest, entries_in_use_stay_and_stay_charged) {
  open(150);
  SystemCache::Handle a = get("a", 100);
  SystemCache::Handle b = get("b", 100);
  EXPECT_EQ(cache->stats().bytes, 200u);  // above the budget, but both are in use
  EXPECT_TRUE(cache->contains("a"));
  EXPECT_EQ(a->system->info().points, 10u);
  a.reset();  // now it can go
  EXPECT_FALSE(cache->contains("a"));
  EXPECT_TRUE(cache->contains("b"));
  b.reset();
  EXPECT_TRUE(cache->contains("b"));
}

TEST_F(SystemCacheTest, a_budget_of_zero_serves_all_the_same) {
  open(0);
  SystemCache::Handle a = get("a", 100);
  ASSERT_NE(a, nullptr);
  EXPECT_EQ(get("a", 100).get(), a.get());  // shared while it is in use
  EXPECT_EQ(prepared, 1);
  a.reset();
  EXPECT_EQ(cache->stats().systems, 0u);
  EXPECT_NE(get("a", 100), nullptr);
  EXPECT_EQ(prepared, 2);
}

TEST_F(SystemCacheTest, reclaim_takes_idle_entries_only) {
  open(1000);
  const SystemCache::Handle used = get("used", 100);
  get("idle1", 100);
  get("idle2", 100);
  cache->reclaim(50);
  EXPECT_FALSE(cache->contains("idle1"));
  EXPECT_TRUE(cache->contains("idle2"));
  cache->reclaim(100000);
  EXPECT_FALSE(cache->contains("idle2"));
  EXPECT_TRUE(cache->contains("used"));
}

TEST_F(SystemCacheTest, a_released_entry_serves_its_users_to_the_end) {
  open(1000);
  SystemCache::Handle old = get("a", 100);
  EXPECT_EQ(cache->release("a"), 100u);
  EXPECT_EQ(cache->release("a"), 0u);
  EXPECT_FALSE(cache->contains("a"));
  EXPECT_EQ(old->system->info().points, 10u);
  const SystemCache::Handle fresh = get("a", 70);
  EXPECT_NE(fresh.get(), old.get());
  old.reset();  // does not touch the new one
  EXPECT_TRUE(cache->contains("a"));
  EXPECT_EQ(cache->stats().bytes, 70u);
}

TEST_F(SystemCacheTest, a_handle_may_outlive_the_cache) {
  open(1000);
  SystemCache::Handle handle = get("a", 100);
  scheduler->stop();
  cache.reset();
  EXPECT_EQ(handle->system->info().points, 10u);
  handle.reset();
}

TEST_F(SystemCacheTest, many_threads_with_more_systems_than_fit) {
  open(250);
  std::atomic<int> wrong{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 8; ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < 100; ++i) {
        const SystemCache::Handle handle = get(std::to_string((t * 7 + i) % 5), 100);
        if (!handle || handle->system->info().points != 10) ++wrong;
      }
    });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
  const SystemCache::Stats stats = cache->stats();
  EXPECT_LE(stats.bytes, 250u);
  EXPECT_GT(stats.evictions, 0u);
  EXPECT_EQ(stats.hits + stats.misses, 800u);
}

// ---- systems of which only the basis is restored ----

class RestoringTest : public SystemCacheTest {
 protected:
  SystemCache::Restore restore(std::size_t bytes) {
    return [this, bytes](const RunContext&) {
      ++restored;
      auto resident = fake_resident(10, bytes);
      resident->extent = ResidentSystem::Extent::basis;
      return resident;
    };
  }
  /// At a gate of its own.
  SystemCache::Restore find_nothing() {
    return [this](const RunContext&) -> std::shared_ptr<ResidentSystem> {
      ++restored;
      nothing.pass();
      return nullptr;
    };
  }
  void TearDown() override {
    nothing.open();
    SystemCacheTest::TearDown();
  }
  SystemCache::Handle get(const std::string& id, const SystemCache::Source& source) {
    const auto listener = std::make_shared<Listener>();
    auto [handle, ticket] = cache->acquire(id, source, ask(listener));
    if (handle) return handle;
    EXPECT_TRUE(eventually([&] { return listener->count() == 1; }));
    const std::lock_guard lock(listener->mutex);
    return std::move(listener->answers[0].handle);
  }

  std::atomic<int> restored{0};
  Gate nothing;
};

TEST_F(RestoringTest, a_restored_system_is_enough_for_who_says_so) {
  open(1000);
  EXPECT_EQ(get("a", {make(100), restore(30)})->extent, ResidentSystem::Extent::basis);
  EXPECT_EQ(get("a", {make(100), restore(30)})->extent, ResidentSystem::Extent::basis);
  EXPECT_EQ(prepared, 0);
  EXPECT_EQ(restored, 1);
  EXPECT_EQ(cache->stats().bytes, 30u);
  EXPECT_EQ(cache->stats().restored, 1u);
}

TEST_F(RestoringTest, a_whole_system_replaces_a_restored_one_that_its_users_keep) {
  open(1000);
  auto basis = get("a", {make(100), restore(30)});
  auto whole = get("a", {make(100)});
  EXPECT_EQ(prepared, 1);
  EXPECT_EQ(whole->extent, ResidentSystem::Extent::whole);
  EXPECT_EQ(basis->bytes(), 30u);
  EXPECT_EQ(cache->stats().systems, 1u);
  EXPECT_EQ(cache->stats().bytes, 100u);
  EXPECT_EQ(get("a", {make(100), restore(30)}).get(), whole.get());
  basis.reset();
  EXPECT_EQ(cache->stats().bytes, 100u) << "it is none of the cache's any more";
  whole.reset();
  cache->set_budget(0);
  EXPECT_EQ(cache->stats().systems, 0u);
  EXPECT_EQ(cache->stats().bytes, 0u);
}

TEST_F(RestoringTest, a_whole_system_that_is_idle_is_replaced_by_none) {
  open(1000);
  get("a", {make(100), restore(30)});
  get("a", {make(100)});
  EXPECT_EQ(cache->stats().bytes, 100u);
  get("a", {make(100), restore(30)});
  EXPECT_EQ(restored, 1);
  cache->set_budget(0);
  EXPECT_EQ(cache->stats().systems, 0u);
}

TEST_F(RestoringTest, where_there_is_nothing_to_restore_all_wait_for_one_preparation) {
  open(1000);
  std::vector<std::shared_ptr<Listener>> listeners;
  std::vector<SystemCache::Ticket> tickets;
  const auto add = [&](const SystemCache::Source& source) {
    listeners.push_back(std::make_shared<Listener>());
    tickets.push_back(cache->acquire("a", source, ask(listeners.back())).second);
  };
  for (int i = 0; i < 5; ++i) add({make_slowly(100), find_nothing()});
  ASSERT_TRUE(eventually([&] { return nothing.waiting() == 1; }));
  for (int i = 0; i < 5; ++i) add({make_slowly(100)});
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; })) << "who needs it whole does not wait for that";
  nothing.open();
  add({make_slowly(100), find_nothing()});
  gate.open();
  for (const auto& listener : listeners) {
    ASSERT_TRUE(eventually([&] { return listener->count() == 1; }));
    EXPECT_EQ(listener->answers[0].handle.get(), listeners[0]->answers[0].handle.get());
    EXPECT_EQ(listener->answers[0].handle->extent, ResidentSystem::Extent::whole);
  }
  EXPECT_EQ(prepared, 1);
}

TEST_F(RestoringTest, what_was_prepared_while_there_was_nothing_to_restore_is_not_prepared_again) {
  open(1000);
  const auto listener = std::make_shared<Listener>();
  const auto ticket = cache->acquire("a", {make(100), find_nothing()}, ask(listener)).second;
  ASSERT_TRUE(eventually([&] { return nothing.waiting() == 1; }));
  const auto whole = get("a", {make(100)});
  nothing.open();
  ASSERT_TRUE(eventually([&] { return listener->count() == 1; }));
  EXPECT_EQ(listener->answers[0].handle.get(), whole.get());
  EXPECT_EQ(prepared, 1);
}

TEST_F(RestoringTest, the_last_who_leaves_a_joined_preparation_cancels_it) {
  open(1000);
  const auto one = std::make_shared<Listener>(), two = std::make_shared<Listener>();
  auto [none, first] = cache->acquire("a", {make_slowly(100)}, ask(one));
  auto [nobody, second] = cache->acquire("a", {make_slowly(100), find_nothing()}, ask(two));
  ASSERT_TRUE(eventually([&] { return nothing.waiting() == 1 && gate.waiting() == 1; }));
  nothing.open();
  // The flight that looked for a basis has joined the other one when the next who asks so begins a flight of its own.
  ASSERT_TRUE(eventually([&] {
    const auto third = std::make_shared<Listener>();
    const int before = restored;
    const auto asked = cache->acquire("a", {make_slowly(100), find_nothing()}, ask(third));
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    return restored > before;
  }));
  first.leave();
  EXPECT_EQ(cancelled, 0);
  second.leave();
  gate.open();
  EXPECT_TRUE(eventually([&] { return cancelled == 1; }));
  EXPECT_EQ(one->count() + two->count(), 0u);
  EXPECT_EQ(prepared, 1);
}

TEST_F(RestoringTest, an_error_of_restoring_is_that_of_who_asked) {
  open(1000);
  const auto listener = std::make_shared<Listener>();
  const SystemCache::Restore fails = [](const RunContext&) -> std::shared_ptr<ResidentSystem> {
    throw Error(ErrorCode::out_of_budget, "memory");
  };
  const auto ticket = cache->acquire("a", {make(100), fails}, ask(listener)).second;
  ASSERT_TRUE(eventually([&] { return listener->count() == 1; }));
  EXPECT_EQ(listener->answers[0].error->code(), ErrorCode::out_of_budget);
  EXPECT_EQ(prepared, 0);
}

}  // namespace
}  // namespace deform::server::system_cache_test
