// SPDX-License-Identifier: GPL-3.0-or-later
// Durability, visibility, and what a crash leaves behind.
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

namespace deform::server {
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

TEST_F(GeometryStoreTest, what_was_put_comes_back_after_a_restart) {
  const std::string id = put(mesh, "wing.obj");
  reopen();
  const Mesh back = store->load(own(id));
  EXPECT_EQ(back.points, mesh.points);
  EXPECT_EQ(back.face_sizes, mesh.face_sizes);
  EXPECT_EQ(back.face_points, mesh.face_points);
  ASSERT_EQ(back.groups.size(), 3u);
  EXPECT_EQ(back.groups[1].name, "right");
  EXPECT_EQ(back.groups[1].points, mesh.groups[1].points);
  EXPECT_EQ(back.groups[2].faces, mesh.groups[2].faces);
  const v1::GeometryInfo info = store->info(own(id));
  EXPECT_EQ(info.name(), "wing.obj");
  EXPECT_EQ(info.points(), 200u);
  EXPECT_EQ(info.faces(), 19u * 9u);
  EXPECT_EQ(info.corners(), 4u * 19u * 9u);
  EXPECT_EQ(info.groups_size(), 3);
  EXPECT_NEAR(info.diagonal(), bounding_box(mesh.points).diagonal(), 0);
  EXPECT_GT(info.registered_unix_ms(), 1'600'000'000'000);
}

TEST_F(GeometryStoreTest, points_only_is_a_geometry_too) {
  Mesh cloud;
  cloud.points = {{1, 2, 3}};
  const std::string id = put(cloud);
  EXPECT_EQ(store->load(own(id)).points, cloud.points);
}

TEST_F(GeometryStoreTest, putting_twice_costs_nothing_and_says_so) {
  const std::string id = mesh_id(mesh);
  EXPECT_FALSE(store->put(mesh, own(id), "first").existed());
  const v1::GeometryInfo again = store->put(mesh, own(id), "second");
  EXPECT_TRUE(again.existed());
  EXPECT_EQ(again.name(), "first");
  EXPECT_EQ(store->catalog().counts().geometries, 1u);
}

TEST_F(GeometryStoreTest, a_second_process_is_refused) {
  EXPECT_EQ(code_of([&] { GeometryStore second(directory.path()); }), ErrorCode::unavailable);
  store.reset();
  EXPECT_NO_THROW(GeometryStore(directory.path()));
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

TEST_F(GeometryStoreTest, a_row_without_its_file_is_data_loss_and_healed_by_registering_again) {
  const std::string id = put(mesh);
  fs::remove(file(id));
  reopen();
  EXPECT_FALSE(store->contains(own(id)));
  EXPECT_EQ(code_of([&] { store->load(own(id)); }), ErrorCode::data_loss);
  put(mesh);
  EXPECT_EQ(store->load(own(id)).points, mesh.points);
  EXPECT_EQ(store->list(default_tenant, {}).geometries_size(), 1);
}

TEST_F(GeometryStoreTest, every_damaged_byte_is_noticed) {
  Mesh small;
  small.points = {{1, 2, 3}, {4, 5, 6}};
  small.groups = {{"g", {1}, {}}};
  const std::string id = put(small);
  std::string good;
  {
    std::ifstream in(file(id), std::ios::binary);
    good.assign(std::istreambuf_iterator<char>(in), {});
  }
  for (std::size_t i = 0; i < good.size(); ++i) {
    std::string bad = good;
    bad[i] = static_cast<char>(bad[i] ^ 0x41);
    write(file(id), bad);
    EXPECT_EQ(code_of([&] { store->load(own(id)); }), ErrorCode::data_loss) << "byte " << i;
    write(file(id), bad.substr(0, i));
    EXPECT_EQ(code_of([&] { store->load(own(id)); }), ErrorCode::data_loss) << "truncated to " << i;
  }
  write(file(id), good + "x");
  EXPECT_EQ(code_of([&] { store->load(own(id)); }), ErrorCode::data_loss);
  put(small);  // the damaged file was set aside
  EXPECT_EQ(store->load(own(id)).points, small.points);
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

TEST_F(GeometryStoreTest, removing) {
  const std::string id = put(mesh);
  put_setup(setup_id, id);
  EXPECT_EQ(code_of([&] { store->remove(own(id), WithSetups::refuse); }), ErrorCode::failed_precondition);
  EXPECT_EQ(store->load(own(id)).points, mesh.points);
  EXPECT_EQ(store->info(own(id)).setups(), 1u);
  EXPECT_EQ(store->remove(own(id), WithSetups::remove), std::vector<std::string>{setup_id});
  EXPECT_EQ(code_of([&] { store->load(own(id)); }), ErrorCode::not_found);
  EXPECT_FALSE(fs::exists(file(id)));
  EXPECT_FALSE(store->catalog().find_setup(own(setup_id)));
  EXPECT_EQ(code_of([&] { store->remove(own(id), WithSetups::remove); }), ErrorCode::not_found);
  reopen();
  EXPECT_EQ(store->catalog().counts().geometries, 0u);
}

TEST_F(GeometryStoreTest, setups_survive_and_need_their_geometry) {
  const std::string id = put(mesh);
  put_setup(setup_id, id);
  EXPECT_EQ(code_of([&] { put_setup(std::string(64, 'd'), std::string(64, 'e')); }), ErrorCode::not_found);
  reopen();
  const auto record = store->catalog().find_setup(own(setup_id));
  ASSERT_TRUE(record);
  EXPECT_EQ(record->geometry_id, id);
  EXPECT_EQ(record->setup, "setup");
  EXPECT_TRUE(store->remove_setup(own(setup_id)));
  EXPECT_FALSE(store->remove_setup(own(setup_id)));
}

TEST_F(GeometryStoreTest, ids_by_prefix) {
  const std::string id = put(mesh);
  EXPECT_EQ(store->resolve_geometry(default_tenant, id).id, id);
  EXPECT_EQ(store->resolve_geometry(default_tenant, id.substr(0, 8)).id, id);
  EXPECT_EQ(code_of([&] { store->resolve_geometry(default_tenant, id.substr(0, 7)).id; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code_of([&] { store->resolve_geometry(default_tenant, "").id; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code_of([&] { store->resolve_geometry(default_tenant, std::string(64, 'G')).id; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code_of([&] { store->resolve_geometry(default_tenant, std::string(8, '%')).id; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code_of([&] { store->resolve_geometry(default_tenant, id + "0").id; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code_of([&] { store->resolve_geometry(default_tenant, std::string(64, 'f')).id; }), ErrorCode::not_found);
  const std::string twin = std::string(63, 'a') + "2";
  put_setup(setup_id, id);
  put_setup(twin, id);
  EXPECT_EQ(code_of([&] { store->resolve_setup(default_tenant, std::string(10, 'a')).id; }), ErrorCode::invalid_argument);
  EXPECT_EQ(store->resolve_setup(default_tenant, twin).id, twin);
}

TEST_F(GeometryStoreTest, listing_in_pages_newest_first) {
  std::vector<std::string> ids;
  for (int i = 0; i < 7; ++i) ids.push_back(put(sheet_mesh(4, 3, 0.1 * i), "mesh" + std::to_string(i)));
  std::vector<std::string> seen;
  v1::ListGeometriesRequest request;
  request.set_page_size(3);
  std::int64_t last = INT64_MAX;
  for (int page = 0; page < 3; ++page) {
    const v1::ListGeometriesReply reply = store->list(default_tenant, request);
    for (const auto& info : reply.geometries()) {
      seen.push_back(info.id());
      EXPECT_LE(info.registered_unix_ms(), last);
      last = info.registered_unix_ms();
    }
    request.set_page_token(reply.next_page_token());
  }
  EXPECT_TRUE(request.page_token().empty());
  std::sort(seen.begin(), seen.end());
  std::sort(ids.begin(), ids.end());
  EXPECT_EQ(seen, ids);
}

TEST_F(GeometryStoreTest, page_tokens_and_sizes_are_checked) {
  for (const std::string token : {"x", "12", "12:", "12:zz", ":", "99999999999999999999:a", "12:abc:def"}) {
    v1::ListGeometriesRequest request;
    request.set_page_token(token);
    EXPECT_EQ(code_of([&] { store->list(default_tenant, request); }), ErrorCode::invalid_argument) << token;
  }
  v1::ListGeometriesRequest request;
  request.set_page_size(1001);
  EXPECT_EQ(code_of([&] { store->list(default_tenant, request); }), ErrorCode::invalid_argument);
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

TEST_F(GeometryStoreTest, several_threads_put_and_remove_the_same) {
  const std::string id = mesh_id(mesh);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < 10; ++i) {
        try {
          t % 2 == 0 ? static_cast<void>(store->put(mesh, own(id), "n"))
                     : static_cast<void>(store->remove(own(id), WithSetups::refuse));
        } catch (const Error& error) {
          EXPECT_EQ(error.code(), ErrorCode::not_found) << error.what();
        }
      }
    });
  }
  for (auto& thread : threads) thread.join();
  store->put(mesh, own(id), "n");
  EXPECT_EQ(store->load(own(id)).points, mesh.points);
  EXPECT_TRUE(fs::is_empty(directory.path() / "tmp"));
}

}  // namespace
}  // namespace deform::server
