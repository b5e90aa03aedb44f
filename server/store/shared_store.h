// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "server/store/shared_catalog.h"
#include "server/store/store.h"
#include "server/store/store_directory.h"
#include "server/store/watched_files.h"

namespace deform::server {

struct SharedStoreOptions {
  StoreOptions store;
  /// How often what was left over is brought to an end, and what is in memory compared with the catalog.
  std::chrono::milliseconds housekeeping{10'000};
  /// How long a preparation waits for another server that prepares the same system.
  std::chrono::milliseconds preparation_patience{60'000};
};

/// A store of several servers, on one machine or on many: a catalog that they share, and a folder that all of them see:
///
///   deformd-store         the mark, with the identity of the catalog: neither goes with another one
///   lock                  held by flock, shared: against a server that wants the folder alone
///   geometries/<key>~<n>  the content whose SHA-256 is its id, immutable; n is the number of the put that wrote it
///   bases/                what prepared systems leave to whoever needs them next (basis_files.h): a cache, which no row names
///   tmp/                  files of uploads under way
///   damaged/              files that were damaged; never touched again
///
/// Names and setups are in the catalog alone. Since no two puts write the same name, no server can
/// harm what another one does, whatever it believes about the others and however late it acts: nothing here needs a lock.
///
/// Put: intent, file in tmp/, synced, renamed, directory synced, row, which ends the intent. Remove: rows away and intent to
/// remove in one step, file away, directory synced, intent ended. What cannot be ended now is ended later; intents of servers
/// that are gone are ended by another one. Files that no intent and no row names stay where they are.
///
/// Nothing is remembered of what is in the catalog: what one server has registered is there for all at once, and so is what one
/// has removed. Throws Error(unavailable) with a retry hint while catalog or folder cannot be reached; a folder that falls silent
/// keeps those calls alone waiting that had begun (watched_files.h). Each tenant has its own
/// copy of a content. Thread-safe.
class SharedStore : public Store {
 public:
  /// Throws Error(failed_precondition) when the folder is one of something else, of one server alone or of another catalog, and
  /// when it is empty although there are geometries in the catalog.
  SharedStore(const std::filesystem::path& directory, std::unique_ptr<SharedCatalog> catalog, SharedStoreOptions options = {});
  ~SharedStore() override;

  v1::GeometryInfo put(const Mesh& mesh, const OwnedId& id, const std::string& name, const PutTerms& terms = {}) override;
  std::optional<v1::GeometryInfo> registered(const OwnedId& id) override;
  v1::GeometryInfo info(const OwnedId& id) override;
  Mesh load(const OwnedId& id) override;
  std::vector<std::string> remove(const OwnedId& id, WithSetups policy, const RowsGone& gone = {}) override;

  /// As put() and put_setup(), with name and time of a record of another store and whatever the quota.
  void put_again(const Mesh& mesh, const GeometryRecord& original);
  void put_setup_again(const SetupRecord& original);

  std::int64_t put_setup(SetupRecord record, const Quota& quota = {}) override;
  std::optional<SetupRecord> find_setup(const OwnedId& id) override;
  bool remove_setup(const OwnedId& id, const RowsGone& gone = {}) override;

  void require_quota(const std::string& tenant, const StoredAmount& more, const Quota& quota) const override;
  StoredAmount amount_of(const std::string& tenant) const override;
  void require_room(std::size_t bytes) const override;
  v1::StoreInfo state() override;
  StoreReport check(const RunContext& context, const RoomFor& room) override;
  /// See shared_store_copies.h.
  StoreReport backup(const std::filesystem::path& to) override;

  v1::ListGeometriesReply list(const std::string& tenant, const v1::ListGeometriesRequest& request) override;

  SyncTimes sync_times() const override { return files_.sync_times(); }
  BasisFiles& bases() override { return bases_; }
  Catalog& catalog() override { return *catalog_; }
  SharedCatalog& shared_catalog() { return *catalog_; }

  std::shared_ptr<void> claim_preparation(const OwnedId& system, const RunContext& context) override;
  void mirror(StoreMirror mirror) override;

 private:
  static std::unique_ptr<StoreDirectory> open_directory(const std::filesystem::path& path, SharedCatalog& catalog,
                                                        FileSystem& files);
  v1::GeometryInfo put(const Mesh& mesh, GeometryRecord record, const PutTerms& terms);
  std::filesystem::path file_of(const GeometryRecord& record) const;
  std::filesystem::path file_of(const Intent::Entry& entry) const;
  std::optional<v1::GeometryInfo> described(const GeometryRecord& record, std::size_t setups);
  void require_folder() const;
  void finish(const Intent& removal);
  void take_back(const GeometryRecord& record);
  void quarantine(const GeometryRecord& record);
  void keep_house();
  void finish_what_is_left();
  void compare_memory();
  void step(const char* what) const { options_.store.on_step(what); }

  const SharedStoreOptions options_;
  const std::unique_ptr<WatchedFiles> watched_;  // unless the options name other files
  mutable StoreFiles files_;
  const std::unique_ptr<SharedCatalog> catalog_;
  const std::unique_ptr<StoreDirectory> directory_;
  DiskSpace disk_;
  BasisFiles bases_;
  std::mutex aside_mutex_;  // one file is set aside at a time
  std::mutex left_mutex_;
  // under left_mutex_
  std::vector<GeometryRecord> left_puts_;  // that failed and could not be taken back
  std::vector<Intent> left_removals_;      // whose files are still there
  mutable std::mutex amounts_mutex_;
  mutable std::map<std::string, StoredAmount> amounts_;  // under amounts_mutex_
  std::mutex mirror_mutex_;
  StoreMirror mirror_;  // under mirror_mutex_
  std::mutex house_mutex_;
  std::condition_variable house_changed_;
  // under house_mutex_
  bool stopping_ = false, compare_now_ = false;
  std::thread house_;
};

}  // namespace deform::server
