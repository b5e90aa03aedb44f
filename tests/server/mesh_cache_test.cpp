// SPDX-License-Identifier: GPL-3.0-or-later
// Geometries in memory.
#include "server/engine/mesh_cache.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "core/base/error.h"
#include "server/store/geometry_file.h"
#include "tests/server/server_fakes.h"
#include "tests/server/test_mesh.h"

namespace deform::server::mesh_cache_test {
namespace {

class MeshCacheTest : public testing::Test {
 protected:
  void open(std::size_t meshes) {
    cache = std::make_unique<MeshCache>(meshes * size, [this](const std::string& id) {
      ++loads;
      if (id == "broken") throw Error(ErrorCode::data_loss, "broken");
      return MeshCache::share(sheet_mesh(10, 10), memory.charge(size, {"loading", "", 0}));
    });
    memory.add_reclaimer([this](std::size_t bytes) { cache->reclaim(bytes); });
  }
  const std::size_t size = mesh_bytes(sheet_mesh(10, 10));
  MemoryBudget memory{100 * size};
  std::atomic<int> loads{0};
  std::unique_ptr<MeshCache> cache;
};

TEST_F(MeshCacheTest, keeps_the_most_recently_used) {
  open(2);
  cache->get("a");
  cache->get("b");
  cache->get("a");
  cache->get("c");
  EXPECT_EQ(loads, 3);
  EXPECT_EQ(memory.in_use(), 2 * size);
  cache->get("a");
  EXPECT_EQ(loads, 3);
  cache->get("b");
  EXPECT_EQ(loads, 4);
}

TEST_F(MeshCacheTest, a_mesh_in_use_is_found_even_when_not_kept) {
  open(0);
  const auto held = cache->get("a");
  EXPECT_EQ(cache->get("a").get(), held.get());
  EXPECT_EQ(loads, 1);
  EXPECT_EQ(memory.in_use(), size);
}

TEST_F(MeshCacheTest, many_threads_load_once) {
  open(2);
  std::vector<std::thread> threads;
  for (int t = 0; t < 8; ++t) threads.emplace_back([&] { EXPECT_EQ(cache->get("a")->point_count(), 100u); });
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(loads, 1);
}

TEST_F(MeshCacheTest, a_failure_is_not_kept) {
  open(2);
  EXPECT_THROW(cache->get("broken"), Error);
  EXPECT_THROW(cache->get("broken"), Error);
  EXPECT_EQ(loads, 2);
  EXPECT_EQ(memory.in_use(), 0u);
}

TEST_F(MeshCacheTest, gives_back_what_nobody_holds_when_memory_is_needed) {
  open(100);
  const auto held = cache->get("held");
  cache->get("idle");
  const Charge charge = memory.charge(99 * size, {"large", "", 0});
  EXPECT_EQ(memory.in_use(), 100 * size);
  EXPECT_EQ(cache->get("held").get(), held.get());
}

TEST_F(MeshCacheTest, forgets) {
  open(2);
  cache->put("a", MeshCache::share(sheet_mesh(10, 10), memory.charge(size, {"", "", 0})));
  cache->get("a");
  EXPECT_EQ(loads, 0);
  cache->forget("a");
  EXPECT_EQ(memory.in_use(), 0u);
  cache->forget("never seen");
}

}  // namespace
}  // namespace deform::server::mesh_cache_test
