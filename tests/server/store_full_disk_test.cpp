// SPDX-License-Identifier: GPL-3.0-or-later
// A full disk: what is there is served, deleting works, adding is refused early. The disk is one that the test fills.
#include <gtest/gtest.h>

#include "server/store/disk_space.h"
#include "tests/server/engine_fixture.h"
#include "tests/server/store_contents.h"

namespace deform::server::store_full_disk_test {
namespace {

namespace fs = std::filesystem;

class FullDisk : public StoreTest {
 protected:
  FullDisk() {
    options.disk.keep_free = 1 << 20;
    options.disk.free_bytes = [this] { return free; };
  }
  std::uint64_t free = std::uint64_t{1} << 30;
  StoreOptions options;
};

TEST_F(FullDisk, it_starts_lists_loads_deletes_and_registers_again_once_there_is_room) {
  StoreContents contents;
  const Mesh mesh = sheet_mesh(5, 4), other = sheet_mesh(4, 4);
  {
    GeometryStore store(data, options);
    contents.add_setup(store, contents.add_geometry(store, mesh, "a.obj"), -0.1);
    contents.add_geometry(store, other, "b.obj");
    EXPECT_TRUE(store.state().writable());
    EXPECT_EQ(fs::file_size(data / "reserve"), 1u << 20);
  }
  free = 1000;
  GeometryStore store(data, options);
  contents.expect_all_of(store);
  EXPECT_FALSE(store.state().writable());
  EXPECT_NE(store.state().reason(), "");
  EXPECT_EQ(store.state().free_bytes(), 1000u);
  EXPECT_EQ(store.state().needed_bytes(), 1u << 20);
  EXPECT_EQ(code_of([&] { store.put(sheet_mesh(6, 6), own(mesh_id(sheet_mesh(6, 6))), "c.obj"); }), ErrorCode::out_of_budget);
  EXPECT_EQ(code_of([&] { store.put_setup(setup_record(mesh_id(mesh), -0.2)); }), ErrorCode::out_of_budget);
  try {
    store.put_setup(setup_record(mesh_id(mesh), -0.2));
  } catch (const Error& error) {
    EXPECT_EQ(error.refusal(), Refusal::disk);
  }
  EXPECT_NO_THROW(store.put_setup(setup_record(mesh_id(mesh), -0.1))) << "is there already";
  EXPECT_TRUE(store.put(mesh, own(mesh_id(mesh)), "").existed());
  store.remove(own(mesh_id(mesh)), WithSetups::remove);
  EXPECT_FALSE(store.contains(own(mesh_id(mesh))));
  free = std::uint64_t{1} << 30;
  EXPECT_TRUE(store.state().writable());
  store.put(mesh, own(mesh_id(mesh)), "a.obj");
  EXPECT_EQ(store.load(own(mesh_id(mesh))).points, mesh.points);
}

TEST_F(FullDisk, the_reserve_is_given_to_a_deletion_and_taken_back_when_there_is_room) {
  const fs::path reserve = data / "reserve";
  bool held = true;
  options.on_step = [&](const char*) { held = fs::exists(reserve); };
  GeometryStore store(data, options);
  const Mesh mesh = sheet_mesh(5, 4);
  store.put(mesh, own(mesh_id(mesh)), "a.obj");
  EXPECT_TRUE(held);
  free = 1000;
  store.remove(own(mesh_id(mesh)), WithSetups::refuse);
  EXPECT_FALSE(held) << "while it was deleted";
  free = std::uint64_t{1} << 30;
  store.state();
  EXPECT_EQ(fs::file_size(reserve), 1u << 20);
}

TEST_F(FullDisk, the_reserve_is_not_taken_back_while_it_is_lent) {
  fs::create_directories(data);
  DiskSpace disk(data, data / "reserve", options.disk);
  disk.hold();
  EXPECT_TRUE(fs::exists(data / "reserve"));
  free = 1000;
  {
    const DiskSpace::Room room(disk);
    EXPECT_FALSE(fs::exists(data / "reserve"));
    free = std::uint64_t{1} << 30;
    disk.hold();  // as the thread that watches the disk does
    EXPECT_FALSE(fs::exists(data / "reserve"));
  }
  EXPECT_TRUE(fs::exists(data / "reserve"));
}

TEST_F(FullDisk, what_an_upload_needs_counts_before_it_is_written) {
  GeometryStore store(data, options);
  free = (1 << 20) + 1000;
  EXPECT_NO_THROW(store.require_room(1000));
  EXPECT_EQ(code_of([&] { store.require_room(1001); }), ErrorCode::out_of_budget);
}

/// The engine on a store whose disk never has enough.
class FullDiskEngine : public EngineFixture {
 protected:
  void fill() {
    options.keep_free = std::size_t{1} << 60;
    reopen();
  }
  template <typename Action>
  static std::string refusal(Action action) {
    try {
      action();
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::out_of_budget) << error.what();
      return error.what();
    }
    return {};
  }
};

TEST_F(FullDiskEngine, uploads_are_refused_at_their_header_and_setups_before_they_are_prepared) {
  const Mesh mesh = sheet_mesh(12, 6);
  const std::string id = register_mesh(mesh).id();
  const v1::SystemInfo system = prepare(sheet_setup(id));
  EXPECT_TRUE(engine->info().store().writable());
  fill();
  EXPECT_FALSE(engine->info().store().writable());
  EXPECT_NE(refusal([&] { engine->begin_upload(header_of(sheet_mesh(9, 9)), {}); }).find("delete geometries"), std::string::npos);
  v1::Setup other = sheet_setup(id);
  other.mutable_variables(0)->set_lower(-0.25);
  EXPECT_NE(refusal([&] { prepare(other); }).find("must stay free"), std::string::npos);

  v1::GeometryHeader known = header_of(mesh);
  known.set_id(id);
  EXPECT_TRUE(engine->begin_upload(known, {})->already_stored());
  EXPECT_EQ(prepare(sheet_setup(id)).id(), system.id()) << "is stored already";
  EXPECT_EQ(deform(request_for(system.id(), {{0.1, 0}})).points.size(), 1u);
  v1::DeleteGeometryRequest request;
  request.set_id(id);
  request.set_with_setups(true);
  EXPECT_EQ(engine->delete_geometry(request, {}).setups_deleted(), 1u);
  EXPECT_EQ(engine->list_geometries({}, {}).geometries_size(), 0);
}

TEST_F(FullDiskEngine, a_system_says_when_its_setup_was_stored_first) {
  const std::string id = register_mesh(sheet_mesh(12, 6)).id();
  const v1::SystemInfo first = prepare(sheet_setup(id));
  EXPECT_GT(first.created_unix_ms(), 1'600'000'000'000);
  reopen();
  EXPECT_EQ(engine->get_system(first.id(), {}).created_unix_ms(), first.created_unix_ms());
  EXPECT_EQ(engine->list_systems({}, {}).systems(0).created_unix_ms(), first.created_unix_ms());
  EXPECT_EQ(prepare(sheet_setup(id)).created_unix_ms(), first.created_unix_ms()) << "preparing again is not storing first";
}

}  // namespace
}  // namespace deform::server::store_full_disk_test
