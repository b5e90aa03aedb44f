// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/server/simulated_catalog.h"

#include <algorithm>
#include <type_traits>

#include "core/base/error.h"
#include "server/store/catalog_records.h"

namespace deform::server {

namespace {

constexpr std::uint32_t retry_ms = 1000;

template <typename Record>
Record read(const SimulatedDatabase::Row<Record>& row) {
  Record record = row.record;
  record.integrity = checksum(record) == row.checksum ? Integrity::intact : Integrity::damaged;
  return record;
}

template <typename Record>
SimulatedDatabase::Row<Record> row_of(const Record& record) {
  return {record, checksum(record)};
}

std::string geometry_key(const SetupRecord& record) { return key_of({record.tenant, record.geometry_id}); }

/// Newest first, then by key from the last; those after `after`.
template <typename Rows, typename Wanted>
auto page_of(const Rows& rows, const std::string& tenant, const std::optional<PageStart>& after, std::size_t limit,
             const Wanted& wanted) {
  using Record = decltype(rows.begin()->second.record);
  using Place = std::pair<std::int64_t, std::string>;
  const Place start = after ? Place{after->created_ms, key_of({tenant, after->id})} : Place{INT64_MAX, ""};
  std::map<Place, const SimulatedDatabase::Row<Record>*, std::greater<>> places;
  for (const auto& [key, row] : rows) {
    if (const Place place{row.record.created_ms, key}; wanted(row.record) && place < start) places[place] = &row;
  }
  std::vector<Record> records;
  for (const auto& [place, row] : places) {
    if (records.size() < limit) records.push_back(read(*row));
  }
  return records;
}

template <typename Rows>
std::vector<std::string> ids_in(const Rows& rows, const std::string& tenant, const std::string& prefix, std::size_t limit) {
  std::vector<std::string> ids;
  for (const auto& [key, row] : rows) {
    if (row.record.tenant == tenant && key.starts_with(prefix) && ids.size() < limit) ids.push_back(row.record.id);
  }
  return ids;
}

template <typename Rows>
std::vector<OwnedId> all_in(const Rows& rows) {
  std::vector<OwnedId> ids;
  for (const auto& [key, row] : rows) ids.push_back(owned(row.record));
  return ids;
}

}  // namespace

// ---- the database ----

SimulatedDatabase::State SimulatedDatabase::state() const {
  const std::lock_guard lock(mutex_);
  return state_;
}

void SimulatedDatabase::pass(std::chrono::milliseconds time) {
  const std::lock_guard lock(mutex_);
  state_.now_ms += time.count();
}

void SimulatedDatabase::set_news(News news) {
  const std::lock_guard lock(mutex_);
  news_ = news;
}

void SimulatedDatabase::damage_geometry(const std::string& key) {
  const std::lock_guard lock(mutex_);
  state_.geometries.at(key).record.info.front() ^= 1;
}

void SimulatedDatabase::damage_setup(const std::string& key) {
  const std::lock_guard lock(mutex_);
  state_.setups.at(key).record.setup.front() ^= 1;
}

void SimulatedDatabase::tell(std::vector<Removed> removed) {
  std::vector<SimulatedCatalog*> sessions;
  {
    const std::lock_guard lock(mutex_);
    untold_.insert(untold_.end(), removed.begin(), removed.end());
    if (news_ != News::at_once) return;
    for (const auto& [owner, session] : sessions_) sessions.push_back(session);
    removed = std::exchange(untold_, {});
  }
  for (SimulatedCatalog* session : sessions) {
    for (const auto& one : removed) session->hear(one);
  }
}

void SimulatedDatabase::deliver() {
  std::vector<SimulatedCatalog*> sessions;
  std::vector<Removed> removed;
  News news;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [owner, session] : sessions_) sessions.push_back(session);
    removed = std::exchange(untold_, {});
    news = news_;
  }
  for (SimulatedCatalog* session : sessions) {
    if (news == News::lost) session->hear_of_a_gap();
    for (const auto& one : removed) {
      if (news != News::lost) session->hear(one);
    }
  }
}

// ---- the session ----

SimulatedCatalog::SimulatedCatalog(SimulatedDatabase& database, SimulatedServer& server,
                                   std::chrono::milliseconds take_over_after, Housekeeping housekeeping)
    : database_(database), server_(server), take_over_after_(take_over_after), housekeeping_(housekeeping) {
  const std::lock_guard lock(database_.mutex_);
  owner_ = ++database_.state_.numbers;
  database_.living_.insert(owner_);
  database_.sessions_[owner_] = this;
}

SimulatedCatalog::~SimulatedCatalog() {
  leave();
  const std::lock_guard lock(database_.mutex_);
  database_.sessions_.erase(owner_);
}

void SimulatedCatalog::cut_off() {
  const std::lock_guard lock(database_.mutex_);
  database_.living_.erase(owner_);
}

void SimulatedCatalog::come_back() {
  {
    const std::lock_guard lock(database_.mutex_);
    database_.living_.insert(owner_);
  }
  hear_of_a_gap();
}

void SimulatedCatalog::leave() {
  {
    const std::lock_guard lock(database_.mutex_);
    database_.living_.erase(owner_);
    std::erase_if(database_.claims_, [&](const auto& claim) { return claim.second.first == owner_; });
  }
  const std::lock_guard lock(turn_mutex_);
  left_ = true;
  turn_changed_.notify_all();
}

void SimulatedCatalog::hear(const SimulatedDatabase::Removed& removed) {
  const std::lock_guard lock(news_mutex_);
  if (news_.removed) news_.removed(removed.what, removed.id);
}

void SimulatedCatalog::hear_of_a_gap() {
  const std::lock_guard lock(news_mutex_);
  if (news_.missed) news_.missed();
}

void SimulatedCatalog::on_news(CatalogNews news) {
  const std::lock_guard lock(news_mutex_);
  news_ = std::move(news);
}

/// One transaction: `work` has the tables and the list of what it removes to itself.
template <typename Work>
auto SimulatedCatalog::call(const Work& work) {
  using Loss = SimulatedServer::Loss;
  const Error lost = Error(ErrorCode::unavailable, "catalog: the simulated database cannot be reached", retry_ms);
  {
    const std::lock_guard lock(turn_mutex_);
    if (left_) throw Error(lost);
  }
  if (!server_.reaches_point()) throw Error(lost);
  const Loss loss = server_.catalog_fault ? server_.catalog_fault() : Loss::none;
  if (loss == Loss::call) throw Error(lost);
  Removed removed;
  const auto transact = [&] {
    const std::lock_guard lock(database_.mutex_);
    return work(database_.state_, removed);
  };
  const auto tell = [&] {
    if (!removed.empty()) database_.tell(std::move(removed));
    if (loss == Loss::answer) throw Error(lost);
  };
  if constexpr (std::is_void_v<std::invoke_result_t<Work, State&, Removed&>>) {
    transact();
    tell();
  } else {
    auto result = transact();
    tell();
    return result;
  }
}

// ---- housekeeping by turn ----

/// A store that keeps house asks first whether there is trouble: here its thread waits until it is its turn.
std::string SimulatedCatalog::trouble() const {
  std::unique_lock lock(turn_mutex_);
  const auto me = std::this_thread::get_id();
  if (housekeeping_ == Housekeeping::by_turn && (housekeeper_ == std::thread::id() || housekeeper_ == me)) {
    housekeeper_ = me;
    waits_ = true;
    turn_changed_.notify_all();
    turn_changed_.wait(lock, [this] { return !waits_ || left_; });
  }
  return left_ || server_.stopped() ? "the session has ended" : "";
}

void SimulatedCatalog::await_housekeeper() {
  std::unique_lock lock(turn_mutex_);
  turn_changed_.wait(lock, [this] { return waits_; });
}

void SimulatedCatalog::keep_house() {
  await_housekeeper();
  {
    const std::lock_guard lock(turn_mutex_);
    waits_ = false;
    turn_changed_.notify_all();
  }
  hear_of_a_gap();  // so that it comes back here when it has done all
  await_housekeeper();
}

// ---- intents ----

std::int64_t SimulatedCatalog::begin(const Intent& intent) {
  return call([&](State& state, Removed&) {
    Intent begun = intent;
    begun.number = ++state.numbers;
    begun.entries.at(0).put = begun.number;
    state.intents[begun.number] = {begun, owner_};
    return begun.number;
  });
}

void SimulatedCatalog::end(std::int64_t number) {
  call([&](State& state, Removed&) { state.intents.erase(number); });
}

std::vector<Intent> SimulatedCatalog::intents() {
  return call([&](State& state, Removed&) {
    std::vector<Intent> intents;
    for (const auto& [number, owned] : state.intents) intents.push_back(owned.intent);
    return intents;
  });
}

bool SimulatedCatalog::revoke(std::int64_t intent) {
  return call([&](State& state, Removed&) {
    const auto found = state.intents.find(intent);
    if (found == state.intents.end() || found->second.owner != owner_) return false;
    found->second.intent.kind = Intent::Kind::remove;
    return true;
  });
}

std::vector<Intent> SimulatedCatalog::take_over() {
  return call([&](State& state, Removed&) {
    std::vector<Intent> taken;
    std::map<std::int64_t, std::int64_t> gone;
    for (auto& [number, owned] : state.intents) {
      if (owned.owner == owner_ || database_.living_.count(owned.owner) > 0) continue;
      const auto known = gone_.find(owned.owner);
      const std::int64_t since = known == gone_.end() ? state.now_ms : known->second;
      gone[owned.owner] = since;
      if (known == gone_.end() || state.now_ms - since < take_over_after_.count()) continue;
      owned.owner = owner_;
      owned.intent.kind = Intent::Kind::remove;
      taken.push_back(owned.intent);
    }
    gone_ = std::move(gone);
    return taken;
  });
}

// ---- geometries ----

bool SimulatedCatalog::add_geometry(const GeometryRecord& record, std::int64_t intent) {
  GeometryRecord put = record;
  put.put = intent;
  return add(put, std::nullopt, {}).outcome != Added::Outcome::known;
}

SharedCatalog::Added SimulatedCatalog::add(const GeometryRecord& record, std::optional<std::int64_t> lost, const Quota& quota) {
  return call([&](State& state, Removed&) -> Added {
    const auto found = state.geometries.find(key_of(owned(record)));
    std::optional<GeometryRecord> known;
    if (found != state.geometries.end()) known = read(found->second);
    const bool intact = known && known->integrity == Integrity::intact;
    const auto intent = state.intents.find(record.put);
    if (intact && known->put != lost) {
      if (intent != state.intents.end()) intent->second.intent.kind = Intent::Kind::remove;
      return {*known, Added::Outcome::known};
    }
    if (record.put != 0 && (intent == state.intents.end() || intent->second.intent.kind != Intent::Kind::put)) {
      throw Error(ErrorCode::unavailable, "catalog: others gave the upload up", retry_ms);
    }
    if (!known) check_quota(record.tenant, amount_in(state, record.tenant), {1, 0, stored_bytes(record)}, quota);
    state.intents.erase(record.put);
    GeometryRecord kept = intact ? *known : record;
    kept.put = record.put;
    state.geometries[key_of(owned(record))] = row_of(kept);
    return {kept, known ? Added::Outcome::healed : Added::Outcome::added};
  });
}

std::optional<GeometryRecord> SimulatedCatalog::find_geometry(const OwnedId& id) {
  return call([&](State& state, Removed&) -> std::optional<GeometryRecord> {
    const auto found = state.geometries.find(key_of(id));
    if (found == state.geometries.end()) return std::nullopt;
    return read(found->second);
  });
}

std::vector<GeometryRecord> SimulatedCatalog::list_geometries(const std::string& tenant, const std::optional<PageStart>& after,
                                                              std::size_t limit) {
  return call([&](State& state, Removed&) {
    return page_of(state.geometries, tenant, after, limit, [&](const GeometryRecord& record) { return record.tenant == tenant; });
  });
}

Intent SimulatedCatalog::remove_geometry(const OwnedId& id, WithSetups policy, const RowsGone& gone) {
  return call([&](State& state, Removed& removed) {
    const auto found = state.geometries.find(key_of(id));
    if (found == state.geometries.end()) throw unknown_geometry(id.id);
    Intent intent{Intent::Kind::remove, {}};
    for (const auto& [key, row] : state.setups) {
      if (geometry_key(row.record) != key_of(id)) continue;
      intent.entries.push_back({Intent::What::setup, row.record.id, row.record.created_ms, {}, row.record.tenant});
      removed.push_back({Intent::What::setup, owned(row.record)});
    }
    if (!intent.entries.empty() && policy == WithSetups::refuse) {
      removed.clear();
      throw Error(ErrorCode::failed_precondition, "geometry " + id.id + ": " + std::to_string(intent.entries.size()) +
                                                      " setups refer to it; delete them too (with_setups) or release them first");
    }
    Intent::Entry entry{Intent::What::geometry, id.id, found->second.record.created_ms, {}, id.tenant};
    entry.put = found->second.record.put;
    intent.entries.push_back(entry);
    intent.number = ++state.numbers;
    removed.push_back({Intent::What::geometry, id});
    std::erase_if(state.setups, [&](const auto& row) { return geometry_key(row.second.record) == key_of(id); });
    state.geometries.erase(found);
    // As with PostgreSQL, the setups are not kept: no files of a shared store are theirs alone.
    state.intents[intent.number] = {{Intent::Kind::remove, {entry}, intent.number}, owner_};
    if (gone) gone(intent);
    return intent;
  });
}

std::vector<std::string> SimulatedCatalog::owners_of(const std::string& geometry_id) {
  return call([&](State& state, Removed&) {
    std::vector<std::string> owners;
    for (const auto& [key, row] : state.geometries) {
      if (row.record.id == geometry_id) owners.push_back(row.record.tenant);
    }
    return owners;
  });
}

// ---- setups ----

void SimulatedCatalog::put_setup(const SetupRecord& record, std::int64_t) { add_setup(record, {}); }

std::int64_t SimulatedCatalog::add_setup(const SetupRecord& record, const Quota& quota) {
  return call([&](State& state, Removed&) {
    if (state.geometries.count(geometry_key(record)) == 0) throw unknown_geometry(record.geometry_id);
    const auto found = state.setups.find(key_of(owned(record)));
    SetupRecord kept = record;
    if (found == state.setups.end()) {
      check_quota(record.tenant, amount_in(state, record.tenant), {0, 1, stored_bytes(record)}, quota);
    } else if (const SetupRecord known = read(found->second); known.integrity == Integrity::intact) {
      kept.created_ms = known.created_ms;
    }
    state.setups[key_of(owned(record))] = row_of(kept);
    return kept.created_ms;
  });
}

std::optional<SetupRecord> SimulatedCatalog::find_setup(const OwnedId& id) {
  return call([&](State& state, Removed&) -> std::optional<SetupRecord> {
    const auto found = state.setups.find(key_of(id));
    if (found == state.setups.end()) return std::nullopt;
    return read(found->second);
  });
}

std::vector<SetupRecord> SimulatedCatalog::list_setups(const OwnedId& geometry, const std::optional<PageStart>& after,
                                                       std::size_t limit) {
  return call([&](State& state, Removed&) {
    auto records = page_of(state.setups, geometry.tenant, after, limit, [&](const SetupRecord& record) {
      return record.tenant == geometry.tenant && (geometry.id.empty() || record.geometry_id == geometry.id);
    });
    std::size_t bytes = 0;
    const auto beyond = std::find_if(records.begin(), records.end(), [&](const SetupRecord& record) {
      const bool full = bytes >= listed_bytes;
      bytes += record.setup.size() + record.info.size();
      return full;
    });
    records.erase(beyond, records.end());
    return records;
  });
}

std::optional<Intent> SimulatedCatalog::remove_setup(const OwnedId& id, const RowsGone& gone) {
  return call([&](State& state, Removed& removed) -> std::optional<Intent> {
    const auto found = state.setups.find(key_of(id));
    if (found == state.setups.end()) return std::nullopt;
    const Intent intent{Intent::Kind::remove, {{Intent::What::setup, id.id, found->second.record.created_ms, {}, id.tenant}}};
    state.setups.erase(found);
    removed.push_back({Intent::What::setup, id});
    if (gone) gone(intent);
    return intent;
  });
}

std::size_t SimulatedCatalog::setup_count(const OwnedId& geometry) {
  return setup_counts(geometry.tenant, {geometry.id})[geometry.id];
}

std::map<std::string, std::size_t> SimulatedCatalog::setup_counts(const std::string& tenant,
                                                                  const std::vector<std::string>& ids) {
  return call([&](State& state, Removed&) {
    std::map<std::string, std::size_t> counts;
    for (const auto& [key, row] : state.setups) {
      const bool asked = std::find(ids.begin(), ids.end(), row.record.geometry_id) != ids.end();
      if (asked && row.record.tenant == tenant) ++counts[row.record.geometry_id];
    }
    return counts;
  });
}

// ---- all of it ----

void SimulatedCatalog::restore(const std::vector<GeometryRecord>& geometries, const std::vector<SetupRecord>& setups) {
  call([&](State& state, Removed&) {
    for (const auto& record : geometries) state.geometries[key_of(owned(record))] = row_of(record);
    for (const auto& record : setups) state.setups[key_of(owned(record))] = row_of(record);
  });
}

Catalog::Damaged SimulatedCatalog::check() {
  return call([&](State& state, Removed&) {
    Damaged damaged;
    for (const auto& [key, row] : state.geometries) {
      if (auto record = read(row); record.integrity == Integrity::damaged) damaged.geometries.push_back(std::move(record));
    }
    for (const auto& [key, row] : state.setups) {
      if (auto record = read(row); record.integrity == Integrity::damaged) damaged.setups.push_back(std::move(record));
    }
    return damaged;
  });
}

void SimulatedCatalog::snapshot(const std::function<void(GeometryRecord&&)>& geometry,
                                const std::function<void(SetupRecord&&)>& setup) {
  const State moment = call([&](State& state, Removed&) { return state; });
  for (const auto& [key, row] : moment.geometries) geometry(read(row));
  for (const auto& [key, row] : moment.setups) setup(read(row));
}

std::vector<std::string> SimulatedCatalog::geometry_ids(const std::string& tenant, const std::string& prefix, std::size_t limit) {
  return call([&](State& state, Removed&) { return ids_in(state.geometries, tenant, prefix, limit); });
}

std::vector<std::string> SimulatedCatalog::setup_ids(const std::string& tenant, const std::string& prefix, std::size_t limit) {
  return call([&](State& state, Removed&) { return ids_in(state.setups, tenant, prefix, limit); });
}

std::vector<OwnedId> SimulatedCatalog::all_geometries() {
  return call([&](State& state, Removed&) { return all_in(state.geometries); });
}

std::vector<OwnedId> SimulatedCatalog::all_setups() {
  return call([&](State& state, Removed&) { return all_in(state.setups); });
}

StoredAmount SimulatedCatalog::amount_in(const State& state, const std::string& tenant) {
  StoredAmount amount;
  for (const auto& [key, row] : state.geometries) {
    if (row.record.tenant != tenant) continue;
    ++amount.geometries;
    amount.bytes += stored_bytes(row.record);
  }
  for (const auto& [key, row] : state.setups) {
    if (row.record.tenant != tenant) continue;
    ++amount.setups;
    amount.bytes += stored_bytes(row.record);
  }
  return amount;
}

StoredAmount SimulatedCatalog::amount_of(const std::string& tenant) {
  return call([&](State& state, Removed&) { return amount_in(state, tenant); });
}

std::map<std::string, StoredAmount> SimulatedCatalog::amounts() {
  return call([&](State& state, Removed&) {
    std::map<std::string, StoredAmount> amounts;
    for (const auto& [key, row] : state.geometries) amounts[row.record.tenant] = amount_in(state, row.record.tenant);
    return amounts;
  });
}

Catalog::Counts SimulatedCatalog::counts() {
  return call([&](State& state, Removed&) { return Counts{state.geometries.size(), state.setups.size()}; });
}

// ---- of several servers ----

std::int64_t SimulatedCatalog::now_ms() {
  return call([&](State& state, Removed&) { return ++state.now_ms; });
}

std::shared_ptr<void> SimulatedCatalog::claim(const std::string& name, std::chrono::milliseconds patience,
                                              const RunContext& context) {
  context.check();
  try {
    const std::uint64_t number = call([&](State& state, Removed&) -> std::uint64_t {
      const std::uint64_t mine = database_.last_claim_ + 1;
      if (!database_.claims_.try_emplace(name, owner_, mine).second) {
        state.now_ms += patience.count();
        return 0;
      }
      return database_.last_claim_ = mine;
    });
    if (number == 0) return nullptr;
    SimulatedDatabase& database = database_;
    return {&database, [&database, name, number](void*) {
              const std::lock_guard lock(database.mutex_);
              const auto found = database.claims_.find(name);
              if (found != database.claims_.end() && found->second.second == number) database.claims_.erase(found);
            }};
  } catch (const Error& error) {
    if (error.code() != ErrorCode::unavailable) throw;
    return nullptr;
  }
}

}  // namespace deform::server
