// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <map>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "tests/server/store_contents.h"

namespace deform::server {

/// Something that a client or the operator asks of a store: few contents, tenants and setups make for many meetings.
struct Action {
  enum Kind { add, prepare, release, remove, list, reopen, check, back_up, rebuild, lose_catalog } kind;
  unsigned mesh = 0, tenant = 0, setup = 0;
  unsigned server = 0;  ///< of several
};

inline constexpr const char* names[] = {"register", "prepare", "release", "remove",  "list",
                                        "reopen",   "check",   "back up", "rebuild", "lose the catalog"};

inline const Mesh& mesh_of(unsigned number) {
  static const std::vector<Mesh> meshes = [] {
    std::vector<Mesh> made;
    for (unsigned i = 0; i < 4; ++i) made.push_back(sheet_mesh(4 + i, 3 + 3 * i, 0.1 * i));
    return made;
  }();
  return meshes[number];
}
inline OwnedId id_of(const Action& action) {
  static const std::vector<std::string> ids = {mesh_id(mesh_of(0)), mesh_id(mesh_of(1)), mesh_id(mesh_of(2)),
                                               mesh_id(mesh_of(3))};
  return {StoreContents::tenants[action.tenant], ids[action.mesh]};
}
inline SetupRecord setup_of(const Action& action) {
  return setup_record(id_of(action).id, -0.1 * (1 + action.setup), id_of(action).tenant);
}
inline std::string name_of(const Action& action) {
  return "mesh " + std::to_string(action.mesh) + " of " + id_of(action).tenant + " at " + std::to_string(action.server);
}

/// The damage that is allowed.
enum class Damage { none, of_what_need_not_be };
/// The first difference between a store and the contents that must (and may) be in it; empty: none.
inline std::string difference(Store& store, const StoreContents& must, const StoreContents& may, Damage damage = Damage::none) {
  const auto found = store.catalog().all_geometries();
  const auto found_setups = store.catalog().all_setups();
  for (const auto& [id, registered] : must.geometries) {
    if (std::find(found.begin(), found.end(), id) == found.end()) return "lost geometry " + key_of(id);
  }
  for (const auto& [id, record] : must.setups) {
    if (std::find(found_setups.begin(), found_setups.end(), id) == found_setups.end()) return "lost system " + key_of(id);
  }
  std::map<std::string, StoredAmount> amounts;
  for (const auto& id : found) {
    ++amounts[id.tenant].geometries;
    const auto expected = may.geometries.find(id);
    if (expected == may.geometries.end()) return "a geometry that should be gone: " + key_of(id);
    const auto required = must.geometries.find(id);
    const bool lenient = damage == Damage::of_what_need_not_be && required == must.geometries.end();
    const v1::GeometryInfo info = store.info(id);
    try {
      if (store.load(id).points != expected->second.mesh.points) return "wrong bytes of " + key_of(id);
    } catch (const Error& error) {
      if (!lenient || error.code() != ErrorCode::data_loss) return "geometry " + key_of(id) + ": " + error.what();
      continue;
    }
    if (lenient && !info.damage().empty()) continue;
    if (!info.damage().empty()) return "geometry " + key_of(id) + ": " + info.damage();
    if (info.name() != expected->second.info.name()) return "geometry " + key_of(id) + " is called \"" + info.name() + "\"";
    const bool known = required != must.geometries.end() && required->second.info.registered_unix_ms() != 0;
    if (known && info.registered_unix_ms() != required->second.info.registered_unix_ms()) {
      return "another time of " + key_of(id);
    }
  }
  for (const auto& id : found_setups) {
    ++amounts[id.tenant].setups;
    const auto expected = may.setups.find(id);
    if (expected == may.setups.end()) return "a system that should be gone: " + key_of(id);
    const auto record = store.find_setup(id);
    if (!record || record->setup != expected->second.setup || record->info != expected->second.info) {
      return "wrong system " + key_of(id);
    }
  }
  for (const char* tenant : StoreContents::tenants) {
    const StoredAmount has = store.amount_of(tenant);
    if (has.geometries != amounts[tenant].geometries || has.setups != amounts[tenant].setups) {
      return std::string("the amounts of ") + tenant + " are wrong";
    }
    if (static_cast<std::size_t>(store.list(tenant, {}).geometries_size()) != has.geometries) return "a list is wrong";
  }
  return {};
}

/// The contents of a store, of all that may be there.
inline StoreContents visible(Store& store, const StoreContents& may) {
  StoreContents seen;
  for (const auto& id : store.catalog().all_geometries()) {
    const auto expected = may.geometries.find(id);
    if (expected != may.geometries.end()) seen.geometries[id] = {expected->second.mesh, store.info(id)};
  }
  for (const auto& id : store.catalog().all_setups()) {
    if (const auto record = store.find_setup(id)) seen.setups[id] = *record;
  }
  return seen;
}

inline StoreContents joined(StoreContents a, const StoreContents& b) {
  a.geometries.insert(b.geometries.begin(), b.geometries.end());
  a.setups.insert(b.setups.begin(), b.setups.end());
  return a;
}

inline StoreContents common(const StoreContents& a, const StoreContents& b) {
  StoreContents both;
  for (const auto& [id, registered] : a.geometries) {
    if (b.geometries.count(id) > 0) both.geometries[id] = registered;
  }
  for (const auto& [id, record] : a.setups) {
    if (b.setups.count(id) > 0) both.setups[id] = record;
  }
  return both;
}

/// The contents after an action; the times of new ones are not known.
inline StoreContents contents_after(StoreContents contents, const Action& action) {
  const OwnedId id = id_of(action);
  switch (action.kind) {
    case Action::add:
      if (contents.geometries.count(id) == 0) {
        v1::GeometryInfo info;
        info.set_name(name_of(action));
        contents.geometries[id] = {mesh_of(action.mesh), info};
      }
      break;
    case Action::prepare:
      if (contents.geometries.count(id) > 0) contents.setups.try_emplace(owned(setup_of(action)), setup_of(action));
      break;
    case Action::release:
      contents.setups.erase(owned(setup_of(action)));
      break;
    case Action::remove:
      contents.geometries.erase(id);
      std::erase_if(contents.setups,
                    [&](const auto& entry) { return entry.first.tenant == id.tenant && entry.second.geometry_id == id.id; });
      break;
    default:
      break;
  }
  return contents;
}

class Simulation : public StoreTest {
 protected:
  static bool is_long() { return std::getenv("DEFORM_LONG") != nullptr; }

  /// Runs `run(seed)` for all seeds, or that of the environment.
  void for_seeds(unsigned count, const std::function<void(std::uint64_t)>& run) {
    if (const char* seed = std::getenv("DEFORM_SIMULATION_SEED")) return run(std::strtoull(seed, nullptr, 10));
    for (std::uint64_t seed = 1; seed <= count && !HasFailure(); ++seed) {
      SCOPED_TRACE("DEFORM_SIMULATION_SEED=" + std::to_string(seed));
      run(seed);
    }
  }

  static void SetUpTestSuite() { states = 0; }
  static void TearDownTestSuite() { std::cout << "[  states  ] " << states << '\n'; }
  static inline std::size_t states = 0;
};

}  // namespace deform::server
