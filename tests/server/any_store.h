// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>

#include "server/store/store.h"
#include "tests/server/store_contents.h"

namespace deform::server {

/// One kind of store, for the tests that hold for all.
struct StoreKind {
  const char* name;
  /// The same folder is the same store, also when it is opened again.
  std::unique_ptr<Store> (*open)(const std::filesystem::path& folder);
};

class AnyStore : public testing::TestWithParam<StoreKind> {
 protected:
  AnyStore() {
    spdlog::set_level(spdlog::level::off);  // damage is caused on purpose, hundreds of times
    reopen();
  }
  void reopen() {
    store.reset();
    store = GetParam().open(directory.path());
  }
  std::string put(const Mesh& given, const std::string& name = "sheet") { return put_for(default_tenant, given, name).id; }
  OwnedId put_for(const std::string& tenant, const Mesh& given, const std::string& name = "sheet") {
    const OwnedId id{tenant, mesh_id(given)};
    store->put(given, id, name);
    return id;
  }
  void put_setup(const std::string& id, const std::string& geometry) {
    store->put_setup({id, geometry, "setup", "info", unix_ms()});
  }
  /// The file of a geometry of the default tenant; no such file when there is none.
  std::filesystem::path file(const std::string& id) const {
    const std::filesystem::path folder = directory.path() / "geometries";
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
      const std::string name = entry.path().filename().string();
      if (name == id || name.starts_with(id + "~")) return entry.path();
    }
    return folder / id;
  }
  static ErrorCode code_of(const std::function<void()>& action) {
    try {
      action();
    } catch (const Error& error) {
      return error.code();
    }
    return ErrorCode::internal;
  }
  /// The message with which a quota refuses an action.
  static std::string refusal(const std::function<void()>& action) {
    try {
      action();
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
      EXPECT_EQ(error.retry_after_ms(), 0u) << "waiting does not help";
      return error.what();
    }
    return "";
  }
  static void write(const std::filesystem::path& path, const std::string& text) { std::ofstream(path) << text; }

  TemporaryDirectory directory;
  std::unique_ptr<Store> store;
  const Mesh mesh = sheet_mesh(20, 10);
  const std::string setup_id = std::string(63, 'a') + "1";
};

}  // namespace deform::server
