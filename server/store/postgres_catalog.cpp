// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/postgres_catalog.h"

#include <spdlog/spdlog.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <type_traits>
#include <utility>

#include "core/base/error.h"
#include "server/store/catalog_records.h"
#include "server/store/postgres.h"

namespace deform::server {

namespace {

using postgres::Clock;
using postgres::Connection;
using postgres::LostConnection;
using postgres::Parameter;
using postgres::Result;
using postgres::Transaction;

constexpr int tables_version = 1;
// `id` and `geometry_id` are keys (key_of). Text is compared byte by byte, so that prefixes are ranges and pages are stable.
constexpr const char* tables[] = {
    "CREATE SCHEMA IF NOT EXISTS deformd",
    "CREATE SEQUENCE deformd.numbers",
    R"(CREATE TABLE deformd.geometries (id text COLLATE "C" PRIMARY KEY, tenant text COLLATE "C" NOT NULL, info bytea NOT NULL,
                                        created_ms bigint NOT NULL, checksum text NOT NULL, put bigint NOT NULL,
                                        bytes bigint NOT NULL))",
    "CREATE INDEX geometries_of_tenant ON deformd.geometries (tenant, created_ms DESC, id DESC)",
    R"(CREATE TABLE deformd.setups (id text COLLATE "C" PRIMARY KEY, tenant text COLLATE "C" NOT NULL,
                                    geometry_id text COLLATE "C" NOT NULL REFERENCES deformd.geometries (id),
                                    setup bytea NOT NULL, info bytea NOT NULL, created_ms bigint NOT NULL,
                                    checksum text NOT NULL, bytes bigint NOT NULL))",
    "CREATE INDEX setups_of_tenant ON deformd.setups (tenant, created_ms DESC, id DESC)",
    "CREATE INDEX setups_by_geometry ON deformd.setups (geometry_id, created_ms DESC, id DESC)",
    R"(CREATE TABLE deformd.intents (number bigint PRIMARY KEY, owner bigint NOT NULL, kind text NOT NULL,
                                     key text COLLATE "C" NOT NULL, put bigint NOT NULL))",
    "CREATE TABLE deformd.meta (version integer NOT NULL, identity text NOT NULL)",
};

constexpr const char* geometry_rows = "SELECT id, info, created_ms, checksum, tenant, put FROM deformd.geometries ";
constexpr const char* setup_rows = "SELECT id, geometry_id, setup, info, created_ms, checksum, tenant FROM deformd.setups ";
constexpr const char* channel = "deformd_removed";

constexpr auto connect_limit = std::chrono::seconds(5);
constexpr auto call_pause = std::chrono::milliseconds(50);
constexpr auto session_pause = std::chrono::milliseconds(200);
constexpr auto ask_every = std::chrono::seconds(2);
constexpr std::size_t most_idle = 8;
constexpr std::uint32_t taken_away_retry_ms = 1000;

/// The tenant and id of a row; what its key is no key of keeps it as its id.
template <typename Record>
void set_owner_in(Record& record, const std::string& key, const std::string& tenant) {
  const auto owner = owned_id(key);
  record.id = owner ? owner->id : key;
  if (owner) record.tenant = owner->tenant;
  if (!owner || owner->tenant != tenant) record.integrity = Integrity::damaged;
}

GeometryRecord geometry_in(const Result& rows, int row) {
  GeometryRecord record{{}, rows.bytes(row, 1), rows.number(row, 2)};
  record.put = rows.number(row, 5);
  set_owner_in(record, rows.text(row, 0), rows.text(row, 4));
  if (checksum(record) != rows.text(row, 3)) record.integrity = Integrity::damaged;
  return record;
}

SetupRecord setup_in(const Result& rows, int row) {
  SetupRecord record{{}, {}, rows.bytes(row, 2), rows.bytes(row, 3), rows.number(row, 4)};
  set_owner_in(record, rows.text(row, 0), rows.text(row, 6));
  const auto geometry = owned_id(rows.text(row, 1));
  if (geometry) record.geometry_id = geometry->id;
  if (!geometry || geometry->tenant != record.tenant || checksum(record) != rows.text(row, 5)) {
    record.integrity = Integrity::damaged;
  }
  return record;
}

/// The first setups of a condition and an order. An answer is in memory as a whole, so its length is decided here.
std::string first_setups(const std::string& where, const std::string& order, const std::string& limit) {
  const std::string page = "SELECT id, created_ms, octet_length(setup) + octet_length(info) AS bytes FROM deformd.setups " +
                           where + " " + order + " " + limit;
  const std::string sums = "SELECT id, sum(bytes) OVER (" + order + ") - bytes AS before FROM (" + page + ") AS page";
  return setup_rows + ("WHERE id IN (SELECT id FROM (" + sums + ") AS sums WHERE before < ") +
         std::to_string(Catalog::listed_bytes) + ") " + order;
}
std::string next_setups() { return first_setups("WHERE id > $1", "ORDER BY id", "LIMIT 100"); }
std::string next_geometries() { return std::string(geometry_rows) + "WHERE id > $1 ORDER BY id LIMIT 100"; }

template <typename Record, typename At>
std::vector<Record> records_of(const Result& rows, At at) {
  std::vector<Record> records;
  for (int row = 0; row < rows.rows(); ++row) records.push_back(at(rows, row));
  return records;
}

std::string row_key(const GeometryRecord& record) { return key_of(owned(record)); }
std::string row_key(const SetupRecord& record) { return key_of(owned(record)); }
std::string geometry_key_in(const SetupRecord& record) { return key_of({record.tenant, record.geometry_id}); }

const char* name_of(Intent::Kind kind) { return kind == Intent::Kind::put ? "put" : "remove"; }

/// For hashtextextended(), which makes the number of an advisory lock of it.
std::string lock_of_server(std::int64_t number) { return "deformd server " + std::to_string(number); }

std::string array_of(const std::vector<std::string>& keys) {
  std::string text = "{";
  for (const auto& one : keys) text += (text.size() > 1 ? "," : "") + one;  // letters, digits, . _ - only
  return text + "}";
}

/// With what is for the operator only.
std::string detail_of(const Error& error) {
  const auto* lost = dynamic_cast<const LostConnection*>(&error);
  return lost == nullptr ? error.what() : "catalog: " + lost->why();
}

class PostgresCatalog : public SharedCatalog {
 public:
  explicit PostgresCatalog(PostgresOptions options)
      : options_(std::move(options)), wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    if (wake_ < 0) throw Error(ErrorCode::unavailable, "catalog: too many open files");
    try {
      open();
    } catch (...) {
      ::close(wake_);
      throw;
    }
    session_thread_ = std::thread([this] { keep_session(); });
  }

  ~PostgresCatalog() override {
    stopping_ = true;
    const std::uint64_t one = 1;
    [[maybe_unused]] const auto written = ::write(wake_, &one, sizeof one);
    session_thread_.join();
    ::close(wake_);
  }

  // ---- intents ----

  std::int64_t begin(const Intent& intent) override {
    if (intent.entries.size() != 1 || intent.entries[0].what != Intent::What::geometry) {
      throw Error(ErrorCode::internal, "catalog: an intent of one geometry was expected");
    }
    const Intent::Entry& entry = intent.entries[0];
    return with([&](Connection& c) {
      return c
          .run(
              "INSERT INTO deformd.intents (number, owner, kind, key, put) SELECT n, $1, $2, $3, n "
              "FROM nextval('deformd.numbers') AS n RETURNING number",
              {owner_, name_of(intent.kind), key_of({entry.tenant, entry.id})})
          .number(0, 0);
    });
  }

  void end(std::int64_t number) override {
    with([&](Connection& c) { c.run("DELETE FROM deformd.intents WHERE number = $1", {number}); });
  }

  std::vector<Intent> intents() override {
    return with(
        [&](Connection& c) { return intents_of(c.run("SELECT number, kind, key, put FROM deformd.intents ORDER BY number")); });
  }

  bool revoke(std::int64_t intent) override {
    return with([&](Connection& c) {
      return c.run("UPDATE deformd.intents SET kind = 'remove' WHERE number = $1 AND owner = $2", {intent, owner_}).affected() >
             0;
    });
  }

  std::vector<Intent> take_over() override {
    return with([&](Connection& c) {
      std::vector<Intent> taken;
      const Result owners = c.run("SELECT DISTINCT owner FROM deformd.intents WHERE owner <> $1", {owner_});
      std::map<std::int64_t, Clock::time_point> gone;
      for (int row = 0; row < owners.rows(); ++row) {
        const std::int64_t owner = owners.number(row, 0);
        Transaction transaction(c);
        if (!locked(c.run("SELECT pg_try_advisory_xact_lock(hashtextextended($1, 0))", {lock_of_server(owner)}))) continue;
        const std::lock_guard lock(gone_mutex_);
        const auto known = gone_.find(owner);
        const Clock::time_point since = known == gone_.end() ? Clock::now() : known->second;
        gone[owner] = since;
        if (Clock::now() - since < options_.take_over_after) continue;
        const Result rows =
            c.run("UPDATE deformd.intents SET owner = $1, kind = 'remove' WHERE owner = $2 RETURNING number, kind, key, put",
                  {owner_, owner});
        transaction.commit();
        for (auto& intent : intents_of(rows)) taken.push_back(std::move(intent));
      }
      const std::lock_guard lock(gone_mutex_);
      gone_ = std::move(gone);
      return taken;
    });
  }

  // ---- geometries ----

  bool add_geometry(const GeometryRecord& record, std::int64_t intent) override {
    GeometryRecord put = record;
    put.put = intent;
    return add(put, std::nullopt, {}).outcome != Added::Outcome::known;
  }

  Added add(const GeometryRecord& record, std::optional<std::int64_t> lost, const Quota& quota) override {
    return with([&](Connection& c) -> Added {
      Transaction transaction(c);
      lock_amounts(c, record.tenant, quota);
      const Result rows = c.run((std::string(geometry_rows) + "WHERE id = $1 FOR UPDATE").c_str(), {row_key(record)});
      std::optional<GeometryRecord> known;
      if (rows.rows() > 0) known = geometry_in(rows, 0);
      if (known && record.put != 0 && known->put == record.put) {  // a call before this one was cut off and has done it
        return {*known, lost ? Added::Outcome::healed : Added::Outcome::added};
      }
      const bool intact = known && known->integrity == Integrity::intact;
      if (intact && known->put != lost) {
        c.run("UPDATE deformd.intents SET kind = 'remove' WHERE number = $1", {record.put});
        transaction.commit();
        return {*known, Added::Outcome::known};
      }
      if (record.put != 0 &&
          c.run("DELETE FROM deformd.intents WHERE number = $1 AND kind = 'put'", {record.put}).affected() == 0) {
        throw Error(ErrorCode::unavailable, taken_away, taken_away_retry_ms);
      }
      GeometryRecord kept = intact ? *known : record;
      kept.put = record.put;
      if (!known) check_amounts(c, record.tenant, {1, 0, stored_bytes(record)}, quota);
      if (write(c, kept, known ? Write::replace : Write::add) == 0)
        throw LostConnection("two servers have added the same at once");
      transaction.commit();
      return {kept, known ? Added::Outcome::healed : Added::Outcome::added};
    });
  }

  std::optional<GeometryRecord> find_geometry(const OwnedId& id) override {
    return with([&](Connection& c) -> std::optional<GeometryRecord> {
      const Result rows = c.run((std::string(geometry_rows) + "WHERE id = $1").c_str(), {key_of(id)});
      if (rows.rows() == 0) return std::nullopt;
      return geometry_in(rows, 0);
    });
  }

  std::vector<GeometryRecord> list_geometries(const std::string& tenant, const std::optional<PageStart>& after,
                                              std::size_t limit) override {
    return with([&](Connection& c) {
      const std::string sql = std::string(geometry_rows) + "WHERE tenant = $1 AND (created_ms, id) < ($2::bigint, $3) " + newest;
      const auto [created_ms, id] = start_of(tenant, after);
      return records_of<GeometryRecord>(c.run(sql.c_str(), {tenant, created_ms, id, as_number(limit)}), geometry_in);
    });
  }

  Intent remove_geometry(const OwnedId& id, WithSetups policy, const RowsGone& gone) override {
    Intent intent{Intent::Kind::remove, {}};
    intent = with([&](Connection& c) {
      Transaction transaction(c);
      if (intent.number != 0) {  // a call before this one was cut off: has it done it?
        if (c.run("SELECT 1 FROM deformd.intents WHERE number = $1", {intent.number}).rows() > 0) return intent;
      }
      intent = {Intent::Kind::remove, {}};
      intent.number = c.run("SELECT nextval('deformd.numbers')").number(0, 0);
      const Result geometry = c.run("SELECT created_ms, put FROM deformd.geometries WHERE id = $1 FOR UPDATE", {key_of(id)});
      if (geometry.rows() == 0) throw unknown_geometry(id.id);
      const Result setups = c.run("SELECT id, created_ms FROM deformd.setups WHERE geometry_id = $1", {key_of(id)});
      for (int row = 0; row < setups.rows(); ++row) {
        const auto setup = owned_id(setups.text(row, 0));
        if (setup) intent.entries.push_back({Intent::What::setup, setup->id, setups.number(row, 1), {}, setup->tenant});
      }
      if (setups.rows() > 0 && policy == WithSetups::refuse) {
        throw Error(ErrorCode::failed_precondition,
                    "geometry " + id.id + ": " + std::to_string(setups.rows()) +
                        " setups refer to it; delete them too (with_setups) or release them first");
      }
      Intent::Entry entry{Intent::What::geometry, id.id, geometry.number(0, 0), {}, id.tenant};
      entry.put = geometry.number(0, 1);
      intent.entries.push_back(entry);
      c.run("SELECT pg_notify($1, 'setup ' || id) FROM deformd.setups WHERE geometry_id = $2", {channel, key_of(id)});
      c.run("SELECT pg_notify($1, $2)", {channel, "geometry " + key_of(id)});
      c.run("DELETE FROM deformd.setups WHERE geometry_id = $1", {key_of(id)});
      c.run("DELETE FROM deformd.geometries WHERE id = $1", {key_of(id)});
      c.run("INSERT INTO deformd.intents (number, owner, kind, key, put) VALUES ($1, $2, 'remove', $3, $4)",
            {intent.number, owner_, key_of(id), entry.put});
      transaction.commit();
      return intent;
    });
    if (gone) gone(intent);
    return intent;
  }

  std::vector<std::string> owners_of(const std::string& geometry_id) override {
    return with([&](Connection& c) {
      const Result rows = c.run("SELECT tenant FROM deformd.geometries WHERE id >= $1 AND id < $2 ORDER BY id",
                                {geometry_id, geometry_id + "/"});  // "/" sorts right after the "." before a tenant
      return records_of<std::string>(rows, [](const Result& result, int row) { return result.text(row, 0); });
    });
  }

  // ---- setups ----

  void put_setup(const SetupRecord& record, std::int64_t) override { add_setup(record, {}); }

  std::int64_t add_setup(const SetupRecord& record, const Quota& quota) override {
    return with(options_.setup_patience, [&](Connection& c) {
      Transaction transaction(c);
      lock_amounts(c, record.tenant, quota);
      if (c.run("SELECT 1 FROM deformd.geometries WHERE id = $1 FOR KEY SHARE", {geometry_key_in(record)}).rows() == 0) {
        throw unknown_geometry(record.geometry_id);
      }
      const Result rows = c.run((std::string(setup_rows) + "WHERE id = $1 FOR UPDATE").c_str(), {row_key(record)});
      SetupRecord kept = record;
      if (rows.rows() > 0) {
        const SetupRecord known = setup_in(rows, 0);
        if (known.integrity == Integrity::intact) kept.created_ms = known.created_ms;
      } else {
        check_amounts(c, record.tenant, {0, 1, stored_bytes(record)}, quota);
      }
      if (write(c, kept, rows.rows() > 0 ? Write::replace : Write::add) == 0) {
        throw LostConnection("two servers have added the same at once");
      }
      transaction.commit();
      return kept.created_ms;
    });
  }

  std::optional<SetupRecord> find_setup(const OwnedId& id) override {
    return with([&](Connection& c) -> std::optional<SetupRecord> {
      const Result rows = c.run((std::string(setup_rows) + "WHERE id = $1").c_str(), {key_of(id)});
      if (rows.rows() == 0) return std::nullopt;
      return setup_in(rows, 0);
    });
  }

  std::vector<SetupRecord> list_setups(const OwnedId& geometry, const std::optional<PageStart>& after,
                                       std::size_t limit) override {
    return with([&](Connection& c) {
      const bool all = geometry.id.empty();
      const std::string sql =
          first_setups(std::string("WHERE ") + (all ? "tenant" : "geometry_id") + " = $1 AND (created_ms, id) < ($2::bigint, $3)",
                       "ORDER BY created_ms DESC, id DESC", "LIMIT $4");
      const auto [created_ms, id] = start_of(geometry.tenant, after);
      const std::string of = all ? geometry.tenant : key_of(geometry);
      return records_of<SetupRecord>(c.run(sql.c_str(), {of, created_ms, id, as_number(limit)}), setup_in);
    });
  }

  std::optional<Intent> remove_setup(const OwnedId& id, const RowsGone& gone) override {
    const auto removed = with([&](Connection& c) -> std::optional<Intent> {
      Transaction transaction(c);
      const Result rows = c.run("DELETE FROM deformd.setups WHERE id = $1 RETURNING created_ms", {key_of(id)});
      if (rows.rows() == 0) return std::nullopt;
      c.run("SELECT pg_notify($1, $2)", {channel, "setup " + key_of(id)});
      transaction.commit();
      return Intent{Intent::Kind::remove, {{Intent::What::setup, id.id, rows.number(0, 0), {}, id.tenant}}};
    });
    if (removed && gone) gone(*removed);
    return removed;
  }

  std::size_t setup_count(const OwnedId& geometry) override {
    return with([&](Connection& c) {
      return as_size(c.run("SELECT count(*) FROM deformd.setups WHERE geometry_id = $1", {key_of(geometry)}), 0, 0);
    });
  }

  std::map<std::string, std::size_t> setup_counts(const std::string& tenant, const std::vector<std::string>& ids) override {
    std::vector<std::string> keys;
    for (const auto& id : ids) keys.push_back(key_of({tenant, id}));
    return with([&](Connection& c) {
      std::map<std::string, std::size_t> counts;
      const Result rows =
          c.run("SELECT geometry_id, count(*) FROM deformd.setups WHERE geometry_id = ANY ($1::text[]) GROUP BY geometry_id",
                {array_of(keys)});
      for (int row = 0; row < rows.rows(); ++row) {
        if (const auto id = owned_id(rows.text(row, 0))) counts[id->id] = as_size(rows, row, 1);
      }
      return counts;
    });
  }

  // ---- all of it ----

  void restore(const std::vector<GeometryRecord>& geometries, const std::vector<SetupRecord>& setups) override {
    with([&](Connection& c) {
      Transaction transaction(c);
      for (const auto& record : geometries) {
        if (write(c, record, Write::replace) == 0) write(c, record, Write::add);
      }
      for (const auto& record : setups) {
        if (write(c, record, Write::replace) == 0) write(c, record, Write::add);
      }
      transaction.commit();
    });
  }

  Damaged check() override {
    Damaged damaged;
    const auto anew = [this](auto read) { return with(read); };
    in_parts(anew, next_geometries(), geometry_in, [&](GeometryRecord&& record) {
      if (record.integrity == Integrity::damaged) damaged.geometries.push_back(std::move(record));
    });
    in_parts(anew, next_setups(), setup_in, [&](SetupRecord&& record) {
      if (record.integrity == Integrity::damaged) damaged.setups.push_back(std::move(record));
    });
    return damaged;
  }

  void snapshot(const std::function<void(GeometryRecord&&)>& geometry, const std::function<void(SetupRecord&&)>& setup) override {
    now_ms();  // of the idle sessions none is lost then
    Lease lease(*this);
    Transaction transaction(*lease);
    lease->run("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ READ ONLY");
    const auto here = [&](auto read) { return read(*lease); };
    in_parts(here, next_geometries(), geometry_in, geometry);
    in_parts(here, next_setups(), setup_in, setup);
    transaction.commit();
  }

  std::vector<std::string> geometry_ids(const std::string& tenant, const std::string& prefix, std::size_t limit) override {
    return ids("SELECT id FROM deformd.geometries WHERE id >= $1 AND id < $2 AND tenant = $3 ORDER BY id LIMIT $4", tenant,
               prefix, limit);
  }
  std::vector<std::string> setup_ids(const std::string& tenant, const std::string& prefix, std::size_t limit) override {
    return ids("SELECT id FROM deformd.setups WHERE id >= $1 AND id < $2 AND tenant = $3 ORDER BY id LIMIT $4", tenant, prefix,
               limit);
  }

  std::vector<OwnedId> all_geometries() override { return all("SELECT id FROM deformd.geometries ORDER BY id"); }
  std::vector<OwnedId> all_setups() override { return all("SELECT id FROM deformd.setups ORDER BY id"); }

  StoredAmount amount_of(const std::string& tenant) override {
    return with([&](Connection& c) { return amount(c, tenant); });
  }

  std::map<std::string, StoredAmount> amounts() override {
    return with([&](Connection& c) {
      std::map<std::string, StoredAmount> amounts;
      const Result rows = c.run("SELECT tenant FROM deformd.geometries UNION SELECT tenant FROM deformd.setups");
      for (int row = 0; row < rows.rows(); ++row) amounts[rows.text(row, 0)] = amount(c, rows.text(row, 0));
      return amounts;
    });
  }

  Counts counts() override {
    return with([&](Connection& c) {
      const Result rows = c.run("SELECT (SELECT count(*) FROM deformd.geometries), (SELECT count(*) FROM deformd.setups)");
      return Counts{as_size(rows, 0, 0), as_size(rows, 0, 1)};
    });
  }

  // ---- of several servers ----

  std::string identity() override { return identity_; }

  std::int64_t now_ms() override {
    return with(
        [&](Connection& c) { return c.run("SELECT floor(extract(epoch FROM clock_timestamp()) * 1000)::bigint").number(0, 0); });
  }

  std::shared_ptr<void> claim(const std::string& name, std::chrono::milliseconds patience, const RunContext& context) override {
    const auto end = Clock::now() + patience;
    if (!lasting_trouble().empty()) return nullptr;
    try {
      auto lease = std::make_shared<Lease>(*this);
      const std::string lock = "deformd " + name;
      while (!locked((*lease)->run("SELECT pg_try_advisory_lock(hashtextextended($1, 0))", {lock}))) {
        if (Clock::now() >= end) return nullptr;
        context.check();
        std::this_thread::sleep_for(call_pause);
      }
      return {lease.get(), [lease, lock](void*) {
                try {
                  (*lease)->run("SELECT pg_advisory_unlock(hashtextextended($1, 0))", {lock});
                } catch (const Error&) {
                  lease->drop();  // and the lock with it
                }
              }};
    } catch (const Error& error) {
      if (error.code() != ErrorCode::unavailable) throw;
      return nullptr;
    }
  }

  void on_news(CatalogNews news) override {
    const std::lock_guard lock(news_mutex_);
    news_ = std::move(news);
  }

  std::string trouble() const override {
    const std::lock_guard lock(trouble_mutex_);
    return trouble_.empty() ? "" : "the database of the catalog cannot be reached";
  }

 private:
  static constexpr const char* newest = "ORDER BY created_ms DESC, id DESC LIMIT $4";
  static constexpr const char* taken_away =
      "catalog: this server was cut off from the database for so long that others gave the upload up";

  // ---- connections ----

  /// A connection of the pool, or a new one; goes back when it is as it was.
  class Lease {
   public:
    explicit Lease(PostgresCatalog& catalog) : catalog_(catalog) {
      {
        const std::lock_guard lock(catalog_.pool_mutex_);
        if (!catalog_.pool_.empty()) {
          connection_ = std::move(catalog_.pool_.back());
          catalog_.pool_.pop_back();
        }
      }
      if (!connection_) connection_ = std::make_unique<Connection>(catalog_.options_.uri, connect_limit);
    }
    ~Lease() {
      if (!connection_) return;
      const std::lock_guard lock(catalog_.pool_mutex_);
      if (connection_->is_lost())
        catalog_.pool_.clear();  // the others are lost, too, most likely
      else if (connection_->is_idle() && catalog_.pool_.size() < most_idle)
        catalog_.pool_.push_back(std::move(connection_));
    }
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;
    Connection* operator->() { return connection_.get(); }
    Connection& operator*() { return *connection_; }
    void drop() { connection_.reset(); }

   private:
    PostgresCatalog& catalog_;
    std::unique_ptr<Connection> connection_;
  };

  template <typename Work>
  std::invoke_result_t<Work, Connection&> with(Work work) {
    return with(options_.call_patience, work);
  }

  /// Again, while the database cannot be reached, until the patience is over.
  template <typename Work>
  std::invoke_result_t<Work, Connection&> with(std::chrono::milliseconds patience, Work work) {
    const auto end = Clock::now() + patience;
    for (;;) {
      try {
        const std::string why = lasting_trouble();
        if (!why.empty()) {
          if (patience <= options_.call_patience) throw LostConnection(why);
        } else {
          Lease lease(*this);
          if constexpr (std::is_void_v<std::invoke_result_t<Work, Connection&>>) {
            work(*lease);
            return note_answer();
          } else {
            auto result = work(*lease);
            note_answer();
            return result;
          }
        }
        if (Clock::now() >= end) throw LostConnection(why);
      } catch (const Error& error) {
        if (error.code() != ErrorCode::unavailable || Clock::now() >= end) throw;
        if (patience <= options_.call_patience && !lasting_trouble().empty()) throw;
      }
      std::this_thread::sleep_for(call_pause);
    }
  }

  /// When calls have waited long enough already.
  std::string lasting_trouble() const {
    const std::lock_guard lock(trouble_mutex_);
    return trouble_.empty() || Clock::now() - trouble_since_ < options_.call_patience ? std::string() : trouble_;
  }

  /// Trouble does not last while calls are answered: then it is only that the connection of the session is cut off again and
  /// again.
  void note_answer() {
    const std::lock_guard lock(trouble_mutex_);
    if (!trouble_.empty()) trouble_since_ = Clock::now();
  }

  void set_trouble(const std::string& why) {
    const std::lock_guard lock(trouble_mutex_);
    if (why.empty()) {
      spdlog::info("catalog: the database answers again");
    } else {
      if (trouble_.empty()) trouble_since_ = Clock::now();
      if (trouble_ != why) spdlog::error("{}; what is in memory is served, the rest waits", why);
    }
    trouble_ = why;
  }

  void open() {
    const auto end = Clock::now() + options_.start_patience;
    for (bool said = false;; said = true) {
      try {
        Connection connection(options_.uri, connect_limit);
        prepare_schema(connection);
        owner_ = connection.run("SELECT nextval('deformd.numbers')").number(0, 0);
        session_ = begin_session();
        return;
      } catch (const Error& error) {
        const std::string why = detail_of(error);
        if (error.code() != ErrorCode::unavailable) throw;
        if (Clock::now() >= end) throw Error(error.code(), why);
        if (!said) spdlog::warn("{}; waiting for it", why);
      }
      std::this_thread::sleep_for(session_pause);
    }
  }

  void prepare_schema(Connection& c) {
    Transaction transaction(c);
    c.run("SELECT pg_advisory_xact_lock(hashtextextended('deformd schema', 0))");
    if (c.run("SELECT to_regclass('deformd.meta')").text(0, 0).empty()) {
      for (const char* statement : tables) c.run(statement);
      c.run("INSERT INTO deformd.meta (version, identity) VALUES ($1::integer, replace(gen_random_uuid()::text, '-', ''))",
            {std::int64_t{tables_version}});
    }
    const Result meta = c.run("SELECT version, identity FROM deformd.meta");
    if (meta.rows() != 1) throw Error(ErrorCode::data_loss, "catalog: the table deformd.meta has not one row");
    if (meta.number(0, 0) != tables_version) {
      throw Error(ErrorCode::failed_precondition,
                  "catalog: its schema has version " + meta.text(0, 0) + ", this server knows " + std::to_string(tables_version));
    }
    identity_ = meta.text(0, 1);
    transaction.commit();
  }

  /// The connection that says that this server lives, and listens.
  std::unique_ptr<Connection> begin_session() {
    auto session = std::make_unique<Connection>(options_.uri, connect_limit);
    session->run("LISTEN deformd_removed");
    is_marked_ = mark_as_living(*session);
    return session;
  }

  /// The session before may not have ended yet for PostgreSQL, and says the same for so long.
  bool mark_as_living(Connection& session) const {
    return locked(session.run("SELECT pg_try_advisory_lock(hashtextextended($1, 0))", {lock_of_server(owner_)}));
  }

  void keep_session() {
    while (!stopping_) {
      try {
        if (!session_) {
          session_ = begin_session();
          set_trouble("");
          const std::lock_guard lock(news_mutex_);
          if (news_.missed) news_.missed();
        }
        Clock::time_point asked = Clock::now();
        while (!stopping_) {
          for (const auto& notification : session_->wait(std::chrono::seconds(1), wake_)) tell(notification.payload);
          if (!is_marked_) is_marked_ = mark_as_living(*session_);
          if (Clock::now() - asked < ask_every) continue;
          session_->run("SELECT 1", {}, connect_limit);
          asked = Clock::now();
        }
      } catch (const Error& error) {
        session_.reset();
        set_trouble(detail_of(error));
        for (int i = 0; i < 4 && !stopping_; ++i) std::this_thread::sleep_for(session_pause / 4);
      }
    }
    session_.reset();
  }

  void tell(const std::string& payload) {
    const std::size_t space = payload.find(' ');
    const auto id = owned_id(payload.substr(space == std::string::npos ? payload.size() : space + 1));
    if (!id) return;
    const std::lock_guard lock(news_mutex_);
    if (news_.removed) news_.removed(payload.starts_with("setup ") ? Intent::What::setup : Intent::What::geometry, *id);
  }

  // ---- rows ----

  static bool locked(const Result& rows) { return rows.text(0, 0) == "t"; }
  static std::int64_t as_number(std::size_t count) { return static_cast<std::int64_t>(count); }
  static std::size_t as_size(const Result& rows, int row, int column) {
    return static_cast<std::size_t>(rows.number(row, column));
  }

  static std::vector<Intent> intents_of(const Result& rows) {
    std::vector<Intent> intents;
    for (int row = 0; row < rows.rows(); ++row) {
      const auto id = owned_id(rows.text(row, 2));
      if (!id) {
        spdlog::warn("store: intent {} is damaged; what it names is kept", rows.number(row, 0));
        continue;
      }
      Intent intent{rows.text(row, 1) == "put" ? Intent::Kind::put : Intent::Kind::remove, {}};
      Intent::Entry entry{Intent::What::geometry, id->id, 0, {}, id->tenant};
      entry.put = rows.number(row, 3);
      intent.entries.push_back(entry);
      intent.number = rows.number(row, 0);
      intents.push_back(std::move(intent));
    }
    return intents;
  }

  enum class Write { add, replace };

  /// Returns the number of rows: adding adds none when there is one, replacing none when there is none.
  static std::int64_t write(Connection& c, const GeometryRecord& record, Write how) {
    const char* sql = how == Write::add ? "INSERT INTO deformd.geometries (id, tenant, info, created_ms, checksum, put, bytes) "
                                          "VALUES ($1, $2, $3, $4, $5, $6, $7) ON CONFLICT (id) DO NOTHING"
                                        : "UPDATE deformd.geometries SET tenant = $2, info = $3, created_ms = $4, checksum = $5, "
                                          "put = $6, bytes = $7 WHERE id = $1";
    return c
        .run(sql, {row_key(record), record.tenant, Parameter::bytes(record.info), record.created_ms, checksum(record), record.put,
                   static_cast<std::int64_t>(stored_bytes(record))})
        .affected();
  }
  static std::int64_t write(Connection& c, const SetupRecord& record, Write how) {
    const char* sql = how == Write::add
                          ? "INSERT INTO deformd.setups (id, tenant, geometry_id, setup, info, created_ms, checksum, bytes) "
                            "VALUES ($1, $2, $3, $4, $5, $6, $7, $8) ON CONFLICT (id) DO NOTHING"
                          : "UPDATE deformd.setups SET tenant = $2, geometry_id = $3, setup = $4, info = $5, created_ms = $6, "
                            "checksum = $7, bytes = $8 WHERE id = $1";
    return c
        .run(sql, {row_key(record), record.tenant, geometry_key_in(record), Parameter::bytes(record.setup),
                   Parameter::bytes(record.info), record.created_ms, checksum(record),
                   static_cast<std::int64_t>(stored_bytes(record))})
        .affected();
  }

  /// What several servers add to a tenant with a quota is counted one after the other.
  static void lock_amounts(Connection& c, const std::string& tenant, const Quota& quota) {
    if (quota.geometries == 0 && quota.stored_bytes == 0) return;
    c.run("SELECT pg_advisory_xact_lock(hashtextextended($1, 0))", {"deformd tenant " + tenant});
  }
  static void check_amounts(Connection& c, const std::string& tenant, const StoredAmount& more, const Quota& quota) {
    if (quota.geometries == 0 && quota.stored_bytes == 0) return;
    check_quota(tenant, amount(c, tenant), more, quota);
  }
  static StoredAmount amount(Connection& c, const std::string& tenant) {
    const Result rows = c.run(
        "SELECT g.n, s.n, g.bytes + s.bytes FROM "
        "(SELECT count(*) AS n, coalesce(sum(bytes), 0)::bigint AS bytes FROM deformd.geometries WHERE tenant = $1) AS g, "
        "(SELECT count(*) AS n, coalesce(sum(bytes), 0)::bigint AS bytes FROM deformd.setups WHERE tenant = $1) AS s",
        {tenant});
    return {as_size(rows, 0, 0), as_size(rows, 0, 1), static_cast<std::uint64_t>(rows.number(0, 2))};
  }

  static std::pair<std::int64_t, std::string> start_of(const std::string& tenant, const std::optional<PageStart>& after) {
    if (after) return {after->created_ms, key_of({tenant, after->id})};
    return {INT64_MAX, ""};
  }

  std::vector<std::string> ids(const char* sql, const std::string& tenant, const std::string& prefix, std::size_t limit) {
    return with([&](Connection& c) {
      // "g" sorts after every hexadecimal digit
      const Result rows = c.run(sql, {prefix, prefix + "g", tenant, as_number(limit)});
      std::vector<std::string> found;
      for (int row = 0; row < rows.rows(); ++row) {
        if (const auto owned = owned_id(rows.text(row, 0))) found.push_back(owned->id);
      }
      return found;
    });
  }

  std::vector<OwnedId> all(const char* sql) {
    return with([&](Connection& c) {
      const Result rows = c.run(sql);
      std::vector<OwnedId> found;
      for (int row = 0; row < rows.rows(); ++row) {
        if (auto owned = owned_id(rows.text(row, 0))) found.push_back(*std::move(owned));
      }
      return found;
    });
  }

  /// At most a hundred rows at a time, by their keys. `with`: runs what it is given with a connection.
  template <typename With, typename At, typename Take>
  static void in_parts(const With& with, const std::string& select, At at, Take take) {
    std::string last;
    for (;;) {
      const Result rows = with([&](Connection& c) { return c.run(select.c_str(), {last}); });
      if (rows.rows() == 0) return;
      for (int row = 0; row < rows.rows(); ++row) take(at(rows, row));
      last = rows.text(rows.rows() - 1, 0);
    }
  }

  const PostgresOptions options_;
  const int wake_;
  std::string identity_;
  std::int64_t owner_ = 0;  ///< the number of this server, never given twice

  std::mutex pool_mutex_;
  std::vector<std::unique_ptr<Connection>> pool_;  // under pool_mutex_
  mutable std::mutex trouble_mutex_;
  // under trouble_mutex_
  std::string trouble_;
  Clock::time_point trouble_since_{};
  std::mutex news_mutex_;
  CatalogNews news_;  // under news_mutex_
  std::mutex gone_mutex_;
  std::map<std::int64_t, Clock::time_point> gone_;  // under gone_mutex_: servers without a session, since when

  std::atomic<bool> stopping_{false};
  // of session_thread_
  std::unique_ptr<Connection> session_;
  bool is_marked_ = false;  // the session has the lock that says that this server lives
  std::thread session_thread_;
};

}  // namespace

std::unique_ptr<SharedCatalog> open_postgres_catalog(const PostgresOptions& options) {
  check_catalog_uri(options.uri);
  return std::make_unique<PostgresCatalog>(options);
}

void check_catalog_uri(const std::string& uri) { postgres::check_uri(uri); }

}  // namespace deform::server
