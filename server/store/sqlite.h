// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

namespace deform::server::sqlite {

struct Close {
  void operator()(sqlite3* db) const { sqlite3_close_v2(db); }
};
using Connection = std::unique_ptr<sqlite3, Close>;

/// Throws what the code of the connection's last call says: Error(data_loss) for a damaged file or one of something else,
/// Error(out_of_budget) for a full disk, else Error(unavailable).
[[noreturn]] void fail(sqlite3* db, int code);

/// flags: SQLITE_OPEN_READONLY, or SQLITE_OPEN_READWRITE with or without SQLITE_OPEN_CREATE. vfs: FileSystem::sqlite_vfs().
Connection open(const std::filesystem::path& file, int flags, const char* vfs = nullptr);

void execute(sqlite3* db, const char* sql);

/// PRAGMA user_version.
std::int64_t version_of(sqlite3* db);

/// One prepared statement, bound left to right, for one use.
class Statement {
 public:
  Statement(sqlite3* db, const char* sql);
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& text(std::string_view value);
  Statement& blob(const std::string& value);
  Statement& number(std::int64_t value);

  /// True when there is a row.
  bool step();
  /// The value of a text or a blob.
  std::string text_at(int column) const;
  std::int64_t number_at(int column) const { return sqlite3_column_int64(statement_, column); }

 private:
  Statement& bound(int code);
  sqlite3* db_;
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0;
};

/// Rolled back unless committed.
class Transaction {
 public:
  explicit Transaction(sqlite3* db) : db_(db) { execute(db, "BEGIN IMMEDIATE"); }
  ~Transaction() {
    if (!done_) sqlite3_exec(db_, "ROLLBACK", nullptr, nullptr, nullptr);
  }
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit() {
    execute(db_, "COMMIT");
    done_ = true;
  }

 private:
  sqlite3* db_;
  bool done_ = false;
};

}  // namespace deform::server::sqlite
