// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "deform/v1/geometry.pb.h"
#include "deform/v1/service.pb.h"
#include "server/store/basis_files.h"
#include "server/store/catalog.h"
#include "server/store/disk_space.h"
#include "server/store/file_system.h"
#include "server/store/store_commands.h"
#include "server/store/store_files.h"

namespace deform::server {

struct StoreOptions {
  DiskOptions disk;
  std::uint64_t most_bases = 0;  ///< bytes of bases/ (basis_files.h)
  /// Called after every step that a crash could follow; for tests.
  std::function<void(const char* step)> on_step = [](const char*) {};
  /// Outlives the store; null: that of this machine.
  FileSystem* files = nullptr;
  /// In the words for clients.
  Naming naming = Naming::in_full;
};

/// On what terms a geometry is stored.
struct PutTerms {
  PutTerms() = default;
  PutTerms(const Quota& of_tenant, RunContext of_call = {}) : quota(of_tenant), context(std::move(of_call)) {}
  Quota quota;
  RunContext context;  ///< stops it until the content is written and synced, of which nothing is left then
};

/// What a server has in memory of what is stored, for a store from which others remove, too.
struct StoreMirror {
  /// Another server, or this one, has removed it: what is in memory of it goes. Must not wait.
  std::function<void(Intent::What what, const OwnedId& id)> forget;
  /// What is in memory, to be compared with the catalog.
  std::function<std::vector<OwnedId>(Intent::What what)> in_memory;
};

/// Durable, content-addressed geometries and the setups prepared on them. What was put is there after any crash; nothing is ever
/// half there. Everything belongs to a tenant, and what another one has is as unknown as what nobody has. Thread-safe.
class Store {
 public:
  Store() = default;
  virtual ~Store() = default;
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;

  /// Stores a validated mesh for a tenant; `existed` of the answer tells whether the tenant had it.
  /// Throws Error(out_of_budget) without a retry hint beyond the quota, cancelled, deadline_exceeded.
  virtual v1::GeometryInfo put(const Mesh& mesh, const OwnedId& id, const std::string& name, const PutTerms& terms = {}) = 0;
  /// The row and the file are there.
  bool contains(const OwnedId& id) { return registered(id).has_value(); }
  /// The description of what contains() finds.
  virtual std::optional<v1::GeometryInfo> registered(const OwnedId& id) = 0;
  /// Throws Error(not_found).
  virtual v1::GeometryInfo info(const OwnedId& id) = 0;
  /// Reads and verifies; throws Error(not_found), Error(data_loss).
  virtual Mesh load(const OwnedId& id) = 0;
  /// Also the setups when the policy says so; returns their ids. Throws Error(not_found), Error(failed_precondition). Whoever has
  /// loaded the mesh keeps it, and so do other tenants.
  virtual std::vector<std::string> remove(const OwnedId& id, WithSetups policy, const RowsGone& gone = {}) = 0;

  /// Adds or replaces; returns when the setup was stored first. Where nothing can be written, a setup that is there stays as it
  /// is. Throws as put() beyond the quota.
  virtual std::int64_t put_setup(SetupRecord record, const Quota& quota = {}) = 0;
  /// Throws Error(data_loss) when what is stored of it is damaged.
  virtual std::optional<SetupRecord> find_setup(const OwnedId& id) = 0;
  /// False when there was none.
  virtual bool remove_setup(const OwnedId& id, const RowsGone& gone = {}) = 0;

  /// Throws Error(out_of_budget) when a tenant may not add so much more.
  virtual void require_quota(const std::string& tenant, const StoredAmount& more, const Quota& quota) const = 0;
  /// What a tenant has.
  virtual StoredAmount amount_of(const std::string& tenant) const = 0;
  /// Throws Error(out_of_budget) when so many bytes cannot be added now.
  virtual void require_room(std::size_t bytes) const = 0;
  /// Whether the store may be added to, and what was set aside. Does not throw, nor wait for a database.
  virtual v1::StoreInfo state() = 0;
  /// Reads and verifies everything, beside the work; `room` is held while a geometry is in memory.
  virtual StoreReport check(const RunContext& context, const RoomFor& room) = 0;
  /// Makes `to`, a new or empty folder, a store of the same content.
  virtual StoreReport backup(const std::filesystem::path& to) = 0;

  virtual v1::ListGeometriesReply list(const std::string& tenant, const v1::ListGeometriesRequest& request) = 0;

  /// Full ids from full ids or unique prefixes of at least 8 digits, among those of the tenant. Throws Error(invalid_argument)
  /// for what is no such prefix or has several answers, Error(not_found).
  OwnedId resolve_geometry(const std::string& tenant, const std::string& id_or_prefix);
  OwnedId resolve_setup(const std::string& tenant, const std::string& id_or_prefix);

  /// How long files and folders took to be durable.
  virtual SyncTimes sync_times() const = 0;

  /// What prepared systems have left; goes with their setups and geometries.
  virtual BasisFiles& bases() = 0;

  /// For listings of setups and counts; what changes files goes through the store.
  virtual Catalog& catalog() = 0;

  /// Where other servers use the store, too: held while a system is prepared, so that others wait for it, though never for ever.
  virtual std::shared_ptr<void> claim_preparation(const OwnedId& /*system*/, const RunContext& /*context*/) { return nullptr; }
  /// Replaces the one before, once none of its functions runs any more.
  virtual void mirror(StoreMirror /*mirror*/) {}
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
/// be large, and none at the end; `add(record)` is false when there is no room for it.
template <typename Fetch, typename Add>
std::string list_page(const std::string& token, std::uint32_t requested, const Fetch& fetch, const Add& add) {
  constexpr std::size_t batch = 8;
  auto after = parse_page_token(token);
  for (std::size_t left = page_size(requested); left > 0;) {
    const auto records = fetch(after, std::min(batch, left));
    for (const auto& record : records) {
      if (!add(record)) return page_token(after->created_ms, after->id);
      after = PageStart{record.created_ms, record.id};
    }
    if (records.empty()) return {};
    left -= records.size();
  }
  return page_token(after->created_ms, after->id);
}

/// Now, in milliseconds since 1970.
std::int64_t unix_ms();

}  // namespace deform::server
