// SPDX-License-Identifier: GPL-3.0-or-later
// The store on a simulated disk: machines that stop between any two operations and lose what was not synced, errors of the disk,
// a full one, and flipped bits. Whatever was acknowledged is there, nothing is half there, and no wrong bytes are served. A state
// is what a stop left, a call on a disk that fails, or a flipped bit. DEFORM_LONG=1 tries many more of them;
// DEFORM_SIMULATION_SEED=N runs the random histories of that seed alone.
#include <gtest/gtest.h>

#include <algorithm>
#include <cerrno>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "server/store/file.h"
#include "server/store/store_commands.h"
#include "tests/server/simulated_disk.h"
#include "tests/server/simulation.h"

namespace deform::server::store_simulation_test {
namespace {

namespace fs = std::filesystem;
using Survival = SimulatedDisk::Survival;

const fs::path place = "/srv/deformd/data";

/// A disk, a store on it, and what it has acknowledged.
class Machine {
 public:
  explicit Machine(SimulatedDisk::State state, std::uint64_t seed = 0) : disk(std::move(state), seed) {
    options.disk.keep_free = std::uint64_t{64} << 10;
    options.files = &disk;
  }
  ~Machine() { store.reset(); }

  void open() { store = std::make_unique<GeometryStore>(place, options); }

  /// Does it; throws what the store throws. `contents` changes when it is acknowledged.
  void act(const Action& action) {
    const OwnedId id = id_of(action);
    switch (action.kind) {
      case Action::add: {
        const v1::GeometryInfo info = store->put(mesh_of(action.mesh), id, name_of(action));
        contents.geometries.insert_or_assign(id, StoreContents::Registered{mesh_of(action.mesh), info});
        break;
      }
      case Action::prepare: {
        SetupRecord record = setup_of(action);
        record.created_ms = store->put_setup(record);
        contents.setups.insert_or_assign(owned(record), record);
        break;
      }
      case Action::release:
        store->remove_setup(owned(setup_of(action)));
        break;
      case Action::remove:
        store->remove(id, WithSetups::remove);
        break;
      case Action::list:
        store->list(id.tenant, {});
        store->state();
        break;
      case Action::reopen:
        store.reset();
        open();
        break;
      case Action::check: {
        store.reset();
        const StoreReport report = check_store(place, disk);
        if (report.outcome != StoreReport::Outcome::well && !disk.fault && !disk.stopped()) {
          ADD_FAILURE() << testing::PrintToString(report.lines);
        }
        open();
        break;
      }
      case Action::back_up:
        backup_store(place, "/srv/backup" + std::to_string(++backups), disk);
        break;
      case Action::rebuild:
        store.reset();
        rebuild_store(place, disk);
        open();
        break;
      case Action::lose_catalog: {
        store.reset();
        const auto hook = std::exchange(disk.before_change, nullptr);
        for (const char* suffix : {"", "-wal", "-journal"}) disk.remove(place / ("catalog.sqlite" + std::string(suffix)));
        sync_directory(disk, place);
        disk.before_change = hook;
        open();
        break;
      }
    }
    contents = contents_after(contents, action);
  }

  SimulatedDisk disk;
  StoreOptions options;
  std::unique_ptr<GeometryStore> store;
  StoreContents contents;
  int backups = 0;
};

class StoreSimulation : public Simulation {
 protected:
  static Action random_action(std::mt19937_64& random) {
    static constexpr Action::Kind kinds[] = {Action::add,     Action::add,          Action::add,    Action::prepare,
                                             Action::prepare, Action::prepare,      Action::remove, Action::list,
                                             Action::release, Action::reopen,       Action::remove, Action::check,
                                             Action::rebuild, Action::lose_catalog, Action::back_up};
    Action action{kinds[random() % std::size(kinds)]};
    action.mesh = static_cast<unsigned>(random() % 4);
    action.tenant = static_cast<unsigned>(random() % 3);
    action.setup = static_cast<unsigned>(random() % 2);
    return action;
  }

  /// Whatever a crash left opens and is what was before or after; returns it, or nothing when the test has failed.
  static bool expect_before_or_after(const SimulatedDisk::State& left, const StoreContents& before, const StoreContents& after,
                                     StoreContents* seen = nullptr) {
    Machine machine(left);
    try {
      machine.open();
      const std::string was = difference(*machine.store, before, before);
      const std::string is = was.empty() ? "" : difference(*machine.store, after, after);
      EXPECT_TRUE(was.empty() || is.empty()) << "before: " << was << "\nafter: " << is;
      EXPECT_TRUE(machine.store->catalog().intents().empty());
      if (seen != nullptr) *seen = visible(*machine.store, joined(before, after));
      machine.store.reset();
      const StoreReport report = check_store(place, machine.disk);
      EXPECT_EQ(report.outcome, StoreReport::Outcome::well) << testing::PrintToString(report.lines);
      EXPECT_EQ(machine.disk.files(place / "tmp").size(), 0u);
      EXPECT_EQ(machine.disk.files(place / "unclaimed").size(), 0u) << machine.disk.files(place / "unclaimed").begin()->first;
    } catch (const Error& error) {
      ADD_FAILURE() << "does not open: " << error.what();
    }
    return !HasFailure();
  }

  /// A backup with a mark is complete, and one that is done has its mark.
  enum class Backup { under_way, done };
  static void expect_whole_backup(const SimulatedDisk::State& left, const StoreContents& contents, Backup backed_up) {
    Machine machine(left);
    const fs::path backup = "/srv/backup1";
    if (backed_up == Backup::done) {
      EXPECT_TRUE(has_mark(backup, machine.disk));
    }
    if (!has_mark(backup, machine.disk)) return;
    machine.store = std::make_unique<GeometryStore>(backup, machine.options);
    EXPECT_EQ(difference(*machine.store, contents, contents), "") << "in a backup";
  }
};

// ---- a machine that stops ----

/// A stop before each change that a history makes to the disk, with several outcomes of each.
void enumerate(const std::vector<Action>& history, unsigned random_outcomes, std::size_t& states,
               const std::function<bool(const SimulatedDisk::State&, std::size_t action, Survival)>& look) {
  struct Stop {
    SimulatedDisk::State state;
    std::size_t action;
  };
  std::vector<Stop> stops;
  Machine machine(SimulatedDisk::empty());
  std::size_t at = 0;
  machine.disk.before_change = [&] { stops.push_back({machine.disk.state(), at}); };
  machine.open();
  for (at = 1; at <= history.size(); ++at) machine.act(history[at - 1]);
  machine.store.reset();
  stops.push_back({machine.disk.state(), at});
  std::mt19937_64 random(1);
  for (std::size_t i = 0; i < stops.size(); ++i) {
    std::vector<Survival> outcomes = {Survival::durable, Survival::all};
    if (random_outcomes > 1) outcomes.insert(outcomes.end(), {Survival::names, Survival::content});
    outcomes.insert(outcomes.end(), random_outcomes, Survival::random);
    for (const Survival survival : outcomes) {
      SCOPED_TRACE("stopped before change " + std::to_string(i + 1) + ", in action " + std::to_string(stops[i].action) + " (" +
                   (stops[i].action == 0 || stops[i].action > history.size() ? "open or close"
                                                                             : names[history[stops[i].action - 1].kind]) +
                   "), outcome " + std::to_string(static_cast<int>(survival)));
      ++states;
      if (!look(SimulatedDisk::after_crash(stops[i].state, survival, random), stops[i].action, survival)) return;
    }
  }
}

const std::vector<Action> histories[] = {
    // Register, prepare, share, remove.
    {{Action::add, 0, 0},
     {Action::prepare, 0, 0, 0},
     {Action::add, 0, 1},
     {Action::prepare, 0, 1, 1},
     {Action::remove, 0, 0},
     {Action::release, 0, 1, 1},
     {Action::add, 0, 0}},
    // The catalog is lost and made anew; a store is copied.
    {{Action::add, 1, 0},
     {Action::prepare, 1, 0, 0},
     {Action::back_up},
     {Action::lose_catalog},
     {Action::rebuild},
     {Action::remove, 1, 0},
     {Action::reopen}},
};

class StopAnywhere : public StoreSimulation, public testing::WithParamInterface<std::size_t> {};

TEST_P(StopAnywhere, what_was_acknowledged_is_there_and_nothing_is_half_there) {
  const auto& history = histories[GetParam()];
  std::vector<StoreContents> contents(1);
  for (const Action& action : history) contents.push_back(contents_after(contents.back(), action));
  contents.push_back(contents.back());
  enumerate(history, is_long() ? 60 : 1, states, [&](const SimulatedDisk::State& left, std::size_t action, Survival) {
    // The times differ from run to run: names and bytes are compared.
    StoreContents before = contents[action == 0 ? 0 : action - 1], after = contents[action];
    Machine machine(left);
    bool well = false;
    try {
      machine.open();
      StoreContents now = visible(*machine.store, joined(before, after));
      for (StoreContents* expected : {&before, &after}) {
        for (auto& [id, registered] : expected->geometries) {
          if (now.geometries.count(id) > 0) {
            registered.info.set_registered_unix_ms(now.geometries[id].info.registered_unix_ms());
          }
        }
      }
      machine.store.reset();
      well = expect_before_or_after(machine.disk.state(), before, after);
      const auto copied = std::find_if(history.begin(), history.end(), [](const Action& a) { return a.kind == Action::back_up; });
      const auto copying = static_cast<std::size_t>(copied - history.begin()) + 1;
      if (action >= copying && copied != history.end()) {
        expect_whole_backup(left, contents[copying], action > copying ? Backup::done : Backup::under_way);
      }
    } catch (const Error& error) {
      ADD_FAILURE() << "does not open: " << error.what();
    }
    return well;
  });
}

INSTANTIATE_TEST_SUITE_P(Histories, StopAnywhere, testing::Range<std::size_t>(0, std::size(histories)));

class RandomHistory : public StoreSimulation {};

TEST_F(RandomHistory, stops_again_and_again_lose_nothing) {
  for_seeds(is_long() ? 3000 : 40, [&](std::uint64_t seed) {
    std::mt19937_64 random(seed);
    SimulatedDisk::State state = SimulatedDisk::empty();
    StoreContents before, after;
    std::string trace;
    for (int stop = 0; stop < 8; ++stop) {
      Machine machine(state, random());
      machine.contents = before;
      machine.backups = 100 * stop;
      machine.disk.stops_at = 1 + random() % (random() % 3 == 0 ? 12 : 250);
      StoreContents next = before;
      try {
        machine.open();
        trace += "\nopened";
        while (!machine.disk.stopped()) {
          const Action action = random_action(random);
          before = machine.contents;
          next = contents_after(before, action);
          trace += std::string("\n") + names[action.kind] + " " + name_of(action);
          try {
            machine.act(action);
          } catch (const Error& error) {
            if (error.code() != ErrorCode::not_found && !machine.disk.stopped()) throw;
            if (!machine.disk.stopped()) next = before;
          }
        }
      } catch (const Error& error) {
        ASSERT_TRUE(machine.disk.stopped()) << error.what() << trace;
      }
      machine.store.reset();
      const auto survival = random() % 4 == 0 ? Survival::all : Survival::random;
      state = SimulatedDisk::after_crash(machine.disk.state(), survival, random);
      trace += "\nstopped at change " + std::to_string(machine.disk.changes());
      after = next;
      while (random() % 3 == 0) {  // and again, while it starts
        ++states;
        Machine starting(state, random());
        starting.disk.stops_at = 1 + random() % 60;
        try {
          starting.open();
        } catch (const Error& error) {
          ASSERT_TRUE(starting.disk.stopped()) << error.what() << trace;
        }
        starting.store.reset();
        state = SimulatedDisk::after_crash(starting.disk.state(), Survival::random, random);
        trace += "\nstopped while starting";
      }
      ++states;
      // Times of what was not acknowledged are not known.
      StoreContents seen;
      for (auto& [id, registered] : after.geometries) {
        if (before.geometries.count(id) > 0) registered.info = before.geometries[id].info;
      }
      {
        Machine look(state);
        try {
          look.open();
        } catch (const Error& error) {
          FAIL() << "does not open: " << error.what() << trace;
        }
        seen = visible(*look.store, joined(before, after));
        for (auto& [id, registered] : after.geometries) {
          if (before.geometries.count(id) == 0 && seen.geometries.count(id) > 0) registered.info = seen.geometries[id].info;
        }
      }
      if (!expect_before_or_after(state, before, after, &seen)) FAIL() << trace;
      before = seen;
    }
  });
}

// ---- a disk that fails or is full ----

TEST_F(RandomHistory, calls_that_fail_leave_what_was_there_and_a_store_that_works) {
  for_seeds(is_long() ? 800 : 40, [&](std::uint64_t seed) {
    std::mt19937_64 random(seed);
    SimulatedDisk::State state = SimulatedDisk::empty();
    StoreContents known;
    for (int round = 0; round < 4; ++round) {
      Machine machine(state, random());
      machine.open();
      StoreContents must = known, may = known;
      std::string trace;
      for (int i = 0; i < 12; ++i) {
        Action action = random_action(random);
        if (action.kind > Action::list) action.kind = Action::add;
        machine.contents = must;
        const bool lasting = random() % 4 == 0;
        const int error = random() % 2 == 0 ? EIO : ENOSPC;
        auto left = static_cast<int>(random() % 40);
        machine.disk.fault = [&, lasting, error](bool changing) mutable {
          if (!changing) return 0;
          --left;
          return left == 0 || (lasting && left < 0) ? error : 0;
        };
        ++states;
        bool done = false;
        try {
          machine.act(action);
          done = true;
        } catch (const Error& failure) {
          if (failure.code() == ErrorCode::not_found) done = may.geometries.count(id_of(action)) == 0;
        }
        machine.disk.fault = nullptr;
        trace += std::string("\n") + names[action.kind] + " " + name_of(action) + (done ? "" : " failed");
        const StoreContents whole = contents_after(may, action);
        if (done) {
          must = machine.contents;
          may = joined(common(whole, whole), must);
          if (action.kind == Action::add) may.geometries.insert_or_assign(id_of(action), must.geometries[id_of(action)]);
        } else {
          must = common(must, whole);
          may = joined(may, whole);
        }
        const std::string differs = difference(*machine.store, must, may, Damage::of_what_need_not_be);
        ASSERT_EQ(differs, "") << trace;
      }
      machine.store.reset();
      state =
          random() % 2 == 0 ? machine.disk.state() : SimulatedDisk::after_crash(machine.disk.state(), Survival::random, random);
      Machine restarted(state);
      ASSERT_NO_THROW(restarted.open()) << trace;
      ASSERT_EQ(difference(*restarted.store, must, may, Damage::of_what_need_not_be), "") << "after a restart" << trace;
      // What was left damaged by a deletion that failed is deleted again.
      for (const auto& id : restarted.store->catalog().all_geometries()) {
        if (!restarted.store->info(id).damage().empty()) restarted.store->remove(id, WithSetups::remove);
      }
      known = visible(*restarted.store, may);
      restarted.store.reset();
      state = restarted.disk.state();
    }
  });
}

TEST_F(StoreSimulation, an_upload_that_failed_at_any_change_is_whole_or_gone_after_a_stop) {
  Machine empty(SimulatedDisk::empty());
  empty.open();
  empty.act({Action::add, 1, 1});
  empty.act({Action::prepare, 1, 1});
  empty.store.reset();
  std::mt19937_64 random(1);
  for (const Action action : {Action{Action::add, 0, 0}, Action{Action::prepare, 1, 1, 1}}) {
    const StoreContents before = empty.contents, after = contents_after(before, action);
    bool failed = true;
    for (int step = 1; failed && !HasFailure(); ++step) {
      Machine machine(empty.disk.state());
      machine.open();
      machine.contents = before;
      int left = step;
      machine.disk.fault = [&](bool changing) { return changing && --left == 0 ? EIO : 0; };
      try {
        machine.act(action);
      } catch (const Error&) {
      }
      failed = left <= 0;
      for (int outcome = 0; failed && outcome < 6; ++outcome) {
        SCOPED_TRACE(std::string(names[action.kind]) + ": change " + std::to_string(step) + " failed, outcome " +
                     std::to_string(outcome));
        ++states;
        Machine restarted(SimulatedDisk::after_crash(machine.disk.state(), Survival::random, random));
        ASSERT_NO_THROW(restarted.open());
        ASSERT_EQ(difference(*restarted.store, before, after), "");
      }
    }
  }
}

TEST_F(StoreSimulation, a_backup_that_stopped_at_any_change_is_whole_or_refused) {
  Machine filled(SimulatedDisk::empty());
  filled.open();
  filled.act({Action::add, 1, 1});
  filled.act({Action::prepare, 1, 1});
  filled.act({Action::add, 0, 2});
  filled.store.reset();
  const fs::path backup = "/backup", restored = "/restored";
  std::mt19937_64 random(1);
  int whole = 0, refused = 0;
  bool stopped = true;
  for (std::uint64_t step = 1; stopped && !HasFailure(); ++step) {
    SCOPED_TRACE("change " + std::to_string(step));
    SimulatedDisk disk(filled.disk.state());
    disk.stops_at = disk.changes() + step;
    try {
      backup_store(place, backup, disk);
    } catch (const Error&) {
    }
    stopped = disk.stopped();
    for (const Survival survival : {Survival::all, Survival::random, Survival::random, Survival::durable}) {
      ++states;
      Machine later(SimulatedDisk::after_crash(disk.state(), survival, random));
      try {
        restore_store(backup, restored, later.disk);
        later.contents = filled.contents;
        later.store = std::make_unique<GeometryStore>(restored, later.options);
        ASSERT_EQ(difference(*later.store, filled.contents, filled.contents), "");
        ++whole;
      } catch (const Error& error) {
        ASSERT_EQ(error.code(), ErrorCode::failed_precondition) << error.what();
        ++refused;
      }
      later.store.reset();
      later.open();
      ASSERT_EQ(difference(*later.store, filled.contents, filled.contents), "") << "what was backed up";
    }
  }
  EXPECT_GE(whole, 4);
  EXPECT_GT(refused, 40);
}

TEST_F(RandomHistory, a_full_disk_refuses_lets_delete_and_works_again_with_room) {
  for_seeds(is_long() ? 1000 : 10, [&](std::uint64_t seed) {
    std::mt19937_64 random(seed);
    Machine machine(SimulatedDisk::empty(), seed);
    machine.options.disk.keep_free = std::uint64_t{4} << 20;
    machine.disk.capacity = (8 << 20) + ((200 + random() % 100) << 10);
    machine.open();
    ErrorCode refused = ErrorCode::internal;
    std::vector<Action> added;
    for (unsigned mesh = 0; mesh < 4; ++mesh) {
      for (unsigned tenant = 0; tenant < 3; ++tenant) {
        const Action add{Action::add, mesh, tenant}, prepare{Action::prepare, mesh, tenant, 0};
        try {
          machine.act(add);
          added.push_back(add);
          machine.act(prepare);
        } catch (const Error& error) {
          refused = error.code();
        }
        ASSERT_EQ(difference(*machine.store, machine.contents, machine.contents), "");
      }
    }
    ++states;
    ASSERT_FALSE(added.empty());
    machine.disk.capacity = machine.disk.used();  // others take the rest
    if (random() % 2 == 0) {
      ASSERT_NO_THROW(machine.act({Action::reopen}));
    }
    try {
      machine.act({Action::add, 3, 2, 0});
    } catch (const Error& error) {
      refused = error.code();
    }
    if (machine.contents.geometries.size() < 12) ASSERT_EQ(refused, ErrorCode::out_of_budget);
    for (const Action& add : added) {
      ASSERT_NO_THROW(machine.act({Action::remove, add.mesh, add.tenant}));
      ASSERT_EQ(difference(*machine.store, machine.contents, machine.contents), "");
    }
    machine.disk.capacity = std::uint64_t{1} << 30;
    for (const Action& add : added) ASSERT_NO_THROW(machine.act(add));
    ASSERT_EQ(difference(*machine.store, machine.contents, machine.contents), "");
    machine.act({Action::check});
  });
}

// ---- flipped bits ----

TEST_F(RandomHistory, a_flipped_bit_is_found_and_costs_nothing_else) {
  for_seeds(is_long() ? 8000 : 150, [&](std::uint64_t seed) {
    std::mt19937_64 random(seed);
    Machine machine(SimulatedDisk::empty(), seed);
    machine.open();
    for (int i = 0; i < 8; ++i) {
      Action action = random_action(random);
      if (action.kind > Action::list) action.kind = Action::add;
      try {
        machine.act(action);
      } catch (const Error& error) {
        ASSERT_EQ(error.code(), ErrorCode::not_found) << error.what();
      }
    }
    machine.store.reset();
    std::vector<std::pair<std::string, std::uint64_t>> files;
    for (const auto& [path, size] : machine.disk.files(place)) {
      if (size > 0 && path != place / "reserve") files.emplace_back(path, size);
    }
    const auto& [path, size] = files[random() % files.size()];
    const std::uint64_t bit = random() % (8 * size);
    SCOPED_TRACE(path + ", bit " + std::to_string(bit));
    machine.disk.flip_bit(path, bit);
    ++states;
    if (fs::path(path).filename() == "deformd-store") {
      try {
        machine.open();
        constexpr std::uint64_t lowest_of_3 = 8 * 22;  // makes the mark of format 2, and this store is of that, too
        EXPECT_EQ(bit, lowest_of_3) << "a damaged mark";
        machine.store.reset();
      } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::failed_precondition) << error.what();
      }
      EXPECT_EQ(rebuild_store(place, machine.disk).outcome, StoreReport::Outcome::well);
    }
    ASSERT_NO_THROW(machine.open());
    StoreContents must = machine.contents;
    if (fs::path(path).parent_path() == place / "geometries") {
      const auto id = owned_id(fs::path(path).filename().string());
      std::erase_if(must.geometries, [&](const auto& entry) { return entry.first.id == id->id; });  // tenants share the bytes
      EXPECT_THROW(machine.store->load(*id), Error);
    }
    ASSERT_EQ(difference(*machine.store, must, machine.contents, Damage::of_what_need_not_be), "");
    for (const auto& [id, registered] : machine.contents.geometries) {
      machine.store->put(registered.mesh, id, registered.info.name());
    }
    machine.store.reset();
    ASSERT_NO_THROW(machine.open());
    for (const auto& [id, registered] : machine.contents.geometries) {
      EXPECT_EQ(machine.store->load(id).points, registered.mesh.points) << "healed";
    }
  });
}

}  // namespace
}  // namespace deform::server::store_simulation_test
