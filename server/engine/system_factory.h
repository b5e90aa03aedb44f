// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "core/base/problems.h"
#include "core/base/run_context.h"
#include "deform/v1/deformation.pb.h"
#include "server/engine/engine.h"
#include "server/engine/memory.h"
#include "server/engine/mesh_cache.h"
#include "server/engine/open_calls.h"
#include "server/engine/scheduler.h"
#include "server/engine/selection_work.h"
#include "server/engine/stored_bases.h"
#include "server/engine/system_cache.h"
#include "server/store/store.h"

namespace deform::server {

/// Makes systems: of a setup, which it stores, or of what is stored. What it makes and selects on the way is charged to the
/// memory before it is there, and what regions select besides to a quarter of it that all selections share.
///
///     of_setup()   recipe -> plan (select, estimate) -> make (claim, charge, prepare, store)
///     of_stored()  restored from its handle basis, or prepared again from its setup
///
/// Thread-safe. Functions throw Error. Holds its parts, which must outlive it and every source it gave.
class SystemFactory {
 public:
  struct Parts {
    const EngineOptions& options;
    MemoryBudget& memory;
    Store& store;
    StoredBases& bases;
    MeshCache& meshes;
    Scheduler& scheduler;
  };
  explicit SystemFactory(const Parts& parts);

  /// A setup about to be prepared or estimated.
  struct Recipe {
    OwnedId id;
    v1::Setup canonical;
    std::int64_t created_ms = 0;  ///< of one that is stored
    Charge charge;                ///< of `canonical` and the Setup that is made of it
    SelectionWork selection;      ///< of its regions
    OwnedId geometry() const { return {id.tenant, canonical.geometry()}; }
  };
  using RecipePtr = std::shared_ptr<const Recipe>;  // shared by all steps of a preparation

  /// Between its steps the context may stop it.
  RecipePtr recipe(const v1::Setup& setup, const std::string& tenant, const RunContext& context);
  /// What selecting the regions of a setup takes; nothing without a geometry. Throws Error(invalid_argument) beyond the limit.
  SelectionWork selection(const v1::Setup& setup, const std::string& tenant) const;
  /// The reply without `resident`. What the call holds is noted in `open`, unless that is null.
  v1::EstimateReply estimate(const v1::EstimateRequest& request, const std::string& tenant, const std::shared_ptr<OpenCall>& open,
                             const RunContext& context);

  SystemCache::Source of_setup(RecipePtr recipe, const Quota& quota);
  enum class Needs { whole_system, basis };
  SystemCache::Source of_stored(const OwnedId& id, Needs needs, const Quota& quota);

 private:
  enum class Storing { store, stored_already };
  struct SelectionCharge {
    Charge share, memory;
  };
  struct Planned;

  Problems problems_of(const v1::Setup& message, const std::string& tenant, const RunContext& context);
  /// The context, with which selecting is charged.
  RunContext charged(RunContext context, SelectionCharge& charge, const std::shared_ptr<OpenCall>& open = nullptr);
  std::shared_ptr<Planned> plan_system(const Recipe& recipe, const RunContext& context);
  std::shared_ptr<ResidentSystem> make_system(const Recipe& recipe, const Planned& planned, Storing storing, const Quota& quota,
                                              const RunContext& context);
  /// What takes long is planned first and then waits for its turn.
  SystemCache::Prepare preparation_of(RecipePtr recipe, Storing storing, const Quota& quota);
  SystemCache::Prepare prepare_again(const OwnedId& id, const Quota& quota);
  /// The system as the store has it; null where its setup or its basis is not stored.
  std::shared_ptr<ResidentSystem> restored_system(const OwnedId& id, const RunContext& context);
  SystemCache::Restore restore(const OwnedId& id);
  void require_stored(const OwnedId& id);
  std::shared_ptr<const Mesh> mesh_of(const OwnedId& geometry) { return parts_.meshes.get(key_of(geometry)); }

  const Parts parts_;
  MemoryBudget selections_;
};

/// Without its setup where an answer would be too large with it.
void leave_out_large_setup(v1::SystemInfo& info);

}  // namespace deform::server
