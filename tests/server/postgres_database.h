// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <initializer_list>
#include <map>
#include <stdexcept>
#include <string>

#include "server/store/postgres.h"
#include "server/store/postgres_catalog.h"
#include "server/store/shared_store.h"

namespace deform::server {

/// The PostgreSQL that tests/support/postgres.py has started for this process.
inline std::string postgres_uri(const std::string& database) {
  const char* folder = std::getenv("DEFORM_TEST_POSTGRES");
  if (folder == nullptr) throw std::runtime_error("run it as \"tests/support/postgres.py run THIS\"");
  return "postgresql:///" + database + "?host=" + folder + "&user=deformd";
}

/// start, stop, kill, pause or resume.
inline void control_postgres(const std::string& action) {
  const std::string command = std::string(std::getenv("DEFORM_TEST_POSTGRES_CONTROL")) + " " + action;
  if (std::system(command.c_str()) != 0) throw std::runtime_error(command + " failed");
}

inline postgres::Result sql(const std::string& uri, const char* statement,
                            std::initializer_list<postgres::Parameter> parameters = {}) {
  postgres::Connection connection(uri, std::chrono::seconds(20));
  return connection.run(statement, parameters);
}

/// An empty one; returns its URI.
inline std::string new_database() {
  static int number = 0;
  const std::string name = "test_" + std::to_string(getpid()) + "_" + std::to_string(++number);
  sql(postgres_uri("postgres"), ("CREATE DATABASE " + name).c_str());
  return postgres_uri(name);
}

/// The database that belongs to a folder.
inline std::string database_of(const std::filesystem::path& folder) {
  static std::map<std::string, std::string> known;
  auto& uri = known[folder.string()];
  if (uri.empty()) uri = new_database();
  return uri;
}

/// Quick to give up, and to clean up.
inline PostgresOptions quick_postgres(const std::string& uri) {
  PostgresOptions options;
  options.uri = uri;
  options.start_patience = std::chrono::seconds(20);
  options.call_patience = std::chrono::seconds(1);
  options.take_over_after = std::chrono::milliseconds(0);
  return options;
}

inline SharedStoreOptions quick_store() {
  SharedStoreOptions options;
  options.store.disk.keep_free = std::uint64_t{64} << 10;
  options.housekeeping = std::chrono::milliseconds(20);
  return options;
}

}  // namespace deform::server
