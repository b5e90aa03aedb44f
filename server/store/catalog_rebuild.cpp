// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/catalog_rebuild.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "core/base/error.h"
#include "proto/convert/mesh/geometry.h"
#include "server/store/basis_files.h"
#include "server/store/catalog_records.h"
#include "server/store/file.h"
#include "server/store/geometry_file.h"
#include "server/store/sqlite_catalog.h"
#include "server/store/sqlite_files.h"

namespace deform::server {

namespace {

namespace fs = std::filesystem;

std::set<OwnedId> as_set(const std::vector<OwnedId>& ids) { return {ids.begin(), ids.end()}; }

std::int64_t modified_ms(FileSystem& files, const fs::path& file) {
  struct stat status {};
  if (files.status(file, FileSystem::Links::follow, status) != 0) fail_on(files, "look at", file);
  return std::int64_t{status.st_mtim.tv_sec} * 1000 + status.st_mtim.tv_nsec / 1'000'000;
}

/// What `read` returns, or nothing when it says that there is nothing to be read.
template <typename Read>
auto unless_damaged(Read read) -> std::optional<decltype(read())> {
  try {
    return read();
  } catch (const Error& error) {
    if (error.code() != ErrorCode::data_loss && error.code() != ErrorCode::invalid_argument) throw;
    return std::nullopt;
  }
}

class Rebuild {
 public:
  Rebuild(const StoreDirectory& directory, OldCatalog old) : directory_(directory), files_(directory.files()) { open(old); }

  OpenedCatalog run() {
    for (const auto& stage : {&Rebuild::finish_intents, &Rebuild::clear_tmp, &Rebuild::mend, &Rebuild::adopt_geometries,
                              &Rebuild::adopt_setups, &Rebuild::end_intents, &Rebuild::record, &Rebuild::count_missing}) {
      try {
        (this->*stage)();
      } catch (const Error& error) {
        if (error.code() != ErrorCode::out_of_budget) throw;
        report_.full = true;  // what is there is served all the same
        spdlog::error("store: {}", error.what());
      }
    }
    log();
    return {std::move(catalog_), report_};
  }

 private:
  void open(OldCatalog old) {
    const fs::path file = directory_.catalog();
    const bool emptied = !exists(files_, file) || file_size(files_, file) == 0;  // SQLite would drop the log of such a one
    const bool log_left = exists(files_, file.string() + "-wal");
    if (old == OldCatalog::set_aside || (emptied && log_left)) set_aside("no longer used");
    try {
      catalog_ = open_sqlite_catalog(file, files_);
      damaged_ = catalog_->check();
      const auto strange = [](const auto& record) { return !is_full_id(record.id); };
      if (std::any_of(damaged_.geometries.begin(), damaged_.geometries.end(), strange) ||
          std::any_of(damaged_.setups.begin(), damaged_.setups.end(), strange)) {
        throw Error(ErrorCode::data_loss, "catalog: has ids that are none");
      }
    } catch (const Error& damage) {
      if (damage.code() != ErrorCode::data_loss) throw;
      catalog_.reset();
      damaged_ = {};
      set_aside(damage.what());
      catalog_ = open_sqlite_catalog(file, files_);
    }
  }

  void set_aside(const std::string& why) {
    if (!exists(files_, directory_.catalog()) && !exists(files_, directory_.catalog().string() + "-wal")) return;
    const fs::path kept = directory_.set_aside_catalog();
    report_.set_aside = kept.string();
    spdlog::error("store: the catalog was set aside as {} ({}); a new one is made of the files", kept.string(), why);
    salvaged_ = salvage_catalog(kept, files_);
  }

  void finish_intents() {
    std::vector<Intent> intents = catalog_->intents();
    intents.insert(intents.end(), salvaged_.intents.begin(), salvaged_.intents.end());  // one of the two has none
    for (const Intent& intent : intents) {
      if (intent.kind == Intent::Kind::remove) {
        report_.garbage += finish_removal(directory_, *catalog_, intent, RemoveFiles::not_renewed, [](const char*) {});
        continue;
      }
      for (const auto& entry : intent.entries) {
        const std::string key = key_of({entry.tenant, entry.id});
        report_.garbage += try_remove(files_, directory_.temporary(key, intent.number));
        report_.garbage += try_remove(files_, directory_.temporary_link(key, intent.number));
        report_.garbage += try_remove(files_, directory_.temporary_record(key, intent.number));
        if (entry.what == Intent::What::geometry && !entry.info.empty()) {
          announced_[{entry.tenant, entry.id}] = {entry.id, entry.info, entry.created_ms, Integrity::intact, entry.tenant};
        }
      }
      finished_.push_back(intent.number);
    }
    for (const fs::path& folder : {directory_.tmp(), directory_.names(), directory_.setups(), directory_.geometries()}) {
      sync_directory(files_, folder);
    }
  }

  void end_intents() {
    for (const std::int64_t number : finished_) catalog_->end(number);
  }

  // 0.1 kept damaged files here.
  void clear_tmp() {
    for (const fs::path& path : entries_of(files_, directory_.tmp())) {
      if (path.extension() == ".damaged") {
        keep_damaged(path);
      } else {
        unclaim(path);
      }
    }
  }

  void unclaim(const fs::path& path) {
    const fs::path kept = directory_.set_aside(path, directory_.unclaimed());
    ++report_.unclaimed;
    spdlog::warn("store: {} is nothing that this store put there; it is kept as {}", path.string(), kept.string());
  }

  void mend() {
    std::vector<GeometryRecord> geometries;
    std::vector<SetupRecord> setups;
    for (const auto& record : damaged_.geometries) {
      if (auto known = known_geometry(owned(record))) {
        geometries.push_back(*std::move(known));
      } else if (is_file(files_, directory_.geometries() / key_of(owned(record)))) {
        if (auto found = geometry_from_content(owned(record))) geometries.push_back(*std::move(found));
      }
    }
    for (const auto& record : damaged_.setups) {
      if (auto known = known_setup(owned(record))) {
        setups.push_back(*std::move(known));
      } else if (is_plausible(record)) {
        setups.push_back(record);
      }
    }
    if (geometries.size() + setups.size() > 0) catalog_->restore(geometries, setups);
    report_.mended = geometries.size() + setups.size();
    report_.still_damaged = damaged_.geometries.size() + damaged_.setups.size() - report_.mended;
  }

  /// From the small file, else from what the upload announced, else from what the old catalog still had.
  std::optional<GeometryRecord> known_geometry(const OwnedId& id) {
    const fs::path file = directory_.names() / key_of(id);
    if (exists(files_, file)) {
      auto record = unless_damaged([&] { return read_geometry_record(file, id, files_); });
      if (record) return record;
      keep_damaged(file);
    }
    if (const auto found = announced_.find(id); found != announced_.end()) return found->second;
    const auto salvaged =
        std::find_if(salvaged_.geometries.begin(), salvaged_.geometries.end(), [&](const auto& r) { return owned(r) == id; });
    if (salvaged == salvaged_.geometries.end()) return std::nullopt;
    return *salvaged;
  }

  std::optional<SetupRecord> known_setup(const OwnedId& id) {
    const fs::path file = directory_.setups() / key_of(id);
    if (!exists(files_, file)) return std::nullopt;
    auto known = unless_damaged([&] {
      SetupRecord record = read_setup_record(file, id, files_);
      verify(record);
      return record;
    });
    if (!known) keep_damaged(file);
    return known;
  }

  void keep_damaged(const fs::path& path) {
    const fs::path kept = directory_.set_aside(path, directory_.damaged());
    ++report_.damaged;
    spdlog::error("store: {} is damaged; it is kept as {}", path.string(), kept.string());
  }

  /// The record of a file whose content has the id and is a geometry as an upload would have been.
  std::optional<GeometryRecord> geometry_from_content(const OwnedId& id) const {
    const fs::path file = directory_.geometries() / key_of(id);
    return unless_damaged([&] {
      const Mesh mesh = read_geometry_file(file, id.id, files_);
      mesh.validate();
      return geometry_record(convert::geometry_info(mesh, id.id, ""), modified_ms(files_, file), id.tenant);
    });
  }

  /// The name of a file says whose it is: nothing is ever adopted for another tenant.
  void adopt_geometries() {
    const auto recorded = as_set(catalog_->all_geometries());
    std::vector<GeometryRecord> adopted;
    for (const fs::path& path : entries_of(files_, directory_.geometries())) {
      const auto id = owned_id(path.filename().string());
      if (id && recorded.count(*id) > 0 && is_file(files_, path)) continue;
      auto found = id && is_file(files_, path) ? geometry_from_content(*id) : std::nullopt;
      if (!found) {
        unclaim(path);
        continue;
      }
      if (auto known = known_geometry(*id)) found = std::move(known);
      adopted.push_back(*std::move(found));
    }
    std::set<OwnedId> taken = recorded;
    for (const auto& record : adopted) taken.insert(owned(record));
    // Geometries whose files are gone: what is known of them tells what to register again, and their setups wait for it.
    for (const fs::path& path : entries_of(files_, directory_.names())) {
      const auto id = owned_id(path.filename().string());
      if (id && taken.count(*id) > 0 && is_file(files_, path)) continue;
      const auto known =
          id && is_file(files_, path) ? unless_damaged([&] { return read_geometry_record(path, *id, files_); }) : std::nullopt;
      if (known && taken.insert(*id).second) {
        adopted.push_back(*known);
      } else {
        unclaim(path);
      }
    }
    for (const auto& record : salvaged_.geometries) {
      if (taken.insert(owned(record)).second) adopted.push_back(record);
    }
    if (!adopted.empty()) catalog_->restore(adopted, {});
    report_.adopted_geometries = adopted.size();
  }

  void adopt_setups() {
    const auto recorded = as_set(catalog_->all_setups());
    const auto geometries = as_set(catalog_->all_geometries());
    const auto has_geometry = [&](const SetupRecord& setup) { return geometries.count({setup.tenant, setup.geometry_id}) > 0; };
    std::vector<SetupRecord> adopted;
    std::set<OwnedId> taken = recorded;
    for (const fs::path& path : entries_of(files_, directory_.setups())) {
      const auto id = owned_id(path.filename().string());
      if (id && recorded.count(*id) > 0 && is_file(files_, path)) continue;
      auto known = id && is_file(files_, path) ? known_setup(*id) : std::nullopt;
      if (!known || !has_geometry(*known)) {
        if (is_anything(files_, path)) unclaim(path);  // else it was damaged
        continue;
      }
      taken.insert(*id);
      adopted.push_back(*std::move(known));
    }
    for (const auto& record : salvaged_.setups) {
      if (has_geometry(record) && taken.insert(owned(record)).second) adopted.push_back(record);
    }
    if (!adopted.empty()) catalog_->restore({}, adopted);
    report_.adopted_setups = adopted.size();
  }

  /// Writes the small files that are not there, all at once.
  void record() {
    Intent intent{Intent::Kind::put, {}};
    for (const auto& id : catalog_->all_geometries()) {
      if (exists(files_, directory_.names() / key_of(id))) continue;
      intent.entries.push_back({Intent::What::geometry, id.id, 0, {}, id.tenant});
    }
    for (const auto& id : catalog_->all_setups()) {
      if (exists(files_, directory_.setups() / key_of(id))) continue;
      intent.entries.push_back({Intent::What::setup, id.id, 0, {}, id.tenant});
    }
    if (intent.entries.empty()) return;
    intent.number = catalog_->begin(intent);
    std::vector<std::pair<fs::path, fs::path>> moves;
    for (const auto& entry : intent.entries) {
      const OwnedId id{entry.tenant, entry.id};
      const fs::path part = directory_.temporary_record(key_of(id), intent.number);
      if (entry.what == Intent::What::geometry) {
        const auto record = catalog_->find_geometry(id);
        if (!record || record->integrity == Integrity::damaged) continue;
        write_record(*record, part, Sync::later, files_);
        moves.emplace_back(part, directory_.names() / key_of(id));
      } else {
        const auto record = catalog_->find_setup(id);
        if (!record || record->integrity == Integrity::damaged) continue;
        write_record(*record, part, Sync::later, files_);
        moves.emplace_back(part, directory_.setups() / key_of(id));
      }
    }
    sync_file_system(files_, directory_.root());
    for (const auto& [from, to] : moves) move_file(files_, from, to);
    sync_directory(files_, directory_.names());
    sync_directory(files_, directory_.setups());
    catalog_->end(intent.number);
    report_.recorded = moves.size();
  }

  void count_missing() {
    for (const auto& id : catalog_->all_geometries()) report_.missing += !is_file(files_, directory_.geometries() / key_of(id));
  }

  void log() const {
    const RebuildReport& r = report_;
    if (r.garbage > 0) spdlog::info("store: removed {} files of uploads and deletions that were interrupted", r.garbage);
    if (r.adopted_geometries + r.adopted_setups > 0) {
      spdlog::warn(
          "store: {} geometries and {} setups were not in the catalog and are again, from their files. Where an older catalog "
          "was restored or the catalog was lost, what was deleted since may have returned",
          r.adopted_geometries, r.adopted_setups);
    }
    if (r.mended > 0) spdlog::warn("store: mended {} damaged entries of the catalog", r.mended);
    if (r.still_damaged > 0)
      spdlog::error("store: {} entries of the catalog are damaged; their geometries must be registered again", r.still_damaged);
    if (r.recorded > 0) spdlog::info("store: wrote {} small files from which the catalog can be rebuilt", r.recorded);
    if (r.missing > 0) {
      spdlog::error(
          "store: {} geometries of the catalog have no file: damaged, or deleted after an older catalog was copied. Register or "
          "delete them again",
          r.missing);
    }
  }

  const StoreDirectory& directory_;
  FileSystem& files_;
  std::unique_ptr<Catalog> catalog_;
  Catalog::Damaged damaged_;
  Salvaged salvaged_;
  std::map<OwnedId, GeometryRecord> announced_;  // by uploads that were interrupted
  std::vector<std::int64_t> finished_;
  RebuildReport report_;
};

/// True when the record in the small file is of that time, or there is none.
template <typename Read>
bool is_of(std::int64_t created_ms, FileSystem& files, const fs::path& file, Read read) {
  if (!exists(files, file)) return true;
  const auto record = unless_damaged([&] { return read(); });
  return record && record->created_ms == created_ms;
}

}  // namespace

OpenedCatalog open_catalog(const StoreDirectory& directory, OldCatalog old) { return Rebuild(directory, old).run(); }

std::size_t finish_removal(const StoreDirectory& directory, Catalog& catalog, const Intent& intent, RemoveFiles which,
                           const std::function<void(const char*)>& step) {
  std::size_t removed = 0;
  FileSystem& files = directory.files();
  const auto remove = [&](const fs::path& file) {
    removed += remove_file(files, file);
    step("a file is removed");
  };
  for (const auto& entry : intent.entries) {
    const OwnedId id{entry.tenant, entry.id};
    if (entry.what == Intent::What::setup) {
      const fs::path file = directory.setups() / key_of(id);
      const bool renewed =
          catalog.find_setup(id) || !is_of(entry.created_ms, files, file, [&] { return read_setup_record(file, id, files); });
      if (which == RemoveFiles::all || !renewed) {
        BasisFiles::remove(directory, id);
        remove(file);
      }
      continue;
    }
    const fs::path file = directory.names() / key_of(id);
    const bool renewed =
        catalog.find_geometry(id) || !is_of(entry.created_ms, files, file, [&] { return read_geometry_record(file, id, files); });
    if (which == RemoveFiles::not_renewed && renewed) continue;
    remove(file);
    remove(directory.geometries() / key_of(id));
  }
  for (const fs::path& folder : {directory.setups(), directory.names(), directory.geometries()}) sync_directory(files, folder);
  step("the removal is durable");
  catalog.end(intent.number);
  step("the removal is done");
  return removed;
}

}  // namespace deform::server
