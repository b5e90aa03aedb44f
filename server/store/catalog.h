// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "server/store/tenant.h"

namespace deform::server {

/// Does a record agree with its checksum?
enum class Integrity { intact, damaged };

/// What the catalog keeps of a geometry. `info` is opaque to it.
struct GeometryRecord {
  std::string id;
  std::string info;
  std::int64_t created_ms = 0;
  Integrity integrity = Integrity::intact;  ///< of what was read
  std::string tenant = default_tenant;
  std::int64_t put = 0;  ///< in a shared store, the number of the put that wrote its file: a part of the name of that
};

/// What the catalog keeps of a prepared setup. `setup` and `info` are opaque to it.
struct SetupRecord {
  std::string id;
  std::string geometry_id;
  std::string setup;
  std::string info;
  std::int64_t created_ms = 0;
  Integrity integrity = Integrity::intact;  ///< of what was read
  std::string tenant = default_tenant;      ///< of the geometry, too
};

inline OwnedId owned(const GeometryRecord& record) { return {record.tenant, record.id}; }
inline OwnedId owned(const SetupRecord& record) { return {record.tenant, record.id}; }

/// What is about to be done to files, recorded before the first of them is touched: after a crash, only what an intent names is
/// garbage.
struct Intent {
  enum class Kind {
    put,    ///< files are written; those still in tmp/ under the number of the intent are garbage
    remove  ///< files are removed; the records are gone already
  };
  enum class What { geometry, setup };
  struct Entry {
    What what = What::geometry;
    std::string id;
    std::int64_t created_ms = 0;  ///< tells a later file of the same id from the one that was meant
    std::string info;             ///< of a geometry that is put
    std::string tenant = default_tenant;
    std::int64_t put = 0;  ///< of a geometry: as in its record
  };
  Kind kind = Kind::put;
  std::vector<Entry> entries;
  std::int64_t number = 0;  ///< given by the catalog, never used twice by one; 0: none
};

/// Position in a listing, newest first: the entry after which the page starts.
struct PageStart {
  std::int64_t created_ms = 0;
  std::string id;
};

enum class WithSetups { refuse, remove };

/// Called when the rows of a removal are gone, in the same moment for all others: nobody sees that they are gone before it has
/// returned. Must not call the catalog.
using RowsGone = std::function<void(const Intent& removal)>;

/// Names of what is durably stored. A record is visible when the call that adds it returned, and then survives a crash; no call
/// has a visible half-way state. Thread-safe. Errors: Error(unavailable) when the storage fails, Error(out_of_budget) when it is
/// full, Error(data_loss) when it is damaged. Several servers share a SharedCatalog (shared_catalog.h).
class Catalog {
 public:
  virtual ~Catalog() = default;

  /// Returns the number of the intent.
  virtual std::int64_t begin(const Intent& intent) = 0;
  virtual void end(std::int64_t number) = 0;
  /// All that are not ended; those that cannot be read any more are left out.
  virtual std::vector<Intent> intents() = 0;

  /// Ends the intent of that number in the same step. False when the tenant has the id already (the record stays as it was unless
  /// it was damaged).
  virtual bool add_geometry(const GeometryRecord& record, std::int64_t intent) = 0;
  virtual std::optional<GeometryRecord> find_geometry(const OwnedId& id) = 0;
  virtual std::vector<GeometryRecord> list_geometries(const std::string& tenant, const std::optional<PageStart>& after,
                                                      std::size_t limit) = 0;
  /// Removes the records of a geometry and its setups and begins the intent to remove their files, in one step; returns that
  /// intent. Throws Error(not_found), or Error(failed_precondition) when there are setups and the policy is to refuse.
  virtual Intent remove_geometry(const OwnedId& id, WithSetups policy, const RowsGone& gone) = 0;
  /// The tenants that have a geometry of this content.
  virtual std::vector<std::string> owners_of(const std::string& geometry_id) = 0;

  /// Adds or replaces; ends the intent of that number in the same step. Throws Error(not_found) when the tenant has no such
  /// geometry.
  virtual void put_setup(const SetupRecord& record, std::int64_t intent) = 0;
  virtual std::optional<SetupRecord> find_setup(const OwnedId& id) = 0;
  /// geometry_id empty: of all of the tenant's. Fewer than `limit`, but at least one that there is, when they take more than
  /// listed_bytes together.
  static constexpr std::size_t listed_bytes = std::size_t{4} << 20;
  virtual std::vector<SetupRecord> list_setups(const OwnedId& geometry, const std::optional<PageStart>& after,
                                               std::size_t limit) = 0;
  /// As remove_geometry(). Nothing when there was none.
  virtual std::optional<Intent> remove_setup(const OwnedId& id, const RowsGone& gone) = 0;
  virtual std::size_t setup_count(const OwnedId& geometry) = 0;

  /// Adds or replaces many records in one step, the geometries first.
  virtual void restore(const std::vector<GeometryRecord>& geometries, const std::vector<SetupRecord>& setups) = 0;
  /// Reads everything. Throws Error(data_loss) when the storage itself is damaged; returns the records that are.
  struct Damaged {
    std::vector<GeometryRecord> geometries;
    std::vector<SetupRecord> setups;
  };
  virtual Damaged check() = 0;

  /// At most `limit` ids of the tenant that start with the prefix.
  virtual std::vector<std::string> geometry_ids(const std::string& tenant, const std::string& prefix, std::size_t limit) = 0;
  virtual std::vector<std::string> setup_ids(const std::string& tenant, const std::string& prefix, std::size_t limit) = 0;

  virtual StoredAmount amount_of(const std::string& tenant) = 0;

  /// The contents of all tenants.
  virtual std::vector<OwnedId> all_geometries() = 0;
  virtual std::vector<OwnedId> all_setups() = 0;
  virtual std::map<std::string, StoredAmount> amounts() = 0;

  /// The contents of all tenants.
  struct Counts {
    std::size_t geometries = 0, setups = 0;
  };
  virtual Counts counts() = 0;
};

}  // namespace deform::server
