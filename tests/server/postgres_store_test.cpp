// SPDX-License-Identifier: GPL-3.0-or-later
// A store that several servers share: what one does is there for all, and none harms what another one does, whatever stops,
// breaks off or comes too late.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <set>
#include <thread>

#include "server/store/geometry_store.h"
#include "tests/server/any_store.h"
#include "tests/server/postgres_database.h"

namespace deform::server::postgres_store_test {
namespace {

namespace fs = std::filesystem;

std::unique_ptr<SharedStore> open_shared(
    const fs::path& folder, const std::string& uri, SharedStoreOptions options = quick_store(),
    const std::function<void(PostgresOptions&)>& change = [](PostgresOptions&) {}) {
  PostgresOptions postgres = quick_postgres(uri);
  change(postgres);
  return std::make_unique<SharedStore>(folder, open_postgres_catalog(postgres), std::move(options));
}

std::unique_ptr<Store> open_any(const fs::path& folder) { return open_shared(folder, database_of(folder)); }

INSTANTIATE_TEST_SUITE_P(Postgres, AnyStore, testing::Values(StoreKind{"shared_store", open_any}),
                         [](const auto& instance) { return instance.param.name; });

class SharedStoreTest : public StoreTest {
 protected:
  SharedStoreTest() : a(open_shared(data, uri)), b(open_shared(data, uri)) {}

  std::string put(Store& store, const Mesh& given, const std::string& name = "sheet") {
    store.put(given, own(mesh_id(given)), name);
    return mesh_id(given);
  }
  std::set<std::string> files() const {
    std::set<std::string> names;
    for (const char* folder : {"geometries", "tmp"}) {
      for (const auto& entry : fs::directory_iterator(data / folder)) names.insert(entry.path().filename().string());
    }
    return names;
  }
  std::int64_t count(const char* statement) const { return sql(uri, statement).number(0, 0); }
  std::int64_t intents() const { return count("SELECT count(*) FROM deformd.intents"); }
  /// Every row has its file, and there is no other file and no intent.
  bool is_clean() const {
    std::set<std::string> expected;
    const auto rows = sql(uri, "SELECT id || '~' || put FROM deformd.geometries");
    for (int row = 0; row < rows.rows(); ++row) expected.insert(rows.text(row, 0));
    return files() == expected && intents() == 0;
  }
  Error error_of(const std::function<void()>& action) {
    try {
      action();
    } catch (const Error& error) {
      return error;
    }
    return {ErrorCode::internal, "no error"};
  }

  const std::string uri = new_database();
  std::unique_ptr<SharedStore> a, b;
  const Mesh mesh = sheet_mesh(6, 5);
  const std::string id = mesh_id(mesh);
};

TEST_F(SharedStoreTest, what_one_server_stores_is_there_for_the_other_at_once) {
  // Not found is not remembered.
  EXPECT_EQ(code_of([&] { b->load(own(id)); }), ErrorCode::not_found);
  EXPECT_EQ(code_of([&] { b->resolve_geometry(default_tenant, id); }), ErrorCode::not_found);
  EXPECT_FALSE(b->contains(own(id)));
  put(*a, mesh, "wing.obj");
  EXPECT_EQ(b->load(own(id)).points, mesh.points);
  EXPECT_EQ(b->info(own(id)).name(), "wing.obj");
  EXPECT_EQ(b->resolve_geometry(default_tenant, id.substr(0, 8)).id, id);
  EXPECT_TRUE(b->put(mesh, own(id), "another name").existed());
  const SetupRecord setup = setup_record(id, -0.1);
  EXPECT_FALSE(b->find_setup(owned(setup)));
  a->put_setup(setup);
  EXPECT_EQ(b->find_setup(owned(setup))->setup, setup.setup);
  EXPECT_EQ(b->info(own(id)).setups(), 1u);
  EXPECT_EQ(b->list(default_tenant, {}).geometries(0).setups(), 1u);
  b->remove(own(id), WithSetups::remove);
  EXPECT_EQ(code_of([&] { a->load(own(id)); }), ErrorCode::not_found);
  EXPECT_FALSE(a->find_setup(owned(setup)));
  EXPECT_TRUE(is_clean());
}

TEST_F(SharedStoreTest, setups_keep_the_time_at_which_they_were_stored_first) {
  put(*a, mesh);
  const std::int64_t first = a->put_setup(setup_record(id, -0.1));
  std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_EQ(b->put_setup(setup_record(id, -0.1)), first);
}

// As long as it has pages, by the clock of the database: that of a server may be wrong.
TEST_F(SharedStoreTest, geometries_of_all_servers_are_listed_in_one_order) {
  std::vector<std::string> expected;
  for (int i = 0; i < 6; ++i) {
    expected.insert(expected.begin(), put(i % 2 == 0 ? *a : *b, sheet_mesh(4, 3, 0.1 * i)));
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  v1::ListGeometriesRequest request;
  request.set_page_size(4);
  std::vector<std::string> seen;
  for (Store* store : {static_cast<Store*>(a.get()), static_cast<Store*>(b.get())}) {
    const auto reply = store->list(default_tenant, request);
    for (const auto& info : reply.geometries()) seen.push_back(info.id());
    request.set_page_token(reply.next_page_token());
  }
  EXPECT_EQ(seen, expected);
  const auto now = count("SELECT floor(extract(epoch FROM clock_timestamp()) * 1000)::bigint");
  EXPECT_LE(a->info(own(seen[0])).registered_unix_ms(), now);
}

TEST_F(SharedStoreTest, what_both_put_at_once_is_there_once) {
  for (int round = 0; round < 10; ++round) {
    const Mesh both = sheet_mesh(6, 5, 1 + round);
    std::thread other([&] { b->put(both, own(mesh_id(both)), "b"); });
    a->put(both, own(mesh_id(both)), "a");
    other.join();
    EXPECT_EQ(a->load(own(mesh_id(both))).points, both.points);
    EXPECT_EQ(a->info(own(mesh_id(both))).name(), b->info(own(mesh_id(both))).name());
  }
  EXPECT_TRUE(is_clean());
}

TEST_F(SharedStoreTest, quotas_hold_for_all_servers_together) {
  const Quota three{0, 3, 0, 0};
  std::atomic<int> stored{0}, refused{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 12; ++i) {
    threads.emplace_back([&, i] {
      const Mesh one = sheet_mesh(8, 8, 1 + i);
      try {
        (i % 2 == 0 ? a : b)->put(one, {"acme", mesh_id(one)}, "", three);
        ++stored;
      } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::out_of_budget) << error.what();
        ++refused;
      }
    });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(stored, 3);
  EXPECT_EQ(refused, 9);
  EXPECT_TRUE(is_clean());
  const StoredAmount amount = b->amount_of("acme");
  EXPECT_EQ(amount.geometries, 3u);
  const Quota full{amount.bytes, 0, 0, 0};
  const std::string of = b->list("acme", {}).geometries(0).id();
  EXPECT_EQ(code_of([&] { a->put_setup(setup_record(of, -0.1, "acme"), full); }), ErrorCode::out_of_budget);
  b->put_setup(setup_record(of, -0.1, "acme"));
  EXPECT_GT(a->amount_of("acme").bytes, amount.bytes);
}

// ---- too late ----

TEST_F(SharedStoreTest, a_removal_that_comes_late_takes_nothing_from_who_registers_again) {
  put(*a, mesh);
  SharedStoreOptions options = quick_store();
  bool done = false;
  options.store.on_step = [&](const char* step) {
    if (std::string(step) != "a removal is announced" || std::exchange(done, true)) return;
    put(*b, mesh, "again");
  };
  const auto slow = open_shared(data, uri, options);
  slow->remove(own(id), WithSetups::remove);
  ASSERT_TRUE(done);
  EXPECT_EQ(a->load(own(id)).points, mesh.points);
  EXPECT_EQ(a->info(own(id)).name(), "again");
  EXPECT_TRUE(is_clean());
}

TEST_F(SharedStoreTest, a_put_that_others_gave_up_is_refused_and_leaves_nothing) {
  SharedStoreOptions options = quick_store();
  bool done = false;
  options.store.on_step = [&](const char* step) {
    if (std::string(step) != "the content is in place" || std::exchange(done, true)) return;
    // As another server does after the session of this one has ended.
    sql(uri, "UPDATE deformd.intents SET owner = -1, kind = 'remove'");
  };
  const auto slow = open_shared(data, uri, options);
  const Error error = error_of([&] { put(*slow, mesh); });
  EXPECT_EQ(error.code(), ErrorCode::unavailable) << error.what();
  EXPECT_GT(error.retry_after_ms(), 0u);
  EXPECT_FALSE(a->contains(own(id)));
  EXPECT_TRUE(eventually([&] { return is_clean(); })) << testing::PrintToString(files());
  put(*slow, mesh);
  EXPECT_EQ(a->load(own(id)).points, mesh.points);
}

TEST_F(SharedStoreTest, a_file_that_is_renewed_while_it_is_read_is_read_again) {
  put(*a, mesh);
  const fs::path old = data / "geometries" / *files().begin();
  // The row names the new file, the other server still knows the old one.
  sql(uri, "UPDATE deformd.geometries SET put = put + 1000000");
  fs::rename(old, data / "geometries" / (id + "~" + std::to_string(count("SELECT put FROM deformd.geometries"))));
  EXPECT_EQ(b->load(own(id)).points, mesh.points);
}

TEST_F(SharedStoreTest, a_put_that_fails_after_its_row_was_written_takes_nothing_away) {
  SharedStoreOptions options = quick_store();
  options.store.on_step = [&](const char* step) {
    if (std::string(step) == "the row is written") throw Error(ErrorCode::unavailable, "as when the database goes now");
  };
  EXPECT_EQ(code_of([&] { put(*open_shared(data, uri, options), mesh); }), ErrorCode::unavailable);
  EXPECT_EQ(a->load(own(id)).points, mesh.points);
  EXPECT_TRUE(is_clean());
}

TEST_F(SharedStoreTest, a_geometry_that_comes_and_goes_is_there_or_not_and_never_damaged) {
  std::atomic<bool> done{false};
  std::thread other([&] {
    for (int i = 0; i < 100; ++i) {
      put(*b, mesh);
      b->remove(own(id), WithSetups::refuse);
    }
    done = true;
  });
  while (!done) {
    try {
      EXPECT_EQ(a->load(own(id)).points, mesh.points);
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::not_found) << error.what();
    }
  }
  other.join();
  EXPECT_TRUE(is_clean());
}

// ---- kill -9 ----

TEST_F(SharedStoreTest, whatever_a_killed_server_was_at_is_brought_to_an_end_by_another_one) {
  const std::string kept = put(*a, sheet_mesh(4, 4));
  const Mesh other = sheet_mesh(5, 4);
  put(*a, other);
  b.reset();
  a.reset();
  int ends = 0;
  for (int step = 0; ends < 2; ++step) {
    SCOPED_TRACE(step);
    const pid_t child = fork();
    if (child == 0) {
      SharedStoreOptions options = quick_store();
      int left = step;
      options.housekeeping = std::chrono::hours(1);
      options.store.on_step = [&](const char*) {
        if (left-- == 0) _exit(7);
      };
      const auto store = open_shared(data, uri, options);
      if (store->contains(own(mesh_id(other)))) store->remove(own(mesh_id(other)), WithSetups::remove);
      store->put(mesh, own(id), "sheet");
      _exit(0);
    }
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFEXITED(status));
    ends += WEXITSTATUS(status) == 0 ? 1 : 0;
    a = open_shared(data, uri);
    EXPECT_TRUE(eventually([&] { return is_clean(); })) << testing::PrintToString(files()) << intents();
    EXPECT_EQ(a->load(own(kept)).points, sheet_mesh(4, 4).points);
    for (const Mesh* either : {&mesh, &other}) {
      if (a->contains(own(mesh_id(*either)))) {
        EXPECT_EQ(a->load(own(mesh_id(*either))).points, either->points);
      }
    }
    if (WEXITSTATUS(status) == 0) {
      EXPECT_TRUE(a->contains(own(id))) << "acknowledged";
    }
    if (a->contains(own(id))) a->remove(own(id), WithSetups::remove);
    put(*a, other);
    a.reset();
  }
}

TEST_F(SharedStoreTest, what_a_living_server_is_at_is_left_alone) {
  SharedStoreOptions options = quick_store();
  bool done = false;
  options.store.on_step = [&](const char* step) {
    if (std::string(step) != "the content is in place" || std::exchange(done, true)) return;
    EXPECT_TRUE(b->shared_catalog().take_over().empty());
    EXPECT_TRUE(b->shared_catalog().take_over().empty());
  };
  const auto slow = open_shared(data, uri, options);
  put(*slow, mesh);
  EXPECT_TRUE(done);
  EXPECT_EQ(b->load(own(id)).points, mesh.points);
}

// ---- what is in memory ----

/// What a server has in memory of a store.
struct Memory {
  explicit Memory(SharedStore& of) : store(of) {
    store.mirror({[this](Intent::What what, const OwnedId& gone) {
                    const std::lock_guard lock(mutex);
                    (what == Intent::What::setup ? setups : geometries).erase(gone);
                  },
                  [this](Intent::What what) {
                    const std::lock_guard lock(mutex);
                    const auto& held = what == Intent::What::setup ? setups : geometries;
                    return std::vector<OwnedId>(held.begin(), held.end());
                  }});
  }
  ~Memory() { store.mirror({}); }
  bool has(const OwnedId& id) {
    const std::lock_guard lock(mutex);
    return setups.count(id) + geometries.count(id) > 0;
  }
  SharedStore& store;
  std::mutex mutex;
  std::set<OwnedId> setups, geometries;
};

class SharedMemory : public SharedStoreTest {
 protected:
  SharedMemory() {
    put(*a, mesh);
    a->put_setup(setup_record(id, -0.1));
    a->put_setup(setup_record(id, -0.2));
  }
  void hold(Memory& memory) {
    const std::lock_guard lock(memory.mutex);
    memory.geometries = {own(id)};
    memory.setups = {own(first), own(second)};
  }
  /// The news of the removal have come when this returns.
  void remove_and_hear(Memory& memory) {
    hold(memory);
    a->remove(own(id), WithSetups::remove);
    ASSERT_TRUE(eventually([&] { return !memory.has(own(first)) && !memory.has(own(second)) && !memory.has(own(id)); }));
  }
  const std::string first = setup_record(id, -0.1).id, second = setup_record(id, -0.2).id;
};

TEST_F(SharedMemory, a_removal_is_told_to_the_others) {
  SharedStoreOptions options = quick_store();
  options.housekeeping = std::chrono::hours(1);  // so that only the news are left
  b = open_shared(data, uri, options);
  Memory memory(*b);
  hold(memory);
  a->remove_setup(own(first));
  EXPECT_TRUE(eventually([&] { return !memory.has(own(first)); }));
  EXPECT_TRUE(memory.has(own(second)));
  EXPECT_TRUE(memory.has(own(id)));
  a->remove(own(id), WithSetups::remove);
  EXPECT_TRUE(eventually([&] { return !memory.has(own(second)) && !memory.has(own(id)); }));
}

TEST_F(SharedMemory, what_was_missed_is_found_by_comparing) {
  Memory memory(*b);  // which looks every 20 ms
  remove_and_hear(memory);
  hold(memory);  // as what was being loaded meanwhile
  EXPECT_TRUE(eventually([&] { return !memory.has(own(first)) && !memory.has(own(second)) && !memory.has(own(id)); }));
}

TEST_F(SharedMemory, what_was_removed_while_the_connection_was_lost_is_found_when_it_is_back) {
  SharedStoreOptions options = quick_store();
  options.housekeeping = std::chrono::hours(1);
  b = open_shared(data, uri, options);
  Memory memory(*b);
  remove_and_hear(memory);
  hold(memory);  // as if the news had been lost
  sql(uri,
      "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid() AND datname = current_database()");
  EXPECT_TRUE(eventually([&] { return !memory.has(own(first)) && !memory.has(own(second)) && !memory.has(own(id)); }));
}

// ---- one at a time ----

TEST_F(SharedStoreTest, one_server_at_a_time_has_a_claim) {
  SharedStoreOptions impatient = quick_store();
  impatient.preparation_patience = std::chrono::milliseconds(0);
  const auto hasty = open_shared(data, uri, impatient);
  auto claim = a->claim_preparation(own(id), {});
  ASSERT_TRUE(claim);
  EXPECT_FALSE(hasty->claim_preparation(own(id), {}));
  EXPECT_TRUE(hasty->claim_preparation({"acme", id}, {})) << "another name";
  std::atomic<bool> has{false};
  std::thread waiting([&] {
    const auto mine = b->claim_preparation(own(id), {});
    has = mine != nullptr;
  });
  EXPECT_FALSE(has);
  claim.reset();
  waiting.join();
  EXPECT_TRUE(has);
  EXPECT_TRUE(hasty->claim_preparation(own(id), {})) << "it was given back";
}

TEST_F(SharedStoreTest, waiting_for_a_claim_can_be_cancelled) {
  const auto claim = a->claim_preparation(own(id), {});
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  std::thread canceller([&] { stop.request_stop(); });
  EXPECT_EQ(code_of([&] { b->claim_preparation(own(id), context); }), ErrorCode::cancelled);
  canceller.join();
}

// ---- what cannot be reached ----

TEST_F(SharedStoreTest, without_the_database_calls_are_refused_with_a_hint_until_it_is_back) {
  put(*a, mesh);
  for (const char* how : {"stop", "kill", "pause"}) {
    SCOPED_TRACE(how);
    control_postgres(how);
    const std::function<void()> calls[] = {[&] { a->load(own(id)); },
                                           [&] { a->contains(own(id)); },
                                           [&] { put(*a, sheet_mesh(4, 4)); },
                                           [&] { a->list(default_tenant, {}); },
                                           [&] { a->remove(own(id), WithSetups::refuse); },
                                           [&] { a->resolve_setup(default_tenant, id); }};
    for (const auto& call : calls) {
      const Error error = error_of(call);
      EXPECT_EQ(error.code(), ErrorCode::unavailable) << error.what();
      EXPECT_GT(error.retry_after_ms(), 0u) << error.what();
    }
    EXPECT_TRUE(eventually([&] { return !a->state().writable(); }));
    EXPECT_NE(a->state().reason(), "");
    EXPECT_EQ(a->claim_preparation(own(id), {}), nullptr) << "preparing does not wait for it";
    control_postgres(std::string(how) == "pause" ? "resume" : "start");
    EXPECT_TRUE(eventually([&] { return a->state().writable() && b->state().writable(); })) << "each finds out by itself";
    EXPECT_EQ(a->load(own(id)).points, mesh.points);
    put(*a, sheet_mesh(4, 4));
    EXPECT_EQ(b->load(own(mesh_id(sheet_mesh(4, 4)))).points, sheet_mesh(4, 4).points);
    a->remove(own(mesh_id(sheet_mesh(4, 4))), WithSetups::refuse);
    EXPECT_TRUE(eventually([&] { return is_clean(); }));
  }
}

TEST_F(SharedStoreTest, connections_that_are_cut_off_cost_no_call) {
  const auto patient = [](PostgresOptions& options) { options.take_over_after = std::chrono::hours(1); };
  a = open_shared(data, uri, quick_store(), patient);
  b = open_shared(data, uri, quick_store(), patient);
  put(*a, mesh);
  std::atomic<bool> stop{false};
  std::thread cutter([&] {
    while (!stop) {
      const auto begin = std::chrono::steady_clock::now();
      sql(uri,
          "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
          "WHERE pid <> pg_backend_pid() AND datname = current_database() AND application_name = 'deformd' "
          "AND query NOT LIKE 'SELECT pg_terminate%'");
      // The others need time for a connection and a statement, too, and more on a busy machine.
      const auto taken = std::chrono::steady_clock::now() - begin;
      std::this_thread::sleep_for(std::max<std::chrono::steady_clock::duration>(std::chrono::milliseconds(20), 3 * taken));
    }
  });
  for (int i = 0; i < 30; ++i) {
    const Mesh one = sheet_mesh(4, 4, 1 + i);
    EXPECT_NO_THROW(put(*a, one));
    EXPECT_NO_THROW(EXPECT_EQ(b->load(own(mesh_id(one))).points, one.points));
    EXPECT_NO_THROW(a->put_setup(setup_record(mesh_id(one), -0.1)));
    if (i % 2 == 0) {
      EXPECT_NO_THROW(EXPECT_EQ(b->remove(own(mesh_id(one)), WithSetups::remove).size(), 1u));
    }
  }
  stop = true;
  cutter.join();
  EXPECT_EQ(a->list(default_tenant, {}).geometries_size(), 16);
  EXPECT_TRUE(eventually([&] { return count("SELECT count(*) FROM deformd.geometries") == 16; }));
}

TEST_F(SharedStoreTest, calls_that_are_answered_are_taken_while_there_is_no_connection_for_news) {
  b.reset();
  put(*a, mesh);
  const std::string elsewhere = postgres_uri("postgres"), name = sql(uri, "SELECT current_database()").text(0, 0);
  const auto allow = [&](const char* connections) {
    sql(elsewhere, ("ALTER DATABASE " + name + " ALLOW_CONNECTIONS " + connections).c_str());
  };
  allow("false");
  sql(elsewhere, ("SELECT pg_terminate_backend(pid) FROM pg_locks JOIN pg_database ON oid = database "
                  "WHERE locktype = 'advisory' AND granted AND datname = '" +
                  name + "'")
                     .c_str());
  EXPECT_TRUE(eventually([&] { return !a->state().writable(); }));
  for (int i = 0; i < 50; ++i) {  // two and a half times as long as calls wait for a database that is gone
    ASSERT_NO_THROW(a->list(default_tenant, {})) << i;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  EXPECT_FALSE(a->state().writable());
  allow("true");
  EXPECT_TRUE(eventually([&] { return a->state().writable(); }));
}

/// Commits are done and wait for a standby that there is not; the connections of those that wait are cut off then, once.
class LostAnswer {
 public:
  explicit LostAnswer(std::string uri) : uri_(std::move(uri)) {
    sql(uri_, "CREATE TABLE IF NOT EXISTS probe (x integer)");
    sql(uri_, "ALTER SYSTEM SET synchronous_standby_names = 'nobody'");
    sql(uri_, "SELECT pg_reload_conf()");
    EXPECT_TRUE(eventually([&] {
      try {
        postgres::Connection probe(uri_, std::chrono::seconds(20));
        probe.run("INSERT INTO probe VALUES (1)", {}, std::chrono::milliseconds(200));
        return false;
      } catch (const postgres::LostConnection&) {
        return true;
      }
    }));
    sql(uri_, "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE wait_event = 'SyncRep'");
    cutter_ = std::thread([this] {
      const char* cut =
          "SELECT count(*) FROM (SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
          "WHERE wait_event = 'SyncRep' AND query = 'COMMIT') AS cut";
      EXPECT_TRUE(eventually([&] { return sql(uri_, cut).number(0, 0) > 0; }));
      sql(uri_, "ALTER SYSTEM RESET synchronous_standby_names");
      sql(uri_, "SELECT pg_reload_conf()");
    });
  }
  ~LostAnswer() { cutter_.join(); }

 private:
  const std::string uri_;
  std::thread cutter_;
};

TEST_F(SharedStoreTest, a_commit_whose_answer_was_lost_is_found_to_be_done) {
  SharedStoreOptions options = quick_store();
  std::unique_ptr<LostAnswer> lost;
  options.store.on_step = [&](const char* step) {
    if (std::string(step) == "the content is in place") lost = std::make_unique<LostAnswer>(uri);
  };
  const auto store = open_shared(data, uri, options, [](PostgresOptions& o) {
    o.take_over_after = std::chrono::hours(1);
    o.call_patience = std::chrono::seconds(20);
  });
  EXPECT_FALSE(store->put(mesh, own(id), "sheet").existed());
  lost.reset();
  EXPECT_EQ(store->load(own(id)).points, mesh.points);
  lost = std::make_unique<LostAnswer>(uri);
  const std::int64_t stored = store->put_setup(setup_record(id, -0.1));
  lost.reset();
  EXPECT_EQ(b->find_setup(own(setup_record(id, -0.1).id))->created_ms, stored);
  lost = std::make_unique<LostAnswer>(uri);
  EXPECT_EQ(store->remove(own(id), WithSetups::remove), std::vector<std::string>{setup_record(id, -0.1).id});
  lost.reset();
  EXPECT_FALSE(b->contains(own(id)));
  EXPECT_TRUE(eventually([&] { return is_clean(); }));
}

TEST_F(SharedStoreTest, without_its_folder_nothing_is_lost_or_unknown) {
  put(*a, mesh);
  const fs::path away = directory.path() / "away";
  for (const bool empty_mount_point : {false, true}) {
    fs::rename(data, away);
    if (empty_mount_point) fs::create_directory(data);
    const std::function<void()> calls[] = {[&] { b->load(own(id)); }, [&] { b->contains(own(id)); }, [&] { put(*b, mesh); },
                                           [&] { put(*b, sheet_mesh(4, 4)); }};
    for (const auto& call : calls) {
      const Error error = error_of(call);
      EXPECT_EQ(error.code(), ErrorCode::unavailable) << error.what();
    }
    EXPECT_FALSE(b->state().writable());
    EXPECT_EQ(b->info(own(id)).damage(), "") << "its client would upload it anew";
    if (empty_mount_point) {
      EXPECT_EQ(code_of([&] { open_shared(data, uri); }), ErrorCode::failed_precondition) << "it must not become a new store";
      fs::remove_all(data);
    }
    fs::rename(away, data);
    EXPECT_TRUE(b->state().writable());
    EXPECT_EQ(b->load(own(id)).points, mesh.points);
  }
  EXPECT_TRUE(eventually([&] { return is_clean(); }));
}

TEST_F(SharedStoreTest, what_is_removed_without_the_folder_goes_when_it_is_back) {
  put(*a, mesh);
  const fs::path away = directory.path() / "away";
  fs::rename(data, away);
  a->remove(own(id), WithSetups::refuse);
  EXPECT_EQ(code_of([&] { b->load(own(id)); }), ErrorCode::not_found);
  fs::rename(away, data);
  EXPECT_TRUE(eventually([&] { return is_clean(); }));
}

TEST_F(SharedStoreTest, a_full_folder_can_be_left) {
  put(*a, mesh);
  SharedStoreOptions options = quick_store();
  options.store.disk.free_bytes = [] { return std::uint64_t{1000}; };
  const auto full = open_shared(data, uri, options);
  EXPECT_FALSE(full->state().writable());
  EXPECT_EQ(code_of([&] { put(*full, sheet_mesh(4, 4)); }), ErrorCode::out_of_budget);
  EXPECT_TRUE(full->put(mesh, own(id), "").existed());
  EXPECT_EQ(full->load(own(id)).points, mesh.points);
  full->remove(own(id), WithSetups::refuse);
  EXPECT_TRUE(is_clean());
}

// ---- what belongs together ----

TEST_F(SharedStoreTest, folders_and_catalogs_of_others_are_refused_and_left_alone) {
  put(*a, mesh);
  const auto before = tree_of(data);
  EXPECT_EQ(code_of([&] { open_shared(data, new_database()); }), ErrorCode::failed_precondition);
  EXPECT_EQ(code_of([&] { GeometryStore alone(data); }), ErrorCode::failed_precondition);
  EXPECT_EQ(code_of([&] { check_store(data); }), ErrorCode::failed_precondition);
  EXPECT_EQ(code_of([&] { rebuild_store(data); }), ErrorCode::failed_precondition);
  EXPECT_EQ(code_of([&] { open_shared(directory.path() / "empty", uri); }), ErrorCode::failed_precondition);
  { GeometryStore alone(directory.path() / "alone"); }
  const auto alone_before = tree_of(directory.path() / "alone");
  EXPECT_EQ(code_of([&] { open_shared(directory.path() / "alone", uri); }), ErrorCode::failed_precondition);
  EXPECT_EQ(tree_of(directory.path() / "alone"), alone_before);
  EXPECT_EQ(tree_of(data), before);
}

TEST_F(SharedStoreTest, tables_of_a_later_version_are_refused) {
  sql(uri, "UPDATE deformd.meta SET version = 2");
  const Error error = error_of([&] { open_shared(data, uri); });
  EXPECT_EQ(error.code(), ErrorCode::failed_precondition) << error.what();
  EXPECT_NE(std::string(error.what()).find("version 2"), std::string::npos) << error.what();
}

TEST_F(SharedStoreTest, servers_that_start_at_once_make_one_store) {
  const std::string fresh = new_database();
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&] { EXPECT_NO_THROW(open_shared(directory.path() / "fresh", fresh)); });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(sql(fresh, "SELECT count(*) FROM deformd.meta").number(0, 0), 1);
}

TEST_F(SharedStoreTest, a_database_that_comes_later_is_waited_for) {
  control_postgres("stop");
  EXPECT_EQ(
      code_of([&] { open_shared(data, uri, quick_store(), [](auto& o) { o.start_patience = std::chrono::milliseconds(1); }); }),
      ErrorCode::unavailable);
  std::thread starter([] { control_postgres("start"); });
  EXPECT_NO_THROW(open_shared(data, uri));
  starter.join();
}

TEST_F(SharedStoreTest, a_damaged_row_is_listed_so_and_healed_by_registering_again) {
  put(*a, mesh);
  a->put_setup(setup_record(id, -0.1));
  sql(uri, "UPDATE deformd.geometries SET info = 'x'");
  sql(uri, "UPDATE deformd.setups SET setup = 'x'");
  EXPECT_NE(b->info(own(id)).damage(), "");
  EXPECT_EQ(code_of([&] { b->find_setup(own(setup_record(id, -0.1).id)); }), ErrorCode::data_loss);
  const StoreReport report = b->check({}, [](const GeometryRecord&) { return nullptr; });
  EXPECT_EQ(report.outcome, StoreReport::Outcome::faults);
  EXPECT_EQ(report.lines.size(), 4u) << testing::PrintToString(report.lines);
  put(*b, mesh);
  b->put_setup(setup_record(id, -0.1));
  EXPECT_EQ(a->info(own(id)).damage(), "");
  EXPECT_TRUE(a->find_setup(own(setup_record(id, -0.1).id)));
  EXPECT_EQ(b->check({}, [](const GeometryRecord&) { return nullptr; }).outcome, StoreReport::Outcome::well);
}

TEST_F(SharedStoreTest, a_damaged_file_is_found_by_checking) {
  put(*a, mesh);
  write_file(data / "geometries" / *files().begin(), "damaged");
  EXPECT_EQ(b->check({}, [](const GeometryRecord&) { return nullptr; }).outcome, StoreReport::Outcome::faults);
}

TEST(PostgresUri, PasswordsAndStrangersAreRefused) {
  EXPECT_NO_THROW(check_catalog_uri("postgresql://deformd@db.example.org/catalog?sslmode=verify-full&passfile=/etc/pgpass"));
  for (const std::string bad : {"", "db", "mysql://db/x", "postgresql://a:hush@db/x", "postgresql://db/x?password=hush",
                                "postgresql://db/x?sslpassword=hush", "postgresql://db/x?nonsense=hush"}) {
    try {
      check_catalog_uri(bad);
      FAIL() << bad;
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::invalid_argument);
      EXPECT_EQ(std::string(error.what()).find("hush"), std::string::npos) << error.what();
    }
  }
}

}  // namespace
}  // namespace deform::server::postgres_store_test
