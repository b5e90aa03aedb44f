// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "server/store/shared_store.h"
#include "tests/server/simulated_catalog.h"
#include "tests/server/simulated_disk.h"
#include "tests/server/simulation.h"

namespace deform::server {

/// Where the shared folder is on the simulated disk, and how long a session has ended when it is taken over.
inline const std::filesystem::path shared_place = "/srv/deformd/shared";
inline constexpr auto take_over_after = std::chrono::seconds(30);

/// How a call ended.
struct Answer {
  enum Kind { done, not_found, failed } kind = done;
  bool existed = false;  ///< what was registered or released
};

/// The contents that may be there after a call that was answered so, by those that may have been there before.
inline std::vector<StoreContents> results(const std::vector<StoreContents>& from, const Action& action, const Answer& answer) {
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
      store = std::make_unique<SharedStore>(shared_place, std::move(made), options);
    } catch (...) {
      catalog = nullptr;
      throw;
    }
    store->mirror({[this](Intent::What what, const OwnedId& id) { memory[what].erase(id); },
                   [this](Intent::What what) { return std::vector<OwnedId>(memory[what].begin(), memory[what].end()); }});
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
          memory[Intent::What::setup].insert(owned(setup_of(action)));
          break;
        case Action::release:
          return {Answer::done, store->remove_setup(owned(setup_of(action)))};
        case Action::remove:
          store->remove(id, WithSetups::remove);
          break;
        case Action::list: {
          const auto reply = store->list(id.tenant, {});
          for (const auto& info : reply.geometries()) EXPECT_EQ(info.damage(), "");
          store->state();
          EXPECT_EQ(store->load(id).points, mesh_of(action.mesh).points);
          memory[Intent::What::geometry].insert(id);
          break;
        }
        case Action::check: {
          const StoreReport report = store->check({}, [](const GeometryRecord&) { return nullptr; });
          EXPECT_EQ(report.outcome, StoreReport::Outcome::well) << testing::PrintToString(report.lines);
          break;
        }
        case Action::back_up:
          store->backup("/srv/backup" + std::to_string(backups + 1));
          ++backups;
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
  std::map<Intent::What, std::set<OwnedId>> memory;  ///< what it holds of what is stored

 private:
  SimulatedDatabase& database_;
};

/// Some servers of one store, and what may be in it.
class Cluster {
 public:
  explicit Cluster(const SimulatedDisk::State& left = SimulatedDisk::empty(), SimulatedDatabase::State rows = {})
      : disk(std::make_unique<SimulatedDisk>(left)), database(std::move(rows)) {
    for (int i = 0; i < 3; ++i) servers.push_back(std::make_unique<Server>(*disk, database));
  }

  Server& at(std::size_t server) { return *servers[server]; }
  bool lives(std::size_t server) { return at(server).store && !at(server).fate.stopped(); }
  void open_all() {
    for (auto& server : servers) server->open();
  }
  /// A new process in the shared_place of one that is gone.
  void restart(std::size_t server) {
    servers[server].reset();
    servers[server] = std::make_unique<Server>(*disk, database);
    servers[server]->open();
  }
  /// The folder loses what was not synced, all servers with it. The database loses nothing.
  void lose_power(SimulatedDisk::Survival survival, std::mt19937_64& random) {
    trace += "\nthe power is lost";
    for (auto& server : servers) {
      server->fate.stop();
      server.reset();
    }
    disk = std::make_unique<SimulatedDisk>(SimulatedDisk::after_crash(disk->state(), survival, random));
    for (auto& server : servers) server = std::make_unique<Server>(*disk, database);
    open_all();
  }

  /// By the server of the action, which may be killed meanwhile. Throws what no fault explains.
  Answer attempt(const Action& action) {
    trace += std::string("\n") + names[action.kind] + " " + name_of(action);
    Answer answer;
    try {
      answer = at(action.server).act(action);
    } catch (const Error& error) {
      const bool stopped = at(action.server).fate.stopped();
      const bool told_so = error.code() == ErrorCode::unavailable || error.code() == ErrorCode::out_of_budget;
      if (!stopped && !(faulty && told_so)) throw Error(error.code(), error.what() + trace);
      answer.kind = Answer::failed;
      trace += stopped ? ": killed" : std::string(": ") + error.what();
    }
    return answer;
  }
  void act(const Action& action) {
    const Answer answer = attempt(action);
    contents = results(contents, action, answer);
  }
  /// A call of another server before a point of an action, counted from its first one.
  struct Meanwhile {
    std::uint64_t point = 1;
    Action action;
  };
  /// Whether there were all those points. `first`: before the first of them.
  bool act_within(
      const Action& outer, const std::vector<Meanwhile>& others, const std::function<void()>& first = [] {}) {
    std::vector<Answer> inside;
    std::uint64_t point = 0;
    at(outer.server).fate.before_point = [&] {
      ++point;
      while (inside.size() < others.size() && others[inside.size()].point <= point) {
        if (inside.empty()) first();
        trace += "\n  meanwhile:";
        inside.push_back(attempt(others[inside.size()].action));
      }
    };
    const Answer outside = attempt(outer);
    at(outer.server).fate.before_point = nullptr;
    // It took effect before, between or after theirs.
    std::vector<StoreContents> before = std::exchange(contents, {});
    for (std::size_t i = 0; i <= inside.size(); ++i) {
      auto after = results(before, outer, outside);
      for (std::size_t j = i; j < inside.size(); ++j) after = results(after, others[j].action, inside[j]);
      contents.insert(contents.end(), after.begin(), after.end());
      if (i < inside.size()) before = results(before, others[i].action, inside[i]);
    }
    return inside.size() == others.size();
  }

  /// All live servers agree on one of the contents that may be there.
  void expect_contents() {
    ASSERT_FALSE(contents.empty()) << "answers that no order of the calls explains" << trace;
    for (std::size_t i = 0; i < servers.size(); ++i) {
      if (!lives(i)) continue;
      SharedStore& store = *at(i).store;
      std::string why;
      const auto found = std::find_if(contents.begin(), contents.end(), [&](const StoreContents& one) {
        const std::string differs = difference(store, one, one);
        why += "\n" + differs;
        return differs.empty();
      });
      ASSERT_NE(found, contents.end()) << "server " << i << ":" << why << trace;
      for (auto& [id, registered] : found->geometries) registered.info = store.info(id);
      contents = {*found};
    }
  }

  /// The live servers keep house until what those that are gone have left is taken over and done.
  void settle() {
    database.deliver();
    for (int round = 0; round < 4; ++round) {
      database.pass(take_over_after);
      for (std::size_t i = 0; i < servers.size(); ++i) {
        if (lives(i)) at(i).catalog->keep_house();
      }
    }
  }

  /// The same by one of them, while others are at work.
  void settle_by(std::size_t server) {
    for (int round = 0; round < 4; ++round) {
      database.pass(take_over_after);
      at(server).catalog->keep_house();
    }
  }

  /// Every row has its file, and every other file is named by an intent.
  void expect_known_files() {
    const auto rows = database.state();
    std::set<std::string> named, required;
    for (const auto& [number, owned] : rows.intents) {
      const auto& entry = owned.intent.entries.at(0);
      const std::string key = key_of({entry.tenant, entry.id}), put = std::to_string(entry.put);
      named.insert((shared_place / "geometries" / (key + "~" + put)).string());
      named.insert((shared_place / "tmp" / (key + "." + put)).string());
    }
    for (const auto& [key, row] : rows.geometries) {
      required.insert((shared_place / "geometries" / (key + "~" + std::to_string(row.record.put))).string());
    }
    for (const char* folder : {"geometries", "tmp"}) {
      for (const auto& [file, bytes] : disk->files(shared_place / folder)) {
        EXPECT_TRUE(required.erase(file) > 0 || named.count(file) > 0) << file << " is nobody's" << trace;
      }
    }
    EXPECT_TRUE(required.empty()) << *required.begin() << " is missing" << trace;
  }

  /// No server has in memory what is not stored any more.
  void expect_memory_of_contents() {
    for (std::size_t i = 0; i < servers.size(); ++i) {
      if (!lives(i)) continue;
      for (const auto& id : at(i).memory[Intent::What::geometry]) {
        EXPECT_EQ(contents.at(0).geometries.count(id), 1u) << "server " << i << " remembers " << key_of(id) << trace;
      }
      for (const auto& id : at(i).memory[Intent::What::setup]) {
        EXPECT_EQ(contents.at(0).setups.count(id), 1u) << "server " << i << " remembers system " << key_of(id) << trace;
      }
    }
  }

  std::unique_ptr<SimulatedDisk> disk;
  SimulatedDatabase database;
  std::vector<std::unique_ptr<Server>> servers;
  std::vector<StoreContents> contents{1};
  bool faulty = false;  ///< calls may be refused
  std::string trace;
};

/// A disk and a database that fail once, or from then on until the call has ended.
struct Fault {
  int error = 0;  ///< of the disk
  SimulatedServer::Loss loss = SimulatedServer::Loss::none;
  enum Length { once, until_the_end } length = once;
};

inline const Fault faults[] = {{EIO},
                               {ENOSPC},
                               {EIO, {}, Fault::until_the_end},
                               {ENOSPC, {}, Fault::until_the_end},
                               {0, SimulatedServer::Loss::call},
                               {0, SimulatedServer::Loss::answer},
                               {0, SimulatedServer::Loss::call, Fault::until_the_end},
                               {0, SimulatedServer::Loss::answer, Fault::until_the_end}};

/// While it lives, calls of a server fail; the first to fail is that with the number.
class Failing {
 public:
  Failing(Cluster& cluster, unsigned server, const Fault& fault, int first)
      : disk_(*cluster.disk), fate_(cluster.at(server).fate), left_(first) {
    cluster.faulty = true;
    const auto hits = [this, fault] { return --left_ == 0 || (left_ < 0 && fault.length == Fault::until_the_end); };
    if (fault.error != 0) {
      disk_.fault = [hits, fault](bool changing) { return (changing || fault.error == EIO) && hits() ? fault.error : 0; };
    } else {
      fate_.catalog_fault = [hits, fault] { return hits() ? fault.loss : SimulatedServer::Loss::none; };
    }
  }
  ~Failing() {
    disk_.fault = nullptr;
    fate_.catalog_fault = nullptr;
  }
  Failing(const Failing&) = delete;
  Failing& operator=(const Failing&) = delete;
  bool reached() const { return left_ <= 0; }

 private:
  SimulatedDisk& disk_;
  SimulatedServer& fate_;
  int left_;
};

}  // namespace deform::server
