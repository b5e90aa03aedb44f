// SPDX-License-Identifier: GPL-3.0-or-later
// Stores that deformd 0.1 has written: stopped, and killed with its catalog still in the log. Two sheets of 12 points with two
// setups each.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include "server/store/sqlite.h"
#include "server/store/sqlite_files.h"
#include "server/store/store_commands.h"
#include "tests/server/store_contents.h"

namespace deform::server::store_migration_test {
namespace {

namespace fs = std::filesystem;

class StoreOf01 : public StoreTest, public testing::WithParamInterface<const char*> {
 protected:
  StoreOf01() { copy_folder(fs::path(STORE_DATA) / GetParam(), data); }

  void expect_everything(GeometryStore& store) {
    const v1::ListGeometriesReply geometries = store.list(default_tenant, {});
    ASSERT_EQ(geometries.geometries_size(), 2);
    for (const auto& info : geometries.geometries()) {
      EXPECT_EQ(info.name(), info.id() == sheet ? "sheet.obj" : "other.obj");
      EXPECT_EQ(info.setups(), 2u);
      EXPECT_EQ(info.damage(), "");
      EXPECT_GT(info.registered_unix_ms(), 1'700'000'000'000);
      const Mesh mesh = store.load(own(info.id()));
      EXPECT_EQ(mesh_id(mesh), info.id());
      EXPECT_EQ(mesh.point_count(), 12u);
      EXPECT_EQ(mesh.groups.size(), 3u);
    }
    const auto setups = store.catalog().list_setups(own(""), std::nullopt, 100);
    ASSERT_EQ(setups.size(), 4u);
    for (const auto& record : setups) EXPECT_TRUE(is_plausible(record)) << record.id;
  }

  const std::string sheet = "66812522bc947ffdd659c1976bc3397d1714b4479d28d0e4551deb531ebeb004";
};

TEST_P(StoreOf01, is_marked_and_migrated_at_the_first_start_after_a_copy_of_its_catalog) {
  expect_everything(*open(data));
  EXPECT_TRUE(has_mark(data));
  struct stat status {};
  ASSERT_EQ(::stat(data.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0700u);
  const fs::path copy = data / "catalog.sqlite.schema-1";
  EXPECT_EQ(sqlite::version_of(sqlite::open(copy, SQLITE_OPEN_READONLY).get()), 1);
  EXPECT_EQ(salvage_catalog(copy).geometries.size(), 2u);
  EXPECT_EQ(salvage_catalog(copy).setups.size(), 4u);
  expect_everything(*open(data));
  EXPECT_EQ(check_store(data).outcome, StoreReport::Outcome::well);
}

TEST_P(StoreOf01, once_migrated_survives_the_loss_of_its_catalog) {
  open(data);
  fs::remove(data / "catalog.sqlite");
  expect_everything(*open(data));
}

TEST_P(StoreOf01, interrupted_between_mark_and_migration_is_migrated_at_the_next_start) {
  write_mark(data);
  expect_everything(*open(data));
  EXPECT_TRUE(fs::exists(data / "catalog.sqlite.schema-1"));
}

TEST_P(StoreOf01, files_that_it_had_quarantined_in_tmp_are_kept) {
  fs::create_directory(data / "tmp");
  write_file(data / "tmp" / (sheet + ".damaged"), "the only copy");
  write_file(data / "tmp" / (sheet + ".3"), "half an upload, as far as one can tell");
  expect_everything(*open(data));
  EXPECT_EQ(file_content(data / "damaged" / (sheet + ".damaged")), "the only copy");
  EXPECT_EQ(file_content(data / "unclaimed" / (sheet + ".3")), "half an upload, as far as one can tell");
}

TEST_P(StoreOf01, without_its_catalog_is_refused_until_it_is_rebuilt_by_hand) {
  fs::remove(data / "catalog.sqlite");
  fs::remove(data / "catalog.sqlite-wal");
  EXPECT_EQ(code_of([&] { open(data); }), ErrorCode::failed_precondition);
  rebuild_store(data);
  const auto store = open(data);
  EXPECT_EQ(store->load(own(sheet)).point_count(), 12u);
  EXPECT_EQ(store->list(default_tenant, {}).geometries_size(), 2);
}

INSTANTIATE_TEST_SUITE_P(Ends, StoreOf01, testing::Values("store_0_1_clean", "store_0_1_killed"),
                         [](const auto& instance) { return std::string(instance.param).substr(10); });

TEST_F(StoreTest, a_damaged_catalog_of_0_1_gives_what_can_still_be_read_of_it) {
  for (std::size_t offset = 4096; offset < 24576; offset += 1024) {
    const fs::path folder = directory.path() / std::to_string(offset);
    copy_folder(fs::path(STORE_DATA) / "store_0_1_clean", folder);
    std::string bytes = file_content(folder / "catalog.sqlite");
    bytes[offset] = static_cast<char>(bytes[offset] ^ 0x55);
    write_file(folder / "catalog.sqlite", bytes);
    const auto store = open(folder);
    const v1::ListGeometriesReply reply = store->list(default_tenant, {});
    ASSERT_EQ(reply.geometries_size(), 2) << offset;
    for (const auto& info : reply.geometries()) EXPECT_EQ(store->load(own(info.id())).point_count(), 12u) << offset;
  }
}

}  // namespace
}  // namespace deform::server::store_migration_test
