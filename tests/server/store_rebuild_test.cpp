// SPDX-License-Identifier: GPL-3.0-or-later
// Whatever happens to the catalog, the files are the truth: nothing registered is lost, nothing unknown is deleted.
#include <gtest/gtest.h>

#include "server/store/sqlite.h"
#include "server/store/store_commands.h"
#include "tests/server/store_contents.h"

namespace deform::server::store_rebuild_test {
namespace {

namespace fs = std::filesystem;

/// One store with seeded contents, as a clean stop and as a kill leave it, and its catalog of yesterday.
class LostCatalog : public StoreTest, public testing::WithParamInterface<unsigned> {
 protected:
  LostCatalog() : random(GetParam()) {
    {
      const auto store = open(base);
      contents.add_some(*store, random);
    }
    fs::copy_file(base / "catalog.sqlite", yesterday);
    const auto store = open(base);
    contents.add_some(*store, random);
    copy_folder(base, killed);
  }

  /// A copy of the store to be harmed.
  fs::path fresh(const fs::path& from) {
    const fs::path to = directory.path() / ("copy" + std::to_string(copies++));
    copy_folder(from, to);
    return to;
  }
  fs::path catalog_of(const fs::path& folder) const { return folder / "catalog.sqlite"; }
  std::size_t anywhere(std::size_t size) { return random() % size; }
  void flip_a_byte(const fs::path& file) {
    std::string bytes = file_content(file);
    ASSERT_FALSE(bytes.empty());
    char& byte = bytes[anywhere(bytes.size())];
    byte = static_cast<char>(byte ^ (1u << (random() % 8)));
    write_file(file, bytes);
  }
  void expect_whole(const fs::path& folder) {
    {
      const auto store = open(folder);
      contents.expect_all_of(*store);
      EXPECT_EQ(count_entries(store_unclaimed(folder)), 0u);
    }
    const StoreReport report = check_store(folder);
    EXPECT_EQ(report.outcome, StoreReport::Outcome::well) << testing::PrintToString(report.lines);
    contents.expect_all_of(*open(folder));  // and at the next start
  }
  static fs::path store_unclaimed(const fs::path& folder) { return folder / "unclaimed"; }

  std::mt19937 random;
  const fs::path base = directory.path() / "base", killed = directory.path() / "killed",
                 yesterday = directory.path() / "yesterday";
  StoreContents contents;
  int copies = 0;
};

TEST_P(LostCatalog, removed) {
  const fs::path with_log = fresh(killed), alone = fresh(base);
  fs::remove(catalog_of(with_log));  // and its log is left
  expect_whole(with_log);
  fs::remove(catalog_of(alone));
  expect_whole(alone);
}

TEST_P(LostCatalog, emptied) {
  const fs::path with_log = fresh(killed), alone = fresh(base);
  fs::resize_file(catalog_of(with_log), 0);
  expect_whole(with_log);
  EXPECT_GT(count_entries(with_log / "damaged"), 0u) << "the log is kept";
  fs::resize_file(catalog_of(alone), 0);
  expect_whole(alone);
}

TEST_P(LostCatalog, one_flipped_bit_in_the_log) {
  const fs::path folder = fresh(killed);
  flip_a_byte(catalog_of(folder).string() + "-wal");
  expect_whole(folder);
}

TEST_P(LostCatalog, one_flipped_bit_in_the_file) {
  const fs::path folder = fresh(base);
  flip_a_byte(catalog_of(folder));
  expect_whole(folder);
}

TEST_P(LostCatalog, yesterdays_restored_over_todays_files) {
  const fs::path folder = fresh(base), with_log = fresh(killed);
  fs::copy_file(yesterday, catalog_of(folder), fs::copy_options::overwrite_existing);
  expect_whole(folder);
  fs::copy_file(yesterday, catalog_of(with_log), fs::copy_options::overwrite_existing);  // under the log of today
  expect_whole(with_log);
}

TEST_P(LostCatalog, cut_off) {
  const fs::path folder = fresh(base);
  fs::resize_file(catalog_of(folder), anywhere(fs::file_size(catalog_of(folder))));
  expect_whole(folder);
}

TEST_P(LostCatalog, a_page_that_cannot_be_read) {
  const fs::path folder = fresh(base);
  std::string bytes = file_content(catalog_of(folder));
  const std::size_t page = anywhere(bytes.size() / 4096);
  for (std::size_t i = 0; i < 4096; ++i) bytes[4096 * page + i] = static_cast<char>(random());
  write_file(catalog_of(folder), bytes);
  expect_whole(folder);
}

INSTANTIATE_TEST_SUITE_P(TwentyStores, LostCatalog, testing::Range(1u, 21u));

class StoreRebuild : public StoreTest {
 protected:
  StoreRebuild() {
    const auto store = open(data);
    id = contents.add_geometry(*store, sheet_mesh(5, 4), "wing.obj");
    setup_id = contents.add_setup(*store, id, -0.25);
  }
  /// Runs statements on the catalog behind the store's back, as a disk gone bad would.
  void alter(const std::string& sql) {
    sqlite::execute(sqlite::open(data / "catalog.sqlite", SQLITE_OPEN_READWRITE).get(), sql.c_str());
  }
  StoreContents contents;
  std::string id, setup_id;
};

TEST_F(StoreRebuild, a_file_whose_hash_is_its_name_is_adopted_and_any_other_is_kept_unclaimed) {
  const Mesh mesh = sheet_mesh(4, 4, 3);
  write_geometry_file(mesh, data / "geometries" / mesh_id(mesh));
  write_file(data / "geometries" / std::string(64, 'c'), "not what its name says");
  write_file(data / "geometries" / "notes.txt", "of an operator");
  fs::create_directory(data / "setups" / "folder");
  write_file(data / "names" / std::string(64, 'd'), "no record");
  write_file(data / "tmp" / (std::string(64, 'e') + ".7"), "no intent names it");
  const auto store = open(data);
  EXPECT_EQ(store->load(own(mesh_id(mesh))).points, mesh.points);
  EXPECT_EQ(file_content(data / "unclaimed" / std::string(64, 'c')), "not what its name says");
  EXPECT_EQ(file_content(data / "unclaimed" / "notes.txt"), "of an operator");
  EXPECT_TRUE(fs::is_directory(data / "unclaimed" / "folder"));
  EXPECT_EQ(store->state().unclaimed_files(), 5u);
  EXPECT_EQ(store->list(default_tenant, {}).geometries_size(), 2);
  contents.expect_in(*store);
}

TEST_F(StoreRebuild, a_file_that_no_upload_would_have_stored_is_not_adopted) {
  Mesh broken = sheet_mesh(4, 4);
  broken.face_points[0] = 99;  // the hash is right, the corner is out of range
  write_geometry_file(broken, data / "geometries" / mesh_id(broken));
  EXPECT_FALSE(open(data)->contains(own(mesh_id(broken))));
  EXPECT_TRUE(fs::exists(data / "unclaimed" / mesh_id(broken)));
}

TEST_F(StoreRebuild, what_is_unclaimed_or_damaged_is_never_overwritten) {
  for (int start = 0; start < 3; ++start) {
    write_file(data / "geometries" / "notes.txt", "version " + std::to_string(start));
    write_file(data / "geometries" / id, "damaged " + std::to_string(start));
    const auto store = open(data);
    EXPECT_EQ(code_of([&] { store->load(own(id)); }), ErrorCode::data_loss);
  }
  EXPECT_EQ(file_content(data / "unclaimed" / "notes.txt"), "version 0");
  EXPECT_EQ(file_content(data / "unclaimed" / "notes.txt.2"), "version 2");
  EXPECT_EQ(file_content(data / "damaged" / id), "damaged 0");
  EXPECT_EQ(file_content(data / "damaged" / (id + ".2")), "damaged 2");
}

TEST_F(StoreRebuild, a_damaged_file_is_told_in_the_listing_and_healed_by_registering_again) {
  write_file(data / "geometries" / id, "damaged");
  const auto store = open(data);
  EXPECT_EQ(code_of([&] { store->load(own(id)); }), ErrorCode::data_loss);
  EXPECT_NE(store->list(default_tenant, {}).geometries(0).damage(), "");
  EXPECT_EQ(store->list(default_tenant, {}).geometries(0).name(), "wing.obj");
  EXPECT_EQ(store->state().damaged_files(), 1u);
  EXPECT_TRUE(store->put(sheet_mesh(5, 4), own(id), "another name").existed());
  contents.expect_all_of(*store);
}

TEST_F(StoreRebuild, damaged_rows_are_mended_from_the_small_files_at_the_start) {
  alter("UPDATE geometries SET info = x'0102'; UPDATE setups SET setup = x'0304'");
  const auto store = open(data);
  contents.expect_all_of(*store);
  EXPECT_FALSE(fs::exists(data / "damaged" / "catalog.0")) << "the others of its rows are good";
}

TEST_F(StoreRebuild, one_damaged_row_does_not_break_a_listing) {
  const auto store = open(data);
  const Mesh other = sheet_mesh(4, 4, 2);
  contents.add_geometry(*store, other, "other.obj");
  fs::remove(data / "names" / id);
  alter("UPDATE geometries SET info = x'0102' WHERE id = '" + id + "'");  // while it is open
  const v1::ListGeometriesReply reply = store->list(default_tenant, {});
  ASSERT_EQ(reply.geometries_size(), 2);
  EXPECT_EQ(reply.geometries(0).damage() + reply.geometries(1).damage(),
            "the entry in the catalog is damaged; register the geometry again");
  EXPECT_FALSE(store->contains(own(id)));
  EXPECT_FALSE(store->put(sheet_mesh(5, 4), own(id), "wing.obj").existed());
  EXPECT_EQ(store->info(own(id)).damage(), "");
  EXPECT_EQ(store->info(own(id)).name(), "wing.obj");
}

TEST_F(StoreRebuild, a_healthy_start_reads_no_geometry_file) {
  write_file(data / "geometries" / id, "nobody looks");
  open(data);
  EXPECT_EQ(file_content(data / "geometries" / id), "nobody looks");
}

TEST_F(StoreRebuild, without_its_small_file_a_geometry_is_adopted_by_its_content) {
  fs::remove(data / "catalog.sqlite");
  fs::remove(data / "names" / id);
  const auto store = open(data);
  EXPECT_EQ(store->load(own(id)).points, sheet_mesh(5, 4).points);
  EXPECT_EQ(store->info(own(id)).name(), "");
  EXPECT_EQ(store->info(own(id)).points(), 20u);
  EXPECT_NEAR(static_cast<double>(store->info(own(id)).registered_unix_ms()), static_cast<double>(unix_ms()), 60'000);
  EXPECT_TRUE(store->find_setup(own(setup_id)));
}

TEST_F(StoreRebuild, a_setup_that_is_not_what_its_id_says_is_not_adopted) {
  fs::remove(data / "catalog.sqlite");
  const std::string good = file_content(data / "setups" / setup_id);
  write_file(data / "setups" / std::string(64, 'a'), good);
  std::string bad = good;
  bad[bad.size() / 2] = static_cast<char>(bad[bad.size() / 2] ^ 1);
  write_file(data / "setups" / setup_id, bad);
  const auto store = open(data);
  EXPECT_EQ(store->catalog().counts().setups, 0u);
  EXPECT_EQ(count_entries(data / "unclaimed") + count_entries(data / "damaged"), 2u) << "both are kept";
}

TEST_F(StoreRebuild, a_geometry_whose_file_was_lost_too_is_listed_and_its_setups_wait_for_it) {
  fs::remove(data / "catalog.sqlite");
  fs::remove(data / "geometries" / id);
  const auto store = open(data);
  EXPECT_NE(store->info(own(id)).damage(), "");
  EXPECT_EQ(store->info(own(id)).setups(), 1u);
  store->put(sheet_mesh(5, 4), own(id), "");
  contents.expect_all_of(*store);
}

TEST_F(StoreRebuild, deleting_removes_the_small_files_too) {
  const auto store = open(data);
  store->remove(own(id), WithSetups::remove);
  for (const char* folder : {"geometries", "names", "setups", "tmp"}) EXPECT_TRUE(fs::is_empty(data / folder)) << folder;
}

TEST_F(StoreRebuild, a_deletion_that_an_old_catalog_has_begun_spares_what_was_registered_since) {
  {
    const auto store = open(data);
    store->catalog().remove_geometry(own(id), WithSetups::remove, {});  // the rows and the intent; killed before the files
  }
  fs::copy(data, directory.path() / "then", fs::copy_options::recursive);
  {
    const auto store = open(data);  // ends the deletion
    EXPECT_EQ(store->catalog().counts().geometries, 0u);
    EXPECT_TRUE(fs::is_empty(data / "geometries"));
    contents = {};
    contents.add_geometry(*store, sheet_mesh(5, 4), "again.obj");
    contents.add_setup(*store, id, -0.25);
  }
  fs::copy_file(directory.path() / "then" / "catalog.sqlite", data / "catalog.sqlite", fs::copy_options::overwrite_existing);
  contents.expect_all_of(*open(data));
}

}  // namespace
}  // namespace deform::server::store_rebuild_test
