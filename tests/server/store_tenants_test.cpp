// SPDX-License-Identifier: GPL-3.0-or-later
// What belongs to whom on the disk: nothing of one tenant is lost by, given to or shown to another, whatever is damaged or
// killed.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <thread>

#include "server/store/catalog_records.h"
#include "server/store/sqlite.h"
#include "server/store/store_commands.h"
#include "tests/server/store_contents.h"

namespace deform::server::store_tenants_test {
namespace {

namespace fs = std::filesystem;

TEST(TenantNames, KeysAreReadAsTheyAreWritten) {
  const std::string id = std::string(63, 'a') + "0";
  EXPECT_EQ(key_of({default_tenant, id}), id);
  EXPECT_EQ(key_of({"acme", id}), id + ".acme");
  for (const std::string& tenant :
       {std::string("default"), std::string("acme"), std::string("0"), std::string("a.b-c_d"), std::string(64, 'x')}) {
    EXPECT_TRUE(is_tenant_name(tenant)) << tenant;
    EXPECT_EQ(owned_id(key_of({tenant, id})), (OwnedId{tenant, id}));
  }
  for (const std::string& bad : {std::string(), std::string("Acme"), std::string("a/b"), std::string("a b"), std::string(".a"),
                                 std::string("-a"), std::string("a\0b", 3), std::string(65, 'x'), std::string("ä")}) {
    EXPECT_FALSE(is_tenant_name(bad)) << bad;
    EXPECT_FALSE(owned_id(id + "." + bad)) << bad;
  }
  for (const std::string& bad :
       {std::string(), id.substr(1), id + "a", id + ".", id + ".default", id + "-acme", id + ".../acme"}) {
    EXPECT_FALSE(owned_id(bad)) << bad;
  }
}

class StoreOfTenants : public StoreTest {
 protected:
  StoreOfTenants() : store(open(data)) {}
  void reopen() {
    store.reset();
    store = open(data);
  }
  OwnedId put(const std::string& tenant, const Mesh& given, const std::string& name = "sheet") {
    const OwnedId id{tenant, mesh_id(given)};
    store->put(given, id, name);
    return id;
  }
  fs::path file(const OwnedId& id) const { return data / "geometries" / key_of(id); }

  std::unique_ptr<GeometryStore> store;
  const Mesh mesh = sheet_mesh(6, 5);
};

TEST_F(StoreOfTenants, the_same_content_is_stored_once_and_goes_with_the_last_of_its_owners) {
  const OwnedId a = put("acme", mesh, "a.obj"), b = put("b", mesh, "b.obj"), d = put(default_tenant, mesh, "d.obj");
  EXPECT_EQ(fs::hard_link_count(file(a)), 3u);
  EXPECT_TRUE(fs::equivalent(file(a), file(d)));
  EXPECT_EQ(store->info(a).name(), "a.obj");
  EXPECT_EQ(store->info(b).name(), "b.obj");
  store->remove(a, WithSetups::refuse);
  EXPECT_FALSE(fs::exists(file(a)));
  EXPECT_EQ(store->load(b).points, mesh.points);
  store->remove(d, WithSetups::refuse);
  reopen();
  EXPECT_EQ(store->load(b).points, mesh.points);
  EXPECT_EQ(store->info(b).name(), "b.obj");
  store->remove(b, WithSetups::refuse);
  for (const char* folder : {"geometries", "names", "tmp", "unclaimed"}) EXPECT_TRUE(fs::is_empty(data / folder)) << folder;
}

TEST_F(StoreOfTenants, whoever_registers_heals_what_others_have_of_it_and_passes_no_damage_on) {
  const OwnedId a = put("acme", mesh);
  write_file(file(a), "damaged");
  const OwnedId b = put("b", mesh);
  EXPECT_EQ(store->load(b).points, mesh.points);
  EXPECT_EQ(store->load(a).points, mesh.points);
}

TEST_F(StoreOfTenants, a_file_set_aside_for_one_stays_away_for_it_alone) {
  const OwnedId a = put("acme", mesh), b = put("b", mesh);
  fs::remove(file(a));
  write_file(file(a), "damaged");  // its own copy, no link any more
  EXPECT_EQ(code_of([&] { store->load(a); }), ErrorCode::data_loss);
  EXPECT_EQ(store->load(b).points, mesh.points);
  EXPECT_NE(store->info(a).damage(), "");
  EXPECT_EQ(store->info(b).damage(), "");
}

TEST_F(StoreOfTenants, without_the_catalog_everything_goes_to_whom_it_belongs) {
  const OwnedId a = put("acme", mesh, "a.obj"), b = put("b", sheet_mesh(5, 5), "b.obj"),
                c = put("acme", sheet_mesh(4, 5), "c.obj");
  store->put_setup(setup_record(a.id, -0.1, "acme"));
  store.reset();
  for (const bool small_files : {true, false}) {
    if (!small_files) fs::remove_all(data / "names");  // then the names of the contents are all there is
    fs::remove(data / "catalog.sqlite");
    reopen();
    EXPECT_EQ(store->list("acme", {}).geometries_size(), 2);
    EXPECT_EQ(store->list("b", {}).geometries_size(), 1);
    EXPECT_EQ(store->list(default_tenant, {}).geometries_size(), 0);
    EXPECT_EQ(store->load(b).points, sheet_mesh(5, 5).points);
    EXPECT_EQ(store->load(c).points, sheet_mesh(4, 5).points);
    EXPECT_EQ(store->info(a).name(), small_files ? "a.obj" : "");
    EXPECT_TRUE(store->find_setup({"acme", setup_record(a.id, -0.1).id}));
    store.reset();
  }
}

// A record that is moved to the name of another tenant is damaged, not theirs: the checksum covers the owner.
TEST_F(StoreOfTenants, a_small_file_under_another_tenants_name_is_not_believed) {
  const OwnedId a = put("acme", mesh, "secret.obj");
  store->put_setup(setup_record(a.id, -0.1, "acme"));
  store.reset();
  fs::remove(data / "catalog.sqlite");
  for (const char* folder : {"names", "setups"}) {
    for (const fs::directory_entry& entry : std::vector<fs::directory_entry>(fs::directory_iterator(data / folder), {})) {
      const auto id = owned_id(entry.path().filename().string());
      ASSERT_TRUE(id);
      fs::copy(entry.path(), data / folder / key_of({"thief", id->id}));
      fs::copy(entry.path(), data / folder / id->id);
    }
  }
  reopen();
  for (const std::string thief : {"thief", "default"}) {
    EXPECT_EQ(store->list(thief, {}).geometries_size(), 0) << thief;
    EXPECT_TRUE(store->catalog().list_setups({thief, ""}, std::nullopt, 10).empty()) << thief;
  }
  EXPECT_EQ(store->info(a).name(), "secret.obj");
}

TEST_F(StoreOfTenants, a_row_whose_owner_was_altered_is_mended_from_the_files) {
  const OwnedId a = put("acme", mesh, "secret.obj");
  store.reset();
  sqlite::execute(sqlite::open(data / "catalog.sqlite", SQLITE_OPEN_READWRITE).get(), "UPDATE geometries SET tenant = 'thief'");
  reopen();
  EXPECT_EQ(store->list("thief", {}).geometries_size(), 0);
  EXPECT_EQ(store->list("acme", {}).geometries_size(), 1);
  EXPECT_EQ(store->info(a).name(), "secret.obj");
}

TEST_F(StoreOfTenants, check_backup_restore_and_rebuild_know_them) {
  StoreContents contents;
  for (const char* tenant : StoreContents::tenants) {
    contents.add_geometry(*store, mesh, std::string("of ") + tenant, tenant);
    contents.add_setup(*store, mesh_id(mesh), -0.1, tenant);
  }
  const fs::path backup = directory.path() / "backup", restored = directory.path() / "restored";
  EXPECT_EQ(backup_store(data, backup).outcome, StoreReport::Outcome::well);
  store.reset();
  EXPECT_EQ(restore_store(backup, restored).outcome, StoreReport::Outcome::well);
  EXPECT_EQ(check_store(restored).outcome, StoreReport::Outcome::well);
  contents.expect_all_of(*open(restored));
  const StoreReport report = rebuild_store(restored);
  EXPECT_EQ(report.outcome, StoreReport::Outcome::well);
  contents.expect_all_of(*open(restored));
  const std::string lines = testing::PrintToString(check_store(restored).lines);
  EXPECT_NE(lines.find("tenant acme: 1 geometries, 1 setups"), std::string::npos) << lines;
  write_file(restored / "geometries" / key_of({"acme", mesh_id(mesh)}), "damaged");
  const std::string faults = testing::PrintToString(check_store(restored).lines);
  EXPECT_NE(faults.find(mesh_id(mesh) + " of tenant acme"), std::string::npos) << faults;
}

TEST_F(StoreOfTenants, a_copy_on_another_disk_shares_the_bytes_again) {
  put("acme", mesh);
  put("b", mesh);
  const auto device = [](const fs::path& path) {
    struct stat about = {};
    return ::stat(path.c_str(), &about) == 0 ? about.st_dev : dev_t{0};
  };
  for (const char* folder : {"/dev/shm", "/var/tmp"}) {
    if (device(folder) == device(data)) continue;
    std::string pattern = (fs::path(folder) / "deform_test_XXXXXX").string();
    if (::mkdtemp(pattern.data()) == nullptr) continue;
    backup_store(data, fs::path(pattern) / "backup");
    const fs::path geometries = fs::path(pattern) / "backup" / "geometries";
    EXPECT_TRUE(fs::equivalent(geometries / key_of({"acme", mesh_id(mesh)}), geometries / key_of({"b", mesh_id(mesh)})));
    fs::remove_all(pattern);
    return;
  }
  FAIL() << "both /dev/shm and /var/tmp are on the disk of the store";
}

// ---- quotas ----

class StoreQuotas : public StoreOfTenants {
 protected:
  std::string refusal(const std::function<void()>& action) {
    try {
      action();
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
      EXPECT_EQ(error.retry_after_ms(), 0u) << "waiting does not help";
      EXPECT_EQ(error.refusal(), Refusal::quota);
      return error.what();
    }
    return "";
  }
};

TEST_F(StoreQuotas, bytes_are_those_of_the_files_and_survive_restarts) {
  const OwnedId id = put("acme", mesh);
  store->put_setup(setup_record(id.id, -0.1, "acme"));
  const std::uint64_t stored = store->amount_of("acme").bytes;
  std::uint64_t on_disk = fs::file_size(file(id));
  for (const char* folder : {"names", "setups"}) {
    for (const auto& entry : fs::directory_iterator(data / folder)) on_disk += fs::file_size(entry.path());
  }
  EXPECT_GT(stored, on_disk - 1024) << "what files need beside their content is below a kilobyte";
  EXPECT_LE(stored, on_disk);
  reopen();
  EXPECT_EQ(store->amount_of("acme").bytes, stored);
  const Quota full{stored, 0, 0, 0};
  const std::string why = refusal([&] { store->put_setup(setup_record(id.id, -0.2, "acme"), full); });
  EXPECT_NE(why.find("quota stored-bytes of tenant \"acme\""), std::string::npos) << why;
  EXPECT_EQ(refusal([&] { store->put_setup(setup_record(id.id, -0.1, "acme"), full); }), "") << "the same again";
  EXPECT_NE(refusal([&] { store->put(sheet_mesh(4, 4), {"acme", mesh_id(sheet_mesh(4, 4))}, "", full); }), "");
  store->remove_setup({"acme", setup_record(id.id, -0.1).id});
  EXPECT_LT(store->amount_of("acme").bytes, stored);
  EXPECT_EQ(refusal([&] { store->put_setup(setup_record(id.id, -0.2, "acme"), full); }), "");
  store->remove(id, WithSetups::remove);
  EXPECT_EQ(store->amount_of("acme").bytes, 0u);
}

// Sharing must not be felt: each of those who have a content is charged all of it.
TEST_F(StoreQuotas, what_is_shared_counts_in_full_for_each) {
  put("acme", mesh, "same");
  put("b", mesh, "same");
  EXPECT_EQ(store->amount_of("acme").bytes, store->amount_of("b").bytes);
}

// ---- stores without tenants ----

/// A store as the version before tenants wrote it: the columns of schema 2, its mark.
class StoreOfFormat2 : public StoreTest {
 protected:
  StoreOfFormat2() {
    {
      const auto store = open(data);
      for (int i = 0; i < 3; ++i) {
        const std::string id = contents.add_geometry(*store, sheet_mesh(4, 4, i), "mesh" + std::to_string(i));
        contents.add_setup(*store, id, -0.1);
      }
    }
    const auto db = sqlite::open(data / "catalog.sqlite", SQLITE_OPEN_READWRITE);
    sqlite::execute(db.get(), R"(
      DROP INDEX geometries_of_tenant; DROP INDEX setups_of_tenant;
      ALTER TABLE geometries DROP COLUMN tenant; ALTER TABLE setups DROP COLUMN tenant;
      CREATE INDEX geometries_by_age ON geometries (created_ms DESC, id DESC);
      CREATE INDEX setups_by_age ON setups (created_ms DESC, id DESC);
      PRAGMA user_version = 2)");
    write_file(data / "deformd-store", "deformd store, format 2\n");
  }
  void expect_migrated(const fs::path& folder) {
    contents.expect_all_of(*open(folder));
    EXPECT_EQ(file_content(folder / "deformd-store"), "deformd store, format 3\n");
    EXPECT_EQ(sqlite::version_of(sqlite::open(folder / "catalog.sqlite", SQLITE_OPEN_READONLY).get()), 3);
    EXPECT_TRUE(fs::is_empty(folder / "damaged"));
    EXPECT_TRUE(fs::is_empty(folder / "unclaimed"));
    EXPECT_EQ(check_store(folder).outcome, StoreReport::Outcome::well);
  }
  StoreContents contents;
};

TEST_F(StoreOfFormat2, belongs_to_the_default_tenant_and_no_file_of_it_changes) {
  const auto before = tree_of(data);
  expect_migrated(data);
  for (const auto& [path, content] : before) {
    if (path.starts_with("catalog") || path == "deformd-store" || path == "reserve") continue;
    EXPECT_EQ(tree_of(data)[path], content) << path;
  }
}

TEST_F(StoreOfFormat2, killed_after_the_mark_is_migrated_at_the_next_start) {
  write_file(data / "deformd-store", "deformd store, format 3\n");
  expect_migrated(data);
}

TEST_F(StoreOfFormat2, killed_while_the_catalog_is_changed_is_as_before_or_after) {
  const fs::path killed = directory.path() / "killed";
  copy_folder(data, killed);
  const pid_t child = fork();
  if (child == 0) {
    const auto store = open(killed);
    _exit(0);  // the log of the catalog stays as it is
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  const std::string log = file_content(killed / "catalog.sqlite-wal");
  constexpr std::size_t frame = 4096 + 24, header = 32;
  ASSERT_GT(log.size(), header + 2 * frame) << "the migration is in the log";
  for (std::size_t size = 0; size <= log.size(); size += frame / 2) {
    SCOPED_TRACE(size);
    const fs::path folder = directory.path() / ("cut" + std::to_string(size));
    copy_folder(killed, folder);
    fs::remove(folder / "catalog.sqlite-shm");
    write_file(folder / "catalog.sqlite-wal", log.substr(0, size));
    expect_migrated(folder);
  }
}

TEST_F(StoreOfFormat2, without_its_catalog_is_rebuilt_for_the_default_tenant) {
  fs::remove(data / "catalog.sqlite");
  expect_migrated(data);
}

TEST_F(StoreOfFormat2, a_later_format_is_refused_and_left_alone) {
  write_file(data / "deformd-store", "deformd store, format 4\n");
  const auto before = tree_of(data);
  EXPECT_EQ(code_of([&] { open(data); }), ErrorCode::failed_precondition);
  auto after = tree_of(data);
  EXPECT_EQ(after, before);
}

}  // namespace
}  // namespace deform::server::store_tenants_test
