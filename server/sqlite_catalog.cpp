#include "server/sqlite_catalog.h"

#include <sqlite3.h>

#include <mutex>
#include <string_view>

#include "core/base/error.h"

namespace deform::server {

namespace {

constexpr int schema_version = 1;
constexpr const char* schema = R"(
  CREATE TABLE IF NOT EXISTS geometries (id TEXT PRIMARY KEY, info BLOB NOT NULL, created_ms INTEGER NOT NULL) WITHOUT ROWID;
  CREATE INDEX IF NOT EXISTS geometries_by_age ON geometries (created_ms DESC, id DESC);
  CREATE TABLE IF NOT EXISTS setups (id TEXT PRIMARY KEY, geometry_id TEXT NOT NULL REFERENCES geometries (id),
                                     setup BLOB NOT NULL, info BLOB NOT NULL, created_ms INTEGER NOT NULL) WITHOUT ROWID;
  CREATE INDEX IF NOT EXISTS setups_by_age ON setups (created_ms DESC, id DESC);
  CREATE INDEX IF NOT EXISTS setups_by_geometry ON setups (geometry_id, created_ms DESC, id DESC);
)";

[[noreturn]] void fail(sqlite3* db, int code) {
  const bool damaged = code == SQLITE_CORRUPT || code == SQLITE_NOTADB;
  throw Error(damaged ? ErrorCode::data_loss : ErrorCode::unavailable, std::string("catalog: ") + sqlite3_errmsg(db));
}

void execute(sqlite3* db, const char* sql) {
  const int code = sqlite3_exec(db, sql, nullptr, nullptr, nullptr);
  if (code != SQLITE_OK) fail(db, code);
}

/// One prepared statement, bound left to right, for one use.
class Statement {
 public:
  Statement(sqlite3* db, const char* sql) : db_(db) {
    const int code = sqlite3_prepare_v2(db, sql, -1, &statement_, nullptr);
    if (code != SQLITE_OK) fail(db, code);
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& text(std::string_view value) {
    return bound(sqlite3_bind_text(statement_, ++bound_, value.data(), static_cast<int>(value.size()), SQLITE_TRANSIENT));
  }
  Statement& blob(const std::string& value) {
    return bound(sqlite3_bind_blob64(statement_, ++bound_, value.data(), value.size(), SQLITE_TRANSIENT));
  }
  Statement& number(std::int64_t value) { return bound(sqlite3_bind_int64(statement_, ++bound_, value)); }

  /// True when there is a row.
  bool step() {
    const int code = sqlite3_step(statement_);
    if (code != SQLITE_ROW && code != SQLITE_DONE) fail(db_, code);
    return code == SQLITE_ROW;
  }
  std::string text_at(int column) const {
    const auto* data = static_cast<const char*>(sqlite3_column_blob(statement_, column));
    return data == nullptr ? std::string()
                           : std::string(data, static_cast<std::size_t>(sqlite3_column_bytes(statement_, column)));
  }
  std::int64_t number_at(int column) const { return sqlite3_column_int64(statement_, column); }

 private:
  Statement& bound(int code) {
    if (code != SQLITE_OK) fail(db_, code);
    return *this;
  }
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

struct Close {
  void operator()(sqlite3* db) const { sqlite3_close_v2(db); }
};

class SqliteCatalog : public Catalog {
 public:
  explicit SqliteCatalog(const std::filesystem::path& file) {
    sqlite3* db = nullptr;
    const int code =
        sqlite3_open_v2(file.c_str(), &db, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, nullptr);
    db_.reset(db);
    if (code != SQLITE_OK) fail(db, code);
    execute(db, "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON;");
    const std::int64_t version = read_version();
    if (version != 0 && version != schema_version) {
      throw Error(ErrorCode::data_loss, "catalog " + file.string() + " has schema version " + std::to_string(version) +
                                            ", this server knows " + std::to_string(schema_version));
    }
    Transaction transaction(db);
    execute(db, schema);
    execute(db, ("PRAGMA user_version = " + std::to_string(schema_version)).c_str());
    transaction.commit();
  }

  bool add_geometry(const GeometryRecord& record) override {
    const std::lock_guard lock(mutex_);
    Statement insert(db_.get(), "INSERT INTO geometries (id, info, created_ms) VALUES (?, ?, ?) ON CONFLICT (id) DO NOTHING");
    insert.text(record.id).blob(record.info).number(record.created_ms).step();
    return sqlite3_changes(db_.get()) > 0;
  }

  std::optional<GeometryRecord> find_geometry(const std::string& id) override {
    const std::lock_guard lock(mutex_);
    Statement query(db_.get(), "SELECT id, info, created_ms FROM geometries WHERE id = ?");
    if (!query.text(id).step()) return std::nullopt;
    return geometry_at(query);
  }

  std::vector<GeometryRecord> list_geometries(const std::optional<PageStart>& after, std::size_t limit) override {
    const std::lock_guard lock(mutex_);
    Statement query(db_.get(),
                    "SELECT id, info, created_ms FROM geometries WHERE (created_ms, id) < (?, ?) "
                    "ORDER BY created_ms DESC, id DESC LIMIT ?");
    bind_page(query, after).number(static_cast<std::int64_t>(limit));
    std::vector<GeometryRecord> records;
    while (query.step()) records.push_back(geometry_at(query));
    return records;
  }

  std::vector<std::string> remove_geometry(const std::string& id, WithSetups policy) override {
    const std::lock_guard lock(mutex_);
    Transaction transaction(db_.get());
    std::vector<std::string> setups;
    Statement query(db_.get(), "SELECT id FROM setups WHERE geometry_id = ?");
    query.text(id);
    while (query.step()) setups.push_back(query.text_at(0));
    if (!setups.empty() && policy == WithSetups::refuse) {
      throw Error(ErrorCode::failed_precondition, "geometry " + id + ": " + std::to_string(setups.size()) +
                                                      " setups refer to it; delete them too (with_setups) or release them first");
    }
    Statement(db_.get(), "DELETE FROM setups WHERE geometry_id = ?").text(id).step();
    Statement(db_.get(), "DELETE FROM geometries WHERE id = ?").text(id).step();
    if (sqlite3_changes(db_.get()) == 0) throw Error(ErrorCode::not_found, "geometry " + id + ": unknown id");
    transaction.commit();
    return setups;
  }

  void put_setup(const SetupRecord& record) override {
    const std::lock_guard lock(mutex_);
    Transaction transaction(db_.get());
    Statement exists(db_.get(), "SELECT 1 FROM geometries WHERE id = ?");
    if (!exists.text(record.geometry_id).step()) {
      throw Error(ErrorCode::not_found, "geometry " + record.geometry_id + ": unknown id");
    }
    Statement insert(db_.get(),
                     "INSERT INTO setups (id, geometry_id, setup, info, created_ms) VALUES (?, ?, ?, ?, ?) "
                     "ON CONFLICT (id) DO UPDATE SET info = excluded.info");
    insert.text(record.id).text(record.geometry_id).blob(record.setup).blob(record.info).number(record.created_ms).step();
    transaction.commit();
  }

  std::optional<SetupRecord> find_setup(const std::string& id) override {
    const std::lock_guard lock(mutex_);
    Statement query(db_.get(), "SELECT id, geometry_id, setup, info, created_ms FROM setups WHERE id = ?");
    if (!query.text(id).step()) return std::nullopt;
    return setup_at(query);
  }

  std::vector<SetupRecord> list_setups(const std::string& geometry_id, const std::optional<PageStart>& after,
                                       std::size_t limit) override {
    const std::lock_guard lock(mutex_);
    const std::string sql = std::string("SELECT id, geometry_id, setup, info, created_ms FROM setups WHERE ") +
                            (geometry_id.empty() ? "" : "geometry_id = ? AND ") +
                            "(created_ms, id) < (?, ?) ORDER BY created_ms DESC, id DESC LIMIT ?";
    Statement query(db_.get(), sql.c_str());
    if (!geometry_id.empty()) query.text(geometry_id);
    bind_page(query, after).number(static_cast<std::int64_t>(limit));
    std::vector<SetupRecord> records;
    while (query.step()) records.push_back(setup_at(query));
    return records;
  }

  bool remove_setup(const std::string& id) override {
    const std::lock_guard lock(mutex_);
    Statement(db_.get(), "DELETE FROM setups WHERE id = ?").text(id).step();
    return sqlite3_changes(db_.get()) > 0;
  }

  std::size_t setup_count(const std::string& geometry_id) override {
    const std::lock_guard lock(mutex_);
    return count_of("SELECT count(*) FROM setups WHERE geometry_id = ?", &geometry_id);
  }

  std::vector<std::string> geometry_ids(const std::string& prefix, std::size_t limit) override {
    return ids("SELECT id FROM geometries WHERE id >= ? AND id < ? ORDER BY id LIMIT ?", prefix, limit);
  }
  std::vector<std::string> setup_ids(const std::string& prefix, std::size_t limit) override {
    return ids("SELECT id FROM setups WHERE id >= ? AND id < ? ORDER BY id LIMIT ?", prefix, limit);
  }

  Counts counts() override {
    const std::lock_guard lock(mutex_);
    return {count_of("SELECT count(*) FROM geometries", nullptr), count_of("SELECT count(*) FROM setups", nullptr)};
  }

 private:
  std::int64_t read_version() {
    Statement query(db_.get(), "PRAGMA user_version");
    return query.step() ? query.number_at(0) : 0;
  }

  static GeometryRecord geometry_at(const Statement& row) { return {row.text_at(0), row.text_at(1), row.number_at(2)}; }
  static SetupRecord setup_at(const Statement& row) {
    return {row.text_at(0), row.text_at(1), row.text_at(2), row.text_at(3), row.number_at(4)};
  }
  static Statement& bind_page(Statement& query, const std::optional<PageStart>& after) {
    if (after) return query.number(after->created_ms).text(after->id);
    return query.number(INT64_MAX).text("");
  }

  std::size_t count_of(const char* sql, const std::string* id) {
    Statement query(db_.get(), sql);
    if (id != nullptr) query.text(*id);
    return query.step() ? static_cast<std::size_t>(query.number_at(0)) : 0;
  }

  std::vector<std::string> ids(const char* sql, const std::string& prefix, std::size_t limit) {
    const std::lock_guard lock(mutex_);
    Statement query(db_.get(), sql);
    query.text(prefix).text(prefix + "g").number(static_cast<std::int64_t>(limit));  // "g" sorts after every hexadecimal digit
    std::vector<std::string> found;
    while (query.step()) found.push_back(query.text_at(0));
    return found;
  }

  std::mutex mutex_;  // one connection, one statement at a time
  std::unique_ptr<sqlite3, Close> db_;
};

}  // namespace

std::unique_ptr<Catalog> open_sqlite_catalog(const std::filesystem::path& file) { return std::make_unique<SqliteCatalog>(file); }

}  // namespace deform::server
