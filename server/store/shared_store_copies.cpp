// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/shared_store_copies.h"

#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "server/store/catalog_records.h"
#include "server/store/file.h"
#include "server/store/geometry_file.h"
#include "server/store/sqlite_catalog.h"
#include "server/store/store_copy.h"
#include "server/store/store_directory.h"

namespace deform::server {

namespace {

namespace fs = std::filesystem;

constexpr int most_rounds = 10;
/// Rows that are written in one transaction.
constexpr std::size_t most_rows = 256, most_row_bytes = std::size_t{4} << 20;

struct Counts {
  std::size_t geometries = 0, setups = 0;
};

std::string text_of(const Counts& counts) {
  return std::to_string(counts.geometries) + " geometries, " + std::to_string(counts.setups) + " setups";
}

/// Writes the rows of a snapshot as those of a store of one server: into its catalog, and as the small files beside it.
class RowsOfOne {
 public:
  RowsOfOne(StoreCopy& copy, FileSystem& files, StoreReport& report) : copy_(copy), files_(files), report_(report) {
    copy_.drop_catalog();
    for (const char* folder : {"names", "setups"}) copy_.drop_others(folder, {});
    catalog_ = open_sqlite_catalog(copy_.catalog(), files_);
  }

  void take(GeometryRecord&& record) {
    const OwnedId id = owned(record);
    if (record.integrity == Integrity::damaged) {
      return complain(report_, named("geometry", id) + ": its entry in the catalog is damaged; left out");
    }
    write_record(record, copy_.root() / "names" / key_of(id), Sync::later, files_);
    geometries.insert_or_assign(id, record.put);
    record.put = 0;
    bytes_ += record.info.size();
    new_geometries_.push_back(std::move(record));
    flush_when_full();
  }

  void take(SetupRecord&& record) {
    const OwnedId id = owned(record);
    if (record.integrity == Integrity::damaged || geometries.count({record.tenant, record.geometry_id}) == 0) {
      return complain(report_, named("system", id) + ": its entry in the catalog or that of its geometry is damaged; left out");
    }
    write_record(record, copy_.root() / "setups" / key_of(id), Sync::later, files_);
    ++setups;
    bytes_ += record.setup.size() + record.info.size();
    new_setups_.push_back(std::move(record));
    flush_when_full();
  }

  /// No more rows.
  void close() {
    flush();
    catalog_.reset();
  }

  std::map<OwnedId, std::int64_t> geometries;  ///< with the number of the put of its file
  std::size_t setups = 0;

 private:
  void flush_when_full() {
    if (new_geometries_.size() + new_setups_.size() >= most_rows || bytes_ >= most_row_bytes) flush();
  }
  void flush() {
    catalog_->restore(new_geometries_, new_setups_);
    new_geometries_.clear();
    new_setups_.clear();
    bytes_ = 0;
  }

  StoreCopy& copy_;
  FileSystem& files_;
  StoreReport& report_;
  std::unique_ptr<Catalog> catalog_;
  std::vector<GeometryRecord> new_geometries_;
  std::vector<SetupRecord> new_setups_;
  std::size_t bytes_ = 0;
};

fs::path file_of(const StoreDirectory& directory, const OwnedId& id, std::int64_t put) {
  return directory.geometries() / (key_of(id) + "~" + std::to_string(put));
}

/// The files of the rows; false when one of them has been removed or renewed since they were read. A content that is there is
/// that of its id, whatever put wrote it.
bool take_files(SharedCatalog& catalog, const StoreDirectory& directory, StoreCopy& copy, const RowsOfOne& rows,
                StoreReport& report) {
  for (const auto& [id, put] : rows.geometries) {
    if (copy.take(file_of(directory, id, put), "geometries", key_of(id))) continue;
    const auto now = catalog.find_geometry(id);
    if (!now || now->put != put) return false;
    if (!directory.is_reachable()) throw Error(ErrorCode::unavailable, "store: the shared folder cannot be reached");
    complain(report, named("geometry", id) + ": its file is missing in " + directory.files().shown(directory.root()));
  }
  return true;
}

std::set<std::string> keys_of(const std::map<OwnedId, std::int64_t>& geometries) {
  std::set<std::string> keys;
  for (const auto& entry : geometries) keys.insert(key_of(entry.first));
  return keys;
}

/// Adds one geometry and reads it back; false when it was there.
bool import_geometry(const StoreDirectory& source, const GeometryRecord& record, SharedStore& store) {
  const OwnedId id = owned(record);
  if (store.contains(id)) return false;
  store.put_again(read_geometry_file(source.geometries() / key_of(id), id.id, source.files()), record);
  store.load(id);  // verifies the hash
  return true;
}

bool import_setup(const SetupRecord& record, SharedStore& store) {
  verify(record);
  if (!store.catalog().setup_ids(record.tenant, record.id, 1).empty()) return false;
  store.put_setup_again(record);
  const auto stored = store.find_setup(owned(record));
  if (!stored) throw Error(ErrorCode::not_found, "it was deleted meanwhile");
  verify(*stored);
  return true;
}

}  // namespace

StoreReport backup_shared_store(SharedCatalog& catalog, const StoreDirectory& directory, const fs::path& to) {
  FileSystem& files = directory.files();
  const fs::path source = fs::weakly_canonical(directory.root()), target = fs::weakly_canonical(to);
  if (std::mismatch(source.begin(), source.end(), target.begin(), target.end()).first == source.end()) {
    throw Error(ErrorCode::invalid_argument,
                "store: " + to.string() + " is inside " + files.shown(source) + "; name a folder elsewhere");
  }
  StoreCopy copy(to, "the store with the catalog " + catalog.identity(), files);
  for (int round = 0; round < most_rounds; ++round) {
    StoreReport report;
    RowsOfOne rows(copy, files, report);
    catalog.snapshot([&](GeometryRecord&& record) { rows.take(std::move(record)); },
                     [&](SetupRecord&& record) { rows.take(std::move(record)); });
    rows.close();
    if (!take_files(catalog, directory, copy, rows, report)) continue;
    copy.drop_others("geometries", keys_of(rows.geometries));
    copy.finish();
    report.lines.push_back(text_of({rows.geometries.size(), rows.setups}));
    return report;
  }
  throw Error(ErrorCode::unavailable, "store: " + files.shown(source) + " changes too fast to be copied");
}

StoreReport import_store(const fs::path& from, SharedStore& store, FileSystem& files) {
  StoreReport report;
  if (is_interrupted_copy(from, files)) {
    throw Error(ErrorCode::failed_precondition, "store: " + from.string() + " has no mark: it is an unfinished backup");
  }
  const StoreDirectory source(from, StoreDirectory::Accept::existing, files);
  const auto catalog = open_sqlite_catalog(source.catalog(), files);
  Counts added, known;
  const auto each = [&](const char* what, const OwnedId& id, std::size_t Counts::*count, const auto& find, const auto& bring) {
    try {
      const auto record = find(id);
      if (!record || record->integrity == Integrity::damaged) {
        throw Error(ErrorCode::data_loss, "its entry in the catalog is damaged");
      }
      Counts& counts = bring(*record) ? added : known;
      ++(counts.*count);
    } catch (const Error& error) {
      // What concerns the whole ends it; it goes on when it is begun again.
      if (error.code() == ErrorCode::unavailable || error.code() == ErrorCode::out_of_budget) throw;
      complain(report, named(what, id) + ": " + error.what() + "; left out");
    }
  };
  for (const auto& id : catalog->all_geometries()) {
    each(
        "geometry", id, &Counts::geometries, [&](const OwnedId& one) { return catalog->find_geometry(one); },
        [&](const GeometryRecord& record) { return import_geometry(source, record, store); });
  }
  for (const auto& id : catalog->all_setups()) {
    each(
        "system", id, &Counts::setups, [&](const OwnedId& one) { return catalog->find_setup(one); },
        [&](const SetupRecord& record) { return import_setup(record, store); });
  }
  report.lines.push_back("added " + text_of(added) + "; there already: " + text_of(known));
  return report;
}

StoreReport restore_shared_store(const fs::path& from, SharedStore& store, FileSystem& files) {
  const Catalog::Counts there = store.catalog().counts();
  if (there.geometries + there.setups > 0) {
    throw Error(ErrorCode::failed_precondition, "store: the catalog is not empty (" + text_of({there.geometries, there.setups}) +
                                                    "); \"import\" adds to what is there, and goes on with a restore that was "
                                                    "interrupted");
  }
  return import_store(from, store, files);
}

}  // namespace deform::server
