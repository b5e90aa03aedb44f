// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/sqlite_files.h"

#include <fcntl.h>
#include <spdlog/spdlog.h>

#include <map>

#include "core/base/error.h"
#include "deform/v1/deformation.pb.h"
#include "deform/v1/geometry.pb.h"
#include "server/store/catalog_records.h"
#include "server/store/file.h"
#include "server/store/sqlite.h"

namespace deform::server {

namespace {

namespace fs = std::filesystem;

/// The tables are described on the first page, which a catalog that was never checkpointed has in its log only.
constexpr std::size_t looked_at = std::size_t{1} << 20;

std::string beginning(const fs::path& path, FileSystem& files) {
  if (!is_file(files, path)) return {};
  std::string text(looked_at, '\0');
  text.resize(File(files, path, O_RDONLY).read(text.data(), text.size()));
  return text;
}

/// Calls take(row) for every row that can be read, from both ends.
template <typename Take>
void read_rows(sqlite3* db, const std::string& select, Take take) {
  for (const char* order : {" ORDER BY 1 ASC", " ORDER BY 1 DESC"}) {
    try {
      sqlite::Statement query(db, (select + order).c_str());
      while (query.step()) take(query);
      return;  // all were read
    } catch (const Error& error) {
      spdlog::debug("store: salvaging: {}", error.what());
    }
  }
}

bool has_checksums(sqlite3* db) {
  try {
    sqlite::Statement(db, "SELECT checksum FROM geometries LIMIT 1");
    return true;
  } catch (const Error&) {
    return false;
  }
}

}  // namespace

bool is_plausible(const GeometryRecord& record) {
  v1::GeometryInfo info;
  return is_full_id(record.id) && info.ParseFromString(record.info) && info.id() == record.id;
}

bool is_plausible(const SetupRecord& record) {
  v1::SystemInfo info;
  if (!is_full_id(record.id) || !info.ParseFromString(record.info)) return false;
  try {
    verify(record);
    return true;
  } catch (const Error&) {
    return false;
  }
}

bool is_catalog_of_0_1(const fs::path& file, FileSystem& files) {
  for (const fs::path& path : {file, fs::path(file.string() + "-wal")}) {
    const std::string text = beginning(path, files);
    if (text.find(
            "CREATE TABLE geometries (id TEXT PRIMARY KEY, info BLOB NOT NULL, created_ms INTEGER NOT NULL) WITHOUT ROWID") !=
            std::string::npos &&
        text.find("CREATE TABLE setups (id TEXT PRIMARY KEY, geometry_id TEXT NOT NULL REFERENCES geometries (id),") !=
            std::string::npos) {
      return true;
    }
  }
  return false;
}

void copy_catalog(const fs::path& from, const fs::path& to, FileSystem& files) {
  const fs::path part = to.string() + ".part";
  try_remove(files, part);
  {
    const auto source = sqlite::open(from, SQLITE_OPEN_READWRITE, files.sqlite_vfs());
    const auto target = sqlite::open(part, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, files.sqlite_vfs());
    sqlite3_backup* backup = sqlite3_backup_init(target.get(), "main", source.get(), "main");
    if (backup == nullptr) sqlite::fail(target.get(), sqlite3_errcode(target.get()));
    const int code = sqlite3_backup_step(backup, -1);
    sqlite3_backup_finish(backup);
    if (code != SQLITE_DONE) sqlite::fail(target.get(), code);
  }
  File(files, part, O_RDONLY).sync();
  move_file(files, part, to);
  sync_directory(files, to.parent_path());
}

Salvaged salvage_catalog(const fs::path& file, FileSystem& files) {
  std::map<OwnedId, GeometryRecord> geometries;
  std::map<OwnedId, SetupRecord> setups;
  std::map<std::int64_t, Intent> intents;
  try {
    const auto db = sqlite::open(file, SQLITE_OPEN_READONLY, files.sqlite_vfs());
    const bool checked = has_checksums(db.get());
    const std::string last = checked ? ", checksum" : "";
    // The key names the tenant in every version.
    read_rows(db.get(), "SELECT id, info, created_ms" + last + " FROM geometries", [&](const sqlite::Statement& row) {
      const auto id = owned_id(row.text_at(0));
      if (!id) return;
      GeometryRecord record{id->id, row.text_at(1), row.number_at(2), Integrity::intact, id->tenant};
      const bool whole = checked ? checksum(record) == row.text_at(3) : is_plausible(record);
      if (whole) geometries.emplace(*id, std::move(record));
    });
    read_rows(db.get(), "SELECT id, geometry_id, setup, info, created_ms" + last + " FROM setups",
              [&](const sqlite::Statement& row) {
                const auto id = owned_id(row.text_at(0)), geometry = owned_id(row.text_at(1));
                if (!id || !geometry || id->tenant != geometry->tenant) return;
                SetupRecord record{id->id,           geometry->id,      row.text_at(2), row.text_at(3),
                                   row.number_at(4), Integrity::intact, id->tenant};
                const bool whole = checked ? checksum(record) == row.text_at(5) : is_plausible(record);
                if (whole) setups.emplace(*id, std::move(record));
              });
    read_rows(db.get(), "SELECT number, entry FROM intents", [&](const sqlite::Statement& row) {
      Intent intent = decode_intent(row.text_at(1));
      intent.number = row.number_at(0);
      intents.emplace(intent.number, std::move(intent));
    });
  } catch (const std::exception& error) {
    spdlog::debug("store: salvaging: {}", error.what());
  }
  Salvaged salvaged;
  for (auto& [id, record] : geometries) salvaged.geometries.push_back(std::move(record));
  for (auto& [id, record] : setups) salvaged.setups.push_back(std::move(record));
  for (auto& [number, intent] : intents) salvaged.intents.push_back(std::move(intent));
  return salvaged;
}

}  // namespace deform::server
