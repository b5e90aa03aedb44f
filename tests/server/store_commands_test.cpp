// SPDX-License-Identifier: GPL-3.0-or-later
// What an operator does by hand: check, rebuild, backup, restore.
#include "server/store/store_commands.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "core/base/error.h"
#include "server/store/store_copy.h"
#include "tests/server/store_contents.h"

namespace deform::server::store_commands_test {
namespace {

namespace fs = std::filesystem;

class StoreCommands : public StoreTest {
 protected:
  StoreCommands() {
    const auto store = open(data);
    for (int i = 0; i < 3; ++i) {
      const std::string id = contents.add_geometry(*store, sheet_mesh(4, 4, i), "mesh" + std::to_string(i));
      contents.add_setup(*store, id, -0.1);
    }
    some_id = contents.geometries.begin()->first.id;
  }
  static std::string text(const StoreReport& report) {
    std::string all;
    for (const auto& line : report.lines) all += line + "\n";
    return all;
  }
  const fs::path backup = directory.path() / "backup";
  StoreContents contents;
  std::string some_id;
};

TEST_F(StoreCommands, check_finds_nothing_in_a_healthy_store_and_changes_nothing) {
  const auto before = tree_of(data);
  const StoreReport report = check_store(data);
  EXPECT_EQ(report.outcome, StoreReport::Outcome::well) << text(report);
  EXPECT_NE(text(report).find("3 geometries, 3 setups"), std::string::npos) << text(report);
  EXPECT_EQ(tree_of(data), before);
}

TEST_F(StoreCommands, check_names_every_kind_of_damage) {
  const std::string setup = contents.setups.begin()->first.id, last = contents.geometries.rbegin()->first.id;
  write_file(data / "geometries" / some_id, "damaged");
  fs::remove(data / "names" / last);
  write_file(data / "setups" / setup, "damaged");
  write_file(data / "geometries" / "stranger", "");
  const StoreReport report = check_store(data);
  EXPECT_EQ(report.outcome, StoreReport::Outcome::faults);
  for (const std::string& named : {"geometry " + some_id, "geometry " + last, "system " + setup, std::string("stranger")}) {
    EXPECT_NE(text(report).find(named), std::string::npos) << named << "\n" << text(report);
  }
  write_file(data / "catalog.sqlite", std::string(10000, 'x'));
  EXPECT_EQ(check_store(data).outcome, StoreReport::Outcome::faults);
  fs::remove(data / "catalog.sqlite");
  EXPECT_EQ(check_store(data).outcome, StoreReport::Outcome::faults);
}

TEST_F(StoreCommands, check_and_rebuild_need_a_stopped_server) {
  const auto store = open(data);
  EXPECT_EQ(code_of([&] { check_store(data); }), ErrorCode::unavailable);
  EXPECT_EQ(code_of([&] { rebuild_store(data); }), ErrorCode::unavailable);
}

TEST_F(StoreCommands, check_and_backup_of_what_is_no_store_make_none) {
  EXPECT_EQ(code_of([&] { check_store(directory.path() / "nothing"); }), ErrorCode::failed_precondition);
  EXPECT_EQ(code_of([&] { backup_store(directory.path() / "nothing", backup); }), ErrorCode::failed_precondition);
  EXPECT_FALSE(fs::exists(directory.path() / "nothing"));
  EXPECT_FALSE(fs::exists(backup));
}

TEST_F(StoreCommands, rebuild_makes_the_same_catalog_and_keeps_the_old_one) {
  const std::string old = file_content(data / "catalog.sqlite");
  const StoreReport report = rebuild_store(data);
  EXPECT_EQ(report.outcome, StoreReport::Outcome::well) << text(report);
  EXPECT_EQ(file_content(data / "damaged" / "catalog.0" / "catalog.sqlite"), old);
  contents.expect_all_of(*open(data));
}

TEST_F(StoreCommands, rebuild_does_not_bring_back_what_a_deletion_under_way_has_removed) {
  open(data)->catalog().remove_geometry(own(some_id), WithSetups::remove, {});  // killed before its files are removed
  rebuild_store(data);
  EXPECT_FALSE(open(data)->contains(own(some_id)));
  EXPECT_EQ(open(data)->catalog().counts().geometries, 2u);
}

TEST_F(StoreCommands, a_backup_beside_a_running_server_is_a_store_and_links_the_files) {
  const auto store = open(data);
  const StoreReport report = backup_store(data, backup);
  EXPECT_EQ(report.outcome, StoreReport::Outcome::well) << text(report);
  EXPECT_EQ(fs::hard_link_count(backup / "geometries" / some_id), 2u);
  store->remove(own(some_id), WithSetups::remove);
  contents.expect_all_of(*open(backup));
  EXPECT_EQ(check_store(backup).outcome, StoreReport::Outcome::well);
}

TEST_F(StoreCommands, a_backup_goes_to_empty_folders_only) {
  fs::create_directories(backup);
  write_file(backup / "photo.jpg", "precious");
  EXPECT_EQ(code_of([&] { backup_store(data, backup); }), ErrorCode::failed_precondition);
  EXPECT_EQ(tree_of(backup).size(), 1u);
}

TEST_F(StoreCommands, files_are_copied_where_links_cannot_go) {
  const TemporaryDirectory other;
  const fs::path elsewhere = other.path() / "backup";
  backup_store(data, elsewhere);
  // On one file system there is nothing to be copied; tests run where there are two.
  std::error_code error;
  fs::create_hard_link(data / "deformd-store", other.path() / "probe", error);
  EXPECT_EQ(fs::hard_link_count(elsewhere / "geometries" / some_id), error ? 1u : 2u);
  contents.expect_all_of(*open(elsewhere));
}

TEST_F(StoreCommands, restore_brings_everything_back_and_refuses_to_overwrite) {
  backup_store(data, backup);
  EXPECT_EQ(code_of([&] { restore_store(backup, data); }), ErrorCode::failed_precondition);
  contents.expect_all_of(*open(data));
  const fs::path restored = directory.path() / "restored";
  EXPECT_EQ(restore_store(backup, restored).outcome, StoreReport::Outcome::well);
  contents.expect_all_of(*open(restored));
}

TEST_F(StoreCommands, a_backup_that_was_not_finished_is_not_restored) {
  backup_store(data, backup);
  fs::remove(backup / "deformd-store");
  const auto says = [](const char* what, const std::function<void()>& action) {
    try {
      action();
      ADD_FAILURE();
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::failed_precondition);
      EXPECT_NE(std::string(error.what()).find(what), std::string::npos) << error.what();
    }
  };
  says("interrupted", [&] { restore_store(backup, directory.path() / "restored"); });
  says("remove it first", [&] { backup_store(data, backup); });
  says("begin it again", [&] { open(backup); });
  EXPECT_FALSE(fs::exists(directory.path() / "restored"));
}

/// Whatever an earlier run has left there.
TEST_F(StoreCommands, a_backup_that_was_interrupted_goes_on) {
  const std::string source = "the store in " + fs::weakly_canonical(data).string();
  const OwnedId whole = contents.geometries.begin()->first, half = contents.geometries.rbegin()->first;
  {
    StoreCopy copy(backup, source, system_files());
    EXPECT_EQ(code_of([&] { backup_store(data, backup); }), ErrorCode::unavailable) << "the other one is at it";
    copy.take(data / "geometries" / key_of(whole), "geometries", key_of(whole));
    write_file(backup / "geometries" / key_of(half), "half of it");
    write_file(backup / "names" / key_of(half), "of another time");
    write_file(backup / "setups" / std::string(64, 'a'), "deleted since then");
    write_file(backup / "catalog.sqlite", "half of it");
  }
  EXPECT_EQ(code_of([&] { open(backup); }), ErrorCode::failed_precondition) << "not yet a store";
  EXPECT_EQ(code_of([&] { restore_store(backup, directory.path() / "restored"); }), ErrorCode::failed_precondition);
  const fs::path another = directory.path() / "another";
  open(another);
  EXPECT_EQ(code_of([&] { backup_store(another, backup); }), ErrorCode::failed_precondition) << "a copy of something else";
  EXPECT_EQ(file_content(backup / "geometries" / key_of(half)), "half of it");
  EXPECT_EQ(backup_store(data, backup).outcome, StoreReport::Outcome::well);
  const StoreReport report = check_store(backup);
  EXPECT_EQ(report.outcome, StoreReport::Outcome::well) << text(report);
  contents.expect_all_of(*open(backup));
  EXPECT_FALSE(fs::exists(backup / unfinished_copy_name));
}

TEST_F(StoreCommands, backups_while_others_register_and_delete_are_consistent) {
  const auto store = open(data);
  std::atomic<bool> stop{false};
  std::thread busy([&] {
    for (int i = 0; !stop; ++i) {
      const Mesh mesh = sheet_mesh(4, 4, 100 + i % 5);
      const std::string id = mesh_id(mesh);
      store->put(mesh, own(id), "busy");
      store->put_setup(setup_record(id, -0.1));
      store->remove(own(id), WithSetups::remove);
    }
  });
  for (int i = 0; i < 5; ++i) {
    const fs::path to = backup.string() + std::to_string(i);
    EXPECT_EQ(backup_store(data, to).outcome, StoreReport::Outcome::well);
    const StoreReport report = check_store(to);
    EXPECT_EQ(report.outcome, StoreReport::Outcome::well) << text(report);
    contents.expect_in(*open(to));
  }
  stop = true;
  busy.join();
}

}  // namespace
}  // namespace deform::server::store_commands_test
