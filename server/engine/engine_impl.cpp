#include "server/engine/engine_impl.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <thread>
#include <utility>

#include "core/deformers/known_centres.h"
#include "proto/convert/info.h"
#include "proto/convert/setup.h"
#include "server/engine/geometry_upload.h"
#include "server/engine/outcome_call.h"
#include "server/store/geometry_file.h"

namespace deform::server {

namespace {

int cores() { return std::max(1, static_cast<int>(std::thread::hardware_concurrency())); }

EngineOptions effective(EngineOptions options) {
  options.validate();
  if (options.memory_budget == 0) options.memory_budget = available_memory() / 5 * 4;
  if (options.cache_budget == 0) options.cache_budget = options.memory_budget / 2;
  if (options.workers == 0) options.workers = cores();
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
  return result;
}

constexpr const char* less_memory =
    "use fewer handle and fixed points, smaller regions of constraints, reduce the centres (reduction), store no basis "
    "(BASIS_NEVER), or raise the server's memory budget";

/// About what the file of an upload will take, by what its header claims (which may be anything); groups come on top.
std::size_t stored_bytes(const v1::GeometryHeader& header) {
  const auto times = [](double bytes, std::uint64_t count) { return bytes * static_cast<double>(count); };
  const auto& cells = header.cells();
  const double bytes = times(24, header.point_count()) + times(4, header.face_count()) + times(4, header.corner_count()) +
                       times(1, cells.elements()) + times(4, cells.element_points()) + times(12, cells.faces()) +
                       times(4, cells.face_points()) + times(4, cells.internal_faces());
  return static_cast<std::size_t>(std::min(bytes, 1e18));
}

/// The engine's side of an upload.
class Upload : public GeometryUpload {
 public:
  Upload(const v1::GeometryHeader& header, const EngineOptions& limits, MemoryBudget& memory, GeometryStore& store,
         MeshCache& meshes, CallContext call)
      : declared_id_(header.id()),
        name_(header.name()),
        store_(store),
        meshes_(meshes),
        call_(std::move(call)),
        buffer_(header, limits, memory),
        stored_(!declared_id_.empty() && store.contains(declared_id_)) {
    if (!stored_) store.require_room(stored_bytes(header));
  }

  bool already_stored() const override { return stored_; }

  void add(const v1::RegisterGeometryRequest& part) override {
    check_call();
    if (!stored_) buffer_.add(part);  // what comes all the same is not needed
  }

  v1::GeometryInfo finish() override {
    check_call();
    if (stored_) {
      v1::GeometryInfo info = store_.info(declared_id_);
      info.set_existed(true);
      return info;
    }
    Mesh mesh = buffer_.take();
    const std::string id = mesh_id(mesh);
    if (!declared_id_.empty() && id != declared_id_) {
      throw Error(ErrorCode::invalid_argument, "header.id: " + declared_id_ + " was announced, the arrays have id " + id);
    }
    check_call();
    v1::GeometryInfo info = store_.put(mesh, id, name_);
    meshes_.put(id, MeshCache::share(std::move(mesh), buffer_.take_charge()));
    return info;
  }

 private:
  void check_call() const {
    RunContext context;
    context.cancel = call_.cancel;
    context.deadline = call_.deadline;
    context.check();
  }

  const std::string declared_id_, name_;
  GeometryStore& store_;
  MeshCache& meshes_;
  const CallContext call_;
  UploadBuffer buffer_;
  const bool stored_;
};

}  // namespace

std::unique_ptr<Engine> Engine::open(const EngineOptions& options) { return std::make_unique<EngineImpl>(options); }

EngineImpl::EngineImpl(const EngineOptions& options)
    : options_(effective(options)),
      memory_(options_.memory_budget),
      store_(options_.data_dir, store_options(options_)),
      meshes_(options_.memory_budget / 8, [this](const std::string& id) { return load_mesh(id); }),
      scheduler_(scheduler_options(options_)),
      cache_(std::make_shared<SystemCache>(
          options_.cache_budget,
          [this](const void* owner, std::function<void()> work) { scheduler_.prepare(owner, std::move(work)); },
          [this](const void* owner) { scheduler_.remove(owner); })) {
  memory_.add_reclaimer([this](std::size_t bytes) { meshes_.reclaim(bytes); });
  memory_.add_reclaimer([this](std::size_t bytes) { cache_->reclaim(bytes); });
}

EngineImpl::~EngineImpl() {
  drain(std::chrono::milliseconds(0));
  scheduler_.stop();
}

void EngineImpl::check_open() const {
  if (calls_.closed()) throw Error(ErrorCode::unavailable, "the server is shutting down");
}

std::unique_ptr<GeometryUpload> EngineImpl::begin_upload(const v1::GeometryHeader& header, const CallContext& call) {
  check_open();
  const auto hexadecimal = [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); };
  if (!header.id().empty() && (header.id().size() != 64 || !std::all_of(header.id().begin(), header.id().end(), hexadecimal))) {
    throw Error(ErrorCode::invalid_argument, "header.id: expected 64 lower-case hexadecimal digits");
  }
  return std::make_unique<Upload>(header, options_, memory_, store_, meshes_, call);
}

std::shared_ptr<const Mesh> EngineImpl::load_mesh(const std::string& id) {
  const v1::GeometryInfo info = store_.info(id);
  std::size_t bytes = sizeof(Mesh) + 24 * info.points() + 4 * (info.faces() + info.corners()) + info.cell_bytes();
  for (const auto& group : info.groups()) {
    bytes += sizeof(Group) + group.name().size() + 4 * (group.points() + group.faces());
  }
  Charge charge = memory_.charge(bytes, {"loading geometry " + id.substr(0, 16), "raise the server's memory budget", 0});
  return MeshCache::share(store_.load(id), std::move(charge));
}

v1::GeometryInfo EngineImpl::get_geometry(const std::string& id) { return store_.info(store_.resolve_geometry(id)); }

v1::ListGeometriesReply EngineImpl::list_geometries(const v1::ListGeometriesRequest& request) { return store_.list(request); }

v1::DeleteGeometryReply EngineImpl::delete_geometry(const v1::DeleteGeometryRequest& request) {
  const std::string id = store_.resolve_geometry(request.id());
  const auto setups = store_.remove(id, request.with_setups() ? WithSetups::remove : WithSetups::refuse);
  meshes_.forget(id);
  for (const auto& setup : setups) cache_->release(setup);
  v1::DeleteGeometryReply reply;
  reply.set_setups_deleted(static_cast<std::uint32_t>(setups.size()));
  return reply;
}

std::shared_ptr<const Points> EngineImpl::get_points(const std::string& id) {
  const auto mesh = meshes_.get(store_.resolve_geometry(id));
  return {mesh, &mesh->points};
}

EngineImpl::Recipe EngineImpl::recipe(const v1::Setup& setup) {
  if (setup.geometry().empty()) throw Error(ErrorCode::invalid_argument, "geometry: must not be empty");
  convert::setup_from_proto(setup, options_.max_handles);  // refuses what has no canonical form
  Recipe recipe;
  const std::string geometry = store_.resolve_geometry(setup.geometry());
  v1::Setup chosen = setup;
  const bool rbf = setup.method().has_rbf() || setup.method().kind_case() == v1::Method::KIND_NOT_SET;
  if (rbf && setup.method().rbf().kernel() == v1::KERNEL_DEFAULT) {
    const v1::GeometryInfo info = store_.info(geometry);
    const bool flat = info.box_min_size() == 3 && info.box_min(2) == info.box_max(2);
    chosen.mutable_method()->mutable_rbf()->set_kernel(flat ? v1::THIN_PLATE : v1::TRIHARMONIC);
  }
  recipe.canonical = convert::canonical_setup(chosen, geometry);
  recipe.id = convert::system_id(recipe.canonical);
  return recipe;
}

v1::EstimateReply EngineImpl::estimate(const v1::EstimateRequest& request) {
  const Recipe recipe = this->recipe(request.setup());
  const auto mesh = meshes_.get(recipe.canonical.geometry());
  const Setup setup = convert::setup_from_proto(recipe.canonical, options_.max_handles);
  const SelectedRegions regions = validate(setup, *mesh);
  v1::EstimateReply reply = convert::estimate_reply(deform::estimate(*mesh, setup));
  if (request.list_centres()) convert::list_centres(known_centres(*mesh, setup), reply);
  reply.set_budget_bytes(memory_.total());
  reply.set_fits(reply.peak_bytes() + mesh_bytes(*mesh) <= memory_.total());
  convert::add_handles(*reply.mutable_handles(), setup, regions);
  convert::add_setup_notes(*reply.mutable_notes(), setup);
  reply.set_fixed_points(regions.fixed.size());
  reply.set_system_id(recipe.id);
  reply.set_resident(cache_->contains(recipe.id));
  return reply;
}

std::shared_ptr<ResidentSystem> EngineImpl::make_system(const Recipe& recipe, Storing storing, const RunContext& context) {
  auto resident = std::make_shared<ResidentSystem>();
  resident->mesh = meshes_.get(recipe.canonical.geometry());
  resident->setup = convert::setup_from_proto(recipe.canonical, options_.max_handles);
  context.progress("select", 0);
  const SelectedRegions regions = validate(resident->setup, *resident->mesh);
  const Estimate estimate = deform::estimate(*resident->mesh, resident->setup);
  context.check();
  resident->charge = memory_.charge(estimate.peak_bytes,
                                    {"preparing system " + recipe.id.substr(0, 16), less_memory, mesh_bytes(*resident->mesh)});
  RunContext budgeted = context;
  budgeted.threads = std::max(1, cores() / static_cast<int>(std::max<std::size_t>(1, scheduler_.load().preparations)));
  resident->system = deform::prepare(resident->mesh, resident->setup, budgeted);
  resident->charge.shrink(resident->system->bytes());
  resident->info = convert::system_info(resident->system->info(), recipe.canonical, recipe.id);
  convert::add_handles(*resident->info.mutable_handles(), resident->setup, regions);
  convert::add_setup_notes(*resident->info.mutable_notes(), resident->setup);
  if (storing == Storing::store) {
    resident->info.set_created_unix_ms(
        store_.put_setup({recipe.id, recipe.canonical.geometry(), recipe.canonical.SerializeAsString(),
                          resident->info.SerializeAsString(), unix_ms()}));
  } else if (const auto record = store_.find_setup(recipe.id)) {
    resident->info.set_created_unix_ms(record->created_ms);
  }
  return resident;
}

void EngineImpl::prepare(const v1::PrepareRequest& request, const CallContext& call,
                         std::function<void(const v1::Progress&)> on_progress,
                         std::function<void(Outcome<v1::SystemInfo>)> on_done) {
  check_open();
  const Recipe recipe = this->recipe(request.setup());
  if (store_.catalog().setup_ids(recipe.id, 1).empty()) store_.require_room(0);  // before the work, not after it
  OutcomeCall<v1::SystemInfo>::Task task;
  task.system_id = recipe.id;
  task.prepare = [this, recipe](const RunContext& context) { return make_system(recipe, Storing::store, context); };
  if (on_progress) {
    task.on_progress = [on_progress](const std::string& stage, double fraction) {
      v1::Progress progress;
      progress.set_stage(stage);
      progress.set_fraction(fraction);
      on_progress(progress);
    };
    task.on_progress("queue", 0);
  }
  task.compute = [](const SystemCache::Handle& system, const RunContext&) {
    v1::SystemInfo info = system->info;
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
  info.set_resident(cache_->contains(record.id));
  info.set_created_unix_ms(record.created_ms);
  return info;
}

v1::SystemInfo EngineImpl::get_system(const std::string& id) {
  const auto record = store_.find_setup(store_.resolve_setup(id));
  if (!record) throw Error(ErrorCode::not_found, "system " + id + ": unknown id");
  return stored_info(*record);
}

v1::ListSystemsReply EngineImpl::list_systems(const v1::ListSystemsRequest& request) {
  const std::string geometry = request.geometry_id().empty() ? "" : store_.resolve_geometry(request.geometry_id());
  const std::size_t limit = page_size(request.page_size());
  const auto records = store_.catalog().list_setups(geometry, parse_page_token(request.page_token()), limit);
  v1::ListSystemsReply reply;
  for (const auto& record : records) *reply.add_systems() = stored_info(record);
  if (records.size() == limit) reply.set_next_page_token(page_token(records.back().created_ms, records.back().id));
  return reply;
}

v1::ReleaseSystemReply EngineImpl::release_system(const v1::ReleaseSystemRequest& request) {
  const std::string id = store_.resolve_setup(request.id());
  if (request.forget()) store_.remove_setup(id);
  v1::ReleaseSystemReply reply;
  reply.set_bytes_released(cache_->release(id));
  return reply;
}

v1::ServerInfo EngineImpl::info() {
  v1::ServerInfo info;
  info.set_version(DEFORM_VERSION);
  info.set_uptime_ms(static_cast<std::uint64_t>(elapsed_ms(opened_)));
  info.set_draining(calls_.closed());
  const Scheduler::Load load = scheduler_.load();
  info.set_workers(static_cast<std::uint32_t>(options_.workers));
  info.set_queue_length(static_cast<std::uint32_t>(load.waiting));
  info.set_queue_limit(static_cast<std::uint32_t>(options_.queue_limit));
  info.set_running(static_cast<std::uint32_t>(load.running + load.preparations));
  info.set_memory_budget(memory_.total());
  info.set_memory_in_use(memory_.in_use());
  const SystemCache::Stats cache = cache_->stats();
  info.set_cache_budget(options_.cache_budget);
  info.set_cache_bytes(cache.bytes);
  info.set_systems_resident(static_cast<std::uint32_t>(cache.systems));
  info.set_cache_hits(cache.hits);
  info.set_cache_misses(cache.misses);
  info.set_cache_evictions(cache.evictions);
  const Catalog::Counts counts = store_.catalog().counts();
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
  return info;
}

v1::StoreInfo EngineImpl::store() { return store_.state(); }

bool EngineImpl::drain(std::chrono::milliseconds limit) {
  calls_.close();
  const bool finished = calls_.wait_until_empty(RunContext::Clock::now() + limit);
  if (!finished) {
    calls_.fail_all(Error(ErrorCode::unavailable, "the server is shutting down"));
    calls_.wait_until_empty(RunContext::Clock::now() + std::chrono::hours(1));
  }
  return finished;
}

}  // namespace deform::server
