// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/sqlite_catalog.h"

#include <spdlog/spdlog.h>

#include <mutex>

#include "core/base/error.h"
#include "server/store/catalog_records.h"
#include "server/store/file.h"
#include "server/store/sqlite.h"
#include "server/store/sqlite_files.h"

namespace deform::server {

namespace {

using sqlite::execute;
using sqlite::Statement;
using sqlite::Transaction;

constexpr int schema_version = 3;
// `id` and `geometry_id` are keys (key_of): of the default tenant they are what they were before there were tenants, so that a
// catalog of then needs no row written anew. `tenant` repeats what the key says, for the listings.
constexpr const char* schema = R"(
  CREATE TABLE IF NOT EXISTS geometries (id TEXT PRIMARY KEY, info BLOB NOT NULL, created_ms INTEGER NOT NULL,
                                         checksum TEXT NOT NULL DEFAULT '',
                                         tenant TEXT NOT NULL DEFAULT 'default') WITHOUT ROWID;
  CREATE INDEX IF NOT EXISTS geometries_of_tenant ON geometries (tenant, created_ms DESC, id DESC);
  CREATE TABLE IF NOT EXISTS setups (id TEXT PRIMARY KEY, geometry_id TEXT NOT NULL REFERENCES geometries (id),
                                     setup BLOB NOT NULL, info BLOB NOT NULL, created_ms INTEGER NOT NULL,
                                     checksum TEXT NOT NULL DEFAULT '',
                                     tenant TEXT NOT NULL DEFAULT 'default') WITHOUT ROWID;
  CREATE INDEX IF NOT EXISTS setups_of_tenant ON setups (tenant, created_ms DESC, id DESC);
  CREATE INDEX IF NOT EXISTS setups_by_geometry ON setups (geometry_id, created_ms DESC, id DESC);
  CREATE TABLE IF NOT EXISTS intents (number INTEGER PRIMARY KEY AUTOINCREMENT, entry BLOB NOT NULL);
)";
constexpr const char* from_1_to_2 = R"(
  ALTER TABLE geometries ADD COLUMN checksum TEXT NOT NULL DEFAULT '';
  ALTER TABLE setups ADD COLUMN checksum TEXT NOT NULL DEFAULT '';
)";
constexpr const char* from_2_to_3 = R"(
  ALTER TABLE geometries ADD COLUMN tenant TEXT NOT NULL DEFAULT 'default';
  ALTER TABLE setups ADD COLUMN tenant TEXT NOT NULL DEFAULT 'default';
  DROP INDEX IF EXISTS geometries_by_age;
  DROP INDEX IF EXISTS setups_by_age;
)";
// The log is written back early and so stays small: what is reserved for it on a full disk is enough. Erasing what was deleted
// would write more than that.
constexpr const char* settings = R"(
  PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON; PRAGMA wal_autocheckpoint = 256;
  PRAGMA secure_delete = OFF;
)";

constexpr const char* select_geometries = "SELECT id, info, created_ms, checksum, tenant FROM geometries ";
constexpr const char* select_setups = "SELECT id, geometry_id, setup, info, created_ms, checksum, tenant FROM setups ";

/// The tenant and id of a row; what its key is no key of keeps it as its id, which marks the catalog as damaged.
template <typename Record>
void set_owner(Record& record, const std::string& key, const std::string& tenant) {
  const auto owner = owned_id(key);
  record.id = owner ? owner->id : key;
  if (owner) record.tenant = owner->tenant;
  if (!owner || owner->tenant != tenant) record.integrity = Integrity::damaged;
}

GeometryRecord geometry_at(const Statement& row) {
  GeometryRecord record{{}, row.text_at(1), row.number_at(2)};
  set_owner(record, row.text_at(0), row.text_at(4));
  if (checksum(record) != row.text_at(3)) record.integrity = Integrity::damaged;
  return record;
}

SetupRecord setup_at(const Statement& row) {
  SetupRecord record{{}, {}, row.text_at(2), row.text_at(3), row.number_at(4)};
  set_owner(record, row.text_at(0), row.text_at(6));
  const auto geometry = owned_id(row.text_at(1));
  if (geometry) record.geometry_id = geometry->id;
  if (!geometry || geometry->tenant != record.tenant || checksum(record) != row.text_at(5)) {
    record.integrity = Integrity::damaged;
  }
  return record;
}

std::string key(const GeometryRecord& record) { return key_of(owned(record)); }
std::string key(const SetupRecord& record) { return key_of(owned(record)); }
std::string geometry_key(const SetupRecord& record) { return key_of({record.tenant, record.geometry_id}); }

/// Rows of 0.1 that make no sense get no checksum, which marks them as damaged.
void add_checksums(sqlite3* db) {
  std::vector<GeometryRecord> geometries;
  std::vector<SetupRecord> setups;
  Statement all_geometries(db, select_geometries);
  while (all_geometries.step()) geometries.push_back(geometry_at(all_geometries));
  Statement all_setups(db, select_setups);
  while (all_setups.step()) setups.push_back(setup_at(all_setups));
  for (const auto& record : geometries) {
    if (!is_plausible(record)) continue;
    Statement(db, "UPDATE geometries SET checksum = ? WHERE id = ?").text(checksum(record)).text(record.id).step();
  }
  for (const auto& record : setups) {
    if (!is_plausible(record)) continue;
    Statement(db, "UPDATE setups SET checksum = ? WHERE id = ?").text(checksum(record)).text(record.id).step();
  }
}

sqlite::Connection open_for_writing(const std::filesystem::path& file, const char* vfs) {
  constexpr int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE;
  auto db = sqlite::open(file, flags, vfs);
  try {
    execute(db.get(), settings);
    return db;
  } catch (const Error& error) {
    if (error.code() != ErrorCode::out_of_budget) throw;
  }
  // Not even room for the index of the log, which is shared with a backup: it can be kept in memory, too.
  db = sqlite::open(file, flags, vfs);
  execute(db.get(), "PRAGMA locking_mode = EXCLUSIVE");
  execute(db.get(), settings);
  return db;
}

class SqliteCatalog : public Catalog {
 public:
  SqliteCatalog(const std::filesystem::path& file, FileSystem& files) {
    db_ = open_for_writing(file, files.sqlite_vfs());
    const std::int64_t version = sqlite::version_of(db_.get());
    if (version == schema_version) return;
    if (version < 0 || version > schema_version) {
      throw Error(ErrorCode::data_loss, "catalog " + file.string() + " has schema version " + std::to_string(version) +
                                            ", this server knows " + std::to_string(schema_version));
    }
    if (sqlite3_db_readonly(db_.get(), "main") == 1 && files.is_writable(file)) {
      throw Error(ErrorCode::data_loss, "catalog " + file.string() + " is damaged");
    }
    if (version == 1 || version == 2) check_storage();
    if (version == 1) {
      const std::filesystem::path copy = file.string() + ".schema-1";
      if (!exists(files, copy)) copy_catalog(file, copy, files);
      spdlog::info("store: migrating the catalog of deformd 0.1, whose copy is {}", copy.string());
    }
    Transaction transaction(db_.get());
    if (version == 1) execute(db_.get(), from_1_to_2);
    if (version == 1 || version == 2) execute(db_.get(), from_2_to_3);
    execute(db_.get(), schema);
    if (version == 1) add_checksums(db_.get());
    execute(db_.get(), ("PRAGMA user_version = " + std::to_string(schema_version)).c_str());
    transaction.commit();
    if (version == 2) spdlog::info("store: what is in the catalog belongs to the tenant \"{}\" now", default_tenant);
  }

  std::int64_t begin(const Intent& intent) override {
    const std::lock_guard lock(mutex_);
    return insert_intent(intent);
  }

  void end(std::int64_t number) override {
    const std::lock_guard lock(mutex_);
    delete_intent(number);
  }

  std::vector<Intent> intents() override {
    const std::lock_guard lock(mutex_);
    std::vector<Intent> found;
    Statement query(db_.get(), "SELECT number, entry FROM intents ORDER BY number");
    while (query.step()) {
      try {
        found.push_back(decode_intent(query.text_at(1)));
        found.back().number = query.number_at(0);
      } catch (const Error&) {
        spdlog::warn("store: intent {} is damaged; what it names is kept", query.number_at(0));
      }
    }
    return found;
  }

  bool add_geometry(const GeometryRecord& record, std::int64_t intent) override {
    const std::lock_guard lock(mutex_);
    Transaction transaction(db_.get());
    Statement known(db_.get(), (std::string(select_geometries) + "WHERE id = ?").c_str());
    const bool there = known.text(key(record)).step() && geometry_at(known).integrity == Integrity::intact;
    if (!there) write(record);
    delete_intent(intent);
    transaction.commit();
    return !there;
  }

  std::optional<GeometryRecord> find_geometry(const OwnedId& id) override {
    const std::lock_guard lock(mutex_);
    Statement query(db_.get(), (std::string(select_geometries) + "WHERE id = ?").c_str());
    if (!query.text(key_of(id)).step()) return std::nullopt;
    return geometry_at(query);
  }

  std::vector<GeometryRecord> list_geometries(const std::string& tenant, const std::optional<PageStart>& after,
                                              std::size_t limit) override {
    const std::lock_guard lock(mutex_);
    const std::string sql = std::string(select_geometries) +
                            "WHERE tenant = ? AND (created_ms, id) < (?, ?) ORDER BY created_ms DESC, id DESC LIMIT ?";
    Statement query(db_.get(), sql.c_str());
    bind_page(query.text(tenant), tenant, after).number(static_cast<std::int64_t>(limit));
    std::vector<GeometryRecord> records;
    while (query.step()) records.push_back(geometry_at(query));
    return records;
  }

  Intent remove_geometry(const OwnedId& id, WithSetups policy, const RowsGone& gone) override {
    const std::lock_guard lock(mutex_);
    Transaction transaction(db_.get());
    Intent intent{Intent::Kind::remove, {}};
    Statement setups(db_.get(), "SELECT id, created_ms FROM setups WHERE geometry_id = ?");
    setups.text(key_of(id));
    while (setups.step()) {
      const auto setup = owned_id(setups.text_at(0));
      if (setup) intent.entries.push_back({Intent::What::setup, setup->id, setups.number_at(1), {}, setup->tenant});
    }
    if (!intent.entries.empty() && policy == WithSetups::refuse) {
      throw Error(ErrorCode::failed_precondition, "geometry " + id.id + ": " + std::to_string(intent.entries.size()) +
                                                      " setups refer to it; delete them too (with_setups) or release them first");
    }
    Statement geometry(db_.get(), "SELECT created_ms FROM geometries WHERE id = ?");
    if (!geometry.text(key_of(id)).step()) throw unknown_geometry(id.id);
    intent.entries.push_back({Intent::What::geometry, id.id, geometry.number_at(0), {}, id.tenant});
    Statement(db_.get(), "DELETE FROM setups WHERE geometry_id = ?").text(key_of(id)).step();
    Statement(db_.get(), "DELETE FROM geometries WHERE id = ?").text(key_of(id)).step();
    intent.number = insert_intent(intent);
    transaction.commit();
    if (gone) gone(intent);
    return intent;
  }

  std::vector<std::string> owners_of(const std::string& geometry_id) override {
    const std::lock_guard lock(mutex_);
    Statement query(db_.get(), "SELECT tenant FROM geometries WHERE id >= ? AND id < ? ORDER BY id");
    query.text(geometry_id).text(geometry_id + "/");  // "/" sorts right after the "." before a tenant
    std::vector<std::string> tenants;
    while (query.step()) tenants.push_back(query.text_at(0));
    return tenants;
  }

  void put_setup(const SetupRecord& record, std::int64_t intent) override {
    const std::lock_guard lock(mutex_);
    Transaction transaction(db_.get());
    Statement exists(db_.get(), "SELECT 1 FROM geometries WHERE id = ?");
    if (!exists.text(geometry_key(record)).step()) throw unknown_geometry(record.geometry_id);
    write(record);
    delete_intent(intent);
    transaction.commit();
  }

  std::optional<SetupRecord> find_setup(const OwnedId& id) override {
    const std::lock_guard lock(mutex_);
    Statement query(db_.get(), (std::string(select_setups) + "WHERE id = ?").c_str());
    if (!query.text(key_of(id)).step()) return std::nullopt;
    return setup_at(query);
  }

  std::vector<SetupRecord> list_setups(const OwnedId& geometry, const std::optional<PageStart>& after,
                                       std::size_t limit) override {
    const std::lock_guard lock(mutex_);
    const std::string sql = std::string(select_setups) + "WHERE " + (geometry.id.empty() ? "tenant" : "geometry_id") +
                            " = ? AND (created_ms, id) < (?, ?) ORDER BY created_ms DESC, id DESC LIMIT ?";
    Statement query(db_.get(), sql.c_str());
    query.text(geometry.id.empty() ? geometry.tenant : key_of(geometry));
    bind_page(query, geometry.tenant, after).number(static_cast<std::int64_t>(limit));
    std::vector<SetupRecord> records;
    for (std::size_t bytes = 0; bytes < listed_bytes && query.step();) {
      records.push_back(setup_at(query));
      bytes += records.back().setup.size() + records.back().info.size();
    }
    return records;
  }

  std::optional<Intent> remove_setup(const OwnedId& id, const RowsGone& gone) override {
    const std::lock_guard lock(mutex_);
    Transaction transaction(db_.get());
    Statement setup(db_.get(), "SELECT created_ms FROM setups WHERE id = ?");
    if (!setup.text(key_of(id)).step()) return std::nullopt;
    Intent intent{Intent::Kind::remove, {{Intent::What::setup, id.id, setup.number_at(0), {}, id.tenant}}};
    Statement(db_.get(), "DELETE FROM setups WHERE id = ?").text(key_of(id)).step();
    intent.number = insert_intent(intent);
    transaction.commit();
    if (gone) gone(intent);
    return intent;
  }

  void restore(const std::vector<GeometryRecord>& geometries, const std::vector<SetupRecord>& setups) override {
    const std::lock_guard lock(mutex_);
    Transaction transaction(db_.get());
    for (const auto& record : geometries) write(record);
    for (const auto& record : setups) write(record);
    transaction.commit();
  }

  Damaged check() override {
    const std::lock_guard lock(mutex_);
    check_storage();
    Damaged damaged;
    Statement geometries(db_.get(), select_geometries);
    while (geometries.step()) {
      GeometryRecord record = geometry_at(geometries);
      if (record.integrity == Integrity::damaged) damaged.geometries.push_back(std::move(record));
    }
    Statement setups(db_.get(), select_setups);
    while (setups.step()) {
      SetupRecord record = setup_at(setups);
      if (record.integrity == Integrity::damaged) damaged.setups.push_back(std::move(record));
    }
    return damaged;
  }

  std::size_t setup_count(const OwnedId& geometry) override {
    const std::lock_guard lock(mutex_);
    Statement query(db_.get(), "SELECT count(*) FROM setups WHERE geometry_id = ?");
    return query.text(key_of(geometry)).step() ? static_cast<std::size_t>(query.number_at(0)) : 0;
  }

  // The + keeps SQLite from going through all rows of the tenant, by their index, instead of the few of the prefix.
  std::vector<std::string> geometry_ids(const std::string& tenant, const std::string& prefix, std::size_t limit) override {
    return ids("SELECT id FROM geometries WHERE id >= ? AND id < ? AND +tenant = ? ORDER BY id LIMIT ?", tenant, prefix, limit);
  }
  std::vector<std::string> setup_ids(const std::string& tenant, const std::string& prefix, std::size_t limit) override {
    return ids("SELECT id FROM setups WHERE id >= ? AND id < ? AND +tenant = ? ORDER BY id LIMIT ?", tenant, prefix, limit);
  }

  std::vector<OwnedId> all_geometries() override { return all("SELECT id FROM geometries ORDER BY id"); }
  std::vector<OwnedId> all_setups() override { return all("SELECT id FROM setups ORDER BY id"); }

  StoredAmount amount_of(const std::string& tenant) override {
    const std::lock_guard lock(mutex_);
    return amount(tenant);
  }

  std::map<std::string, StoredAmount> amounts() override {
    const std::lock_guard lock(mutex_);
    std::map<std::string, StoredAmount> amounts;
    Statement tenants(db_.get(), "SELECT tenant FROM geometries UNION SELECT tenant FROM setups");
    while (tenants.step()) amounts[tenants.text_at(0)] = amount(tenants.text_at(0));
    return amounts;
  }

  Counts counts() override {
    const std::lock_guard lock(mutex_);
    return {count_of("SELECT count(*) FROM geometries"), count_of("SELECT count(*) FROM setups")};
  }

 private:
  // The thorough check: the quick one does not compare the indices with the tables.
  void check_storage() {
    Statement check(db_.get(), "PRAGMA integrity_check(1)");
    if (check.step() && check.text_at(0) == "ok") return;
    throw Error(ErrorCode::data_loss, "catalog: " + check.text_at(0));
  }

  StoredAmount amount(const std::string& tenant) {
    StoredAmount amount;
    Statement geometries(db_.get(), (std::string(select_geometries) + "WHERE tenant = ?").c_str());
    geometries.text(tenant);
    while (geometries.step()) {
      ++amount.geometries;
      amount.bytes += stored_bytes(geometry_at(geometries));
    }
    Statement setups(db_.get(), "SELECT count(*), ifnull(sum(length(setup) + length(info)), 0) FROM setups WHERE tenant = ?");
    if (setups.text(tenant).step()) {
      amount.setups = static_cast<std::size_t>(setups.number_at(0));
      amount.bytes += static_cast<std::uint64_t>(setups.number_at(1));
    }
    return amount;
  }

  std::int64_t insert_intent(const Intent& intent) {
    Statement(db_.get(), "INSERT INTO intents (entry) VALUES (?)").blob(encode(intent)).step();
    return sqlite3_last_insert_rowid(db_.get());
  }
  void delete_intent(std::int64_t number) {
    if (number != 0) Statement(db_.get(), "DELETE FROM intents WHERE number = ?").number(number).step();
  }

  void write(const GeometryRecord& record) {
    Statement insert(db_.get(),
                     "INSERT INTO geometries (id, info, created_ms, checksum, tenant) VALUES (?, ?, ?, ?, ?) "
                     "ON CONFLICT (id) DO UPDATE SET info = excluded.info, created_ms = excluded.created_ms, "
                     "checksum = excluded.checksum, tenant = excluded.tenant");
    insert.text(key(record)).blob(record.info).number(record.created_ms).text(checksum(record)).text(record.tenant).step();
  }
  void write(const SetupRecord& record) {
    Statement insert(
        db_.get(),
        "INSERT INTO setups (id, geometry_id, setup, info, created_ms, checksum, tenant) VALUES (?, ?, ?, ?, ?, ?, ?) "
        "ON CONFLICT (id) DO UPDATE SET geometry_id = excluded.geometry_id, setup = excluded.setup, "
        "info = excluded.info, created_ms = excluded.created_ms, checksum = excluded.checksum, "
        "tenant = excluded.tenant");
    insert.text(key(record)).text(geometry_key(record)).blob(record.setup).blob(record.info).number(record.created_ms);
    insert.text(checksum(record)).text(record.tenant).step();
  }

  static Statement& bind_page(Statement& query, const std::string& tenant, const std::optional<PageStart>& after) {
    if (after) return query.number(after->created_ms).text(key_of({tenant, after->id}));
    return query.number(INT64_MAX).text("");
  }

  std::size_t count_of(const char* sql) {
    Statement query(db_.get(), sql);
    return query.step() ? static_cast<std::size_t>(query.number_at(0)) : 0;
  }

  std::vector<std::string> ids(const char* sql, const std::string& tenant, const std::string& prefix, std::size_t limit) {
    const std::lock_guard lock(mutex_);
    Statement query(db_.get(), sql);
    // "g" sorts after every hexadecimal digit
    query.text(prefix).text(prefix + "g").text(tenant).number(static_cast<std::int64_t>(limit));
    std::vector<std::string> found;
    while (query.step()) {
      if (const auto owned = owned_id(query.text_at(0))) found.push_back(owned->id);
    }
    return found;
  }

  std::vector<OwnedId> all(const char* sql) {
    const std::lock_guard lock(mutex_);
    Statement query(db_.get(), sql);
    std::vector<OwnedId> found;
    while (query.step()) {
      if (auto owned = owned_id(query.text_at(0))) found.push_back(*std::move(owned));
    }
    return found;
  }

  std::mutex mutex_;  // one connection, one statement at a time
  sqlite::Connection db_;
};

}  // namespace

std::unique_ptr<Catalog> open_sqlite_catalog(const std::filesystem::path& file, FileSystem& files) {
  return std::make_unique<SqliteCatalog>(file, files);
}

}  // namespace deform::server
