// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <filesystem>
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
#include "server/store/store.h"
#include "server/store/store_directory.h"

namespace deform::server {

/// A store of one server, in one directory that belongs to the server's user alone:
///
///   deformd-store     the mark: this folder is a store, and of which format. Without it, only an empty folder becomes one
///   lock              held by flock while the store is open: one process per directory
///   catalog.sqlite    names, setups, intents; a row decides what is visible, and has a checksum
///   geometries/<key>  the content whose SHA-256 is its id, immutable
///   names/<key>       the row of the geometry (name, time, description), with a checksum
///   setups/<key>      the row of a setup: its canonical form, whose hash is its id, and its description, with a checksum
///   bases/            what prepared systems leave to whoever needs them next (basis_files.h): a cache, which no row names
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
class GeometryStore : public Store {
 public:
  /// Throws Error(unavailable) when another process has the directory or it cannot be written, Error(failed_precondition) when it
  /// is a folder of something else.
  explicit GeometryStore(const std::filesystem::path& directory, StoreOptions options = {});
  ~GeometryStore() override;

  v1::GeometryInfo put(const Mesh& mesh, const OwnedId& id, const std::string& name, const PutTerms& terms = {}) override;
  std::optional<v1::GeometryInfo> registered(const OwnedId& id) override;
  v1::GeometryInfo info(const OwnedId& id) override;
  Mesh load(const OwnedId& id) override;
  std::vector<std::string> remove(const OwnedId& id, WithSetups policy, const RowsGone& gone = {}) override;

  std::int64_t put_setup(SetupRecord record, const Quota& quota = {}) override;
  std::optional<SetupRecord> find_setup(const OwnedId& id) override;
  bool remove_setup(const OwnedId& id, const RowsGone& gone = {}) override;

  void require_quota(const std::string& tenant, const StoredAmount& more, const Quota& quota) const override;
  StoredAmount amount_of(const std::string& tenant) const override;
  void require_room(std::size_t bytes) const override;
  /// Also takes back the reserve when there is room again.
  v1::StoreInfo state() override;
  StoreReport check(const RunContext& context, const RoomFor& room) override {
    return check_open_store(directory_, *catalog_, bases_, context, room);
  }
  StoreReport backup(const std::filesystem::path& to) override { return backup_store(directory_.root(), to, files_); }

  v1::ListGeometriesReply list(const std::string& tenant, const v1::ListGeometriesRequest& request) override;

  SyncTimes sync_times() const override { return files_.sync_times(); }
  BasisFiles& bases() override { return bases_; }
  Catalog& catalog() override { return *catalog_; }

 private:
  std::optional<v1::GeometryInfo> described(const GeometryRecord& record);
  void share_content(const GeometryRecord& record, std::int64_t intent);
  void take_back(const GeometryRecord& record, std::int64_t intent);
  void undo(const Intent::Entry& entry, std::int64_t intent);
  void undo_what_is_left();
  Intent remove_rows(const OwnedId& id, WithSetups policy, const RowsGone& gone);
  void finish(const Intent& removal);
  /// What is about to be added to what a tenant has; taken back when it is destroyed before it was kept.
  class Addition;
  std::optional<GeometryRecord> put_content(const std::filesystem::path& temporary, const GeometryRecord& record,
                                            std::int64_t intent, Addition& addition, bool heals);
  void count_again(const std::string& tenant);
  void quarantine(const OwnedId& id);
  void step(const char* what) const { options_.on_step(what); }

  const StoreOptions options_;
  mutable StoreFiles files_;
  const StoreDirectory directory_;
  DiskSpace disk_;
  BasisFiles bases_;
  std::unique_ptr<Catalog> catalog_;
  std::mutex visibility_;  // file and row change together
  // under visibility_
  std::vector<std::pair<Intent::Entry, std::int64_t>> left_;  // of puts that failed and could not be taken back
  mutable std::mutex amounts_mutex_;
  // under amounts_mutex_
  std::map<std::string, StoredAmount> amounts_;  // as in the catalog
  std::map<std::string, StoredAmount> adding_;   // of puts under way
};

}  // namespace deform::server
