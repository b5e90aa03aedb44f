// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "server/store/shared_catalog.h"
#include "tests/server/simulated_server.h"

namespace deform::server {

class SimulatedCatalog;

/// The database of servers that share a store, in memory: durable whatever stops, and all calls of its sessions are transactions.
/// Its clock stands still but for pass() and a millisecond whenever it is read. Thread-safe.
class SimulatedDatabase {
 public:
  /// As the tables keep them: a row is damaged when it does not have its checksum any more. Rows go by key_of().
  template <typename Record>
  struct Row {
    Record record;
    std::string checksum;
  };
  struct OwnedIntent {
    Intent intent;
    std::int64_t owner = 0;  ///< the number of a session
  };
  struct State {
    std::map<std::string, Row<GeometryRecord>> geometries;
    std::map<std::string, Row<SetupRecord>> setups;
    std::map<std::int64_t, OwnedIntent> intents;
    std::int64_t numbers = 0;
    std::int64_t now_ms = 1'700'000'000'000;
  };

  /// When the sessions hear of removals.
  enum class News {
    at_once,
    late,  ///< with deliver()
    lost   ///< with deliver(), and then only that they have missed some
  };

  SimulatedDatabase() = default;
  explicit SimulatedDatabase(State state) : state_(std::move(state)) {}

  /// A copy.
  State state() const;
  void pass(std::chrono::milliseconds time);
  void set_news(News news);
  void deliver();
  /// Flips a bit of what a row says; its key is that of a geometry or setup that is there.
  void damage_geometry(const std::string& key);
  void damage_setup(const std::string& key);

 private:
  friend class SimulatedCatalog;
  struct Removed {
    Intent::What what;
    OwnedId id;
  };
  void tell(std::vector<Removed> removed);

  mutable std::mutex mutex_;
  // under mutex_
  State state_;
  std::set<std::int64_t> living_;                                         ///< sessions that have not ended
  std::map<std::string, std::pair<std::int64_t, std::uint64_t>> claims_;  ///< the session that has the name, and the number
  std::uint64_t last_claim_ = 0;
  std::map<std::int64_t, SimulatedCatalog*> sessions_;
  News news_ = News::at_once;
  std::vector<Removed> untold_;
};

/// A session of a SimulatedDatabase. It is a server's: when that stops (SimulatedServer) it ends, and what it has begun is left.
/// Calls fail as the SimulatedServer says, without an effect or after it.
class SimulatedCatalog : public SharedCatalog {
 public:
  enum class Housekeeping {
    free,    ///< as the store likes
    by_turn  ///< only during keep_house(): one thread acts at a time
  };
  /// The others outlive this.
  SimulatedCatalog(SimulatedDatabase& database, SimulatedServer& server, std::chrono::milliseconds take_over_after,
                   Housekeeping housekeeping);
  ~SimulatedCatalog() override;

  // ---- the session ----
  /// For the others the session has ended, although the server lives and its calls are answered.
  void cut_off();
  /// As when the connection is back: removals may have been missed meanwhile.
  void come_back();
  /// The session ends for good. To be called before the store is destroyed, whose thread would else wait for a turn for ever.
  void leave();

  // ---- housekeeping by turn ----
  /// Once the store is open: waits for its thread.
  void await_housekeeper();
  /// The store keeps house once. What it has taken notice of at the turn before is brought to an end: twice does all.
  void keep_house();

  // ---- SharedCatalog ----
  std::int64_t begin(const Intent& intent) override;
  void end(std::int64_t number) override;
  std::vector<Intent> intents() override;
  bool revoke(std::int64_t intent) override;
  std::vector<Intent> take_over() override;

  bool add_geometry(const GeometryRecord& record, std::int64_t intent) override;
  Added add(const GeometryRecord& record, std::optional<std::int64_t> lost, const Quota& quota) override;
  std::optional<GeometryRecord> find_geometry(const OwnedId& id) override;
  std::vector<GeometryRecord> list_geometries(const std::string& tenant, const std::optional<PageStart>& after,
                                              std::size_t limit) override;
  Intent remove_geometry(const OwnedId& id, WithSetups policy, const RowsGone& gone) override;
  std::vector<std::string> owners_of(const std::string& geometry_id) override;

  void put_setup(const SetupRecord& record, std::int64_t intent) override;
  std::int64_t add_setup(const SetupRecord& record, const Quota& quota) override;
  std::optional<SetupRecord> find_setup(const OwnedId& id) override;
  std::vector<SetupRecord> list_setups(const OwnedId& geometry, const std::optional<PageStart>& after,
                                       std::size_t limit) override;
  std::optional<Intent> remove_setup(const OwnedId& id, const RowsGone& gone) override;
  std::size_t setup_count(const OwnedId& geometry) override;
  std::map<std::string, std::size_t> setup_counts(const std::string& tenant, const std::vector<std::string>& ids) override;

  void restore(const std::vector<GeometryRecord>& geometries, const std::vector<SetupRecord>& setups) override;
  Damaged check() override;
  void snapshot(const std::function<void(GeometryRecord&&)>& geometry, const std::function<void(SetupRecord&&)>& setup) override;
  std::vector<std::string> geometry_ids(const std::string& tenant, const std::string& prefix, std::size_t limit) override;
  std::vector<std::string> setup_ids(const std::string& tenant, const std::string& prefix, std::size_t limit) override;
  std::vector<OwnedId> all_geometries() override;
  std::vector<OwnedId> all_setups() override;
  StoredAmount amount_of(const std::string& tenant) override;
  std::map<std::string, StoredAmount> amounts() override;
  Counts counts() override;

  std::string identity() override { return std::string(32, 'd'); }
  std::int64_t now_ms() override;
  /// Nobody else acts while the caller waits, so the patience passes at once.
  std::shared_ptr<void> claim(const std::string& name, std::chrono::milliseconds patience, const RunContext& context) override;
  void on_news(CatalogNews news) override;
  std::string trouble() const override;

 private:
  friend class SimulatedDatabase;
  using State = SimulatedDatabase::State;
  using Removed = std::vector<SimulatedDatabase::Removed>;

  template <typename Work>
  auto call(const Work& work);
  void hear(const SimulatedDatabase::Removed& removed);
  void hear_of_a_gap();
  static StoredAmount amount_in(const State& state, const std::string& tenant);

  SimulatedDatabase& database_;
  SimulatedServer& server_;
  const std::chrono::milliseconds take_over_after_;
  const Housekeeping housekeeping_;
  std::int64_t owner_ = 0;
  std::map<std::int64_t, std::int64_t> gone_;  // of the database's mutex: sessions that have ended, since when
  std::mutex news_mutex_;
  CatalogNews news_;  // under news_mutex_

  mutable std::mutex turn_mutex_;
  mutable std::condition_variable turn_changed_;
  // under turn_mutex_
  mutable std::thread::id housekeeper_;
  mutable bool waits_ = false;
  bool left_ = false;
};

}  // namespace deform::server
