// SPDX-License-Identifier: GPL-3.0-or-later
// Backups of a store that servers share, and the way of a store of one server to them.
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "server/store/geometry_store.h"
#include "server/store/shared_store_copies.h"
#include "tests/server/postgres_database.h"
#include "tests/server/store_contents.h"

namespace deform::server::postgres_copies_test {
namespace {

namespace fs = std::filesystem;

class SharedStoreCopies : public StoreTest {
 protected:
  SharedStoreCopies() : shared(open_shared(folder, uri)) {}
  static std::unique_ptr<SharedStore> open_shared(const fs::path& at, const std::string& database,
                                                  SharedStoreOptions options = quick_store()) {
    return std::make_unique<SharedStore>(at, open_postgres_catalog(quick_postgres(database)), std::move(options));
  }
  void fill(Store& store) {
    for (unsigned seed = 1; seed <= 3; ++seed) {
      std::mt19937 random(seed);
      contents.add_some(store, random);
    }
    const std::string id = contents.add_geometry(store, sheet_mesh(5, 4), "wing");
    contents.add_setup(store, id, -0.25);
  }
  static std::string text(const StoreReport& report) {
    std::string all;
    for (const auto& line : report.lines) all += line + "\n";
    return all;
  }
  fs::path file_of(const OwnedId& id) const {
    for (const auto& entry : fs::directory_iterator(folder / "geometries")) {
      if (entry.path().filename().string().starts_with(key_of(id) + "~")) return entry.path();
    }
    return {};
  }

  const fs::path folder = directory.path() / "shared", backup = directory.path() / "backup";
  const std::string uri = new_database();
  std::unique_ptr<SharedStore> shared;
  StoreContents contents;
};

TEST_F(SharedStoreCopies, a_backup_is_the_store_of_one_server) {
  fill(*shared);
  const StoreReport report = shared->backup(backup);
  EXPECT_EQ(report.outcome, StoreReport::Outcome::well) << text(report);
  const StoreReport checked = check_store(backup);
  EXPECT_EQ(checked.outcome, StoreReport::Outcome::well) << text(checked);
  contents.expect_all_of(*open(backup));
  EXPECT_EQ(fs::hard_link_count(file_of(contents.geometries.begin()->first)), 2u);
  fs::remove(backup / "catalog.sqlite");
  EXPECT_EQ(rebuild_store(backup).outcome, StoreReport::Outcome::well) << "its small files say the same";
  contents.expect_all_of(*open(backup));
}

TEST_F(SharedStoreCopies, a_backup_is_restored_as_either_kind) {
  fill(*shared);
  shared->backup(backup);
  const auto other = open_shared(directory.path() / "other", new_database());
  EXPECT_EQ(restore_shared_store(backup, *other).outcome, StoreReport::Outcome::well);
  contents.expect_all_of(*other);
  EXPECT_EQ(code_of([&] { restore_shared_store(backup, *other); }), ErrorCode::failed_precondition) << "it is not empty";
  restore_store(backup, directory.path() / "alone");
  contents.expect_all_of(*open(directory.path() / "alone"));
  // And once around: a backup of what was restored is the same again.
  other->backup(directory.path() / "second");
  contents.expect_all_of(*open(directory.path() / "second"));
}

TEST_F(SharedStoreCopies, backups_while_others_register_and_delete_are_of_one_moment) {
  fill(*shared);
  const auto beside = open_shared(folder, uri);
  std::atomic<bool> stop{false};
  std::thread busy([&] {
    for (int i = 0; !stop; ++i) {
      const Mesh mesh = sheet_mesh(4, 4, 100 + i % 5);
      const std::string id = mesh_id(mesh);
      beside->put(mesh, own(id), "busy");
      beside->put_setup(setup_record(id, -0.1));
      beside->remove(own(id), WithSetups::remove);
    }
  });
  for (int i = 0; i < 5; ++i) {
    const fs::path to = backup.string() + std::to_string(i);
    EXPECT_EQ(shared->backup(to).outcome, StoreReport::Outcome::well);
    const StoreReport report = check_store(to);
    EXPECT_EQ(report.outcome, StoreReport::Outcome::well) << text(report);
    contents.expect_in(*open(to));
    EXPECT_LE(open(to)->catalog().all_geometries().size(), contents.geometries.size() + 1) << "one of them at a time";
  }
  stop = true;
  busy.join();
}

TEST_F(SharedStoreCopies, a_backup_names_what_is_damaged_and_has_the_rest) {
  fill(*shared);
  const OwnedId lost = contents.geometries.begin()->first, bad = contents.geometries.rbegin()->first;
  fs::remove(file_of(lost));
  sql(uri, "UPDATE deformd.geometries SET created_ms = created_ms + 1 WHERE id = $1", {key_of(bad)});
  const StoreReport report = shared->backup(backup);
  EXPECT_EQ(report.outcome, StoreReport::Outcome::faults);
  EXPECT_NE(text(report).find(lost.id), std::string::npos) << text(report);
  EXPECT_NE(text(report).find(bad.id), std::string::npos) << text(report);
  const auto opened = open(backup);
  for (const auto& [id, registered] : contents.geometries) {
    if (id == lost || id == bad) continue;
    EXPECT_EQ(opened->load(id).points, registered.mesh.points);
  }
  EXPECT_NE(opened->info(lost).damage(), "");
  EXPECT_FALSE(opened->contains(bad));
}

TEST_F(SharedStoreCopies, a_backup_without_the_folder_or_the_database_is_refused) {
  fill(*shared);
  fs::rename(folder, directory.path() / "away");
  EXPECT_EQ(code_of([&] { shared->backup(backup); }), ErrorCode::unavailable);
  fs::rename(directory.path() / "away", folder);
  EXPECT_EQ(code_of([&] { shared->backup(folder / "inside"); }), ErrorCode::invalid_argument);
  EXPECT_EQ(shared->backup(backup).outcome, StoreReport::Outcome::well);
  EXPECT_EQ(code_of([&] { shared->backup(backup); }), ErrorCode::failed_precondition) << "it is a store now";
}

TEST_F(SharedStoreCopies, an_import_brings_everything_and_again_nothing) {
  {
    const auto alone = open(data);
    fill(*alone);
  }
  const auto before = tree_of(data / "geometries");
  const StoreReport first = import_store(data, *shared);
  EXPECT_EQ(first.outcome, StoreReport::Outcome::well) << text(first);
  const std::string all =
      std::to_string(contents.geometries.size()) + " geometries, " + std::to_string(contents.setups.size()) + " setups";
  EXPECT_EQ(text(first), "added " + all + "; there already: 0 geometries, 0 setups\n");
  contents.expect_all_of(*shared);
  EXPECT_EQ(tree_of(data / "geometries"), before);
  const StoreReport second = import_store(data, *shared);
  EXPECT_EQ(second.outcome, StoreReport::Outcome::well);
  EXPECT_EQ(text(second), "added 0 geometries, 0 setups; there already: " + all + "\n");
  contents.expect_all_of(*shared);
  EXPECT_EQ(shared->check({}, [](const GeometryRecord&) { return nullptr; }).outcome, StoreReport::Outcome::well);
}

TEST_F(SharedStoreCopies, an_import_adds_to_what_is_there) {
  {
    const auto alone = open(data);
    fill(*alone);
  }
  const Mesh mesh = sheet_mesh(9, 3);
  shared->put(mesh, own(mesh_id(mesh)), "mine");
  shared->put(sheet_mesh(5, 4), own(mesh_id(sheet_mesh(5, 4))), "its name here");
  EXPECT_EQ(import_store(data, *shared).outcome, StoreReport::Outcome::well);
  EXPECT_EQ(shared->info(own(mesh_id(mesh))).name(), "mine");
  EXPECT_EQ(shared->info(own(mesh_id(sheet_mesh(5, 4)))).name(), "its name here") << "what is there stays as it is";
  EXPECT_EQ(shared->catalog().all_geometries().size(), contents.geometries.size() + 1);
  EXPECT_EQ(shared->catalog().all_setups().size(), contents.setups.size());
}

/// Wherever it stops, the next one goes on, and in the end all is there and nothing besides.
TEST_F(SharedStoreCopies, an_import_that_was_cut_off_goes_on) {
  {
    const auto alone = open(data);
    fill(*alone);
  }
  shared.reset();
  int stops = 0;
  for (bool done = false; !done;) {
    ASSERT_LT(stops, 200);
    SharedStoreOptions options = quick_store();
    int steps = 0;
    options.store.on_step = [&](const char*) {
      if (++steps == 4) throw Error(ErrorCode::unavailable, "cut off");
    };
    const auto store = open_shared(folder, uri, options);
    try {
      EXPECT_EQ(import_store(data, *store).outcome, StoreReport::Outcome::well);
      done = true;
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::unavailable) << error.what();
      ++stops;
    }
  }
  EXPECT_GT(stops, 1);
  contents.expect_all_of(*open_shared(folder, uri));
}

TEST_F(SharedStoreCopies, an_import_names_what_is_damaged_and_has_the_rest) {
  std::string setup;
  {
    const auto alone = open(data);
    fill(*alone);
  }
  const OwnedId bad = contents.geometries.begin()->first;
  write_file(data / "geometries" / key_of(bad), "damaged");
  const StoreReport report = import_store(data, *shared);
  EXPECT_EQ(report.outcome, StoreReport::Outcome::faults);
  EXPECT_NE(text(report).find("geometry " + bad.id), std::string::npos) << text(report);
  EXPECT_FALSE(shared->contains(bad));
  EXPECT_EQ(shared->catalog().all_geometries().size(), contents.geometries.size() - 1);
}

TEST_F(SharedStoreCopies, an_import_wants_a_store_of_one_server_that_nobody_has_open) {
  const auto alone = open(data);
  EXPECT_EQ(code_of([&] { import_store(data, *shared); }), ErrorCode::unavailable);
  EXPECT_EQ(code_of([&] { import_store(folder, *shared); }), ErrorCode::failed_precondition) << "the shared folder itself";
  EXPECT_EQ(code_of([&] { import_store(directory.path() / "nowhere", *shared); }), ErrorCode::failed_precondition);
}

}  // namespace
}  // namespace deform::server::postgres_copies_test
