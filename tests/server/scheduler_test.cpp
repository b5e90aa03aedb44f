// SPDX-License-Identifier: GPL-3.0-or-later
// Who computes when: the bounded queue, fairness, slots, and preparations that keep out of the way.
#include "server/engine/scheduler.h"

#include <gtest/gtest.h>

#include <atomic>
#include <map>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "tests/server/server_fakes.h"

namespace deform::server::scheduler_test {
namespace {

Scheduler::Options options(int workers, std::size_t queue_limit = 256, std::size_t running_limit = 4) {
  Scheduler::Options result;
  result.workers = workers;
  result.preparation_workers = 1;
  result.queue_limit = queue_limit;
  result.running_limit = running_limit;
  return result;
}

TEST(Scheduler, a_full_queue_refuses_with_a_hint_and_recovers) {
  Scheduler scheduler(options(1, 3));
  std::vector<Scheduler::Place> places;
  for (int i = 0; i < 3; ++i) places.push_back(scheduler.enter("a"));
  EXPECT_EQ(scheduler.load().waiting, 3u);
  try {
    scheduler.enter("b");
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
    EXPECT_GT(error.retry_after_ms(), 0u);
    EXPECT_EQ(error.refusal(), Refusal::queue);
    EXPECT_NE(std::string(error.what()).find("limit is 3"), std::string::npos);
  }
  places.pop_back();
  EXPECT_NO_THROW(places.push_back(scheduler.enter("b")));
  places.clear();
  EXPECT_EQ(scheduler.load().waiting, 0u);
}

TEST(Scheduler, clients_that_take_all_leave_places_for_others) {
  constexpr std::size_t limit = 90;
  for (const std::size_t greedy : {1u, 2u, 5u}) {
    Scheduler scheduler(options(1, limit));
    std::map<std::string, std::vector<Scheduler::Place>> places;
    const auto enters = [&](const std::string& client) {
      try {
        places[client].push_back(scheduler.enter(client));
        return true;
      } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
        EXPECT_GT(error.retry_after_ms(), 0u);
        EXPECT_EQ(error.refusal(), Refusal::queue);
        EXPECT_NE(std::string(error.what()).find("kept for others"), std::string::npos) << error.what();
        return false;
      }
    };
    bool any = true;
    while (any) {
      any = false;
      for (std::size_t i = 0; i < greedy; ++i) any = enters("greedy " + std::to_string(i)) || any;
    }
    const double share = 4.0 * limit / (4.0 * static_cast<double>(greedy) + 1);
    for (std::size_t i = 0; i < greedy; ++i) {
      EXPECT_NEAR(static_cast<double>(places["greedy " + std::to_string(i)].size()), share, 2) << greedy;
    }
    // Whoever comes next finds a place, and the greedy ones have none the more for it.
    EXPECT_TRUE(enters("modest"));
    EXPECT_FALSE(enters("greedy 0"));
    // What a client leaves is its own to take again.
    places["modest"].clear();
    places["greedy 0"].clear();
    EXPECT_TRUE(enters("greedy 0"));
    places.clear();
    EXPECT_EQ(scheduler.load().waiting, 0u);
  }
}

TEST(Scheduler, what_waits_for_a_preparation_has_places_of_its_own) {
  using Queue = Scheduler::Queue;
  Scheduler scheduler(options(1, 10));
  std::vector<Scheduler::Place> places;
  for (int i = 0; i < 10; ++i) places.push_back(scheduler.enter("p" + std::to_string(i), Queue::preparations));
  EXPECT_EQ(scheduler.load().waiting_for_preparation, 10u);
  EXPECT_EQ(scheduler.load().waiting, 0u);
  try {
    scheduler.enter("q", Queue::preparations);
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("queue for preparations is full: 10 "), std::string::npos) << error.what();
  }
  // Nor does one client's share of the one count in the other.
  for (int i = 0; i < 9; ++i) places.push_back(scheduler.enter("p0", Queue::workers));
  EXPECT_EQ(scheduler.load().waiting, 9u);
  EXPECT_THROW(scheduler.enter("p0", Queue::workers), Error);
  Scheduler::Place moved = std::move(places[0]);
  places[0] = Scheduler::Place();
  EXPECT_EQ(scheduler.load().waiting_for_preparation, 10u);
  moved = scheduler.enter("s");
  EXPECT_EQ(scheduler.load().waiting_for_preparation, 9u);
  EXPECT_EQ(scheduler.load().waiting, 10u);
  moved.leave();
  places.clear();
  EXPECT_EQ(scheduler.load().waiting_for_preparation, 0u);
  EXPECT_EQ(scheduler.load().waiting, 0u);
}

TEST(Scheduler, clients_take_turns) {
  Scheduler scheduler(options(1, 256, 1));
  Gate gate;
  std::mutex mutex;
  std::vector<std::string> order;
  int owner = 0;
  scheduler.start("z", &owner, 1, [&](Scheduler::Slot) { gate.pass(); });
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; }));
  for (int i = 0; i < 6; ++i) {
    for (const std::string client : {"greedy", "greedy", "greedy", "modest"}) {
      if (client == "modest" && i > 2) continue;
      scheduler.start(client, &owner, 1, [&, client](Scheduler::Slot) {
        const std::lock_guard lock(mutex);
        order.push_back(client);
      });
    }
  }
  gate.open();
  ASSERT_TRUE(eventually([&] {
    const std::lock_guard lock(mutex);
    return order.size() == 21;
  }));
  // The three of the modest client are among the first six although eighteen others were there before.
  EXPECT_EQ(std::count(order.begin(), order.begin() + 6, "modest"), 3);
}

/// What a lone worker takes in which order, of what is queued by `fill` while it is busy with a large request of "early".
std::vector<std::string> order_of(
    const std::function<void(Scheduler&, const std::function<void(const std::string& client, double cost)>& add)>& fill,
    std::size_t count) {
  Scheduler scheduler(options(1, 256, 1));
  Gate gate;
  std::mutex mutex;
  std::vector<std::string> order;
  int owner = 0;
  scheduler.start("early", &owner, 1e6, [&](Scheduler::Slot) { gate.pass(); });
  EXPECT_TRUE(eventually([&] { return gate.waiting() == 1; }));
  fill(scheduler, [&](const std::string& client, double cost) {
    scheduler.start(client, &order, cost, [&, client](Scheduler::Slot) {
      const std::lock_guard lock(mutex);
      order.push_back(client);
    });
  });
  gate.open();
  EXPECT_TRUE(eventually([&] {
    const std::lock_guard lock(mutex);
    return order.size() == count;
  }));
  scheduler.stop();
  return order;
}

TEST(Scheduler, small_requests_do_not_wait_for_the_large_ones_of_others) {
  const auto order = order_of(
      [](Scheduler&, const auto& add) {
        for (int i = 0; i < 50; ++i) add("greedy" + std::to_string(i), 10'000);
        for (int i = 0; i < 3; ++i) add("modest", 1);
      },
      53);
  EXPECT_EQ(std::count(order.begin(), order.begin() + 3, "modest"), 3);
}

// One that comes late finds large ones that have waited for long, and still comes first.
TEST(Scheduler, small_requests_that_come_late_do_not_wait_either) {
  Scheduler scheduler(options(1, 256, 1));
  std::mutex mutex;
  std::vector<std::string> order;
  const auto add = [&](const std::string& client, double cost, const std::function<void()>& more) {
    scheduler.start(client, &order, cost, [&, client, more](Scheduler::Slot) {
      more();
      const std::lock_guard lock(mutex);
      order.push_back(client);
    });
  };
  for (int i = 0; i < 50; ++i) {
    add("greedy" + std::to_string(i), 10'000, [&, i] {
      if (i % 10 == 9) add("modest", 1, [] {});
    });
  }
  ASSERT_TRUE(eventually([&] {
    const std::lock_guard lock(mutex);
    return order.size() == 55;
  }));
  scheduler.stop();
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (order[i].ends_with("9")) {
      EXPECT_EQ(order[i + 1], "modest") << "after " << order[i];
    }
  }
}

TEST(Scheduler, large_requests_wait_until_others_have_had_as_much) {
  const auto order = order_of(
      [](Scheduler&, const auto& add) {
        add("large", 100.5);
        for (int i = 0; i < 200; ++i) add("small", 1);
      },
      201);
  EXPECT_EQ(std::find(order.begin(), order.end(), "large") - order.begin(), 100);
}

TEST(Scheduler, whoever_had_more_than_his_share_waits_when_he_comes_again) {
  const auto order = order_of(
      [](Scheduler&, const auto& add) {
        add("greedy", 100);
        add("greedy", 1);
        for (int i = 0; i < 90; ++i) add("modest", 1);
      },
      92);
  EXPECT_EQ(std::count(order.begin(), order.begin() + 90, "modest"), 90);
}

TEST(Scheduler, what_was_had_while_nobody_waited_is_not_held_against_anyone) {
  const auto order = order_of(
      [](Scheduler&, const auto& add) {
        add("modest", 10);
        add("early", 1);
      },
      2);
  EXPECT_EQ(order.front(), "early");
}

TEST(Scheduler, what_is_removed_costs_nothing) {
  int gone = 0;
  const auto order = order_of(
      [&](Scheduler& scheduler, const auto& add) {
        scheduler.start("a", &gone, 1'000'000, [](Scheduler::Slot) { ADD_FAILURE() << "it was removed"; });
        scheduler.remove(&gone);
        add("b", 10);
        add("a", 1);
      },
      2);
  EXPECT_EQ(order.front(), "a");
}

TEST(Scheduler, no_more_requests_run_than_there_are_slots) {
  Scheduler scheduler(options(4, 256, 2));
  std::mutex mutex;
  std::vector<Scheduler::Slot> held;
  int owner = 0;
  for (int i = 0; i < 5; ++i) {
    scheduler.start("a", &owner, 1, [&](Scheduler::Slot slot) {
      const std::lock_guard lock(mutex);
      held.push_back(std::move(slot));
    });
  }
  const auto begun = [&] {
    const std::lock_guard lock(mutex);
    return held.size();
  };
  ASSERT_TRUE(eventually([&] { return begun() == 2; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(30));
  EXPECT_EQ(begun(), 2u);
  EXPECT_EQ(scheduler.load().running, 2u);
  {
    const std::lock_guard lock(mutex);
    held[0].leave();
  }
  ASSERT_TRUE(eventually([&] { return begun() == 3; }));
  const Scheduler::Slot resumed = scheduler.resume();  // never waits
  EXPECT_EQ(scheduler.load().running, 3u);
  scheduler.remove(&owner);
  scheduler.stop();
  held.clear();
}

TEST(Scheduler, steps_go_on_while_starts_wait_for_slots) {
  Scheduler scheduler(options(1, 256, 1));
  int owner = 0;
  std::atomic<bool> started{false};
  std::atomic<bool> stepped{false};
  Scheduler::Slot taken = scheduler.resume();
  scheduler.start("a", &owner, 1, [&](Scheduler::Slot) { started = true; });
  scheduler.step(&owner, [&] { stepped = true; });
  ASSERT_TRUE(eventually([&] { return stepped.load(); }));
  EXPECT_FALSE(started);
  taken.leave();
  EXPECT_TRUE(eventually([&] { return started.load(); }));
}

TEST(Scheduler, a_preparation_holds_no_worker) {
  Scheduler scheduler(options(1));
  Gate gate;
  int owner = 0;
  scheduler.prepare("a", &owner, 60, [&] { gate.pass(); });
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; }));
  EXPECT_EQ(scheduler.load().preparations, 1u);
  std::atomic<bool> stepped{false};
  scheduler.step(&owner, [&] { stepped = true; });
  EXPECT_TRUE(eventually([&] { return stepped.load(); }));
  gate.open();
  EXPECT_TRUE(eventually([&] { return scheduler.load().preparations == 0; }));
}

TEST(Scheduler, a_short_preparation_does_not_wait_for_long_ones) {
  Scheduler scheduler(options(1));
  Gate gate;
  int owner = 0;
  std::atomic<int> brief{0};
  std::atomic<bool> late{false};
  scheduler.prepare("a", &owner, 600, [&] { gate.pass(); });
  scheduler.prepare("a", &owner, 600, [&] { late = true; });
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; }));
  for (int i = 0; i < 3; ++i) scheduler.prepare("a", &owner, 0.1, [&] { ++brief; });
  EXPECT_TRUE(eventually([&] { return brief == 3; }));
  EXPECT_FALSE(late);
  gate.open();
  EXPECT_TRUE(eventually([&] { return late.load(); }));
}

TEST(Scheduler, long_preparations_do_not_wait_for_short_ones) {
  Scheduler scheduler(options(1));
  Gate gate;
  int owner = 0;
  std::atomic<bool> done{false};
  for (int i = 0; i < 2; ++i) scheduler.prepare("a", &owner, 1, [&] { gate.pass(); });
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 2; }));  // both threads
  for (int i = 0; i < 20; ++i) scheduler.prepare("a", &owner, 1, [&] { EXPECT_TRUE(eventually([&] { return done.load(); })); });
  scheduler.prepare("b", &owner, 60, [&] { done = true; });
  gate.open();
  EXPECT_TRUE(eventually([&] { return done.load(); }));
  scheduler.stop();
}

TEST(Scheduler, long_preparations_of_clients_take_turns) {
  Scheduler scheduler(options(1));
  Gate gate;
  int owner = 0, gone = 0;
  std::mutex mutex;
  std::string order;
  const auto note = [&](char name) {
    return [&, name] {
      const std::lock_guard lock(mutex);
      order += name;
    };
  };
  scheduler.prepare("a", &owner, 100, [&] { gate.pass(); });
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; }));
  for (int i = 0; i < 4; ++i) scheduler.prepare("a", &owner, 100, note('a'));
  for (int i = 0; i < 2; ++i) scheduler.prepare("b", &owner, 10, note('b'));
  scheduler.prepare("b", &gone, 10, note('x'));
  scheduler.remove(&gone);
  scheduler.prepare("c", &owner, 150, note('c'));
  gate.open();
  scheduler.stop();
  EXPECT_EQ(order, "bbacaaa");
}

TEST(Scheduler, short_preparations_of_clients_take_turns) {
  Scheduler scheduler(options(1));
  Gate gate;
  int owner = 0, gone = 0;
  std::mutex mutex;
  std::string order;
  const auto add = [&](char client, double seconds) {
    scheduler.prepare(std::string(1, client), &owner, seconds, [&, client] {
      const std::lock_guard lock(mutex);
      order += client;
    });
  };
  Gate long_one;  // so that one thread takes all the short ones
  scheduler.prepare("z", &owner, 100, [&] { long_one.pass(); });
  ASSERT_TRUE(eventually([&] { return long_one.waiting() == 1; }));
  scheduler.prepare("z", &owner, 1, [&] { gate.pass(); });
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; }));
  for (int i = 0; i < 4; ++i) add('a', 0);  // counts for as much as a short one takes at least
  for (int i = 0; i < 2; ++i) add('b', 0);
  scheduler.prepare("b", &gone, 1, [&] { ADD_FAILURE() << "it was removed"; });
  scheduler.remove(&gone);
  add('c', 1);
  gate.open();
  ASSERT_TRUE(eventually([&] {
    const std::lock_guard lock(mutex);
    return order.size() == 7;
  }));
  EXPECT_EQ(order, "ababaac");
  long_one.open();
  scheduler.stop();
}

TEST(Scheduler, removed_work_never_runs) {
  Scheduler scheduler(options(1));
  Gate gate;
  int blocker = 0, gone = 0, kept = 0;
  scheduler.step(&blocker, [&] { gate.pass(); });
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; }));
  std::atomic<int> wrong{0}, right{0};
  for (int i = 0; i < 10; ++i) {
    scheduler.step(&gone, [&] { ++wrong; });
    scheduler.start("a", &gone, 1, [&](Scheduler::Slot) { ++wrong; });
    scheduler.step(&kept, [&] { ++right; });
    scheduler.start("a", &kept, 1, [&](Scheduler::Slot) { ++right; });
  }
  scheduler.remove(&gone);
  gate.open();
  ASSERT_TRUE(eventually([&] { return right == 20; }));
  EXPECT_EQ(wrong, 0);
}

TEST(Scheduler, stop_runs_what_is_queued_and_may_be_called_twice) {
  std::atomic<int> done{0};
  int owner = 0;
  Scheduler scheduler(options(2));
  for (int i = 0; i < 100; ++i) scheduler.step(&owner, [&] { ++done; });
  scheduler.stop();
  EXPECT_EQ(done, 100);
  scheduler.stop();
}

TEST(Scheduler, many_threads_at_once) {
  Scheduler scheduler(options(4, 100000, 3));
  std::atomic<int> done{0};
  std::vector<std::thread> clients;
  for (int c = 0; c < 8; ++c) {
    clients.emplace_back([&, c] {
      for (int i = 0; i < 200; ++i) {
        auto place = std::make_shared<Scheduler::Place>(scheduler.enter(std::to_string(i % 3)));
        scheduler.start(std::to_string(c), place.get(), 1, [&, place](Scheduler::Slot slot) {
          place->leave();
          auto shared = std::make_shared<Scheduler::Slot>(std::move(slot));
          scheduler.step(place.get(), [&, shared] {
            shared->leave();
            ++done;
          });
        });
      }
    });
  }
  for (auto& client : clients) client.join();
  EXPECT_TRUE(eventually([&] { return done == 1600; }));
  EXPECT_EQ(scheduler.load().waiting, 0u);
  EXPECT_EQ(scheduler.load().running, 0u);
}

}  // namespace
}  // namespace deform::server::scheduler_test
