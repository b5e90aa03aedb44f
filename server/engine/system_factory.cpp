// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/system_factory.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

#include "core/base/control_group.h"
#include "core/base/number_text.h"
#include "core/deformers/methods.h"
#include "proto/convert/base/fields.h"
#include "proto/convert/info.h"
#include "proto/convert/setup.h"
#include "server/store/catalog_records.h"
#include "server/store/geometry_file.h"

namespace deform::server {

namespace {

constexpr const char* less_memory =
    "use fewer handle and fixed points, smaller regions of constraints, reduce the centres (reduction), store no basis "
    "(BASIS_NEVER), or raise the server's memory budget";

/// The limit of a description of a system with its setup; the reply around it stays below 1 MiB.
constexpr std::size_t largest_info = 1'000'000;

/// What a setup takes in memory; of small ones nothing is counted, as of everything else that each call has.
std::size_t setup_bytes(const v1::Setup& setup) {
  constexpr std::size_t small = 64 << 10;
  const std::size_t bytes = setup.SpaceUsedLong();
  return bytes > small ? bytes : 0;
}

const ChargePurpose setup_purpose{"reading the setup", "select fewer points by their ids, or raise the server's memory budget",
                                  0};

/// In the log, at the level debug: so that those of several servers show who prepared what when.
class NotedPreparation {
 public:
  explicit NotedPreparation(std::string system) : system_(std::move(system)) {
    spdlog::debug("engine: begins to prepare system {}", system_);
  }
  ~NotedPreparation() { spdlog::debug("engine: ends preparing system {}", system_); }
  NotedPreparation(const NotedPreparation&) = delete;
  NotedPreparation& operator=(const NotedPreparation&) = delete;

 private:
  const std::string system_;
};

}  // namespace

void leave_out_large_setup(v1::SystemInfo& info) {
  if (info.ByteSizeLong() > largest_info) info.clear_setup();
}

SystemFactory::SystemFactory(const Parts& parts) : parts_(parts), selections_(parts.options.memory_budget / 4) {}

SelectionWork SystemFactory::selection(const v1::Setup& setup, const std::string& tenant) const {
  if (setup.geometry().empty()) return {};  // which is refused
  const OwnedId geometry = parts_.store.resolve_geometry(tenant, setup.geometry());
  const SelectionWork work = selection_work(setup, parts_.store.info(geometry).points());
  work.check(parts_.options.max_setup_work);
  return work;
}

SystemFactory::RecipePtr SystemFactory::recipe(const v1::Setup& setup, const std::string& tenant, const RunContext& context) {
  if (setup.geometry().empty()) throw Error(ErrorCode::invalid_argument, "geometry: must not be empty");
  auto recipe = std::make_shared<Recipe>();
  // At once: with its kernel, canonical, its bytes, and as a Setup.
  recipe->charge = parts_.memory.charge(4 * setup_bytes(setup), setup_purpose);
  context.check();
  convert::setup_from_proto(setup, parts_.options.max_handles);  // refuses what has no canonical form
  context.check();
  recipe->selection = selection(setup, tenant);
  const OwnedId geometry = parts_.store.resolve_geometry(tenant, setup.geometry());
  recipe->canonical = convert::canonical_setup(convert::with_kernel(setup, parts_.store.info(geometry)), geometry.id);
  context.check();
  recipe->id = {tenant, convert::system_id(recipe->canonical)};
  context.check();
  recipe->charge.shrink(2 * setup_bytes(recipe->canonical));
  return recipe;
}

Problems SystemFactory::problems_of(const v1::Setup& message, const std::string& tenant, const RunContext& context) {
  Problems problems(Problems::Mode::collect);
  const Setup setup = convert::setup_from_proto(message, parts_.options.max_handles, problems);
  problems.check("geometry", [&] {
    if (message.geometry().empty()) throw Error(ErrorCode::invalid_argument, "geometry: must not be empty");
  });
  if (message.geometry().empty()) return problems;
  find_problems(*mesh_of(parts_.store.resolve_geometry(tenant, message.geometry())), setup, problems, context);
  return problems;
}

RunContext SystemFactory::charged(RunContext context, SelectionCharge& charge, const std::shared_ptr<OpenCall>& open) {
  context.on_claim = [this, &charge, open](std::size_t bytes) {
    const char* advice = "use fewer or smaller regions of constraints, or raise the server's memory budget";
    if (charge.share.bytes() + bytes > selections_.total()) {
      throw Error(ErrorCode::out_of_budget, "what the regions of the setup select takes more than " +
                                                mebibytes(selections_.total()) + ", a quarter of the memory budget; " + advice)
          .refused_for(Refusal::memory);
    }
    const ChargePurpose purpose{"selecting the points of the setup", advice, 0};
    selections_.grow(charge.share, bytes, purpose);
    parts_.memory.grow(charge.memory, bytes, purpose);
    if (open) open->set_result_bytes(charge.memory.bytes());
  };
  return context;
}

v1::EstimateReply SystemFactory::estimate(const v1::EstimateRequest& request, const std::string& tenant,
                                          const std::shared_ptr<OpenCall>& open, const RunContext& context) {
  if (request.list_problems()) {
    SelectionCharge charge;
    const Problems problems = problems_of(request.setup(), tenant, charged(context, charge, open));
    if (!problems.empty()) return convert::problems_reply(problems);
  }
  const RecipePtr recipe = this->recipe(request.setup(), tenant, context);
  const auto mesh = mesh_of(recipe->geometry());
  const Setup setup = convert::setup_from_proto(recipe->canonical, parts_.options.max_handles);
  SelectionCharge charge;
  const SelectedRegions regions = validate(setup, *mesh, charged(context, charge, open));
  v1::EstimateReply reply = convert::estimate_reply(deform::estimate(*mesh, setup, regions, context));
  if (request.list_centres()) convert::list_centres(known_centres(*mesh, setup, regions, context), reply);
  reply.set_budget_bytes(parts_.memory.total());
  reply.set_fits(reply.peak_bytes() + mesh_bytes(*mesh) <= parts_.memory.total());
  convert::add_handles(*reply.mutable_handles(), setup, regions);
  convert::add_setup_notes(*reply.mutable_notes(), setup, *mesh, regions, context);
  convert::add_setup_hints(*reply.mutable_notes(), setup, *mesh, regions, context);
  reply.set_fixed_points(regions.fixed.size());
  reply.set_system_id(recipe->id.id);
  return reply;
}

/// What is known of a system before it is prepared.
struct SystemFactory::Planned {
  std::shared_ptr<ResidentSystem> resident = std::make_shared<ResidentSystem>();
  SelectionCharge charge;
  SelectedRegions regions;
  Estimate estimate;
};

std::shared_ptr<SystemFactory::Planned> SystemFactory::plan_system(const Recipe& recipe, const RunContext& context) {
  auto planned = std::make_shared<Planned>();
  ResidentSystem& resident = *planned->resident;
  resident.mesh = mesh_of(recipe.geometry());
  resident.setup = convert::setup_from_proto(recipe.canonical, parts_.options.max_handles);
  context.progress("select", 0);
  planned->regions = validate(resident.setup, *resident.mesh, charged(context, planned->charge));
  resident.sides = symmetry_sides(resident.setup, *resident.mesh);
  planned->estimate = deform::estimate(*resident.mesh, resident.setup, planned->regions, context);
  context.check();
  return planned;
}

SystemCache::Prepare SystemFactory::preparation_of(RecipePtr recipe, Storing storing, const Quota& quota) {
  return [this, recipe, storing, quota](const RunContext& context) -> SystemCache::Prepared {
    if (const double selecting = recipe->selection.seconds(); selecting > Scheduler::short_seconds) {
      return SystemCache::Long{selecting, [this, recipe, storing, quota](const RunContext& later) {
                                 return make_system(*recipe, *plan_system(*recipe, later), storing, quota, later);
                               }};
    }
    const auto planned = plan_system(*recipe, context);
    if (planned->estimate.seconds <= Scheduler::short_seconds) return make_system(*recipe, *planned, storing, quota, context);
    // What waits for its turn holds no memory but its setup, and selects its points again.
    return SystemCache::Long{planned->estimate.seconds, [this, recipe, storing, quota](const RunContext& later) {
                               return make_system(*recipe, *plan_system(*recipe, later), storing, quota, later);
                             }};
  };
}

std::shared_ptr<ResidentSystem> SystemFactory::make_system(const Recipe& recipe, const Planned& planned, Storing storing,
                                                           const Quota& quota, const RunContext& context) {
  const auto& resident = planned.resident;
  const Estimate& estimate = planned.estimate;
  const auto claim = parts_.store.claim_preparation(recipe.id, context);
  const NotedPreparation noted(key_of(recipe.id));
  // Its setup stays with the system, as a message and as a Setup.
  resident->setup_bytes = 2 * setup_bytes(recipe.canonical);
  resident->charge =
      parts_.memory.charge(estimate.peak_bytes + resident->setup_bytes,
                           {"preparing system " + recipe.id.id.substr(0, 16), less_memory, mesh_bytes(*resident->mesh)});
  RunContext budgeted = context;
  budgeted.threads =
      std::max(1, available_cores() / static_cast<int>(std::max<std::size_t>(1, parts_.scheduler.load().preparations)));
  resident->system = deform::prepare(resident->mesh, resident->setup, budgeted);
  resident->charge.shrink(resident->bytes());
  resident->memory_return.bytes = resident->charge.bytes();
  return_freed_memory(estimate.peak_bytes - std::min(estimate.peak_bytes, resident->system->bytes()));
  resident->info = convert::system_info(resident->system->info(), recipe.canonical, recipe.id.id);
  resident->info.set_design_seconds(estimate.design_seconds);
  convert::add_handles(*resident->info.mutable_handles(), resident->setup, planned.regions);
  convert::add_setup_notes(*resident->info.mutable_notes(), resident->setup, *resident->mesh, planned.regions, context);
  resident->told = resident->info;
  leave_out_large_setup(resident->told);
  std::int64_t created_ms = recipe.created_ms;
  if (storing == Storing::store) {
    created_ms = parts_.store.put_setup({recipe.id.id, recipe.canonical.geometry(), recipe.canonical.SerializeAsString(),
                                         resident->told.SerializeAsString(), unix_ms(), Integrity::intact, recipe.id.tenant},
                                        quota);
  } else {
    require_stored(recipe.id);
  }
  resident->info.set_created_unix_ms(created_ms);
  resident->told.set_created_unix_ms(created_ms);
  double seconds = 0;
  for (const auto& stage : resident->system->info().stage_seconds) seconds += stage.second;
  if (seconds >= std::chrono::duration<double>(parts_.options.stored_from).count()) parts_.bases.keep(recipe.id, resident, quota);
  return resident;
}

/// What was deleted while it was prepared is not served.
void SystemFactory::require_stored(const OwnedId& id) {
  try {
    if (!parts_.store.catalog().setup_ids(id.tenant, id.id, 1).empty()) return;
  } catch (const Error& error) {
    if (error.code() != ErrorCode::unavailable) throw;
    return;  // known when the preparation began, and compared with the catalog again later
  }
  throw Error(ErrorCode::not_found, "system " + id.id + ": unknown id");
}

SystemCache::Prepare SystemFactory::prepare_again(const OwnedId& id, const Quota& quota) {
  return [this, id, quota](const RunContext& context) -> SystemCache::Prepared {
    const auto record = parts_.store.find_setup(id);
    if (!record) throw Error(ErrorCode::not_found, "system " + id.id + ": unknown id");
    auto recipe = std::make_shared<Recipe>();
    recipe->id = id;
    recipe->created_ms = record->created_ms;
    if (!recipe->canonical.ParseFromString(record->setup)) {
      throw Error(ErrorCode::data_loss, "catalog: the setup of system " + id.id + " is damaged");
    }
    recipe->charge = parts_.memory.charge(2 * setup_bytes(recipe->canonical), setup_purpose);
    recipe->selection = selection_work(recipe->canonical, parts_.store.info(recipe->geometry()).points());
    return preparation_of(recipe, Storing::stored_already, quota)(context);
  };
}

std::shared_ptr<ResidentSystem> SystemFactory::restored_system(const OwnedId& id, const RunContext& context) {
  if (!parts_.bases.contains(id)) return nullptr;
  const auto record = parts_.store.find_setup(id);
  if (!record) return nullptr;
  v1::Setup canonical;
  auto resident = std::make_shared<ResidentSystem>();
  if (!canonical.ParseFromString(record->setup) || !resident->told.ParseFromString(record->info)) return nullptr;
  const Charge charge = parts_.memory.charge(2 * setup_bytes(canonical), setup_purpose);  // of `canonical` and what is made of it
  resident->setup = convert::setup_from_proto(canonical, parts_.options.max_handles);
  if (static_cast<std::size_t>(resident->told.handles_size()) != resident->setup.handles.size()) return nullptr;
  resident->setup_bytes = 2 * setup_bytes(canonical);
  resident->told.set_id(id.id);
  resident->told.set_created_unix_ms(record->created_ms);
  resident->info = resident->told;
  *resident->info.mutable_setup() = std::move(canonical);
  resident->mesh = mesh_of({id.tenant, record->geometry_id});
  resident->sides = symmetry_sides(resident->setup, *resident->mesh);
  resident = parts_.bases.restore(id, std::move(resident), context);
  if (resident) require_stored(id);
  return resident;
}

SystemCache::Restore SystemFactory::restore(const OwnedId& id) {
  return [this, id](const RunContext& context) -> std::shared_ptr<ResidentSystem> {
    try {
      return restored_system(id, context);
    } catch (const Error& error) {
      // What is damaged, gone or not allowed any more is for the preparation to say, or to heal.
      const ErrorCode code = error.code();
      if (code == ErrorCode::data_loss || code == ErrorCode::not_found || code == ErrorCode::invalid_argument) return nullptr;
      throw;
    }
  };
}

SystemCache::Source SystemFactory::of_setup(RecipePtr recipe, const Quota& quota) {
  const OwnedId id = recipe->id;
  return {preparation_of(std::move(recipe), Storing::store, quota), restore(id)};
}

SystemCache::Source SystemFactory::of_stored(const OwnedId& id, Needs needs, const Quota& quota) {
  return {prepare_again(id, quota), needs == Needs::basis ? restore(id) : SystemCache::Restore()};
}

}  // namespace deform::server
