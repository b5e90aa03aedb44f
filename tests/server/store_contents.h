// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <random>
#include <string>
#include <utility>

#include "proto/convert/setup.h"
#include "server/store/geometry_file.h"
#include "server/store/geometry_store.h"
#include "tests/server/server_fakes.h"
#include "tests/server/test_mesh.h"

namespace deform::server {

/// Small: hundreds of stores are opened.
inline StoreOptions small_store() {
  StoreOptions options;
  options.disk.keep_free = std::uint64_t{64} << 10;
  return options;
}

inline std::string file_content(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

inline void write_file(const std::filesystem::path& path, const std::string& content) {
  std::ofstream(path, std::ios::binary) << content;
}

/// Paths below a folder with the content of files: what must not change when a folder is left alone.
inline std::map<std::string, std::string> tree_of(const std::filesystem::path& folder) {
  std::map<std::string, std::string> tree;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    tree[entry.path().lexically_relative(folder).string()] = entry.is_regular_file() ? file_content(entry.path()) : "folder";
  }
  return tree;
}

/// As kill -9 leaves it: what the process has written is there, nothing is brought to an end.
inline void copy_folder(const std::filesystem::path& from, const std::filesystem::path& to) {
  std::filesystem::copy(from, to, std::filesystem::copy_options::recursive);
}

/// A setup of a sheet_mesh as preparing it stores it.
inline SetupRecord setup_record(const std::string& geometry_id, double lower, const std::string& tenant = default_tenant) {
  v1::Setup setup = sheet_setup(geometry_id);
  setup.mutable_variables(0)->set_lower(lower);
  const v1::Setup canonical = convert::canonical_setup(setup, geometry_id);
  v1::SystemInfo info;
  info.set_id(convert::system_id(canonical));
  info.set_geometry_id(geometry_id);
  info.set_centres(42);
  return {info.id(), geometry_id, canonical.SerializeAsString(), info.SerializeAsString(), unix_ms(), Integrity::intact, tenant};
}

/// What was put into a store, and must come out of it again, for the same tenant.
struct StoreContents {
  struct Registered {
    Mesh mesh;
    v1::GeometryInfo info;
  };
  static constexpr const char* tenants[] = {default_tenant, "acme", "b-2.x"};
  std::map<OwnedId, Registered> geometries;
  std::map<OwnedId, SetupRecord> setups;

  std::string add_geometry(Store& store, const Mesh& mesh, const std::string& name, const std::string& tenant = default_tenant) {
    const OwnedId id{tenant, mesh_id(mesh)};
    geometries[id] = {mesh, store.put(mesh, id, name)};
    return id.id;
  }
  std::string add_setup(Store& store, const std::string& geometry_id, double lower, const std::string& tenant = default_tenant) {
    SetupRecord record = setup_record(geometry_id, lower, tenant);
    record.created_ms = store.put_setup(record);
    setups.insert_or_assign(owned(record), record);
    return record.id;
  }
  /// A few geometries with a few setups each, some of them of several tenants.
  void add_some(Store& store, std::mt19937& random) {
    const auto below = [&](unsigned n) { return random() % n; };
    for (unsigned g = 0; g < 1 + below(3); ++g) {
      const Mesh mesh = sheet_mesh(4 + below(4), 3 + below(4), 0.001 * below(1'000'000));
      for (unsigned first = below(3), t = first; t <= first + below(2); ++t) {
        const std::string tenant = tenants[t % 3];
        const std::string id =
            add_geometry(store, mesh, "mesh " + std::to_string(below(1000)) + " of " + tenant + " \xc3\xbc.obj", tenant);
        for (unsigned s = 0; s < below(4); ++s) add_setup(store, id, -0.001 * (1 + below(1'000'000)), tenant);
      }
    }
  }

  void expect_in(Store& store) const {
    for (const auto& [id, registered] : geometries) {
      ASSERT_NO_THROW(EXPECT_EQ(store.load(id).points, registered.mesh.points) << key_of(id)) << key_of(id);
      const v1::GeometryInfo info = store.info(id);
      EXPECT_EQ(info.name(), registered.info.name());
      EXPECT_EQ(info.registered_unix_ms(), registered.info.registered_unix_ms());
      EXPECT_EQ(info.points(), registered.mesh.point_count());
      EXPECT_EQ(info.damage(), "");
    }
    for (const auto& [id, expected] : setups) {
      const auto found = store.find_setup(id);
      ASSERT_TRUE(found) << key_of(id);
      EXPECT_EQ(found->setup, expected.setup);
      EXPECT_EQ(found->info, expected.info);
      EXPECT_EQ(found->geometry_id, expected.geometry_id);
      EXPECT_EQ(found->created_ms, expected.created_ms);
      EXPECT_EQ(found->tenant, expected.tenant);
    }
  }
  /// That and nothing else, for any tenant.
  void expect_all_of(Store& store) const {
    expect_in(store);
    EXPECT_EQ(store.catalog().all_geometries().size(), geometries.size());
    EXPECT_EQ(store.catalog().all_setups().size(), setups.size());
    for (const std::string tenant : tenants) {
      const auto of_tenant = [&](const auto& entry) { return entry.first.tenant == tenant; };
      const auto has = std::count_if(geometries.begin(), geometries.end(), of_tenant);
      const auto prepared = std::count_if(setups.begin(), setups.end(), of_tenant);
      EXPECT_EQ(store.list(tenant, {}).geometries_size(), has) << tenant;
      EXPECT_EQ(store.catalog().list_setups({tenant, ""}, std::nullopt, 1000).size(), static_cast<std::size_t>(prepared))
          << tenant;
      const StoredAmount amount = store.amount_of(tenant);
      EXPECT_EQ(amount.geometries, static_cast<std::size_t>(has)) << tenant;
      EXPECT_EQ(amount.setups, static_cast<std::size_t>(prepared)) << tenant;
    }
  }
};

/// In memory where that can be: hundreds of stores are written, and what a kill leaves does not depend on the disk.
class QuickDirectory {
 public:
  QuickDirectory() {
    const std::filesystem::path memory = "/dev/shm";
    std::string pattern = (memory / "deform_test_XXXXXX").string();
    if (mkdtemp(pattern.data()) == nullptr) {
      pattern = (std::filesystem::temp_directory_path() / "deform_test_XXXXXX").string();
      if (mkdtemp(pattern.data()) == nullptr) throw std::runtime_error("no folder for temporary files");
    }
    path_ = pattern;
  }
  ~QuickDirectory() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  QuickDirectory(const QuickDirectory&) = delete;
  QuickDirectory& operator=(const QuickDirectory&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

class StoreTest : public testing::Test {
 protected:
  StoreTest() { spdlog::set_level(spdlog::level::off); }  // damage is caused on purpose

  static std::unique_ptr<GeometryStore> open(const std::filesystem::path& folder) {
    return std::make_unique<GeometryStore>(folder, small_store());
  }
  template <typename Action>
  static ErrorCode code_of(Action action) {
    try {
      action();
    } catch (const Error& error) {
      return error.code();
    }
    return ErrorCode::internal;
  }

  QuickDirectory directory;
  const std::filesystem::path data = directory.path() / "data";
};

}  // namespace deform::server
