// SPDX-License-Identifier: GPL-3.0-or-later
// A store of one server: its folder, its catalog, and what a crash leaves behind. What holds for every store is in
// any_store_test.cpp.
#include "server/store/geometry_store.h"

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <thread>
#include <vector>

#include "core/base/error.h"
#include "server/store/geometry_file.h"
#include "server/store/sqlite_catalog.h"
#include "tests/server/server_fakes.h"
#include "tests/server/test_mesh.h"

namespace deform::server::geometry_store_test {
namespace {

namespace fs = std::filesystem;

class GeometryStoreTest : public testing::Test {
 protected:
  GeometryStoreTest() {
    spdlog::set_level(spdlog::level::off);  // damage is caused on purpose, hundreds of times
    reopen();
  }
  void reopen() {
    store.reset();
    store = std::make_unique<GeometryStore>(directory.path());
  }
  std::string put(const Mesh& given, const std::string& name = "sheet") {
    const std::string id = mesh_id(given);
    store->put(given, own(id), name);
    return id;
  }
  void put_setup(const std::string& id, const std::string& geometry) {
    store->put_setup({id, geometry, "setup", "info", unix_ms()});
  }
  fs::path file(const std::string& id) const { return directory.path() / "geometries" / id; }
  ErrorCode code_of(const std::function<void()>& action) {
    try {
      action();
    } catch (const Error& error) {
      return error.code();
    }
    return ErrorCode::internal;
  }
  static void write(const fs::path& path, const std::string& text) { std::ofstream(path) << text; }

  TemporaryDirectory directory;
  std::unique_ptr<GeometryStore> store;
  const Mesh mesh = sheet_mesh(20, 10);
  const std::string setup_id = std::string(63, 'a') + "1";
};

TEST_F(GeometryStoreTest, what_comes_and_goes_is_whole_or_unknown) {
  const std::string id = put(mesh);
  std::atomic<bool> ending{false};
  std::atomic<int> found{0}, unknown{0}, wrong{0};
  const auto look = [&](const std::function<void()>& action) {
    while (!ending) {
      std::this_thread::sleep_for(std::chrono::microseconds(200));  // those who change want their turn, too
      try {
        action();
        ++found;
      } catch (const Error& error) {
        ++(error.code() == ErrorCode::not_found ? unknown : wrong);
      }
    }
  };
  std::vector<std::thread> lookers;
  lookers.emplace_back(look, [&] { wrong += store->load(own(id)).points != mesh.points; });
  lookers.emplace_back(look, [&] { wrong += !store->info(own(id)).damage().empty(); });
  lookers.emplace_back(look, [&] {
    const v1::ListGeometriesReply reply = store->list(default_tenant, {});
    for (const auto& info : reply.geometries()) wrong += !info.damage().empty();
  });
  for (int i = 0; i < 25; ++i) {
    store->remove(own(id), WithSetups::refuse);
    std::thread other([&] { store->put(mesh, own(id), "other"); });
    put(mesh);
    other.join();
  }
  ending = true;
  for (auto& looker : lookers) looker.join();
  EXPECT_GT(found, 0);
  EXPECT_GT(unknown, 0);
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(store->state().damaged_files(), 0u);
}

TEST_F(GeometryStoreTest, a_second_process_is_refused) {
  EXPECT_EQ(code_of([&] { GeometryStore second(directory.path()); }), ErrorCode::unavailable);
  store.reset();
  EXPECT_NO_THROW(GeometryStore(directory.path()));
}

TEST_F(GeometryStoreTest, one_whose_lock_outlives_it_for_a_moment_is_waited_for) {
  std::thread dying([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    store.reset();
  });
  EXPECT_NO_THROW(GeometryStore(directory.path()));
  dying.join();
}

TEST_F(GeometryStoreTest, leftovers_of_interrupted_uploads_are_collected) {
  const std::string id = put(mesh), other = std::string(64, 'b');
  const std::int64_t intent = store->catalog().begin({Intent::Kind::put, {{Intent::What::geometry, other, 7, {}}}});
  store.reset();
  write(directory.path() / "tmp" / (other + "." + std::to_string(intent)), "half an upload");
  reopen();
  EXPECT_TRUE(fs::is_empty(directory.path() / "tmp"));
  EXPECT_TRUE(fs::is_empty(directory.path() / "unclaimed"));
  EXPECT_EQ(store->load(own(id)).points, mesh.points);
  EXPECT_EQ(store->list(default_tenant, {}).geometries_size(), 1);
}

TEST_F(GeometryStoreTest, a_catalog_of_something_else_is_kept_and_replaced) {
  const std::string id = put(mesh, "wing.obj");
  store.reset();
  write(directory.path() / "catalog.sqlite", std::string(5000, 'x'));
  reopen();
  EXPECT_EQ(store->info(own(id)).name(), "wing.obj");
  std::ifstream in(directory.path() / "damaged" / "catalog.0" / "catalog.sqlite");
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(in), {}), std::string(5000, 'x'));
}

TEST_F(GeometryStoreTest, a_directory_that_cannot_be_written_is_named) {
  write(directory.path() / "file", "");
  try {
    GeometryStore inside_a_file(directory.path() / "file" / "data");
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::unavailable);
    EXPECT_NE(std::string(error.what()).find("file"), std::string::npos);
  }
}

}  // namespace
}  // namespace deform::server::geometry_store_test
