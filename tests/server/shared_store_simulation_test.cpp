// SPDX-License-Identifier: GPL-3.0-or-later
// The store of several servers on a simulated disk and a simulated database: servers that are killed between any two steps while
// the others go on, power that is lost, steps of one server between those of another, connections that are lost before or after
// the call was done, errors of the disk, a full one, and flipped bits. Whatever was acknowledged is there for all, nothing is
// half there, what was removed stays away, and no file stays that nobody knows of. A state is what one such fault left.
// DEFORM_LONG=1 tries many more of them; DEFORM_SIMULATION_SEED=N runs the random histories of that seed alone.
#include <gtest/gtest.h>

#include <cerrno>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "server/store/shared_store.h"
#include "tests/server/any_store.h"
#include "tests/server/simulated_catalog.h"
#include "tests/server/simulated_disk.h"
#include "tests/server/simulation.h"

namespace deform::server {
namespace {

namespace fs = std::filesystem;
using Survival = SimulatedDisk::Survival;

const fs::path place = "/srv/deformd/shared";
constexpr auto take_over_after = std::chrono::seconds(30);

// ---- the catalog is one ----

std::unique_ptr<Store> open_with_simulated_catalog(const fs::path& folder) {
  static std::map<fs::path, SimulatedDatabase> databases;
  static SimulatedServer server;
  SharedStoreOptions options;
  return std::make_unique<SharedStore>(
      folder,
      std::make_unique<SimulatedCatalog>(databases[folder], server, take_over_after, SimulatedCatalog::Housekeeping::free),
      options);
}

INSTANTIATE_TEST_SUITE_P(Simulated, AnyStore, testing::Values(StoreKind{"shared_store", open_with_simulated_catalog}),
                         [](const auto& kind) { return kind.param.name; });

// ---- servers ----

/// How a call ended.
struct Answer {
  enum Kind { done, not_found, failed } kind = done;
  bool existed = false;  ///< what was registered or released
};

/// What may be there after a call that was answered so, by what may have been there before.
std::vector<StoreContents> results(const std::vector<StoreContents>& from, const Action& action, const Answer& answer) {
  std::vector<StoreContents> to;
  for (const auto& contents : from) {
    const bool known = contents.geometries.count(id_of(action)) > 0;
    const bool released = action.kind == Action::release && contents.setups.count(owned(setup_of(action))) > 0;
    const bool says_existed = action.kind == Action::add || action.kind == Action::release;
    const bool needs_geometry = action.kind == Action::prepare || action.kind == Action::remove || action.kind == Action::list;
    const bool existed = action.kind == Action::release ? released : known;
    if (answer.kind == Answer::done && says_existed && answer.existed != existed) continue;
    if (answer.kind == Answer::done && needs_geometry && !known) continue;
    if (answer.kind == Answer::not_found && (!needs_geometry || known)) continue;
    if (answer.kind != Answer::done) to.push_back(contents);
    if (answer.kind != Answer::not_found) to.push_back(contents_after(contents, action));
  }
  return to;
}

/// One server of a store.
class Server {
 public:
  Server(SimulatedDisk& disk, SimulatedDatabase& database) : files(disk, fate), database_(database) {}
  ~Server() { stop(); }
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  void open() {
    auto made = std::make_unique<SimulatedCatalog>(database_, fate, take_over_after, SimulatedCatalog::Housekeeping::by_turn);
    catalog = made.get();
    SharedStoreOptions options;
    options.store.disk.keep_free = std::uint64_t{64} << 10;
    options.store.files = &files;
    options.housekeeping = std::chrono::hours(1);
    try {
      store = std::make_unique<SharedStore>(place, std::move(made), options);
    } catch (...) {
      catalog = nullptr;
      throw;
    }
    catalog->await_housekeeper();
  }

  /// In order, or, once its fate has stopped it, as a killed process: nothing is brought to an end.
  void stop() {
    if (!store) return;
    catalog->leave();
    store.reset();
    catalog = nullptr;
  }

  /// Throws what is not an answer of the store.
  Answer act(const Action& action) {
    const OwnedId id = id_of(action);
    try {
      switch (action.kind) {
        case Action::add:
          return {Answer::done, store->put(mesh_of(action.mesh), id, name_of(action)).existed()};
        case Action::prepare:
          store->put_setup(setup_of(action));
          break;
        case Action::release:
          return {Answer::done, store->remove_setup(owned(setup_of(action)))};
        case Action::remove:
          store->remove(id, WithSetups::remove);
          break;
        case Action::list:
          store->list(id.tenant, {});
          store->state();
          EXPECT_EQ(store->load(id).points, mesh_of(action.mesh).points);
          break;
        case Action::check: {
          const StoreReport report = store->check({}, [](const GeometryRecord&) { return nullptr; });
          EXPECT_EQ(report.outcome, StoreReport::Outcome::well) << testing::PrintToString(report.lines);
          break;
        }
        case Action::back_up:
          store->backup("/srv/backup" + std::to_string(++backups));
          break;
        default:
          ADD_FAILURE() << "not of a shared store";
      }
    } catch (const Error& error) {
      if (error.code() != ErrorCode::not_found) throw;
      return {Answer::not_found};
    }
    return {};
  }

  SimulatedServer fate;
  ServerFiles files;
  std::unique_ptr<SharedStore> store;
  SimulatedCatalog* catalog = nullptr;
  int backups = 0;

 private:
  SimulatedDatabase& database_;
};

/// Some servers of one store, and what may be in it.
class Cluster {
 public:
  explicit Cluster(SimulatedDisk::State disk_state = SimulatedDisk::empty(), SimulatedDatabase::State rows = {})
      : disk(std::move(disk_state)), database(std::move(rows)) {
    for (int i = 0; i < 3; ++i) servers.push_back(std::make_unique<Server>(disk, database));
  }

  Server& at(std::size_t server) { return *servers[server]; }
  void open_all() {
    for (auto& server : servers) server->open();
  }
  /// A new process in the place of one that was killed.
  void restart(std::size_t server) {
    servers[server].reset();
    servers[server] = std::make_unique<Server>(disk, database);
    servers[server]->open();
  }

  /// By the server of the action, which may be killed meanwhile.
  void act(const Action& action) {
    trace += std::string("\n") + names[action.kind] + " " + name_of(action);
    Answer answer;
    try {
      answer = at(action.server).act(action);
    } catch (const Error& error) {
      if (!at(action.server).fate.stopped()) throw;
      answer.kind = Answer::failed;
      trace += ": killed";
    }
    contents = results(contents, action, answer);
  }

  /// All live servers agree on one of the contents that may be there.
  void expect_contents() {
    ASSERT_FALSE(contents.empty()) << "an answer that no order of the calls explains" << trace;
    std::string why;
    for (auto& server : servers) {
      if (!server->store || server->fate.stopped()) continue;
      std::vector<StoreContents> found;
      for (const auto& one : contents) {
        const std::string differs = difference(*server->store, one, one);
        if (differs.empty()) {
          found.push_back(one);
          break;
        }
        why += "\n" + differs;
      }
      ASSERT_FALSE(found.empty()) << why << trace;
      for (auto& [id, registered] : found[0].geometries) registered.info = server->store->info(id);
      contents = std::move(found);
    }
  }

  /// The live servers keep house until what those that are gone have left is taken over and done.
  void settle() {
    for (int round = 0; round < 4; ++round) {
      database.pass(take_over_after);
      for (auto& server : servers) {
        if (server->store && !server->fate.stopped()) server->catalog->keep_house();
      }
    }
  }

  /// Every row has its file, and every other file is named by an intent.
  void expect_known_files() {
    const auto rows = database.state();
    std::set<std::string> named, required;
    for (const auto& [number, owned] : rows.intents) {
      const auto& entry = owned.intent.entries.at(0);
      named.insert((place / "geometries" / (key_of({entry.tenant, entry.id}) + "~" + std::to_string(entry.put))).string());
      named.insert((place / "tmp" / (key_of({entry.tenant, entry.id}) + "." + std::to_string(entry.put))).string());
    }
    for (const auto& [key, row] : rows.geometries) {
      required.insert((place / "geometries" / (key + "~" + std::to_string(row.record.put))).string());
    }
    for (const char* folder : {"geometries", "tmp"}) {
      for (const auto& [file, bytes] : disk.files(place / folder)) {
        EXPECT_TRUE(required.erase(file) > 0 || named.count(file) > 0) << file << " is nobody's" << trace;
      }
    }
    EXPECT_TRUE(required.empty()) << *required.begin() << " is missing" << trace;
  }

  SimulatedDisk disk;
  SimulatedDatabase database;
  std::vector<std::unique_ptr<Server>> servers;
  std::vector<StoreContents> contents{1};
  std::string trace;
};

class SharedStoreSimulation : public Simulation {
 protected:
  /// When all is settled nothing is left but the rows and their files, whoever looks.
  static void expect_clean(Cluster& cluster) {
    cluster.settle();
    cluster.expect_contents();
    cluster.expect_known_files();
    const auto intents = cluster.database.state().intents;
    EXPECT_TRUE(intents.empty()) << intents.size() << " intents are left" << cluster.trace;
  }
};

// ---- a server that is killed, and power that is lost ----

const std::vector<Action> histories[] = {
    // Register, prepare, share, remove.
    {{Action::add, 0, 0, 0, 0},
     {Action::prepare, 0, 0, 0, 1},
     {Action::add, 0, 1, 0, 1},
     {Action::add, 0, 0, 0, 1},
     {Action::remove, 0, 0, 0, 1},
     {Action::list, 0, 1, 0, 0},
     {Action::add, 0, 0, 0, 0},
     {Action::release, 0, 0, 0, 1}},
};

class KilledAnywhere : public SharedStoreSimulation, public testing::WithParamInterface<std::size_t> {};

TEST_P(KilledAnywhere, a_server_leaves_what_was_acknowledged_and_others_end_the_rest) {
  const auto& history = histories[GetParam()];
  for (const unsigned victim : {0u, 1u}) {
    bool killed = true;
    for (std::uint64_t point = 1; killed && !HasFailure(); ++point) {
      SCOPED_TRACE("server " + std::to_string(victim) + " is killed at point " + std::to_string(point));
      Cluster cluster;
      cluster.at(2).open();
      cluster.at(victim).fate.stops_at = point;
      for (const unsigned server : {0u, 1u}) {
        try {
          cluster.at(server).open();
        } catch (const Error& error) {
          ASSERT_TRUE(cluster.at(server).fate.stopped()) << error.what();
        }
      }
      std::size_t at = 0;
      for (; at < history.size() && !cluster.at(victim).fate.stopped(); ++at) cluster.act(history[at]);
      killed = cluster.at(victim).fate.stopped();
      cluster.at(victim).fate.stops_at = UINT64_MAX;
      ++states;
      cluster.expect_contents();
      cluster.at(victim).stop();
      expect_clean(cluster);
      cluster.restart(victim);
      if (at > 0) cluster.act(history[at - 1]);
      expect_clean(cluster);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Histories, KilledAnywhere, testing::Range<std::size_t>(0, std::size(histories)));

}  // namespace
}  // namespace deform::server
