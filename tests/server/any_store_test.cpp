// SPDX-License-Identifier: GPL-3.0-or-later
// What every store keeps, whatever its catalog: durability, visibility, tenants and quotas.
#include <gtest/gtest.h>

#include <atomic>
#include <fstream>
#include <thread>

#include "tests/server/any_store.h"

namespace deform::server::any_store_test {
namespace {

namespace fs = std::filesystem;

TEST_P(AnyStore, what_was_put_comes_back_after_a_restart) {
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

TEST_P(AnyStore, points_only_is_a_geometry_too) {
  Mesh cloud;
  cloud.points = {{1, 2, 3}};
  const std::string id = put(cloud);
  EXPECT_EQ(store->load(own(id)).points, cloud.points);
}

TEST_P(AnyStore, what_is_cancelled_leaves_nothing) {
  std::stop_source stop;
  RunContext context;
  context.stop = stop.get_token();
  stop.request_stop();
  const std::string id = mesh_id(mesh);
  EXPECT_EQ(code_of([&] { store->put(mesh, own(id), "first", {Quota(), context}); }), ErrorCode::cancelled);
  EXPECT_FALSE(store->contains(own(id)));
  EXPECT_EQ(store->catalog().counts().geometries, 0u);
  EXPECT_EQ(store->amount_of(default_tenant).bytes, 0u);
  EXPECT_FALSE(fs::exists(file(id)));
  EXPECT_FALSE(store->put(mesh, own(id), "first").existed());
}

TEST_P(AnyStore, putting_twice_costs_nothing_and_says_so) {
  const std::string id = mesh_id(mesh);
  EXPECT_FALSE(store->put(mesh, own(id), "first").existed());
  const v1::GeometryInfo again = store->put(mesh, own(id), "second");
  EXPECT_TRUE(again.existed());
  EXPECT_EQ(again.name(), "first");
  EXPECT_EQ(store->catalog().counts().geometries, 1u);
}

TEST_P(AnyStore, a_row_without_its_file_is_data_loss_and_healed_by_registering_again) {
  const std::string id = put(mesh);
  fs::remove(file(id));
  reopen();
  EXPECT_FALSE(store->contains(own(id)));
  EXPECT_EQ(code_of([&] { store->load(own(id)); }), ErrorCode::data_loss);
  put(mesh);
  EXPECT_EQ(store->load(own(id)).points, mesh.points);
  EXPECT_EQ(store->list(default_tenant, {}).geometries_size(), 1);
}

TEST_P(AnyStore, every_damaged_byte_is_noticed) {
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

TEST_P(AnyStore, removing) {
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

TEST_P(AnyStore, setups_survive_and_need_their_geometry) {
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

TEST_P(AnyStore, ids_by_prefix) {
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

TEST_P(AnyStore, listing_in_pages_newest_first) {
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

TEST_P(AnyStore, page_tokens_and_sizes_are_checked) {
  for (const std::string token : {"x", "12", "12:", "12:zz", ":", "99999999999999999999:a", "12:abc:def"}) {
    v1::ListGeometriesRequest request;
    request.set_page_token(token);
    EXPECT_EQ(code_of([&] { store->list(default_tenant, request); }), ErrorCode::invalid_argument) << token;
  }
  v1::ListGeometriesRequest request;
  request.set_page_size(1001);
  EXPECT_EQ(code_of([&] { store->list(default_tenant, request); }), ErrorCode::invalid_argument);
}

TEST_P(AnyStore, several_threads_put_and_remove_the_same) {
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

// ---- tenants ----

TEST_P(AnyStore, what_another_has_is_as_unknown_as_what_nobody_has) {
  const OwnedId theirs = put_for("acme", mesh, "secret.obj");
  const std::string setup = setup_record(theirs.id, -0.1).id;
  store->put_setup(setup_record(theirs.id, -0.1, "acme"));
  for (const std::string stranger : {"default", "acm", "acme2", "b"}) {
    const OwnedId id{stranger, theirs.id};
    EXPECT_FALSE(store->contains(id));
    EXPECT_EQ(code_of([&] { store->info(id); }), ErrorCode::not_found);
    EXPECT_EQ(code_of([&] { store->load(id); }), ErrorCode::not_found);
    EXPECT_EQ(code_of([&] { store->remove(id, WithSetups::remove); }), ErrorCode::not_found);
    EXPECT_EQ(code_of([&] { store->resolve_geometry(stranger, theirs.id); }), ErrorCode::not_found);
    EXPECT_EQ(code_of([&] { store->resolve_geometry(stranger, theirs.id.substr(0, 8)); }), ErrorCode::not_found);
    EXPECT_EQ(code_of([&] { store->resolve_setup(stranger, setup); }), ErrorCode::not_found);
    EXPECT_FALSE(store->find_setup({stranger, setup}));
    EXPECT_FALSE(store->remove_setup({stranger, setup}));
    EXPECT_EQ(code_of([&] { store->put_setup(setup_record(theirs.id, -0.2, stranger)); }), ErrorCode::not_found);
    EXPECT_EQ(store->list(stranger, {}).geometries_size(), 0);
    EXPECT_TRUE(store->catalog().list_setups({stranger, ""}, std::nullopt, 10).empty());
    EXPECT_TRUE(store->catalog().list_setups(id, std::nullopt, 10).empty());
    EXPECT_EQ(store->amount_of(stranger).bytes, 0u);
  }
  EXPECT_TRUE(store->find_setup({"acme", setup}));
  EXPECT_EQ(store->list("acme", {}).geometries(0).name(), "secret.obj");
}

TEST_P(AnyStore, prefixes_are_unique_among_ones_own) {
  const OwnedId mine = put_for("acme", mesh);
  put_for("b", mesh);
  put_for(default_tenant, mesh);
  EXPECT_EQ(store->resolve_geometry("acme", mine.id.substr(0, 8)), mine);
}

TEST_P(AnyStore, setups_of_the_same_id_are_apart) {
  const OwnedId a = put_for("acme", mesh), b = put_for("b", mesh);
  const std::string setup = setup_record(mesh_id(mesh), -0.1).id;
  store->put_setup(setup_record(a.id, -0.1, "acme"));
  store->put_setup(setup_record(b.id, -0.1, "b"));
  EXPECT_EQ(store->info(a).setups(), 1u);
  EXPECT_EQ(code_of([&] { store->remove(a, WithSetups::refuse); }), ErrorCode::failed_precondition);
  EXPECT_TRUE(store->remove_setup({"acme", setup}));
  EXPECT_TRUE(store->find_setup({"b", setup}));
  EXPECT_EQ(store->info(b).setups(), 1u);
  store->put_setup(setup_record(a.id, -0.1, "acme"));
  store->remove(b, WithSetups::remove);
  EXPECT_TRUE(store->find_setup({"acme", setup}));
}

TEST_P(AnyStore, geometries_are_counted_by_tenant_and_room_comes_back) {
  const Quota two{0, 2, 0, 0};
  store->put(sheet_mesh(4, 4, 1), {"acme", mesh_id(sheet_mesh(4, 4, 1))}, "", two);
  store->put(sheet_mesh(4, 4, 2), {"acme", mesh_id(sheet_mesh(4, 4, 2))}, "", two);
  const OwnedId third{"acme", mesh_id(mesh)};
  const std::string why = refusal([&] { store->put(mesh, third, "", two); });
  EXPECT_NE(why.find("quota geometries of tenant \"acme\": 2 are registered, the limit is 2"), std::string::npos) << why;
  EXPECT_FALSE(store->contains(third));
  EXPECT_TRUE(fs::is_empty(directory.path() / "tmp"));
  EXPECT_EQ(refusal([&] { store->put(mesh, {"b", third.id}, "", two); }), "") << "of others that are full nobody hears";
  EXPECT_EQ(refusal([&] {
              store->put(sheet_mesh(4, 4, 1), {"acme", mesh_id(sheet_mesh(4, 4, 1))}, "", two);
            }),
            "")
      << "what is there takes no room";
  store->remove({"acme", mesh_id(sheet_mesh(4, 4, 1))}, WithSetups::refuse);
  EXPECT_EQ(refusal([&] { store->put(mesh, third, "", two); }), "");
}

TEST_P(AnyStore, puts_at_the_same_time_do_not_exceed_it_together) {
  const Quota three{0, 3, 0, 0};
  std::atomic<int> stored{0}, refused{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 12; ++i) {
    threads.emplace_back([&, i] {
      const Mesh own_mesh = sheet_mesh(12, 12, 1 + i);
      try {
        store->put(own_mesh, {"acme", mesh_id(own_mesh)}, "", three);
        ++stored;
      } catch (const Error&) {
        ++refused;
      }
    });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(stored, 3);
  EXPECT_EQ(refused, 9);
  EXPECT_EQ(store->list("acme", {}).geometries_size(), 3);
}

}  // namespace
}  // namespace deform::server::any_store_test
