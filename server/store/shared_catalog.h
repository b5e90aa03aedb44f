// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "server/store/catalog.h"

namespace deform::server {

/// What the other servers of a catalog tell. Called from a thread of the catalog, one call at a time; must not wait.
struct CatalogNews {
  std::function<void(Intent::What what, const OwnedId& id)> removed;  ///< also by this server
  /// Removals may have been missed: what is in memory has to be compared with the catalog.
  std::function<void()> missed;
};

/// A catalog that several servers use at once. Each is there as long as it has a session; what a server has begun and not ended
/// is taken over by another one some time after its session ended, whether its process still lives or not. That is safe because
/// no two puts write the same file: the number of a put is a part of the file's name, its row can only be added while its intent
/// to put is there, and whoever takes an intent over first makes one to remove of it, in one step.
///
/// While the database cannot be reached, calls try for a moment and then throw Error(unavailable) with a retry hint. Calls that
/// were cut off are repeated, and have the effect and answer of one.
class SharedCatalog : public Catalog {
 public:
  /// 32 hexadecimal digits, other ones in every catalog that was ever made.
  virtual std::string identity() = 0;
  /// Milliseconds since 1970 by the clock of the database, which is the same for all servers.
  virtual std::int64_t now_ms() = 0;

  /// What became of a put whose file is in place.
  struct Added {
    GeometryRecord record;  ///< the one that is in the catalog now; with another number of put, that of another file
    enum class Outcome { added, healed, known } outcome;
  };
  /// As add_geometry(), with record.put as the intent. `lost`: the number of the put whose file was found missing or damaged; a
  /// record with that number gets the new file and keeps its name and time. When the tenant has another one, the intent becomes
  /// one to remove the file that was put. Throws Error(out_of_budget) beyond the quota, with all that other servers have added.
  virtual Added add(const GeometryRecord& record, std::optional<std::int64_t> lost, const Quota& quota) = 0;
  /// As put_setup(), without an intent: returns when the setup was stored first. Throws Error(out_of_budget) beyond the quota.
  virtual std::int64_t add_setup(const SetupRecord& record, const Quota& quota) = 0;

  /// Makes of an intent to put one to remove; false when it has ended, as it does when its row is added.
  virtual bool revoke(std::int64_t intent) = 0;
  /// Intents of servers whose sessions have ended, all to remove now and of this server. What was ended at the last call, too,
  /// and not just for a moment.
  virtual std::vector<Intent> take_over() = 0;

  /// All rows as they are in one moment, the geometries first, each group by key. Does not try again: throws Error(unavailable)
  /// when the database is lost in the middle.
  virtual void snapshot(const std::function<void(GeometryRecord&&)>& geometry,
                        const std::function<void(SetupRecord&&)>& setup) = 0;

  /// The numbers of setups of many geometries of a tenant.
  virtual std::map<std::string, std::size_t> setup_counts(const std::string& tenant, const std::vector<std::string>& ids) = 0;

  /// A name that one server at a time has, as long as the result lives or the session that holds it. Waits for at most that long;
  /// null when another server still has it then, and when the database cannot be reached. Throws the errors of the context.
  virtual std::shared_ptr<void> claim(const std::string& name, std::chrono::milliseconds patience, const RunContext& context) = 0;

  /// Once no call back runs any more.
  virtual void on_news(CatalogNews news) = 0;
  /// Empty while the database answers; else one clause that says why not. Does not wait.
  virtual std::string trouble() const = 0;
};

}  // namespace deform::server
