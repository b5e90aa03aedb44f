// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/sqlite.h"

#include "core/base/error.h"

namespace deform::server::sqlite {

namespace {

constexpr int busy_ms = 10'000;  // a backup beside the server holds it up for moments only

ErrorCode meaning(int code) {
  switch (code) {
    case SQLITE_IOERR_READ:  // the disk cannot give back what was written to it
    case SQLITE_IOERR_SHORT_READ:
    case SQLITE_IOERR_CORRUPTFS:
      return ErrorCode::data_loss;
    case SQLITE_IOERR_SHMSIZE:
      return ErrorCode::out_of_budget;
    default:
      break;
  }
  switch (code & 0xff) {
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
    case SQLITE_FORMAT:
    case SQLITE_ERROR:  // our statements are right, so the tables are not ours
      return ErrorCode::data_loss;
    case SQLITE_FULL:
      return ErrorCode::out_of_budget;
    default:
      return ErrorCode::unavailable;
  }
}

}  // namespace

void fail(sqlite3* db, int code) {
  const int extended = db == nullptr ? code : sqlite3_extended_errcode(db);
  const ErrorCode kind = meaning((extended & 0xff) == (code & 0xff) ? extended : code);
  throw Error(kind, std::string("catalog: ") + (db == nullptr ? sqlite3_errstr(code) : sqlite3_errmsg(db)))
      .refused_for(kind == ErrorCode::out_of_budget ? Refusal::disk : Refusal::none);
}

Connection open(const std::filesystem::path& file, int flags, const char* vfs) {
  sqlite3* db = nullptr;
  const int code = sqlite3_open_v2(file.c_str(), &db, flags | SQLITE_OPEN_NOMUTEX, vfs);
  Connection connection(db);
  if (code != SQLITE_OK) fail(db, code);
  sqlite3_busy_timeout(db, busy_ms);
  return connection;
}

void execute(sqlite3* db, const char* sql) {
  const int code = sqlite3_exec(db, sql, nullptr, nullptr, nullptr);
  if (code != SQLITE_OK) fail(db, code);
}

std::int64_t version_of(sqlite3* db) {
  Statement query(db, "PRAGMA user_version");
  return query.step() ? query.number_at(0) : 0;
}

Statement::Statement(sqlite3* db, const char* sql) : db_(db) {
  const int code = sqlite3_prepare_v2(db, sql, -1, &statement_, nullptr);
  if (code != SQLITE_OK) fail(db, code);
}

Statement& Statement::text(std::string_view value) {
  return bound(sqlite3_bind_text(statement_, ++bound_, value.data(), static_cast<int>(value.size()), SQLITE_TRANSIENT));
}

Statement& Statement::blob(const std::string& value) {
  return bound(sqlite3_bind_blob64(statement_, ++bound_, value.data(), value.size(), SQLITE_TRANSIENT));
}

Statement& Statement::number(std::int64_t value) { return bound(sqlite3_bind_int64(statement_, ++bound_, value)); }

bool Statement::step() {
  const int code = sqlite3_step(statement_);
  if (code != SQLITE_ROW && code != SQLITE_DONE) fail(db_, code);
  return code == SQLITE_ROW;
}

std::string Statement::text_at(int column) const {
  const auto* data = static_cast<const char*>(sqlite3_column_blob(statement_, column));
  return data == nullptr ? std::string() : std::string(data, static_cast<std::size_t>(sqlite3_column_bytes(statement_, column)));
}

Statement& Statement::bound(int code) {
  if (code != SQLITE_OK) fail(db_, code);
  return *this;
}

}  // namespace deform::server::sqlite
