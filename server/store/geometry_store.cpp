// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/geometry_store.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "core/base/error.h"
#include "proto/convert/mesh/geometry.h"
#include "server/store/catalog_rebuild.h"
#include "server/store/catalog_records.h"
#include "server/store/file.h"
#include "server/store/geometry_file.h"

namespace deform::server {

GeometryStore::GeometryStore(const std::filesystem::path& directory, StoreOptions options)
    : options_(std::move(options)),
      files_(options_.files == nullptr ? system_files() : *options_.files, directory, options_.naming),
      directory_(directory, StoreDirectory::Accept::stores, files_),
      disk_(directory_.root(), directory_.reserve(), options_.disk, files_),
      bases_(directory_, disk_, options_.most_bases) {
  bases_.sweep(BasisFiles::Alone::yes);
  {
    const DiskSpace::Room room(disk_);
    catalog_ = open_catalog(directory_, OldCatalog::keep_if_whole).catalog;
    amounts_ = catalog_->amounts();
  }
  const std::string why = disk_.refusal();
  if (!why.empty()) spdlog::error("store: nothing is written: {}", why);
}

GeometryStore::~GeometryStore() = default;

void GeometryStore::require_room(std::size_t bytes) const {
  bases_.make_room(bytes);
  disk_.require(bytes);
}

// ---- quotas ----

void GeometryStore::require_quota(const std::string& tenant, const StoredAmount& more, const Quota& quota) const {
  const std::lock_guard lock(amounts_mutex_);
  const auto of = [&](const auto& amounts) {
    const auto found = amounts.find(tenant);
    return found == amounts.end() ? StoredAmount() : found->second;
  };
  const StoredAmount has = of(amounts_), adds = of(adding_);
  check_quota(tenant, {has.geometries + adds.geometries, 0, has.bytes + adds.bytes}, more, quota);
}

StoredAmount GeometryStore::amount_of(const std::string& tenant) const {
  const std::lock_guard lock(amounts_mutex_);
  const auto found = amounts_.find(tenant);
  return found == amounts_.end() ? StoredAmount() : found->second;
}

class GeometryStore::Addition {
 public:
  /// Throws beyond the quota. Checked and entered in one step, so that puts at the same time do not exceed it together.
  Addition(GeometryStore& store, std::string tenant, const StoredAmount& more, const Quota& quota)
      : store_(store), tenant_(std::move(tenant)), more_(more) {
    const std::lock_guard lock(store_.amounts_mutex_);
    StoredAmount& adding = store_.adding_[tenant_];
    const StoredAmount has = store_.amounts_[tenant_];
    check_quota(tenant_, {has.geometries + adding.geometries, 0, has.bytes + adding.bytes}, more, quota);
    add(adding);
  }
  ~Addition() {
    const std::lock_guard lock(store_.amounts_mutex_);
    if (!kept_) leave();
  }
  Addition(const Addition&) = delete;
  Addition& operator=(const Addition&) = delete;

  /// What was being added is there. Counted once at any time.
  void keep() {
    const std::lock_guard lock(store_.amounts_mutex_);
    add(store_.amounts_[tenant_]);
    leave();
    kept_ = true;
  }

 private:
  void leave() {
    const auto adding = store_.adding_.find(tenant_);
    adding->second.geometries -= more_.geometries;
    adding->second.setups -= more_.setups;
    adding->second.bytes -= more_.bytes;
    if (adding->second.geometries + adding->second.setups + adding->second.bytes == 0) store_.adding_.erase(adding);
  }
  void add(StoredAmount& amount) const {
    amount.geometries += more_.geometries;
    amount.setups += more_.setups;
    amount.bytes += more_.bytes;
  }

  GeometryStore& store_;
  const std::string tenant_;
  const StoredAmount more_;
  bool kept_ = false;  ///< under the mutex of the amounts
};

/// After what takes away or replaces, which is done whether it can be counted or not.
void GeometryStore::count_again(const std::string& tenant) {
  try {
    const StoredAmount now = catalog_->amount_of(tenant);
    const std::lock_guard lock(amounts_mutex_);
    amounts_[tenant] = now;
  } catch (const Error& error) {
    spdlog::warn("store: what tenant {} has is counted at its next change: {}", tenant, error.what());
  }
}

// ---- geometries ----

v1::GeometryInfo GeometryStore::put(const Mesh& mesh, const OwnedId& id, const std::string& name, const PutTerms& terms) {
  if (auto info = registered(id)) {
    info->set_existed(true);
    return *info;
  }
  require_room(mesh_bytes(mesh));
  const GeometryRecord record = geometry_record(convert::geometry_info(mesh, id.id, name), unix_ms(), id.tenant);
  // What heals takes no more than there was.
  const bool heals = catalog_->find_geometry(id).has_value();
  Addition addition(*this, id.tenant, heals ? StoredAmount() : StoredAmount{1, 0, stored_bytes(record)}, terms.quota);
  const std::int64_t intent =
      catalog_->begin({Intent::Kind::put, {{Intent::What::geometry, id.id, record.created_ms, record.info, id.tenant}}});
  try {
    step("an upload is announced");
    const std::filesystem::path temporary = directory_.temporary(key_of(id), intent);
    write_geometry_file(mesh, temporary, files_, terms.context);
    step("the content is written");
    const auto known = put_content(temporary, record, intent, addition, heals);
    v1::GeometryInfo info = recorded_info(known.value_or(record));
    info.set_setups(static_cast<std::uint32_t>(catalog_->setup_count(id)));
    info.set_existed(known.has_value());
    return info;
  } catch (...) {
    take_back(record, intent);
    throw;
  }
}

/// Returns the record that was there, of a geometry whose file was lost or was put at the same time: it keeps its name.
std::optional<GeometryRecord> GeometryStore::put_content(const std::filesystem::path& temporary, const GeometryRecord& record,
                                                         std::int64_t intent, Addition& addition, bool heals) {
  const std::string key = key_of(owned(record));
  const std::lock_guard lock(visibility_);
  move_file(files_, temporary, directory_.geometries() / key);
  share_content(record, intent);
  sync_directory(files_, directory_.geometries());
  step("the content is in place");
  auto known = catalog_->find_geometry(owned(record));
  if (known && known->integrity == Integrity::damaged) known.reset();
  const GeometryRecord& kept = known ? *known : record;
  const std::filesystem::path small = directory_.temporary_record(key_of(owned(record)), intent);
  write_record(kept, small, Sync::now, files_);
  step("the small file is written");
  move_file(files_, small, directory_.names() / key);
  sync_directory(files_, directory_.names());
  step("the small file is in place");
  catalog_->add_geometry(kept, intent);
  step("the row is written");
  // Before others may remove it.
  if (!known && !heals) addition.keep();
  if (heals) count_again(record.tenant);
  return known;
}

/// Other tenants that have the content get a link to what was just written in place of their own copy, which ends with that. A
/// copy that stays because there are no links is as good.
void GeometryStore::share_content(const GeometryRecord& record, std::int64_t intent) {
  const std::filesystem::path link = directory_.temporary_link(key_of(owned(record)), intent);
  for (const std::string& tenant : catalog_->owners_of(record.id)) {
    const std::filesystem::path theirs = directory_.geometries() / key_of({tenant, record.id});
    // What was set aside as damaged stays so until its owner registers it again: nobody else may decide that it is there.
    if (tenant == record.tenant || !is_seen(files_, theirs)) continue;
    if (files_.link(directory_.geometries() / key_of(owned(record)), link) != 0) return;
    step("a link is made");
    move_file(files_, link, theirs);
    step("a content is shared");
  }
}

/// Removes the file of an upload that failed; what cannot be removed now is left to the next start.
void GeometryStore::take_back(const GeometryRecord& record, std::int64_t intent) {
  const std::lock_guard lock(visibility_);
  try_remove(files_, directory_.temporary(key_of(owned(record)), intent));
  try_remove(files_, directory_.temporary_link(key_of(owned(record)), intent));
  try_remove(files_, directory_.temporary_record(key_of(owned(record)), intent));
  undo({Intent::What::geometry, record.id, record.created_ms, {}, record.tenant}, intent);
}

/// What is in place goes as in any removal: were its files removed before that is announced, a part of them could be back after a
/// crash, without the intent that says what they are; and a row that could not be committed could be back without them.
void GeometryStore::undo(const Intent::Entry& entry, std::int64_t intent) {
  const DiskSpace::Room room(disk_);
  const OwnedId id{entry.tenant, entry.id};
  const bool setup = entry.what == Intent::What::setup;
  try {
    const bool recorded = setup ? catalog_->find_setup(id).has_value() : catalog_->find_geometry(id).has_value();
    const bool in_place =
        setup ? exists(files_, directory_.setups() / key_of(id))
              : exists(files_, directory_.geometries() / key_of(id)) || exists(files_, directory_.names() / key_of(id));
    if (!recorded && in_place) {
      Intent removal{Intent::Kind::remove, {entry}};
      removal.number = catalog_->begin(removal);
      finish_removal(directory_, *catalog_, removal, RemoveFiles::all, [](const char*) {});
    }
    catalog_->end(intent);
  } catch (const Error& error) {
    spdlog::warn("store: what was not stored is removed or found later: {}", error.what());
    left_.emplace_back(entry, intent);
  }
}

/// Before a removal, whose caller must not find afterwards what could not be taken back earlier.
void GeometryStore::undo_what_is_left() {
  for (const auto& [entry, intent] : std::exchange(left_, {})) undo(entry, intent);
}

std::optional<v1::GeometryInfo> GeometryStore::registered(const OwnedId& id) {
  const auto record = catalog_->find_geometry(id);
  if (!record || record->integrity == Integrity::damaged) return std::nullopt;
  const auto info = described(*record);
  return info && info->damage().empty() ? info : std::nullopt;
}

v1::GeometryInfo GeometryStore::info(const OwnedId& id) {
  const auto record = catalog_->find_geometry(id);
  const auto info = record ? described(*record) : std::nullopt;
  if (!info) throw unknown_geometry(id.id);
  return *info;
}

/// Nothing when it has been removed since the record was read. Rows go before files, and files come before rows: while nothing
/// comes or goes, both are there or neither.
std::optional<v1::GeometryInfo> GeometryStore::described(const GeometryRecord& record) {
  v1::GeometryInfo info;
  if (record.integrity == Integrity::damaged || !info.ParseFromString(record.info)) {
    info.Clear();
    info.set_damage("the entry in the catalog is damaged; register the geometry again");
    try {
      const GeometryRecord small = read_geometry_record(directory_.names() / key_of(owned(record)), owned(record), files_);
      if (!info.ParseFromString(small.info)) info.Clear();
    } catch (const std::exception& error) {
      spdlog::error("store: geometry {}: {}", record.id, error.what());
    }
    info.set_id(record.id);
  }
  const std::filesystem::path file = directory_.geometries() / key_of(owned(record));
  if (!is_seen(files_, file)) {
    const std::lock_guard lock(visibility_);
    if (!catalog_->find_geometry(owned(record))) return std::nullopt;
    if (!is_seen(files_, file)) info.set_damage("the stored file is missing or damaged; register the geometry again");
  }
  info.set_setups(static_cast<std::uint32_t>(catalog_->setup_count(owned(record))));
  return info;
}

Mesh GeometryStore::load(const OwnedId& id) {
  if (!catalog_->find_geometry(id)) throw unknown_geometry(id.id);
  const std::filesystem::path file = directory_.geometries() / key_of(id);
  if (is_seen(files_, file)) {
    try {
      return read_geometry_file(file, id.id, files_);
    } catch (const Error& error) {
      spdlog::debug("store: geometry {} is read once more: {}", key_of(id), error.what());
    }
  }
  // It may be on its way out, or in again. What is wrong while nothing changes is wrong.
  const std::lock_guard lock(visibility_);
  if (!catalog_->find_geometry(id)) throw unknown_geometry(id.id);
  if (!is_seen(files_, file)) {
    throw Error(ErrorCode::data_loss, "geometry " + id.id + ": the stored file is missing; register the geometry again");
  }
  try {
    return read_geometry_file(file, id.id, files_);
  } catch (const Error& damage) {
    if (damage.code() == ErrorCode::data_loss) quarantine(id);
    throw;
  }
}

// Out of the way, so that registering again stores a good file; kept, because it may be all there is. With visibility_ held.
void GeometryStore::quarantine(const OwnedId& id) {
  try {
    const auto kept = directory_.set_aside(directory_.geometries() / key_of(id), directory_.damaged());
    spdlog::error("store: the file of geometry {} is damaged and was set aside as {}", key_of(id), kept.string());
  } catch (const Error& error) {
    spdlog::error("store: the file of geometry {} is damaged: {}", key_of(id), error.what());
  }
}

/// Where not even a row can be written and the reserve is gone, the content goes first and makes room. Only in between would a
/// crash leave what was to be removed, listed as damaged.
Intent GeometryStore::remove_rows(const OwnedId& id, WithSetups policy, const RowsGone& gone) {
  const std::filesystem::path file = directory_.geometries() / key_of(id);
  try {
    return catalog_->remove_geometry(id, policy, gone);
  } catch (const Error& error) {
    const bool wanted = policy == WithSetups::remove || catalog_->setup_count(id) == 0;
    struct stat status {};
    const bool shared =
        files_.status(file, FileSystem::Links::follow, status) == 0 && status.st_nlink > 1;  // then no room would be made
    if (error.code() != ErrorCode::out_of_budget || !wanted || shared) throw;
  }
  try_remove(files_, file);
  return catalog_->remove_geometry(id, policy, gone);
}

std::vector<std::string> GeometryStore::remove(const OwnedId& id, WithSetups policy, const RowsGone& gone) {
  const std::lock_guard lock(visibility_);
  const DiskSpace::Room room(disk_);
  undo_what_is_left();
  const Intent removal = remove_rows(id, policy, gone);
  finish(removal);
  count_again(id.tenant);
  std::vector<std::string> setups;
  for (const auto& entry : removal.entries) {
    if (entry.what == Intent::What::setup) setups.push_back(entry.id);
  }
  return setups;
}

/// The rows are gone, so the call succeeds: files that cannot be removed now are left to the next start.
void GeometryStore::finish(const Intent& removal) {
  try {
    step("a removal is announced");
    finish_removal(directory_, *catalog_, removal, RemoveFiles::all, options_.on_step);
  } catch (const Error& error) {
    spdlog::warn("store: the files of a removal are removed at the next start: {}", error.what());
  }
}

std::int64_t GeometryStore::put_setup(SetupRecord record, const Quota& quota) {
  const std::lock_guard lock(visibility_);
  const OwnedId id = owned(record);
  if (!catalog_->find_geometry({record.tenant, record.geometry_id})) {
    throw unknown_geometry(record.geometry_id);
  }
  const auto known = catalog_->find_setup(id);
  const bool stays = known && known->integrity == Integrity::intact;
  if (stays) record.created_ms = known->created_ms;
  if (stays && !disk_.refusal().empty()) return record.created_ms;
  require_room(record.setup.size() + record.info.size());
  Addition addition(*this, id.tenant, known ? StoredAmount() : StoredAmount{0, 1, stored_bytes(record)}, quota);
  const std::int64_t intent =
      catalog_->begin({Intent::Kind::put, {{Intent::What::setup, record.id, record.created_ms, {}, record.tenant}}});
  const std::filesystem::path temporary = directory_.temporary_record(key_of(owned(record)), intent);
  try {
    step("a setup is announced");
    write_record(record, temporary, Sync::now, files_);
    step("the setup is written");
    move_file(files_, temporary, directory_.setups() / key_of(id));
    sync_directory(files_, directory_.setups());
    step("the setup is in place");
    catalog_->put_setup(record, intent);
    step("the row of the setup is written");
    known ? count_again(id.tenant) : addition.keep();
  } catch (...) {
    try_remove(files_, temporary);
    undo({Intent::What::setup, record.id, record.created_ms, {}, record.tenant}, intent);
    throw;
  }
  return record.created_ms;
}

std::optional<SetupRecord> GeometryStore::find_setup(const OwnedId& id) {
  auto record = catalog_->find_setup(id);
  if (!record || record->integrity == Integrity::intact) return record;
  try {
    return read_setup_record(directory_.setups() / key_of(id), id, files_);
  } catch (const Error&) {
    throw Error(ErrorCode::data_loss, "system " + id.id + ": the stored setup is damaged; prepare it again from its file");
  }
}

bool GeometryStore::remove_setup(const OwnedId& id, const RowsGone& gone) {
  const std::lock_guard lock(visibility_);
  const DiskSpace::Room room(disk_);
  undo_what_is_left();
  const auto removal = catalog_->remove_setup(id, gone);
  if (removal) {
    finish(*removal);
    count_again(id.tenant);
  }
  return removal.has_value();
}

v1::StoreInfo GeometryStore::state() {
  bases_.make_room(0);
  disk_.hold();
  v1::StoreInfo state;
  state.set_reason(disk_.refusal());
  state.set_writable(state.reason().empty());
  state.set_free_bytes(disk_.free());
  state.set_needed_bytes(disk_.keep_free());
  state.set_damaged_files(count_entries(directory_.damaged(), files_));
  state.set_unclaimed_files(count_entries(directory_.unclaimed(), files_));
  return state;
}

v1::ListGeometriesReply GeometryStore::list(const std::string& tenant, const v1::ListGeometriesRequest& request) {
  v1::ListGeometriesReply reply;
  PageRoom room;
  const auto fetch = [&](const auto& after, std::size_t limit) { return catalog_->list_geometries(tenant, after, limit); };
  reply.set_next_page_token(list_page(request.page_token(), request.page_size(), fetch, [&](const GeometryRecord& record) {
    auto info = described(record);
    if (!info) return true;  // removed meanwhile
    if (!room.takes(info->ByteSizeLong())) return false;
    *reply.add_geometries() = *std::move(info);
    return true;
  }));
  return reply;
}

}  // namespace deform::server
