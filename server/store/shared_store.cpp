// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/shared_store.h"

#include <spdlog/spdlog.h>

#include <cerrno>
#include <utility>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "proto/convert/mesh/geometry.h"
#include "server/store/catalog_records.h"
#include "server/store/file.h"
#include "server/store/geometry_file.h"
#include "server/store/shared_store_copies.h"

namespace deform::server {

namespace {

constexpr std::uint32_t folder_retry_ms = 1000;
constexpr const char* register_again = "register the geometry again";

/// The description of a geometry whose row is intact and whose file was there.
v1::GeometryInfo whole_info(const GeometryRecord& record, std::size_t setups) {
  v1::GeometryInfo info = recorded_info(record);
  info.set_setups(static_cast<std::uint32_t>(setups));
  return info;
}

/// A file that cannot be looked at is not missing.
bool is_missing(FileSystem& files, const std::filesystem::path& path) {
  struct stat status {};
  return files.status(path, FileSystem::Links::follow, status) != 0 && (errno == ENOENT || errno == ENOTDIR);
}

}  // namespace

SharedStore::SharedStore(const std::filesystem::path& directory, std::unique_ptr<SharedCatalog> catalog,
                         SharedStoreOptions options)
    : options_(std::move(options)),
      watched_(options_.store.files == nullptr ? std::make_unique<WatchedFiles>(system_files(), directory) : nullptr),
      files_(watched_ ? static_cast<FileSystem&>(*watched_) : *options_.store.files, directory, options_.store.naming),
      catalog_(std::move(catalog)),
      directory_(open_directory(directory, *catalog_, files_)),
      disk_(directory_->root(), directory_->reserve(), options_.store.disk, files_),
      bases_(*directory_, disk_, options_.store.most_bases) {
  bases_.sweep(BasisFiles::Alone::no);
  catalog_->on_news({[this](Intent::What what, const OwnedId& id) {
                       const std::lock_guard lock(mirror_mutex_);
                       if (mirror_.forget) mirror_.forget(what, id);
                     },
                     [this] {
                       const std::lock_guard lock(house_mutex_);
                       compare_now_ = true;
                       house_changed_.notify_all();
                     }});
  house_ = std::thread([this] { keep_house(); });
  const std::string why = disk_.refusal();
  if (!why.empty()) spdlog::error("store: nothing is written: {}", why);
}

SharedStore::~SharedStore() {
  {
    const std::lock_guard lock(house_mutex_);
    stopping_ = true;
  }
  house_changed_.notify_all();
  house_.join();
  catalog_->on_news({});
}

/// One server at a time makes a store of an empty folder.
std::unique_ptr<StoreDirectory> SharedStore::open_directory(const std::filesystem::path& path, SharedCatalog& catalog,
                                                            FileSystem& files) {
  const auto claim = catalog.claim("store", std::chrono::seconds(10), {});
  if (!has_mark(path, files) && is_empty_folder(path, files)) {
    const std::size_t geometries = catalog.counts().geometries;
    if (geometries > 0) {
      throw Error(ErrorCode::failed_precondition, "store: " + path.string() + " is empty, but there are " +
                                                      std::to_string(geometries) +
                                                      " geometries in the catalog: is the shared folder mounted?");
    }
  }
  return std::make_unique<StoreDirectory>(path, StoreDirectory::Accept::stores, files, catalog.identity());
}

std::filesystem::path SharedStore::file_of(const GeometryRecord& record) const {
  return directory_->geometries() / (key_of(owned(record)) + "~" + std::to_string(record.put));
}

std::filesystem::path SharedStore::file_of(const Intent::Entry& entry) const {
  return directory_->geometries() / (key_of({entry.tenant, entry.id}) + "~" + std::to_string(entry.put));
}

/// A file that is not there means nothing when nothing is there.
void SharedStore::require_folder() const {
  if (directory_->is_reachable()) return;
  throw Error(ErrorCode::unavailable, "store: the shared folder cannot be reached", folder_retry_ms);
}

void SharedStore::require_room(std::size_t bytes) const {
  bases_.make_room(bytes);
  if (disk_.refusal(bytes).empty()) return;
  require_folder();  // else there is no room either
  disk_.require(bytes);
}

// ---- quotas ----

void SharedStore::require_quota(const std::string& tenant, const StoredAmount& more, const Quota& quota) const {
  if (quota.geometries != 0 || quota.stored_bytes != 0) check_quota(tenant, catalog_->amount_of(tenant), more, quota);
}

/// The last one that could be read, while the catalog cannot.
StoredAmount SharedStore::amount_of(const std::string& tenant) const {
  std::optional<StoredAmount> now;
  try {
    now = catalog_->amount_of(tenant);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::unavailable) throw;
  }
  const std::lock_guard lock(amounts_mutex_);
  if (now) amounts_[tenant] = *now;
  return amounts_[tenant];
}

// ---- geometries ----

v1::GeometryInfo SharedStore::put(const Mesh& mesh, const OwnedId& id, const std::string& name, const PutTerms& terms) {
  return put(mesh, geometry_record(convert::geometry_info(mesh, id.id, name), catalog_->now_ms(), id.tenant), terms);
}

void SharedStore::put_again(const Mesh& mesh, const GeometryRecord& original) {
  put(mesh, geometry_record(recorded_info(original), original.created_ms, original.tenant), {});
}

v1::GeometryInfo SharedStore::put(const Mesh& mesh, GeometryRecord record, const PutTerms& terms) {
  const OwnedId id = owned(record);
  const auto known = catalog_->find_geometry(id);
  std::optional<std::int64_t> lost;
  if (known && known->integrity == Integrity::intact) {
    if (is_seen(files_, file_of(*known))) {
      v1::GeometryInfo info = whole_info(*known, catalog_->setup_count(id));
      info.set_existed(true);
      return info;
    }
    require_folder();
    lost = known->put;
  }
  require_room(mesh_bytes(mesh));
  record.put = catalog_->begin({Intent::Kind::put, {{Intent::What::geometry, id.id, record.created_ms, {}, id.tenant}}});
  try {
    step("an upload is announced");
    const std::filesystem::path temporary = directory_->temporary(key_of(id), record.put);
    write_geometry_file(mesh, temporary, files_, terms.context);
    step("the content is written");
    move_file(files_, temporary, file_of(record));
    sync_directory(files_, directory_->geometries());
    step("the content is in place");
    const SharedCatalog::Added added = catalog_->add(record, lost, terms.quota);
    step("the row is written");
    // The file of a row that was damaged, or one that could not be looked at, may be there: nothing names it from now on.
    if (added.outcome == SharedCatalog::Added::Outcome::healed && known) try_remove(files_, file_of(*known));
    if (added.outcome == SharedCatalog::Added::Outcome::known) {
      Intent removal{Intent::Kind::remove, {{Intent::What::geometry, id.id, 0, {}, id.tenant}}};
      removal.entries[0].put = removal.number = record.put;
      finish(removal);
    }
    v1::GeometryInfo info = whole_info(added.record, catalog_->setup_count(id));
    info.set_existed(added.outcome != SharedCatalog::Added::Outcome::added);
    return info;
  } catch (...) {
    take_back(record);
    throw;
  }
}

/// Nothing of it is touched unless the catalog knows that its row is not there and will not be.
void SharedStore::take_back(const GeometryRecord& record) {
  try_remove(files_, directory_->temporary(key_of(owned(record)), record.put));
  try {
    if (!catalog_->revoke(record.put)) {
      // Its row is there, or others gave it up, who may have looked for its file before that was written.
      const auto now = catalog_->find_geometry(owned(record));
      if (now && now->put == record.put) return;
    }
  } catch (const Error& error) {
    spdlog::warn("store: what was not stored is removed later: {}", error.what());
    const std::lock_guard lock(left_mutex_);
    left_puts_.push_back(record);
    return;
  }
  Intent removal{Intent::Kind::remove, {{Intent::What::geometry, record.id, 0, {}, record.tenant}}};
  removal.entries[0].put = removal.number = record.put;
  finish(removal);
}

/// The rows are gone, so the call succeeds.
void SharedStore::finish(const Intent& removal) {
  try {
    step("a removal is announced");
    bool of_put = false;
    for (const auto& entry : removal.entries) {
      if (entry.what == Intent::What::setup) bases_.remove({entry.tenant, entry.id});
      if (entry.what != Intent::What::geometry) continue;
      if (entry.put == removal.number) {  // it began as one to put, whose file may not have come further
        remove_file(files_, directory_->temporary(key_of({entry.tenant, entry.id}), entry.put));
        of_put = true;
      }
      remove_file(files_, file_of(entry));
      step("a file is removed");
    }
    // A folder that is not there has no file either.
    require_folder();
    if (of_put) sync_directory(files_, directory_->tmp());
    sync_directory(files_, directory_->geometries());
    step("the removal is durable");
    catalog_->end(removal.number);
    step("the removal is done");
  } catch (const Error& error) {
    spdlog::warn("store: the files of a removal are removed later: {}", error.what());
    const std::lock_guard lock(left_mutex_);
    left_removals_.push_back(removal);
  }
}

std::optional<v1::GeometryInfo> SharedStore::registered(const OwnedId& id) {
  const auto record = catalog_->find_geometry(id);
  if (!record || record->integrity != Integrity::intact) return std::nullopt;
  if (!is_seen(files_, file_of(*record))) {
    require_folder();
    return std::nullopt;
  }
  return described(*record, catalog_->setup_count(id));
}

v1::GeometryInfo SharedStore::info(const OwnedId& id) {
  const auto record = catalog_->find_geometry(id);
  const auto info = record ? described(*record, catalog_->setup_count(id)) : std::nullopt;
  if (!info) throw unknown_geometry(id.id);
  return *info;
}

/// Nothing when it has been removed since the record was read.
std::optional<v1::GeometryInfo> SharedStore::described(const GeometryRecord& record, std::size_t setups) {
  v1::GeometryInfo info;
  if (record.integrity == Integrity::damaged || !info.ParseFromString(record.info)) {
    info.Clear();
    info.set_damage(std::string("the entry in the catalog is damaged; ") + register_again);
    info.set_id(record.id);
  } else if (is_missing(files_, file_of(record))) {
    const auto now = catalog_->find_geometry(owned(record));
    if (!now) return std::nullopt;
    if (now->put != record.put) return described(*now, setups);
    // Nothing is known of a folder that cannot be reached: then the catalog is believed, and systems in memory go on.
    if (directory_->is_reachable()) info.set_damage(std::string("the stored file is missing or damaged; ") + register_again);
  }
  info.set_setups(static_cast<std::uint32_t>(setups));
  return info;
}

Mesh SharedStore::load(const OwnedId& id) {
  auto record = catalog_->find_geometry(id);
  for (;;) {
    if (!record) throw unknown_geometry(id.id);
    std::optional<Error> failure;
    if (!is_missing(files_, file_of(*record))) {
      try {
        return read_geometry_file(file_of(*record), id.id, files_);
      } catch (const Error& error) {
        failure = error;
      }
    }
    require_folder();
    // Another server may have removed or renewed it meanwhile.
    const auto now = catalog_->find_geometry(id);
    if (now && now->put == record->put) {
      if (!failure) {
        throw Error(ErrorCode::data_loss, "geometry " + id.id + ": the stored file is missing; " + register_again);
      }
      if (failure->code() == ErrorCode::data_loss) quarantine(*record);
      throw Error(*failure);
    }
    record = now;
  }
}

// Out of the way, so that registering again stores a good file; kept, because it may be all there is.
void SharedStore::quarantine(const GeometryRecord& record) {
  const std::lock_guard lock(aside_mutex_);
  try {
    const auto kept = directory_->set_aside(file_of(record), directory_->damaged());
    spdlog::error("store: the file of geometry {} is damaged and was set aside as {}", key_of(owned(record)), kept.string());
  } catch (const Error& error) {
    spdlog::error("store: the file of geometry {} is damaged: {}", key_of(owned(record)), error.what());
  }
}

std::vector<std::string> SharedStore::remove(const OwnedId& id, WithSetups policy, const RowsGone& gone) {
  const Intent removal = catalog_->remove_geometry(id, policy, gone);
  finish(removal);
  std::vector<std::string> setups;
  for (const auto& entry : removal.entries) {
    if (entry.what == Intent::What::setup) setups.push_back(entry.id);
  }
  return setups;
}

v1::ListGeometriesReply SharedStore::list(const std::string& tenant, const v1::ListGeometriesRequest& request) {
  v1::ListGeometriesReply reply;
  PageRoom room;
  std::map<std::string, std::size_t> setups;
  const auto fetch = [&](const auto& after, std::size_t limit) {
    auto records = catalog_->list_geometries(tenant, after, limit);
    std::vector<std::string> ids;
    for (const auto& record : records) ids.push_back(record.id);
    setups = catalog_->setup_counts(tenant, ids);
    return records;
  };
  reply.set_next_page_token(list_page(request.page_token(), request.page_size(), fetch, [&](const GeometryRecord& record) {
    const auto count = setups.find(record.id);
    auto info = described(record, count == setups.end() ? 0 : count->second);
    if (!info) return true;  // removed meanwhile
    if (!room.takes(info->ByteSizeLong())) return false;
    *reply.add_geometries() = *std::move(info);
    return true;
  }));
  return reply;
}

// ---- setups ----

std::int64_t SharedStore::put_setup(SetupRecord record, const Quota& quota) {
  record.created_ms = catalog_->now_ms();
  return catalog_->add_setup(record, quota);
}

void SharedStore::put_setup_again(const SetupRecord& original) { catalog_->add_setup(original, {}); }

std::optional<SetupRecord> SharedStore::find_setup(const OwnedId& id) {
  auto record = catalog_->find_setup(id);
  if (record && record->integrity == Integrity::damaged) {
    throw Error(ErrorCode::data_loss, "system " + id.id + ": the stored setup is damaged; prepare it again from its file");
  }
  return record;
}

bool SharedStore::remove_setup(const OwnedId& id, const RowsGone& gone) {
  const bool removed = catalog_->remove_setup(id, gone).has_value();
  if (removed) bases_.remove(id);
  return removed;
}

std::shared_ptr<void> SharedStore::claim_preparation(const OwnedId& system, const RunContext& context) {
  return catalog_->claim("preparation " + key_of(system), options_.preparation_patience, context);
}

// ---- the whole ----

v1::StoreInfo SharedStore::state() {
  v1::StoreInfo state;
  std::string why = catalog_->trouble();
  if (why.empty() && !directory_->is_reachable()) why = "the shared folder cannot be reached";
  if (why.empty()) bases_.make_room(0);
  if (why.empty()) why = disk_.refusal();
  state.set_reason(why);
  state.set_writable(why.empty());
  state.set_free_bytes(disk_.free());
  state.set_needed_bytes(disk_.keep_free());
  state.set_damaged_files(count_entries(directory_->damaged(), files_));
  state.set_unclaimed_files(count_entries(directory_->unclaimed(), files_));
  return state;
}

StoreReport SharedStore::check(const RunContext& context, const RoomFor& room) {
  StoreReport report;
  const Catalog::Damaged damaged = catalog_->check();
  for (const auto& record : damaged.geometries)
    complain(report, named("geometry", owned(record)) + ": its entry in the catalog is damaged");
  for (const auto& record : damaged.setups)
    complain(report, named("system", owned(record)) + ": its entry in the catalog is damaged");
  require_folder();
  const auto geometries = catalog_->all_geometries(), setups = catalog_->all_setups();
  for (const auto& id : geometries) {
    context.check();
    const auto record = catalog_->find_geometry(id);
    if (!record || record->integrity == Integrity::damaged) continue;
    const auto held = room(*record);
    try {
      read_geometry_file(file_of(*record), id.id, files_).validate();
    } catch (const Error& error) {
      const auto now = catalog_->find_geometry(id);
      if (now && now->put == record->put) complain(report, named("geometry", id) + ": " + error.public_message());
    }
  }
  for (const auto& id : setups) {
    context.check();
    const auto record = catalog_->find_setup(id);
    if (!record || record->integrity == Integrity::damaged) continue;
    try {
      verify(*record);
    } catch (const Error& error) {
      complain(report, named("system", id) + ": " + error.public_message());
    }
  }
  check_bases(report, bases_, context);
  report.lines.push_back(std::to_string(count_entries(directory_->damaged(), files_)) + " entries in damaged/");
  report.lines.push_back(std::to_string(geometries.size()) + " geometries, " + std::to_string(setups.size()) +
                         " setups: " + (report.outcome == StoreReport::Outcome::well ? "every file is whole" : "see above"));
  return report;
}

StoreReport SharedStore::backup(const std::filesystem::path& to) {
  require_folder();
  return backup_shared_store(*catalog_, *directory_, to);
}

void SharedStore::mirror(StoreMirror mirror) {
  const std::lock_guard lock(mirror_mutex_);
  mirror_ = std::move(mirror);
}

void SharedStore::finish_what_is_left() {
  std::vector<GeometryRecord> puts;
  std::vector<Intent> removals;
  {
    const std::lock_guard lock(left_mutex_);
    puts = std::exchange(left_puts_, {});
    removals = std::exchange(left_removals_, {});
  }
  if (!catalog_->trouble().empty() || !directory_->is_reachable()) {
    const std::lock_guard lock(left_mutex_);
    left_puts_.insert(left_puts_.end(), puts.begin(), puts.end());
    left_removals_.insert(left_removals_.end(), removals.begin(), removals.end());
    return;
  }
  for (const auto& record : puts) take_back(record);
  for (const auto& removal : removals) finish(removal);
  const auto taken = catalog_->take_over();
  if (!taken.empty()) spdlog::info("store: ends {} uploads and deletions of servers that are gone", taken.size());
  for (const auto& removal : taken) finish(removal);
}

/// For changes without a notification: these are lost with a connection, and what is being loaded is in no memory yet.
void SharedStore::compare_memory() {
  for (const Intent::What what : {Intent::What::setup, Intent::What::geometry}) {
    std::vector<OwnedId> held;
    {
      const std::lock_guard lock(mirror_mutex_);
      if (mirror_.in_memory) held = mirror_.in_memory(what);
    }
    for (const OwnedId& id : held) {
      const bool setup = what == Intent::What::setup;
      if (!(setup ? catalog_->setup_ids(id.tenant, id.id, 1) : catalog_->geometry_ids(id.tenant, id.id, 1)).empty()) continue;
      const std::lock_guard lock(mirror_mutex_);
      if (mirror_.forget) mirror_.forget(what, id);
    }
  }
}

void SharedStore::keep_house() {
  std::unique_lock lock(house_mutex_);
  for (bool first = true; !stopping_; first = false) {
    lock.unlock();
    try {
      finish_what_is_left();
      if (!first) compare_memory();  // nothing is in memory yet
    } catch (const std::exception& error) {
      spdlog::warn("store: {}", error.what());
    }
    lock.lock();
    house_changed_.wait_for(lock, options_.housekeeping, [this] { return stopping_ || compare_now_; });
    compare_now_ = false;
  }
}

}  // namespace deform::server
