// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/mesh/mesh.h"
#include "deform/v1/geometry.pb.h"
#include "deform/v1/service.pb.h"
#include "server/store/catalog.h"
#include "server/store/disk_space.h"
#include "server/store/file_system.h"
#include "server/store/store_commands.h"
#include "server/store/store_directory.h"

namespace deform::server {

struct StoreOptions {
  DiskOptions disk;
  /// Called after every step that a crash could follow; for tests.
  std::function<void(const char* step)> on_step = [](const char*) {};
  /// Outlives the store; null: that of this machine.
  FileSystem* files = nullptr;
};

/// Durable, content-addressed geometries and the setups prepared on them, in one directory that belongs to the server's user
/// alone:
///
///   deformd-store     the mark: this folder is a store, and of which format. Without it, only an empty folder becomes one
///   lock              held by flock while the store is open: one process per directory
///   catalog.sqlite    names, setups, intents; a row decides what is visible, and has a checksum
///   geometries/<key>  the content whose SHA-256 is its id, immutable
///   names/<key>       the row of the geometry (name, time, description), with a checksum
///   setups/<key>      the row of a setup: its canonical form, whose hash is its id, and its description, with a checksum
///   tmp/              files of uploads under way, named after their intent
///   damaged/          files and catalogs that were damaged; never touched again
///   unclaimed/        what stood among the files and is nothing of the store's; never touched again
///   reserve           room for deleting on a full disk
///   catalog.sqlite.schema-1   the catalog as deformd 0.1 left it
///
/// Everything belongs to a tenant, and what another one has is as unknown as what nobody has. The key is the id for the default
/// tenant and "<id>.<tenant>" for others, so that the name of a file says whose it is, whatever else is lost; the checksums of
/// rows and small files cover the tenant, too. Tenants that have the same content share its bytes by hard links, where the file
/// system has them: each has a name of its own, and the bytes go with the last of them. Whoever puts a content writes it in full,
/// shared or not, and the others then get links to what was written: so neither time nor damage passes between tenants.
///
/// Put: intent, file in tmp/, synced, renamed, directory synced, the small file in the same way, row (which ends the intent).
/// Remove: rows away and intent (one step), files away, directories synced, intent ended. So a crash at any point leaves what was
/// visible before or after. At the start, files named by an intent and by no row are removed, and nothing else ever is: a file
/// without a row is adopted when its hash is its name, and moved to unclaimed/ when not. The catalog is checked; if it is damaged
/// it is moved to damaged/ and rebuilt from names/, setups/, geometries/ and what can still be read of it.
/// A row whose file is missing or damaged is listed with `damage`, an Error(data_loss) when used, and healed by registering
/// again. Where the disk is full, what is there is served, and deleting works; adding is an Error(out_of_budget). Thread-safe.
class GeometryStore {
 public:
  /// Throws Error(unavailable) when another process has the directory or it cannot be written, Error(failed_precondition) when it
  /// is a folder of something else.
  explicit GeometryStore(const std::filesystem::path& directory, StoreOptions options = {});
  ~GeometryStore();
  GeometryStore(const GeometryStore&) = delete;
  GeometryStore& operator=(const GeometryStore&) = delete;

  /// Stores a validated mesh for a tenant; `existed` of the answer tells whether the tenant had it.
  /// Throws Error(out_of_budget) without a retry hint beyond the quota.
  v1::GeometryInfo put(const Mesh& mesh, const OwnedId& id, const std::string& name, const Quota& quota = {});
  /// The row and the file are there.
  bool contains(const OwnedId& id) { return registered(id).has_value(); }
  /// The description of what contains() finds.
  std::optional<v1::GeometryInfo> registered(const OwnedId& id);
  /// Throws Error(not_found).
  v1::GeometryInfo info(const OwnedId& id);
  /// Reads and verifies; throws Error(not_found), Error(data_loss).
  Mesh load(const OwnedId& id);
  /// Also the setups when the policy says so; returns their ids. Throws Error(not_found), Error(failed_precondition). Whoever has
  /// loaded the mesh keeps it, and so do other tenants.
  std::vector<std::string> remove(const OwnedId& id, WithSetups policy, const RowsGone& gone = {});

  /// Adds or replaces; returns when the setup was stored first. Where nothing can be written, a setup that is there stays as it
  /// is. Throws as put() beyond the quota.
  std::int64_t put_setup(SetupRecord record, const Quota& quota = {});
  /// Throws Error(data_loss) when neither the row nor the small file is whole.
  std::optional<SetupRecord> find_setup(const OwnedId& id);
  /// False when there was none.
  bool remove_setup(const OwnedId& id, const RowsGone& gone = {});

  /// Throws Error(out_of_budget) when a tenant may not add so much more.
  void require_quota(const std::string& tenant, const StoredAmount& more, const Quota& quota) const;
  /// What a tenant has.
  StoredAmount amount_of(const std::string& tenant) const;
  /// Throws Error(out_of_budget) when so many bytes cannot be added now.
  void require_room(std::size_t bytes) const { disk_.require(bytes); }
  /// Whether the store may be added to, and what was set aside. Also takes back the reserve when there is room again.
  v1::StoreInfo state();
  /// check_open_store() of this one.
  StoreReport check(const RunContext& context, const RoomFor& room) {
    return check_open_store(directory_, *catalog_, context, room);
  }

  v1::ListGeometriesReply list(const std::string& tenant, const v1::ListGeometriesRequest& request);

  /// Full ids from full ids or unique prefixes of at least 8 digits, among those of the tenant. Throws Error(invalid_argument)
  /// for what is no such prefix or has several answers, Error(not_found).
  OwnedId resolve_geometry(const std::string& tenant, const std::string& id_or_prefix);
  OwnedId resolve_setup(const std::string& tenant, const std::string& id_or_prefix);

  /// For listings of setups and counts; what changes files goes through the store.
  Catalog& catalog() { return *catalog_; }

 private:
  std::optional<v1::GeometryInfo> described(const GeometryRecord& record);
  bool has_content(const GeometryRecord& record);
  void share_content(const GeometryRecord& record, std::int64_t intent);
  void take_back(const GeometryRecord& record, std::int64_t intent);
  void undo(const Intent::Entry& entry, std::int64_t intent);
  void undo_what_is_left();
  Intent remove_rows(const OwnedId& id, WithSetups policy, const RowsGone& gone);
  void finish(const Intent& removal);
  /// What is about to be added to what a tenant has; taken back when it is destroyed before it was kept.
  class Addition;
  std::optional<GeometryRecord> put_content(const Mesh& mesh, const GeometryRecord& record, std::int64_t intent,
                                            Addition& addition, bool heals);
  void count_again(const std::string& tenant);
  void quarantine(const OwnedId& id);
  void step(const char* what) const { options_.on_step(what); }

  const StoreOptions options_;
  FileSystem& files_;
  const StoreDirectory directory_;
  DiskSpace disk_;
  std::unique_ptr<Catalog> catalog_;
  std::mutex visibility_;  // file and row change together
  // under visibility_
  std::vector<std::pair<Intent::Entry, std::int64_t>> left_;  // of puts that failed and could not be taken back
  mutable std::mutex amounts_mutex_;
  // under amounts_mutex_
  std::map<std::string, StoredAmount> amounts_;  // as in the catalog
  std::map<std::string, StoredAmount> adding_;   // of puts under way
};

/// "<created_ms>:<id>" and back; page sizes. Shared by the listings.
std::string page_token(std::int64_t created_ms, const std::string& id);
std::optional<PageStart> parse_page_token(const std::string& token);
std::size_t page_size(std::uint32_t requested);

/// Whether one more entry fits into the reply of a listing: messages stay below 1 MiB. The first one always does.
class PageRoom {
 public:
  bool takes(std::size_t bytes);

 private:
  std::size_t bytes_ = 0;
};

/// One page of a listing; returns the token of the next one. `fetch(after, limit)` reads records, few at a time, since each may
/// be large; `add(record)` is false when there is no room for it.
template <typename Fetch, typename Add>
std::string list_page(const std::string& token, std::uint32_t requested, const Fetch& fetch, const Add& add) {
  constexpr std::size_t batch = 8;
  auto after = parse_page_token(token);
  for (std::size_t left = page_size(requested); left > 0;) {
    const std::size_t wanted = std::min(batch, left);
    const auto records = fetch(after, wanted);
    for (const auto& record : records) {
      if (!add(record)) return page_token(after->created_ms, after->id);
      after = PageStart{record.created_ms, record.id};
    }
    if (records.size() < wanted) return {};
    left -= wanted;
  }
  return page_token(after->created_ms, after->id);
}

/// Now, in milliseconds since 1970.
std::int64_t unix_ms();

}  // namespace deform::server
