// SPDX-License-Identifier: GPL-3.0-or-later
// The store of several servers on a simulated disk and a simulated database: servers that are killed between any two steps while
// the others go on, power that is lost, steps of one server between those of another, connections that are lost before or after
// the call was done, errors of the disk, a full one, and flipped bits. Whatever was acknowledged is there for all, nothing is
// half there, what was removed stays away, and no file stays that nobody knows of. A state is what one such fault left.
// DEFORM_LONG=1 tries many more of them; DEFORM_SIMULATION_SEED=N runs the random histories of that seed alone.
#include <gtest/gtest.h>

#include <cerrno>
#include <cstdlib>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "server/store/geometry_store.h"
#include "tests/server/any_store.h"
#include "tests/server/simulated_cluster.h"

namespace deform::server::shared_store_simulation_test {
namespace {

namespace fs = std::filesystem;
using Survival = SimulatedDisk::Survival;

const fs::path& place = shared_place;

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

class SharedStoreSimulation : public Simulation {
 protected:
  void expect_states(std::size_t at_least, std::size_t in_long) const {
    if (std::getenv("DEFORM_SIMULATION_SEED") != nullptr) return;
    EXPECT_GE(states - before_, is_long() ? in_long : at_least) << "the simulation does not reach what it did";
  }

  /// When all is settled nothing is left but the rows and their files, whoever looks.
  static void expect_clean(Cluster& cluster) {
    cluster.settle();
    ASSERT_NO_FATAL_FAILURE(cluster.expect_contents());
    cluster.expect_known_files();
    cluster.expect_memory_of_contents();
    const auto intents = cluster.database.state().intents;
    EXPECT_TRUE(intents.empty()) << intents.size() << " intents are left" << cluster.trace;
  }

 private:
  const std::size_t before_ = states;
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
  std::vector<Survival> outcomes = {Survival::durable, Survival::names, Survival::content};
  outcomes.insert(outcomes.end(), is_long() ? 50 : 1, Survival::random);
  std::mt19937_64 random(1);
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
      for (const Survival survival : outcomes) {
        ++states;
        Cluster later(cluster.disk->state(), cluster.database.state());
        later.contents = cluster.contents;
        later.trace = cluster.trace;
        later.lose_power(survival, random);
        later.expect_contents();
        expect_clean(later);
        // Files of uploads that were taken over do not come back.
        later.lose_power(survival == Survival::random ? Survival::random : Survival::durable, random);
        expect_clean(later);
      }
      ++states;
      cluster.expect_contents();
      cluster.at(victim).stop();
      expect_clean(cluster);
      cluster.restart(victim);
      if (at > 0) cluster.act(history[at - 1]);
      cluster.lose_power(Survival::random, random);
      expect_clean(cluster);
    }
  }
  expect_states(690, 2900);
}

INSTANTIATE_TEST_SUITE_P(Histories, KilledAnywhere, testing::Range<std::size_t>(0, std::size(histories)));

TEST_F(SharedStoreSimulation, a_server_that_is_killed_while_it_ends_what_another_one_left_leaves_it_to_a_third) {
  std::mt19937_64 random(1);
  for (const auto kind : {Action::add, Action::remove}) {
    bool first_killed = true, second_killed = true;
    for (std::uint64_t first = 1; first_killed && !HasFailure(); ++first) {
      for (std::uint64_t second = 1; first_killed && (second_killed || second == 1) && !HasFailure(); ++second) {
        SCOPED_TRACE(std::string(names[kind]) + ": killed at points " + std::to_string(first) + " and " + std::to_string(second));
        Cluster cluster;
        cluster.open_all();
        if (kind == Action::remove) cluster.act({Action::add, 0, 0, 0, 2});
        auto& one = cluster.at(0).fate;
        one.stops_at = one.points() + first;
        cluster.act({kind, 0, 0, 0, 0});
        first_killed = one.stopped();
        one.stops_at = UINT64_MAX;
        cluster.at(0).stop();
        auto& other = cluster.at(1).fate;
        other.stops_at = other.points() + second;
        cluster.settle_by(1);
        second_killed = other.stopped();
        other.stops_at = UINT64_MAX;
        cluster.at(1).stop();
        ++states;
        ASSERT_NO_FATAL_FAILURE(cluster.expect_contents());
        if (random() % 2 == 0) cluster.lose_power(Survival::random, random);
        expect_clean(cluster);
      }
    }
  }
  expect_states(110, 110);
}

// ---- servers that act at the same time ----

/// Every pair of calls for the same content, one of them between any two steps of the other one.
class Between : public SharedStoreSimulation {
 protected:
  enum class Session { lives, is_cut_off };
  void run(Session session) {
    const Action::Kind outers[] = {Action::add, Action::prepare, Action::release, Action::remove, Action::list, Action::check};
    const Action::Kind inners[] = {Action::add, Action::prepare, Action::release, Action::remove, Action::list};
    for (int start = 0; start <= 2; start += is_long() ? 1 : 2) {
      for (const Action::Kind outer : outers) {
        for (const Action::Kind inner : inners) {
          bool reached = true;
          for (std::uint64_t point = 1; reached && !HasFailure(); ++point) {
            Cluster cluster;
            cluster.open_all();
            if (start > 0) cluster.act({Action::add, 0, 1, 0, 2});
            if (start > 1) cluster.act({Action::prepare, 0, 1, 0, 2});
            cluster.faulty = session == Session::is_cut_off;
            reached = cluster.act_within({outer, 0, 1, 0, 0}, {{point, {inner, 0, 1, 0, 1}}}, [&] {
              cluster.at(1).catalog->keep_house();
              if (session == Session::lives) return;
              cluster.at(0).catalog->cut_off();
              cluster.settle_by(1);
            });
            ++states;
            ASSERT_NO_FATAL_FAILURE(cluster.expect_contents());
            if (session == Session::is_cut_off) cluster.at(0).catalog->come_back();
            cluster.faulty = false;
            expect_clean(cluster);
          }
        }
      }
    }
  }
};

/// Put, removed and put again by another server while this one is at it: nothing is taken for what it was.
TEST_F(Between, what_comes_goes_and_comes_again_meanwhile_is_not_mixed_up) {
  const std::vector<std::vector<Action::Kind>> sequences = {{Action::remove, Action::add}, {Action::add, Action::remove}};
  for (const auto outer : {Action::add, Action::prepare, Action::remove, Action::list, Action::check}) {
    for (const auto& inner : sequences) {
      bool reached = true;
      for (std::uint64_t from = 1; reached && !HasFailure(); ++from) {
        for (std::uint64_t to = from; reached && !HasFailure(); to += is_long() ? 1 : 5) {
          Cluster cluster;
          cluster.open_all();
          if (inner[0] == Action::remove) cluster.act({Action::add, 0, 1, 0, 2});
          reached = cluster.act_within({outer, 0, 1, 0, 0}, {{from, {inner[0], 0, 1, 0, 1}}, {to, {inner[1], 0, 1, 0, 1}}});
          ++states;
          ASSERT_NO_FATAL_FAILURE(cluster.expect_contents());
          expect_clean(cluster);
          if (!reached && to > from) {
            reached = true;
            break;
          }
        }
      }
    }
  }
  expect_states(190, 190);
}

TEST_F(Between, calls_for_the_same_content_have_an_order) {
  run(Session::lives);
  expect_states(380, 380);
}

TEST_F(Between, what_is_taken_from_a_server_that_lives_is_refused_and_leaves_nothing) {
  run(Session::is_cut_off);
  expect_states(380, 380);
}

TEST_F(SharedStoreSimulation, a_put_that_others_ended_before_its_file_was_written_leaves_no_file) {
  Cluster cluster;
  cluster.open_all();
  cluster.faulty = true;
  bool taken_over = false;
  cluster.at(0).fate.before_point = [&] {
    if (taken_over || cluster.database.state().intents.empty()) return;
    taken_over = true;
    cluster.at(0).catalog->cut_off();
    cluster.settle_by(1);
    EXPECT_TRUE(cluster.database.state().intents.empty()) << "taken over and ended";
  };
  cluster.act({Action::add, 0, 0, 0, 0});
  cluster.at(0).fate.before_point = nullptr;
  EXPECT_TRUE(taken_over);
  EXPECT_NE(cluster.trace.find("gave the upload up"), std::string::npos) << cluster.trace;
  cluster.at(0).catalog->come_back();
  EXPECT_EQ(cluster.disk->files(place / "geometries").size(), 0u);
  expect_clean(cluster);
}

TEST_F(SharedStoreSimulation, a_file_in_tmp_that_was_taken_over_stays_away_when_the_power_is_lost) {
  Cluster cluster;
  cluster.open_all();
  int written = 0;
  cluster.at(0).fate.before_point = [&] {
    for (const auto& [file, bytes] : cluster.disk->files(place / "tmp")) written += bytes > 0 ? 1 : 0;
    if (written == 2) cluster.at(0).fate.stop();  // it is synced and not yet renamed
  };
  cluster.act({Action::add, 0, 0, 0, 0});
  cluster.at(0).stop();
  ASSERT_EQ(cluster.disk->files(place / "tmp").size(), 1u);
  std::mt19937_64 random(1);
  cluster.lose_power(Survival::all, random);
  expect_clean(cluster);
  ASSERT_EQ(cluster.disk->files(place / "tmp").size(), 0u);
  cluster.lose_power(Survival::durable, random);
  EXPECT_EQ(cluster.disk->files(place / "tmp").size(), 0u);
  expect_clean(cluster);
}

// ---- calls that fail ----

TEST_F(SharedStoreSimulation, calls_that_fail_are_done_or_not_and_leave_a_store_that_works) {
  for (const int start : {0, 1, 2}) {
    for (const Fault& fault : faults) {
      for (const auto kind : {Action::add, Action::prepare, Action::release, Action::remove, Action::list}) {
        bool reached = true;
        for (int first = 1; reached && !HasFailure(); ++first) {
          SCOPED_TRACE(std::string(names[kind]) + " of start " + std::to_string(start) + ", fault " +
                       std::to_string(&fault - faults) + " at " + std::to_string(first));
          Cluster cluster;
          cluster.open_all();
          if (start > 0) cluster.act({Action::add, 0, 1, 0, 2});
          if (start > 1) cluster.act({Action::prepare, 0, 1, 0, 2});
          {
            const Failing failing(cluster, 0, fault, first);
            cluster.act({kind, 0, 1, 0, 0});
            reached = failing.reached();
          }
          ++states;
          ASSERT_NO_FATAL_FAILURE(cluster.expect_contents());
          cluster.act({Action::add, 0, 1, 0, 0});
          cluster.settle();
          cluster.expect_known_files();
          // An intent whose begin was not answered is known to the catalog alone, and ends when the server does. All else the
          // server ends itself, later.
          if (fault.loss == SimulatedServer::Loss::answer) cluster.restart(0);
          expect_clean(cluster);
        }
      }
    }
  }
  expect_states(470, 470);
}

TEST_F(SharedStoreSimulation, a_file_that_cannot_be_looked_at_is_not_called_lost) {
  Cluster cluster;
  cluster.open_all();
  const Action registering{Action::add, 0, 0, 0, 0};
  cluster.act(registering);
  SharedStore& store = *cluster.at(1).store;
  {
    const Failing look(cluster, 1, {EIO}, 1);
    EXPECT_EQ(store.info(id_of(registering)).damage(), "");
  }
  {
    const Failing look(cluster, 1, {EIO}, 1);
    EXPECT_EQ(store.load(id_of(registering)).points, mesh_of(0).points);
  }
  const Failing open(cluster, 1, {EIO}, 2);
  EXPECT_EQ(code_of([&] { store.load(id_of(registering)); }), ErrorCode::unavailable);
}

// ---- the first start ----

TEST_F(SharedStoreSimulation, servers_that_start_at_once_or_are_killed_meanwhile_make_one_store) {
  std::mt19937_64 random(1);
  for (const bool killed : {false, true}) {
    bool reached = true;
    for (std::uint64_t point = 1; reached && !HasFailure(); ++point) {
      SCOPED_TRACE((killed ? "killed at point " : "another one at point ") + std::to_string(point));
      Cluster cluster;
      auto& fate = cluster.at(0).fate;
      if (killed) {
        fate.stops_at = point;
      } else {
        fate.before_point = [&, left = point]() mutable {
          if (--left == 0) cluster.at(1).open();
        };
      }
      try {
        cluster.at(0).open();
      } catch (const Error& error) {
        // One that has waited in vain for the claim of another one may find half a store: it has to be started again.
        const bool half = error.code() == ErrorCode::failed_precondition && !killed;
        EXPECT_TRUE(half || error.code() == ErrorCode::unavailable) << error.what();
      }
      ++states;
      fate.before_point = nullptr;
      reached = killed ? fate.stopped() : cluster.at(1).store != nullptr;
      if (killed && random() % 2 == 0) {
        cluster.lose_power(Survival::random, random);
      } else {
        for (std::size_t server = 0; server < 3; ++server) {
          if (!cluster.lives(server)) cluster.restart(server);
        }
      }
      for (const unsigned server : {0u, 1u, 2u}) cluster.act({Action::add, server, 0, 0, server});
      expect_clean(cluster);
    }
  }
  expect_states(40, 40);
}

// ---- damage ----

/// A geometry whose file was damaged and is set aside, by a server that has noticed it.
class Damaged : public SharedStoreSimulation {
 protected:
  static void damage(Cluster& cluster) {
    cluster.open_all();
    cluster.act(registering_at(2));
    const auto files = cluster.disk->files(place / "geometries");
    ASSERT_EQ(files.size(), 1u);
    cluster.disk->flip_bit(files.begin()->first, 4 * files.begin()->second);
    EXPECT_EQ(code_of([&] { cluster.at(2).store->load(id_of(registering_at(2))); }), ErrorCode::data_loss);
  }
  static Action registering_at(unsigned server) { return {Action::add, 1, 1, 0, server}; }
};

TEST_F(Damaged, two_servers_that_heal_the_same_leave_one_file) {
  for (const auto inner : {Action::add, Action::remove, Action::prepare}) {
    bool reached = true;
    for (std::uint64_t point = 1; reached && !HasFailure(); ++point) {
      SCOPED_TRACE(std::string(names[inner]) + " at point " + std::to_string(point));
      Cluster cluster;
      ASSERT_NO_FATAL_FAILURE(damage(cluster));
      reached = cluster.act_within(registering_at(0), {{point, {inner, 1, 1, 0, 1}}});
      ++states;
      expect_clean(cluster);
      EXPECT_EQ(cluster.disk->files(place / "damaged").size(), 1u) << "it may be all there is";
    }
  }
  expect_states(30, 30);
}

TEST_F(Damaged, a_server_that_is_killed_while_it_heals_leaves_that_to_another_one) {
  std::mt19937_64 random(1);
  bool killed = true;
  for (std::uint64_t point = 1; killed && !HasFailure(); ++point) {
    SCOPED_TRACE("killed at point " + std::to_string(point));
    Cluster cluster;
    ASSERT_NO_FATAL_FAILURE(damage(cluster));
    auto& fate = cluster.at(0).fate;
    fate.stops_at = fate.points() + point;
    cluster.act(registering_at(0));
    killed = fate.stopped();
    fate.stops_at = UINT64_MAX;
    ++states;
    cluster.at(0).stop();
    if (random() % 2 == 0) cluster.lose_power(Survival::random, random);
    cluster.act(registering_at(1));
    expect_clean(cluster);
  }
  expect_states(10, 10);
}

TEST_F(Damaged, a_flipped_bit_is_found_by_all_servers_and_costs_nothing_else) {
  for_seeds(is_long() ? 3000 : 100, [&](std::uint64_t seed) {
    std::mt19937_64 random(seed);
    Cluster cluster;
    cluster.open_all();
    for (unsigned mesh = 0; mesh < 3; ++mesh) {
      cluster.act({Action::add, mesh, 0, 0, mesh});
      cluster.act({Action::add, mesh, 1, 0, 1});
      cluster.act({Action::prepare, mesh, 1, 0, 2});
    }
    const Action hit{Action::add, static_cast<unsigned>(random() % 3), static_cast<unsigned>(random() % 2), 0, 0};
    const auto one = static_cast<std::size_t>(random() % 3), other = (one + 1) % 3;
    const OwnedId id = id_of(hit), system = owned(setup_of({Action::prepare, hit.mesh, 1, 0, 0}));
    const auto file =
        place / "geometries" / (key_of(id) + "~" + std::to_string(cluster.database.state().geometries.at(key_of(id)).record.put));
    ++states;
    StoreContents whole = cluster.contents.at(0);
    switch (random() % 4) {
      case 0:
        cluster.database.damage_geometry(key_of(id));
        EXPECT_NE(cluster.at(one).store->info(id).damage(), "");
        EXPECT_EQ(cluster.at(other).store->load(id).points, mesh_of(hit.mesh).points) << "the file is whole";
        break;
      case 1:
        cluster.database.damage_setup(key_of(system));
        EXPECT_EQ(code_of([&] { cluster.at(one).store->find_setup(system); }), ErrorCode::data_loss);
        break;
      default:
        cluster.disk->flip_bit(file, random() % (8 * cluster.disk->files(place).at(file.string())));
        EXPECT_EQ(code_of([&] { cluster.at(one).store->load(id); }), ErrorCode::data_loss);
        EXPECT_EQ(code_of([&] { cluster.at(other).store->load(id); }), ErrorCode::data_loss);
        EXPECT_NE(cluster.at(other).store->info(id).damage(), "");
    }
    const StoreReport report = cluster.at(other).store->check({}, [](const GeometryRecord&) { return nullptr; });
    EXPECT_EQ(report.outcome, StoreReport::Outcome::faults) << "seen by the operator";
    for (const auto& [known, registered] : whole.geometries) {
      if (known == id) continue;
      EXPECT_EQ(cluster.at(other).store->load(known).points, registered.mesh.points) << key_of(known);
    }
    EXPECT_TRUE(cluster.at(one).store->put(mesh_of(hit.mesh), id, name_of({hit.kind, hit.mesh, hit.tenant})).existed());
    cluster.act({Action::prepare, hit.mesh, 1, 0, 2});
    // A row that was damaged has its time and name anew.
    whole.geometries.at(id).info = cluster.at(one).store->info(id);
    cluster.contents = {whole};
    expect_clean(cluster);
    cluster.act({Action::check, 0, 0, 0, 1});
  });
  expect_states(100, 3000);
}

TEST_F(Damaged, a_folder_without_its_mark_is_not_the_store_and_nothing_is_lost) {
  Cluster cluster;
  ASSERT_NO_FATAL_FAILURE(damage(cluster));
  cluster.act(registering_at(0));
  cluster.disk->flip_bit(place / "deformd-store", 8);
  const auto files = cluster.disk->files(place);
  EXPECT_EQ(code_of([&] { cluster.at(0).store->check({}, [](const GeometryRecord&) { return nullptr; }); }),
            ErrorCode::unavailable);
  EXPECT_FALSE(cluster.at(1).store->state().writable());
  EXPECT_EQ(code_of([&] { cluster.restart(2); }), ErrorCode::failed_precondition);
  EXPECT_EQ(cluster.disk->files(place), files);
  cluster.disk->flip_bit(place / "deformd-store", 8);
  cluster.restart(2);
  expect_clean(cluster);
}

// ---- what is in memory ----

TEST_F(SharedStoreSimulation, removals_reach_the_memory_of_all_servers_with_the_news_or_when_they_compare) {
  using News = SimulatedDatabase::News;
  for (const News news : {News::at_once, News::late, News::lost}) {
    Cluster cluster;
    cluster.open_all();
    cluster.act({Action::add, 0, 0, 0, 0});
    for (const unsigned server : {0u, 1u, 2u}) {
      cluster.act({Action::prepare, 0, 0, 0, server});
      cluster.act({Action::list, 0, 0, 0, server});
    }
    cluster.database.set_news(news);
    cluster.act({Action::remove, 0, 0, 0, 2});
    cluster.expect_contents();
    for (auto& server : cluster.servers) {
      const bool knows = server->memory[Intent::What::geometry].empty() && server->memory[Intent::What::setup].empty();
      EXPECT_EQ(knows, news == News::at_once);
    }
    cluster.database.deliver();
    if (news == News::lost) {
      for (auto& server : cluster.servers) {
        server->catalog->keep_house();  // the first time there is nothing to compare
        server->catalog->keep_house();
      }
    }
    cluster.expect_memory_of_contents();
  }
}

// ---- a full disk ----

TEST_F(SharedStoreSimulation, a_full_folder_refuses_lets_remove_and_works_again_with_room) {
  for_seeds(is_long() ? 1000 : 20, [&](std::uint64_t seed) {
    std::mt19937_64 random(seed);
    Cluster cluster;
    cluster.disk->capacity = (64 + 8 + random() % 32) << 10;  // what stays free, and some geometries
    cluster.open_all();
    cluster.faulty = true;
    for (unsigned mesh = 0; mesh < 4; ++mesh) {
      for (unsigned tenant = 0; tenant < 3; ++tenant) cluster.act({Action::add, mesh, tenant, 0, (mesh + tenant) % 3});
      ++states;
      ASSERT_NO_FATAL_FAILURE(cluster.expect_contents());
    }
    EXPECT_LT(cluster.contents.at(0).geometries.size(), 12u) << "some were refused";
    cluster.disk->capacity = cluster.disk->used();  // others take the rest
    cluster.act({Action::add, 3, 2, 0, 0});
    ASSERT_NO_FATAL_FAILURE(cluster.expect_contents());
    cluster.faulty = false;
    for (const auto& [id, registered] : StoreContents(cluster.contents.at(0)).geometries) {
      ASSERT_NO_THROW(cluster.at(1).store->remove(id, WithSetups::refuse)) << cluster.trace;
      cluster.contents.at(0).geometries.erase(id);
    }
    expect_clean(cluster);
    cluster.disk->capacity = std::uint64_t{1} << 30;
    cluster.act({Action::add, 3, 2, 0, 2});
    expect_clean(cluster);
  });
  expect_states(80, 4000);
}

// ---- copies ----

TEST_F(SharedStoreSimulation, a_backup_has_what_there_was_at_one_moment) {
  for (const auto inner : {Action::add, Action::remove, Action::prepare}) {
    bool reached = true;
    for (std::uint64_t point = 1; reached && !HasFailure(); point += is_long() ? 1 : 3) {
      SCOPED_TRACE(std::string(names[inner]) + " at point " + std::to_string(point));
      Cluster cluster;
      cluster.open_all();
      cluster.act({Action::add, 0, 0, 0, 0});
      cluster.act({Action::add, 1, 1, 0, 1});
      cluster.act({Action::prepare, 1, 1, 0, 1});
      ASSERT_NO_FATAL_FAILURE(cluster.expect_contents());
      const Action meanwhile{inner, inner == Action::add ? 2u : 1u, 1, 1, 1};
      const StoreContents before = cluster.contents.at(0);
      reached = cluster.act_within({Action::back_up, 0, 0, 0, 0}, {{point, meanwhile}});
      ++states;
      expect_clean(cluster);
      StoreOptions options;
      options.disk.keep_free = std::uint64_t{64} << 10;
      options.files = cluster.disk.get();
      GeometryStore copy("/srv/backup1", options);
      const std::string was = difference(copy, before, before), is = difference(copy, cluster.contents[0], cluster.contents[0]);
      EXPECT_TRUE(was.empty() || is.empty()) << was << "\n" << is;
    }
  }
  expect_states(20, 60);
}

// ---- all of it, again and again ----

class RandomCluster : public SharedStoreSimulation {
 protected:
  static Action random_action(std::mt19937_64& random, std::uint64_t server) {
    static constexpr Action::Kind kinds[] = {Action::add,     Action::add,    Action::add,    Action::prepare, Action::prepare,
                                             Action::release, Action::remove, Action::remove, Action::list,    Action::check};
    Action action{kinds[random() % std::size(kinds)]};
    action.mesh = static_cast<unsigned>(random() % 3);
    action.tenant = static_cast<unsigned>(random() % 2);
    action.setup = static_cast<unsigned>(random() % 2);
    action.server = static_cast<unsigned>(server);
    return action;
  }

  /// One thing that happens to the servers.
  static void step(Cluster& cluster, std::mt19937_64& random) {
    const auto one = static_cast<unsigned>(random() % 3), other = static_cast<unsigned>((one + 1 + random() % 2) % 3);
    Action action = random_action(random, one);
    std::vector<Cluster::Meanwhile> meanwhile;
    for (std::uint64_t point = 1 + random() % 24; meanwhile.size() < 4 && point < 26; point += random() % 12) {
      Action next = random_action(random, (one + 1 + random() % 2) % 3);
      if (random() % 4 != 0) {  // the same content
        next.mesh = action.mesh;
        next.tenant = action.tenant;
      }
      meanwhile.push_back({point, next});
    }
    auto& fate = cluster.at(one).fate;
    switch (random() % 9) {
      case 0:
      case 1:
        cluster.act(action);
        break;
      case 2:
        cluster.act_within(action, meanwhile);
        break;
      case 3:  // killed, maybe after another server has come in between
        fate.stops_at = fate.points() + 1 + random() % 24;
        cluster.act_within(action, meanwhile);
        fate.stops_at = UINT64_MAX;
        break;
      case 4: {
        const Failing failing(cluster, one, faults[random() % std::size(faults)], static_cast<int>(1 + random() % 10));
        if (action.kind == Action::check) action.kind = Action::list;
        cluster.act(action);
        break;
      }
      case 5: {
        cluster.faulty = true;
        cluster.act_within(action, meanwhile, [&] {
          cluster.at(one).catalog->cut_off();
          cluster.settle_by(other);
        });
        cluster.at(one).catalog->come_back();
        break;
      }
      case 6:
        cluster.trace += "\nnews";
        cluster.database.set_news(static_cast<SimulatedDatabase::News>(random() % 3));
        cluster.database.deliver();
        break;
      case 7:  // killed while it ends what others have left
        cluster.trace += "\nhousekeeping";
        if (random() % 2 == 0) fate.stops_at = fate.points() + 1 + random() % 24;
        cluster.settle_by(one);
        fate.stops_at = UINT64_MAX;
        break;
      default:
        cluster.lose_power(random() % 4 == 0 ? Survival::all : Survival::random, random);
    }
    cluster.faulty = false;
  }

  /// New processes for those that were killed, at once or after others have ended what they were at.
  static void revive(Cluster& cluster, std::mt19937_64& random) {
    for (unsigned server = 0; server < 3; ++server) {
      if (cluster.lives(server)) continue;
      cluster.at(server).stop();
      if (random() % 2 == 0) cluster.settle();
      cluster.restart(server);
    }
  }
};

TEST_F(RandomCluster, a_seed_does_the_same_again) {
  for_seeds(10, [&](std::uint64_t seed) {
    std::string traces[2];
    std::map<std::string, std::uint64_t> files[2];
    for (const int run : {0, 1}) {
      std::mt19937_64 random(seed);
      Cluster cluster;
      cluster.open_all();
      for (int i = 0; i < 12; ++i) {
        step(cluster, random);
        cluster.contents.resize(1);  // none is looked at
        revive(cluster, random);
      }
      traces[run] = cluster.trace + "\nat " + std::to_string(cluster.database.state().now_ms);
      files[run] = cluster.disk->files(place);
    }
    EXPECT_EQ(traces[0], traces[1]);
    EXPECT_EQ(files[0], files[1]);
  });
}

TEST_F(RandomCluster, whatever_happens_to_servers_nothing_is_lost_or_comes_back) {
  for_seeds(is_long() ? 8200 : 60, [&](std::uint64_t seed) {
    std::mt19937_64 random(seed);
    Cluster cluster;
    cluster.open_all();
    for (int i = 0; i < 12; ++i) {
      ASSERT_NO_THROW(step(cluster, random)) << cluster.trace;
      ++states;
      ASSERT_NO_FATAL_FAILURE(cluster.expect_contents());
      revive(cluster, random);
      ASSERT_FALSE(HasFailure()) << cluster.trace;
    }
    for (unsigned server = 0; server < 3; ++server) cluster.restart(server);
    expect_clean(cluster);
    cluster.act({Action::check});
  });
  expect_states(720, 98'400);
}

}  // namespace
}  // namespace deform::server::shared_store_simulation_test
