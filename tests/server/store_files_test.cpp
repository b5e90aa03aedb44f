// SPDX-License-Identifier: GPL-3.0-or-later
// What clients are told of the files of a store whose disk fails: their names below its folder, and never where that is.
#include "server/store/store_files.h"

#include <fcntl.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cerrno>
#include <functional>
#include <numeric>
#include <set>
#include <string>
#include <string_view>

#include "core/base/error.h"
#include "server/store/file.h"
#include "tests/server/simulated_disk.h"
#include "tests/server/store_contents.h"

namespace deform::server::store_files_test {
namespace {

const std::filesystem::path secret = "/srv/of-nobody/data";

TEST(StoreFiles, what_is_below_the_folder_is_shown_below_it_and_the_rest_as_it_is) {
  SimulatedDisk disk(SimulatedDisk::empty());
  for (const char* folder : {"/srv/of-nobody/data", "/srv/of-nobody/data/", "/srv/of-nobody/./data"}) {
    const StoreFiles files(disk, folder, Naming::below_the_folder);
    EXPECT_EQ(files.shown(secret / "geometries" / "1a"), "geometries/1a");
    EXPECT_EQ(files.shown(secret), "the data directory");
    EXPECT_EQ(files.shown(secret / ""), "the data directory");
    EXPECT_EQ(files.shown("/srv/of-nobody/database"), "/srv/of-nobody/database");
    EXPECT_EQ(files.shown("/backup"), "/backup");
  }
  EXPECT_EQ(StoreFiles(disk, "data", Naming::below_the_folder).shown("data/tmp/1a"), "tmp/1a");
  EXPECT_EQ(StoreFiles(disk, secret, Naming::in_full).shown(secret / "tmp"), "/srv/of-nobody/data/tmp");
}

TEST(StoreFiles, a_folder_that_is_a_link_is_not_shown_by_where_it_leads_either) {
  const TemporaryDirectory directory;
  std::filesystem::create_directory(directory.path() / "disk");
  std::filesystem::create_directory_symlink(directory.path() / "disk", directory.path() / "data");
  const StoreFiles files(system_files(), directory.path() / "data", Naming::below_the_folder);
  EXPECT_EQ(files.shown(std::filesystem::canonical(directory.path()) / "disk" / "setups"), "setups");
}

TEST(StoreFiles, syncs_are_counted_those_that_fail_too) {
  SimulatedDisk disk(SimulatedDisk::empty());
  GeometryStore store(secret, [&] {
    StoreOptions options = small_store();
    options.files = &disk;
    return options;
  }());
  const auto count = [&] {
    const SyncTimes times = store.sync_times();
    return std::accumulate(times.counts.begin(), times.counts.end(), std::uint64_t{0});
  };
  const std::uint64_t opened = count();
  const Mesh mesh = sheet_mesh(4, 3);
  store.put(mesh, {default_tenant, mesh_id(mesh)}, "sheet");
  EXPECT_EQ(count(), opened + 4) << "the content, the small file and their folders";
  EXPECT_GT(store.sync_times().seconds, 0);
  StoreFiles files(disk, secret, Naming::in_full);
  const File file(files, secret / "names" / mesh_id(mesh), O_RDONLY);
  disk.fault = [](bool) { return EIO; };
  EXPECT_THROW(file.sync(), Error);
  disk.fault = nullptr;
  const SyncTimes times = files.sync_times();
  EXPECT_EQ(std::accumulate(times.counts.begin(), times.counts.end(), std::uint64_t{0}), 1u);
}

/// Every verb of a store, with the n-th access to its disk failing, for every n.
TEST(StoreFiles, no_error_of_a_failing_disk_tells_clients_where_the_store_is) {
  spdlog::set_level(spdlog::level::off);
  const Mesh mesh = sheet_mesh(4, 3), other = sheet_mesh(5, 3);
  const OwnedId id{default_tenant, mesh_id(mesh)};
  SimulatedDisk::State state = SimulatedDisk::empty();
  StoreOptions options = small_store();
  options.naming = Naming::below_the_folder;
  {
    SimulatedDisk disk(state);
    options.files = &disk;
    GeometryStore store(secret, options);
    store.put(mesh, id, "sheet");
    store.put_setup(setup_record(id.id, -0.1));
    state = disk.state();
  }
  std::set<std::string> told;
  std::size_t with_places = 0;
  const auto fails = [&](int error, const std::function<void(GeometryStore&)>& verb) {
    for (int n = 0;; ++n) {
      SimulatedDisk disk(state);
      options.files = &disk;
      GeometryStore store(secret, options);
      int left = n;
      disk.fault = [&](bool) { return left-- == 0 ? error : 0; };
      try {
        verb(store);
      } catch (const Error& failure) {
        const std::string_view to_clients = failure.public_message(), in_full = failure.what();
        EXPECT_EQ(to_clients.find("of-nobody"), std::string_view::npos) << to_clients;
        EXPECT_FALSE(to_clients.empty());
        EXPECT_EQ(failure.refusal(), failure.code() == ErrorCode::out_of_budget ? Refusal::disk : Refusal::none);
        if (in_full.find(secret.string()) != std::string_view::npos) {
          ++with_places;
          told.insert(std::string(to_clients.substr(0, to_clients.find_first_of("0123456789"))));
        }
      }
      disk.fault = nullptr;
      if (left >= 0) return;
    }
  };
  for (const int error : {EIO, ENOSPC}) {
    fails(error, [&](GeometryStore& store) { store.put(other, {default_tenant, mesh_id(other)}, "other"); });
    fails(error, [&](GeometryStore& store) { store.put_setup(setup_record(id.id, -0.2)); });
    fails(error, [&](GeometryStore& store) { store.load(id); });
    fails(error, [&](GeometryStore& store) { store.find_setup({default_tenant, setup_record(id.id, -0.1).id}); });
    fails(error, [&](GeometryStore& store) { store.list(default_tenant, {}); });
    fails(error, [&](GeometryStore& store) { store.remove(id, WithSetups::remove); });
    fails(error, [&](GeometryStore& store) { store.backup("/copies/1"); });
    fails(error, [&](GeometryStore& store) {
      const StoreReport report = store.check({}, [](const GeometryRecord&) { return nullptr; });
      for (const std::string& line : report.lines) EXPECT_EQ(line.find("of-nobody"), std::string::npos) << line;
    });
  }
  EXPECT_GT(with_places, 20u);
  for (const char* start : {"store: cannot open tmp/", "store: cannot write tmp/", "store: cannot move tmp/",
                            "store: cannot sync geometries: Input/output error"}) {
    EXPECT_TRUE(std::any_of(told.begin(), told.end(), [&](const std::string& one) { return one.starts_with(start); })) << start;
  }
  spdlog::set_level(spdlog::level::info);
}

}  // namespace
}  // namespace deform::server::store_files_test
