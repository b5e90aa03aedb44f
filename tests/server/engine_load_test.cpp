// SPDX-License-Identifier: GPL-3.0-or-later
// Many clients at once: different systems, one system, more systems than the cache holds, a full queue.
#include <atomic>
#include <map>
#include <memory>
#include <thread>
#include <vector>

#include "tests/server/engine_fixture.h"

namespace deform::server::engine_load_test {
namespace {

class EngineLoadTest : public EngineFixture {
 protected:
  static constexpr int clients = 8;
  /// A geometry and a system for each client.
  void prepare_all() {
    for (int c = 0; c < clients; ++c) {
      const Mesh mesh = sheet_mesh(24 + static_cast<std::size_t>(c), 12, c);
      systems.push_back(prepare(sheet_setup(register_mesh(mesh).id())).id());
      expected.push_back(deform(request_for(systems.back(), {{0.2, 0.1}})).points[0]);
    }
  }
  template <typename Action>
  static void in_parallel(const Action& action) {
    std::vector<std::thread> threads;
    for (int c = 0; c < clients; ++c) threads.emplace_back([&action, c] { action(c); });
    for (auto& thread : threads) thread.join();
  }
  std::vector<std::string> systems;
  std::vector<Points> expected;
};

TEST_F(EngineLoadTest, eight_clients_with_different_systems) {
  prepare_all();
  std::atomic<int> wrong{0};
  in_parallel([&](int c) {
    CallContext call;
    call.client = "client " + std::to_string(c);
    for (int i = 0; i < 20; ++i) {
      const auto k = static_cast<std::size_t>(c);
      if (largest_difference(deform(request_for(systems[k], {{0.2, 0.1}}), call).points[0], expected[k]) != 0) ++wrong;
    }
  });
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(engine->info().designs_served(), 8u + 160u);
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST_F(EngineLoadTest, memory_of_released_systems_goes_back_to_the_system) {
  constexpr std::size_t mebibyte = std::size_t{1} << 20;
  const std::string id = register_mesh(sheet_mesh(300, 300)).id();
  std::vector<std::unique_ptr<char[]>> kept;
  const auto prepare_and_release = [&] {
    std::vector<std::string> prepared;
    for (int k = 0; k < 8; ++k) {
      v1::Setup setup = sheet_setup(id);
      setup.mutable_method()->mutable_rbf()->set_reduction(v1::REDUCTION_RINGS);  // as many systems as numbers of rings
      setup.mutable_method()->mutable_rbf()->set_reduction_rings(static_cast<std::uint32_t>(k + 4));
      prepared.push_back(prepare(setup).id());
    }
    // What is kept lies behind what is freed, so that the heap does not shrink by itself.
    for (int k = 0; k < 100; ++k) kept.push_back(std::make_unique<char[]>(100'000));
    const std::size_t full = resident_set_bytes();
    std::size_t released = 0;
    for (const std::string& system : prepared) {
      v1::ReleaseSystemRequest release;
      release.set_id(system);
      released += engine->release_system(release, {}).bytes_released();
    }
    EXPECT_GT(released, 90 * mebibyte);
    return full;
  };
  prepare_and_release();  // what a server keeps anyway: pools, caches, the mesh
  const std::size_t before = resident_set_bytes();
  EXPECT_GT(prepare_and_release(), before + 70 * mebibyte);
  EXPECT_TRUE(eventually([&] { return resident_set_bytes() < before + 48 * mebibyte; }))
      << (resident_set_bytes() - before) / mebibyte << " MiB more than before";
}
#endif

TEST_F(EngineLoadTest, more_systems_than_the_cache_holds) {
  prepare_all();
  options.cache_budget = engine->get_system(systems[0], {}).bytes() * 5 / 2;
  reopen();
  std::atomic<int> wrong{0};
  in_parallel([&](int c) {
    for (int i = 0; i < 8; ++i) {
      const auto k = static_cast<std::size_t>((c + 3 * i) % clients);
      if (largest_difference(deform(request_for(systems[k], {{0.2, 0.1}})).points[0], expected[k]) != 0) ++wrong;
    }
  });
  EXPECT_EQ(wrong, 0);
  EXPECT_TRUE(eventually([&] { return engine->info().cache_bytes() <= options.cache_budget; }));
  EXPECT_GT(engine->info().cache_evictions(), 0u);
}

TEST_F(EngineLoadTest, many_askers_of_one_setup_share_one_preparation) {
  const v1::GeometryInfo geometry = register_mesh(sheet_mesh(80, 60));
  in_parallel([&](int) { EXPECT_TRUE(prepare(sheet_setup(geometry.id())).resident()); });
  const std::lock_guard lock(stages_mutex);
  EXPECT_EQ(engine->info().systems_resident(), 1u);
  EXPECT_EQ(engine->info().setups(), 1u);
}

TEST_F(EngineLoadTest, a_preparation_does_not_keep_deformations_waiting) {
  options.workers = 1;
  reopen();
  const std::string quick = prepare(sheet_setup(register_mesh(sheet_mesh(20, 10)).id())).id();
  v1::PrepareRequest request;
  *request.mutable_setup() = sheet_setup(register_mesh(sheet_mesh(40, 600)).id());
  request.mutable_setup()->mutable_method()->mutable_rbf()->set_reduction(v1::REDUCTION_OFF);
  Waiter<v1::SystemInfo> waiter;
  std::atomic<bool> prepared{false};
  std::stop_source stop;
  CallContext call;
  call.stop = stop.get_token();
  engine->prepare(request, call, {}, [&, done = waiter.callback()](Engine::Outcome<v1::SystemInfo> outcome) {
    prepared = true;
    done(std::move(outcome));
  });
  int served = 0;
  while (!prepared) {
    deform(request_for(quick, {{0.1, 0}}));
    ++served;
    if (served >= 5) stop.request_stop();  // that is enough
  }
  EXPECT_GE(served, 2);
  EXPECT_TRUE(eventually([&] { return engine->info().running() == 0; }));
  engine.reset();
}

TEST_F(EngineLoadTest, a_full_queue_refuses_and_what_was_accepted_is_served) {
  options.queue_limit = 2;
  options.workers = 1;
  reopen();
  const std::string system = prepare(sheet_setup(register_mesh(sheet_mesh(40, 30)).id())).id();
  std::atomic<int> served{0}, refused{0};
  in_parallel([&](int) {
    for (int i = 0; i < 20; ++i) {
      try {
        deform(request_for(system, {{0.1, 0.1}}));
        ++served;
      } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::out_of_budget) << error.what();
        EXPECT_GT(error.retry_after_ms(), 0u);
        ++refused;
      }
    }
  });
  EXPECT_EQ(served + refused, 160);
  EXPECT_GT(served, 0);
  EXPECT_EQ(engine->info().queue_length(), 0u);
  EXPECT_EQ(engine->info().designs_served(), static_cast<std::uint64_t>(served));
}

TEST_F(EngineLoadTest, memory_charged_comes_back) {
  prepare_all();
  const std::uint64_t before = engine->info().memory_in_use();
  in_parallel([&](int c) {
    for (int i = 0; i < 10; ++i) {
      std::stop_source stop;
      CallContext call;
      call.stop = stop.get_token();
      const auto job = engine->deform(request_for(systems[static_cast<std::size_t>(c)], {{0, 0}, {0.1, 0}}), 0, call, [] {});
      if (i % 2 == 0) stop.request_stop();
    }
  });
  EXPECT_TRUE(eventually([&] { return engine->info().running() == 0 && engine->info().memory_in_use() <= before; }))
      << engine->info().memory_in_use() << " against " << before;
  for (const auto& id : systems) {
    v1::ReleaseSystemRequest release;
    release.set_id(id);
    engine->release_system(release, {});
  }
  const v1::ListGeometriesReply geometries = engine->list_geometries({}, {});
  for (const auto& info : geometries.geometries()) {
    v1::DeleteGeometryRequest remove;
    remove.set_id(info.id());
    remove.set_with_setups(true);
    engine->delete_geometry(remove, {});
  }
  EXPECT_TRUE(eventually([&] { return engine->info().memory_in_use() == 0; })) << engine->info().memory_in_use();
}

}  // namespace
}  // namespace deform::server::engine_load_test
