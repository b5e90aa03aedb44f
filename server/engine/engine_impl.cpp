// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/engine_impl.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/control_group.h"
#include "core/base/version.h"
#include "proto/convert/base/block.h"
#include "proto/convert/base/fields.h"
#include "proto/convert/design.h"
#include "proto/convert/detection.h"
#include "proto/convert/info.h"
#include "proto/convert/report.h"
#include "proto/convert/setup.h"
#include "server/engine/compiled_records.h"
#include "server/engine/deform_job.h"
#include "server/engine/design_result.h"
#include "server/engine/evaluate_call.h"
#include "server/engine/geometry_upload.h"
#include "server/engine/outcome_call.h"
#include "server/engine/warm_starts.h"
#include "server/store/catalog_records.h"
#include "server/store/geometry_file.h"
#include "server/store/geometry_store.h"
#include "server/store/postgres_catalog.h"
#include "server/store/shared_store.h"

namespace deform::server {

namespace {

EngineOptions effective(EngineOptions options) {
  options.validate();
  options.memory_budget = memory_budget_of(options.memory_budget);
  if (options.cache_budget == 0) options.cache_budget = options.memory_budget / 2;
  if (options.workers == 0) options.workers = available_cores();
  return options;
}

Scheduler::Options scheduler_options(const EngineOptions& options) {
  Scheduler::Options result;
  result.workers = options.workers;
  result.preparation_workers = std::max(1, options.workers / 2);
  result.queue_limit = options.queue_limit;
  result.running_limit = std::max<std::size_t>(4, 2 * static_cast<std::size_t>(options.workers));
  return result;
}

StoreOptions store_options(const EngineOptions& options) {
  StoreOptions result;
  result.disk.keep_free = options.keep_free;
  result.most_bases = options.max_stored_bases;
  result.naming = Naming::below_the_folder;
  return result;
}

std::unique_ptr<Store> open_store(const EngineOptions& options) {
  if (options.catalog.empty()) return std::make_unique<GeometryStore>(options.data_dir, store_options(options));
  PostgresOptions postgres;
  postgres.uri = options.catalog;
  SharedStoreOptions shared;
  shared.store = store_options(options);
  return std::make_unique<SharedStore>(options.data_dir, open_postgres_catalog(postgres), shared);
}

/// What detecting on a mesh takes at most beside the mesh.
std::size_t detect_bytes(const Mesh& mesh) {
  return 600 * mesh.face_count() + 200 * mesh.point_count() + 64 * mesh.face_points.size();
}

/// About how long detecting takes: 0.6 s of processor time for a car of 40,000 faces, 2 s for one of 800,000; but 2.4 s for a
/// wing of 10,800, as the shape says how many primitives are tried.
double detect_seconds(const v1::GeometryInfo& info) { return 0.5 + 1.5e-6 * static_cast<double>(info.faces() + info.points()); }

/// A field that has been computed already, served as a deformation of one design.
class FieldEvaluation : public Evaluation {
 public:
  explicit FieldEvaluation(Points field) : field_(std::move(field)) {}
  std::size_t design_count() const override { return 1; }
  const DesignReport& report(std::size_t) const override { return report_; }
  void evaluate(std::size_t begin, std::size_t end, std::size_t, std::span<Vec3* const> out) const override {
    std::copy(field_.begin() + static_cast<std::ptrdiff_t>(begin), field_.begin() + static_cast<std::ptrdiff_t>(end), out[0]);
  }

 private:
  const Points field_;
  const DesignReport report_;
};

/// One value per variable of the setup.
std::vector<double> values(const google::protobuf::RepeatedField<double>& numbers, const Setup& setup, const char* field) {
  const std::size_t expected = setup.variables.size();
  if (static_cast<std::size_t>(numbers.size()) != expected) {
    convert::refuse_field(field, "expected " + std::to_string(expected) + " numbers, got " + std::to_string(numbers.size()));
  }
  return {numbers.begin(), numbers.end()};
}

constexpr std::size_t most_gradient_numbers = 100'000;  // of a reply: below 1 MiB

std::vector<double> values_or_zero(const google::protobuf::RepeatedField<double>& numbers, const Setup& setup) {
  return numbers.empty() ? std::vector<double>(setup.variables.size(), 0.0) : values(numbers, setup, "variables");
}

}  // namespace

std::unique_ptr<Engine> Engine::open(const EngineOptions& options) { return std::make_unique<EngineImpl>(options); }

EngineImpl::EngineImpl(const EngineOptions& options)
    : options_(effective(options)),
      memory_(options_.memory_budget),
      store_(open_store(options_)),
      bases_(*store_, memory_),
      meshes_(options_.memory_budget / 8, [this](const std::string& key) { return load_mesh(*owned_id(key)); }),
      scheduler_(scheduler_options(options_)),
      factory_({options_, memory_, *store_, bases_, meshes_, scheduler_}),
      cache_(std::make_shared<SystemCache>(
          options_.cache_budget,
          [this](const std::string& client, const void* owner, double seconds, std::function<void()> work) {
            scheduler_.prepare(client, owner, seconds, std::move(work));
          },
          [this](const void* owner) { scheduler_.remove(owner); })) {
  memory_.add_reclaimer([this](std::size_t bytes) { meshes_.reclaim(bytes); });
  memory_.add_reclaimer([this](std::size_t bytes) { cache_->reclaim(bytes); });
  store_->mirror({[this](Intent::What what, const OwnedId& id) {
                    what == Intent::What::setup ? static_cast<void>(cache_->release(key_of(id))) : meshes_.forget(key_of(id));
                  },
                  [this](Intent::What what) {
                    std::vector<OwnedId> ids;
                    for (const auto& key : what == Intent::What::setup ? cache_->ids() : meshes_.ids()) {
                      if (auto id = owned_id(key)) ids.push_back(*std::move(id));
                    }
                    return ids;
                  }});
}

EngineImpl::~EngineImpl() {
  store_->mirror({});
  drain(std::chrono::milliseconds(0));
  scheduler_.stop();
}

void EngineImpl::check_open() const {
  if (calls_.closed()) throw Error(ErrorCode::unavailable, "the server is shutting down").refused_for(Refusal::draining);
}

// ---- geometries ----

std::unique_ptr<GeometryUpload> EngineImpl::begin_upload(const v1::GeometryHeader& header, const CallContext& call) {
  check_open();
  const auto hexadecimal = [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); };
  if (!header.id().empty() && (header.id().size() != 64 || !std::all_of(header.id().begin(), header.id().end(), hexadecimal))) {
    throw Error(ErrorCode::invalid_argument, "header.id: expected 64 lower-case hexadecimal digits");
  }
  return make_upload(header, options_, {&memory_, store_.get(), &meshes_}, call);
}

std::shared_ptr<const Mesh> EngineImpl::load_mesh(const OwnedId& id) {
  const v1::GeometryInfo info = store_->info(id);
  const std::size_t bytes = sizeof(Mesh) + content_bytes(info) + static_cast<std::size_t>(info.groups_size()) * sizeof(Group);
  Charge charge = memory_.charge(bytes, {"loading geometry " + id.id.substr(0, 16), "raise the server's memory budget", 0});
  return MeshCache::share(store_->load(id), std::move(charge));
}

v1::GeometryInfo EngineImpl::get_geometry(const std::string& id, const CallContext& call) {
  return store_->info(store_->resolve_geometry(call.tenant, id));
}

v1::ListGeometriesReply EngineImpl::list_geometries(const v1::ListGeometriesRequest& request, const CallContext& call) {
  return store_->list(call.tenant, request);
}

v1::DeleteGeometryReply EngineImpl::delete_geometry(const v1::DeleteGeometryRequest& request, const CallContext& call) {
  const OwnedId id = store_->resolve_geometry(call.tenant, request.id());
  SystemCache::Forgotten forgotten;
  const auto setups = store_->remove(id, request.with_setups() ? WithSetups::remove : WithSetups::refuse, forget_in(forgotten));
  meshes_.forget(key_of(id));
  v1::DeleteGeometryReply reply;
  reply.set_setups_deleted(static_cast<std::uint32_t>(setups.size()));
  return reply;
}

std::shared_ptr<const Points> EngineImpl::get_points(const std::string& id, const CallContext& call) {
  const auto mesh = mesh_of(store_->resolve_geometry(call.tenant, id));
  return {mesh, &mesh->points};
}

// ---- systems ----

void EngineImpl::estimate(v1::EstimateRequest request, const CallContext& call,
                          std::function<void(Outcome<v1::EstimateReply>)> on_done) {
  check_open();
  using EstimateCall = OutcomeCall<v1::EstimateReply>;
  EstimateCall::Task task;
  task.seconds = factory_.selection(request.setup(), call.tenant).seconds();
  task.compute = [this, tenant = call.tenant, open = call.open,
                  shared = std::make_shared<const v1::EstimateRequest>(std::move(request))](const SystemCache::Handle&,
                                                                                            const RunContext& context) {
    v1::EstimateReply reply = factory_.estimate(*shared, tenant, open, context);
    reply.set_resident(cache_->contains(key_of({tenant, reply.system_id()})));
    return reply;
  };
  task.on_done = std::move(on_done);
  std::make_shared<EstimateCall>(EstimateCall::Parts{&scheduler_, cache_.get(), &calls_}, std::move(task), call)->begin();
}

void EngineImpl::prepare(const v1::PrepareRequest& request, const CallContext& call,
                         std::function<void(const v1::Progress&)> on_progress,
                         std::function<void(Outcome<v1::SystemInfo>)> on_done) {
  check_open();
  const SystemFactory::RecipePtr recipe = factory_.recipe(request.setup(), call.tenant, context_of(call));
  if (store_->catalog().setup_ids(call.tenant, recipe->id.id, 1).empty()) {  // before the work, not after it
    store_->require_room(0);
    store_->require_quota(call.tenant, {0, 1, recipe->canonical.ByteSizeLong()}, call.quota);
  }
  OutcomeCall<v1::SystemInfo>::Task task;
  task.system_id = recipe->id.id;
  task.source = factory_.of_setup(recipe, call.quota);
  task.brings_setup = true;
  if (on_progress) {
    task.on_progress = [on_progress](const std::string& stage, double fraction) {
      v1::Progress progress;
      progress.set_stage(stage);
      progress.set_fraction(fraction);
      on_progress(progress);
    };
    task.on_progress("queue", 0);
  }
  task.compute = [omit_setup = request.omit_setup()](const SystemCache::Handle& system, const RunContext&) {
    v1::SystemInfo info = system->told;
    if (omit_setup) info.clear_setup();
    info.set_resident(true);
    return info;
  };
  task.on_done = std::move(on_done);
  std::make_shared<OutcomeCall<v1::SystemInfo>>(OutcomeCall<v1::SystemInfo>::Parts{&scheduler_, cache_.get(), &calls_},
                                                std::move(task), call)
      ->begin();
}

v1::SystemInfo EngineImpl::stored_info(const SetupRecord& record) {
  v1::SystemInfo info;
  if (record.integrity == Integrity::damaged || !info.ParseFromString(record.info)) {
    // One damaged entry must not hide the others.
    info.Clear();
    info.set_geometry_id(record.geometry_id);
    info.add_notes("The stored entry of this system is damaged; prepare it again from its setup file.");
  }
  info.set_id(record.id);
  info.set_resident(cache_->contains(key_of(owned(record))));
  info.set_created_unix_ms(record.created_ms);
  info.set_setup_bytes(record.setup.size());  // not in entries of versions before 0.3
  leave_out_large_setup(info);
  return info;
}

SetupRecord EngineImpl::stored_setup(const std::string& id, const CallContext& call) {
  auto record = store_->find_setup(store_->resolve_setup(call.tenant, id));
  if (!record) throw Error(ErrorCode::not_found, "system " + id + ": unknown id");
  return *std::move(record);
}

v1::SystemInfo EngineImpl::get_system(const std::string& id, const CallContext& call) {
  return stored_info(stored_setup(id, call));
}

std::string EngineImpl::get_setup(const std::string& system_id, const CallContext& call) {
  SetupRecord record = stored_setup(system_id, call);
  if (record.integrity == Integrity::intact) return std::move(record.setup);
  throw Error(ErrorCode::data_loss, "catalog: the setup of system " + record.id + " is damaged");
}

v1::ListSystemsReply EngineImpl::list_systems(const v1::ListSystemsRequest& request, const CallContext& call) {
  const OwnedId geometry =
      request.geometry_id().empty() ? OwnedId{call.tenant, ""} : store_->resolve_geometry(call.tenant, request.geometry_id());
  v1::ListSystemsReply reply;
  PageRoom room;
  const auto fetch = [&](const auto& after, std::size_t limit) { return store_->catalog().list_setups(geometry, after, limit); };
  reply.set_next_page_token(list_page(request.page_token(), request.page_size(), fetch, [&](const SetupRecord& record) {
    v1::SystemInfo info = stored_info(record);
    if (request.omit_setup()) info.clear_setup();
    if (!room.takes(info.ByteSizeLong())) return false;
    *reply.add_systems() = std::move(info);
    return true;
  }));
  return reply;
}

v1::ReleaseSystemReply EngineImpl::release_system(const v1::ReleaseSystemRequest& request, const CallContext& call) {
  const OwnedId id = store_->resolve_setup(call.tenant, request.id());
  v1::ReleaseSystemReply reply;
  if (!request.forget()) {
    reply.set_bytes_released(cache_->release(key_of(id)));
    return reply;
  }
  SystemCache::Forgotten forgotten;
  if (!store_->remove_setup(id, forget_in(forgotten))) {
    throw Error(ErrorCode::not_found, "system " + request.id() + ": unknown id");  // another call was faster
  }
  reply.set_bytes_released(forgotten.bytes);
  return reply;
}

// ---- deformations and derivatives ----

/// Systems leave memory in the moment in which their setups leave the catalog, so that what is in memory is there.
RowsGone EngineImpl::forget_in(SystemCache::Forgotten& forgotten) {
  return [this, &forgotten](const Intent& removal) {
    std::vector<std::string> keys;
    for (const auto& entry : removal.entries) {
      if (entry.what == Intent::What::setup) keys.push_back(key_of({entry.tenant, entry.id}));
    }
    forgotten = cache_->forget(keys);
  };
}

// The catalog is asked only for what is not in memory.
OwnedId EngineImpl::resolve_system(const std::string& tenant, const std::string& id) {
  const OwnedId owned{tenant, id};
  return is_full_id(id) && cache_->contains(key_of(owned)) ? owned : store_->resolve_setup(tenant, id);
}

std::shared_ptr<DeformJob> EngineImpl::begin_job(DeformTask task, Needs needs, const CallContext& call,
                                                 std::function<void()> on_ready) {
  task.source = factory_.of_stored({call.tenant, task.system_id}, needs, call.quota);
  DeformParts parts;
  parts.scheduler = &scheduler_;
  parts.cache = cache_.get();
  parts.memory = &memory_;
  parts.calls = &calls_;
  parts.block_points = options_.block_points;
  parts.on_served = [this](std::size_t designs) { designs_served_ += designs; };
  const auto deform_call = std::make_shared<DeformCall>(parts, std::move(task), call, std::move(on_ready));
  deform_call->begin();
  return make_deform_job(deform_call);
}

std::shared_ptr<DeformJob> EngineImpl::deform(v1::DeformRequest request, std::uint64_t request_id, const CallContext& call,
                                              std::function<void()> on_ready) {
  check_open();
  const Failures failures = failures_from_proto(request);
  if (failures == Failures::fail_request) {
    convert::check_designs(request, options_.max_designs);
  } else {
    convert::check_design_count(request, options_.max_designs);
  }
  convert::encode_options(request.output(), 1.0);  // refuses at once what is plainly wrong
  const EvaluationPath path = convert::path_from_proto(request.path());
  const DesignChecks checks = DesignChecks::from_proto(request);
  DeformTask task;
  task.system_id = resolve_system(call.tenant, request.system_id()).id;
  task.request_id = request_id;
  task.designs = static_cast<std::size_t>(request.designs_size());
  task.output = request.output();
  task.failures = failures;
  const auto shared = std::make_shared<const v1::DeformRequest>(std::move(request));
  task.bind_bytes = [shared](const ResidentSystem& system) { return convert::bind_bytes(*shared, system.info); };
  task.bind = [shared, path, failures, id = task.system_id, starts = call.warm_starts](
                  const ResidentSystem& system, const RunContext& context) -> BoundDesigns {
    const WarmStart start = shared->warm_start() && starts ? starts->last(id) : WarmStart{};
    WarmStart warm;
    std::vector<std::vector<std::string>> doubts;  // of the designs that are bound last
    const auto bind = [&](std::span<const Design> designs) {
      warm = start;
      auto evaluation = shared->warm_start() ? system.system->bind_sequence(designs, path, warm, context)
                                             : system.system->bind(designs, path, context);
      doubts.clear();
      for (const Design& design : designs) doubts.push_back(design_doubts(system, design));
      return evaluation;
    };
    BoundDesigns bound = failures == Failures::per_design ? bind_each(convert_each(*shared, system), bind)
                                                          : BoundDesigns(bind(convert::designs_from_proto(*shared, system.info)));
    if (bound.evaluation) bound.doubts = std::move(doubts);
    if (shared->warm_start() && starts && bound.evaluation) starts->set(id, std::move(warm));
    return bound;
  };
  task.checker = [this, shared, checks, failures](const SystemCache::Handle& system, const RunContext& context) {
    const auto designs = [&] {
      return failures == Failures::per_design ? convert_each(*shared, *system).designs
                                              : convert::designs_from_proto(*shared, system->info);
    };
    return DesignChecker::make(system, checks, designs, memory_, context);
  };
  const Needs needs = convert::needs_solution(*shared) ? Needs::whole_system : Needs::basis;
  return begin_job(std::move(task), needs, call, std::move(on_ready));
}

std::shared_ptr<EvaluateJob> EngineImpl::evaluate(v1::EvaluateHeader header, const CallContext& call,
                                                  std::function<void()> on_ready) {
  check_open();
  auto request = std::make_shared<v1::DeformRequest>();
  *request->add_designs() = std::move(*header.mutable_design());
  request->set_path(v1::PATH_DIRECT);
  request->set_solver_tolerance(header.solver_tolerance());
  if (request->designs(0).continues()) throw Error(ErrorCode::invalid_argument, "design.continues: only in DeformStream");
  convert::check_designs(*request, 1);
  convert::encode_options(header.output(), 1.0);  // refuses at once what is plainly wrong
  EvaluateTask task;
  task.system_id = resolve_system(call.tenant, header.system_id()).id;
  task.output = header.output();
  task.source = factory_.of_stored({call.tenant, task.system_id}, Needs::whole_system, call.quota);
  task.bind_bytes = [request](const ResidentSystem& system) {
    return convert::bind_bytes(*request, system.info) + system.system->info().design_bytes;
  };
  task.bind = [request](const ResidentSystem& system, const RunContext& context) {
    return system.system->bind_in_space(convert::design_from_proto(*request, 0, system.info), context);
  };
  task.doubts = [request](const ResidentSystem& system) {
    return design_doubts(system, convert::design_from_proto(*request, 0, system.info));
  };
  const EvaluateParts parts{{&scheduler_, cache_.get(), &calls_}, &memory_, [this] { ++designs_served_; }};
  const auto evaluate_call = std::make_shared<EvaluateCall>(parts, std::move(task), call, std::move(on_ready));
  evaluate_call->begin();
  return make_evaluate_job(evaluate_call);
}

std::shared_ptr<DeformJob> EngineImpl::jacobian_vector(v1::JacobianVectorRequest request, const CallContext& call,
                                                       std::function<void()> on_ready) {
  check_open();
  convert::check_finite(request.variables(), "variables");
  convert::check_finite(request.direction(), "direction");
  DeformTask task;
  task.system_id = resolve_system(call.tenant, request.system_id()).id;
  task.output.set_encoding(v1::RAW_F64);
  task.values = DeformTask::Values::vectors;
  task.bind_bytes = [](const ResidentSystem& system) { return 2 * system.mesh->point_count() * sizeof(Vec3); };
  task.bind = [request = std::move(request)](const ResidentSystem& system, const RunContext& context) -> BoundDesigns {
    const auto variables = values_or_zero(request.variables(), system.setup);
    const auto direction = values(request.direction(), system.setup, "direction");
    return BoundDesigns(std::make_unique<const FieldEvaluation>(system.system->jacobian_vector(variables, direction, context)));
  };
  return begin_job(std::move(task), Needs::basis, call, std::move(on_ready));
}

void EngineImpl::vector_jacobian(const v1::VectorJacobianHeader& header, Points cotangents, const CallContext& call,
                                 std::function<void(Outcome<v1::VectorJacobianReply>)> on_done) {
  using Reply = v1::VectorJacobianReply;
  check_open();
  convert::check_finite(header.variables(), "variables");
  const std::size_t count = check_cotangent_count(header);
  for (std::size_t i = 0; i < cotangents.size(); ++i) {
    for (const double x : cotangents[i]) {
      if (std::isfinite(x)) continue;
      const std::size_t points = std::max<std::size_t>(1, cotangents.size() / count);
      convert::refuse_field(count == 1 ? "cotangent" : "cotangents[" + std::to_string(i / points) + "]",
                            "point " + std::to_string(i % points) + " must be finite");
    }
  }
  OutcomeCall<Reply>::Task task;
  task.system_id = resolve_system(call.tenant, header.system_id()).id;
  task.source = factory_.of_stored({call.tenant, task.system_id}, Needs::basis, call.quota);
  // As they came, one by one, at the following points, and as the columns of sums.
  const std::size_t bytes = (count == 1 ? 2 : 4) * cotangents.size() * sizeof(Vec3);
  const auto charge = std::make_shared<Charge>(memory_.charge_call(
      bytes, {"vector-Jacobian product", "send fewer cotangents, or raise the server's memory budget", 0}, call.share()));
  task.compute = [header, charge, count, given = std::make_shared<Points>(std::move(cotangents))](
                     const SystemCache::Handle& system, const RunContext& context) {
    const std::size_t points = system->mesh->point_count();
    if (given->size() != count * points) {
      convert::refuse_field("cotangent",
                            "expected " + std::to_string(count * points) + " points, got " + std::to_string(given->size()));
    }
    const std::size_t variables = system->setup.variables.size();
    if (count * variables > most_gradient_numbers) {
      convert::refuse_field("cotangents", std::to_string(count) + " times " + std::to_string(variables) +
                                              " variables are more than " + std::to_string(most_gradient_numbers) + " numbers");
    }
    std::vector<Points> fields;
    if (count == 1) {
      fields.push_back(std::move(*given));
    } else {
      for (std::size_t j = 0; j < count; ++j) {
        const auto from = given->begin() + static_cast<std::ptrdiff_t>(j * points);
        fields.emplace_back(from, from + static_cast<std::ptrdiff_t>(points));
      }
    }
    Reply reply;
    for (const auto& gradient :
         system->system->vector_jacobians(values_or_zero(header.variables(), system->setup), fields, context)) {
      for (const double g : gradient) reply.add_gradient(g);
    }
    return reply;
  };
  task.cost = [count](const ResidentSystem& system) { return static_cast<double>(count) * system.design_work(); };
  task.on_done = std::move(on_done);
  std::make_shared<OutcomeCall<Reply>>(OutcomeCall<Reply>::Parts{&scheduler_, cache_.get(), &calls_}, std::move(task), call)
      ->begin();
}

void EngineImpl::get_basis(const v1::GetBasisRequest& request, const CallContext& call,
                           std::function<void(Outcome<std::shared_ptr<BasisRecords>>)> on_done) {
  using BasisCall = OutcomeCall<std::shared_ptr<BasisRecords>>;
  check_open();
  constexpr std::size_t longest_name = 4096;
  if (request.mesh().size() > longest_name) {
    throw Error(ErrorCode::invalid_argument, "mesh: a name of " + std::to_string(request.mesh().size()) + " bytes, at most " +
                                                 std::to_string(longest_name) + " are allowed");
  }
  BasisCall::Task task;
  task.system_id = resolve_system(call.tenant, request.system_id()).id;
  task.source = factory_.of_stored({call.tenant, task.system_id}, Needs::basis, call.quota);
  task.compute = [this, tenant = call.tenant, share = call.share(), mesh = request.mesh()](
                     const SystemCache::Handle& system, const RunContext&) -> std::shared_ptr<BasisRecords> {
    Charge charge = memory_.charge_call(
        CompiledForm::bytes_for(*system->system) + CompiledRecords::working_bytes,
        {"compiling system " + system->info.id().substr(0, 16), "raise the server's memory budget", system->system->bytes()},
        share);
    const std::string name = mesh.empty() ? store_->info({tenant, system->info.geometry_id()}).name() : mesh;
    return std::make_shared<CompiledRecords>(system, name, std::move(charge));
  };
  task.cost = [](const ResidentSystem& system) { return system.design_work(); };
  task.on_done = std::move(on_done);
  std::make_shared<BasisCall>(BasisCall::Parts{&scheduler_, cache_.get(), &calls_}, std::move(task), call)->begin();
}

// ---- detection ----

void EngineImpl::detect(const v1::DetectRequest& request, const CallContext& call,
                        std::function<void(Outcome<DetectReplies>)> on_done) {
  check_open();
  const DetectOptions options = convert::detect_options(request);
  if (request.geometry_id().empty()) throw Error(ErrorCode::invalid_argument, "geometry_id: must not be empty");
  const OwnedId geometry = store_->resolve_geometry(call.tenant, request.geometry_id());
  OutcomeCall<DetectReplies>::Task task;
  task.seconds = detect_seconds(store_->info(geometry));
  task.compute = [this, options, geometry](const SystemCache::Handle&, const RunContext& context) -> DetectReplies {
    const auto from = RunContext::Clock::now();
    const auto mesh = mesh_of(geometry);
    const Charge charge = memory_.charge(detect_bytes(*mesh), {"detecting primitives of geometry " + geometry.id.substr(0, 16),
                                                               "raise the server's memory budget", mesh_bytes(*mesh)});
    std::vector<v1::DetectReply> replies = convert::detect_replies(deform::detect(*mesh, options, context));
    replies.back().mutable_summary()->set_seconds(elapsed_ms(from) * 1e-3);
    return std::make_shared<const std::vector<v1::DetectReply>>(std::move(replies));
  };
  task.on_done = std::move(on_done);
  using DetectCall = OutcomeCall<DetectReplies>;
  std::make_shared<DetectCall>(DetectCall::Parts{&scheduler_, cache_.get(), &calls_}, std::move(task), call)->begin();
}

// ---- the server ----

void EngineImpl::give_back_idle_memory(std::size_t bytes) {
  meshes_.reclaim(bytes);
  cache_->reclaim(bytes);
  return_freed_memory(freed_bytes_worth_returning);
}

v1::ServerInfo EngineImpl::info() {
  v1::ServerInfo info;
  info.set_version(version());
  info.set_uptime_ms(static_cast<std::uint64_t>(elapsed_ms(opened_)));
  info.set_draining(calls_.closed());
  const Scheduler::Load load = scheduler_.load();
  info.set_workers(static_cast<std::uint32_t>(options_.workers));
  info.set_queue_length(static_cast<std::uint32_t>(load.waiting + load.waiting_for_preparation));
  info.set_preparation_queue_length(static_cast<std::uint32_t>(load.waiting_for_preparation));
  info.set_queue_limit(static_cast<std::uint32_t>(scheduler_.queue_limit()));
  info.set_running(static_cast<std::uint32_t>(load.running + load.preparations));
  info.set_memory_budget(memory_.total());
  info.set_memory_in_use(memory_.in_use());
  const SystemCache::Stats cache = cache_->stats();
  info.set_cache_budget(cache_->budget());
  info.set_cache_bytes(cache.bytes);
  info.set_systems_resident(static_cast<std::uint32_t>(cache.systems));
  info.set_cache_hits(cache.hits);
  info.set_cache_misses(cache.misses);
  info.set_cache_evictions(cache.evictions);
  const Catalog::Counts counts = this->counts();
  info.set_geometries(counts.geometries);
  info.set_setups(counts.setups);
  info.set_designs_served(designs_served_);
  info.set_resident_set_bytes(resident_set_bytes());
  *info.mutable_store() = store();
  v1::Limits& limits = *info.mutable_limits();
  limits.set_max_points(options_.max_points);
  limits.set_max_faces(options_.max_faces);
  limits.set_max_groups(options_.max_groups);
  limits.set_max_designs(options_.max_designs);
  limits.set_max_handles(options_.max_handles);
  limits.set_max_setup_work(options_.max_setup_work);
  return info;
}

/// The figures of a server are there while its catalog cannot be reached, too.
Catalog::Counts EngineImpl::counts() {
  std::optional<Catalog::Counts> now;
  try {
    now = store_->catalog().counts();
  } catch (const Error& error) {
    if (error.code() != ErrorCode::unavailable) throw;
  }
  const std::lock_guard lock(counts_mutex_);
  if (now) counts_ = *now;
  return counts_;
}

v1::StoreInfo EngineImpl::store() { return store_->state(); }

Engine::Evicted EngineImpl::evict(const std::string& id_or_prefix, const std::optional<std::string>& tenant) {
  constexpr std::size_t shortest_prefix = 8;
  if (!id_or_prefix.empty() && id_or_prefix.size() < shortest_prefix) {
    throw Error(ErrorCode::invalid_argument, "system_id: \"" + id_or_prefix + "\" has fewer than 8 digits");
  }
  const auto evicted = cache_->release_if([&](const std::string& key) {
    const auto owned = owned_id(key);
    return owned && owned->id.starts_with(id_or_prefix) && (!tenant || owned->tenant == *tenant);
  });
  if (evicted.systems == 0 && !id_or_prefix.empty()) {
    throw Error(ErrorCode::not_found, "system " + id_or_prefix + ": not in memory");
  }
  if (id_or_prefix.empty() && !tenant) meshes_.reclaim(memory_.total());  // what no system needs any more
  return_freed_memory(freed_bytes_worth_returning);
  return {evicted.systems, evicted.in_use, evicted.bytes};
}

StoreReport EngineImpl::check_store(const RunContext& context) {
  return store_->check(context, [this](const GeometryRecord& record) {
    v1::GeometryInfo info;
    info.ParseFromString(record.info);
    return std::make_shared<Charge>(
        memory_.charge(content_bytes(info), {"checking geometry " + record.id.substr(0, 16), "try again later", 0}));
  });
}

StoreReport EngineImpl::backup_store(const std::filesystem::path& to) {
  if (!to.is_absolute()) throw Error(ErrorCode::invalid_argument, "directory: \"" + to.string() + "\" is not absolute");
  return store_->backup(to);
}

bool EngineImpl::drain(std::chrono::milliseconds limit) {
  calls_.close();
  const auto end = RunContext::Clock::now() + limit;
  const bool finished = calls_.wait_until_empty(end);
  bases_.wait_until_written(end);
  if (!finished) {
    calls_.fail_all(Error(ErrorCode::unavailable, "the server is shutting down").refused_for(Refusal::draining));
    calls_.wait_until_empty(RunContext::Clock::now() + std::chrono::hours(1));
  }
  return finished;
}

}  // namespace deform::server
