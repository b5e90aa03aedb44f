// Deformations and derivatives: what turns a request into a task of a call.
#include <cmath>
#include <utility>

#include "proto/convert/base/block.h"
#include "proto/convert/base/fields.h"
#include "proto/convert/design.h"
#include "proto/convert/report.h"
#include "server/engine/deform_job.h"
#include "server/engine/engine_impl.h"
#include "server/engine/outcome_call.h"
#include "server/engine/warm_starts.h"

namespace deform::server {

namespace {

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

std::vector<double> values_or_zero(const google::protobuf::RepeatedField<double>& numbers, const Setup& setup) {
  return numbers.empty() ? std::vector<double>(setup.variables.size(), 0.0) : values(numbers, setup, "variables");
}

}  // namespace

// The catalog is asked only for what is not in memory.
std::string EngineImpl::resolve_system(const std::string& id) { return cache_->contains(id) ? id : store_.resolve_setup(id); }

SystemCache::Prepare EngineImpl::prepare_again(const std::string& id) {
  return [this, id](const RunContext& context) {
    const auto record = store_.find_setup(id);
    if (!record) throw Error(ErrorCode::not_found, "system " + id + ": unknown id");
    Recipe recipe;
    recipe.id = id;
    if (!recipe.canonical.ParseFromString(record->setup)) {
      throw Error(ErrorCode::data_loss, "catalog: the setup of system " + id + " is damaged");
    }
    return make_system(recipe, Storing::stored_already, context);
  };
}

std::shared_ptr<DeformJob> EngineImpl::begin_job(DeformTask task, const CallContext& call, std::function<void()> on_ready) {
  task.prepare = prepare_again(task.system_id);
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
  task.system_id = resolve_system(request.system_id());
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
    const auto bind = [&](std::span<const Design> designs) {
      if (!shared->warm_start()) return system.system->bind(designs, path, context);
      warm = start;
      return system.system->bind_sequence(designs, path, warm, context);
    };
    BoundDesigns bound = failures == Failures::per_design ? bind_each(convert_each(*shared, system), bind)
                                                          : BoundDesigns(bind(convert::designs_from_proto(*shared, system.info)));
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
  return begin_job(std::move(task), call, std::move(on_ready));
}

std::shared_ptr<DeformJob> EngineImpl::jacobian_vector(v1::JacobianVectorRequest request, const CallContext& call,
                                                       std::function<void()> on_ready) {
  check_open();
  convert::check_finite(request.variables(), "variables");
  convert::check_finite(request.direction(), "direction");
  DeformTask task;
  task.system_id = resolve_system(request.system_id());
  task.output.set_encoding(v1::RAW_F64);
  task.values = DeformTask::Values::vectors;
  task.bind_bytes = [](const ResidentSystem& system) { return 2 * system.mesh->point_count() * sizeof(Vec3); };
  task.bind = [request = std::move(request)](const ResidentSystem& system, const RunContext& context) -> BoundDesigns {
    const auto variables = values_or_zero(request.variables(), system.setup);
    const auto direction = values(request.direction(), system.setup, "direction");
    return BoundDesigns(std::make_unique<const FieldEvaluation>(system.system->jacobian_vector(variables, direction, context)));
  };
  return begin_job(std::move(task), call, std::move(on_ready));
}

void EngineImpl::vector_jacobian(const v1::VectorJacobianHeader& header, Points cotangent, const CallContext& call,
                                 std::function<void(Outcome<v1::VectorJacobianReply>)> on_done) {
  using Reply = v1::VectorJacobianReply;
  check_open();
  convert::check_finite(header.variables(), "variables");
  for (std::size_t i = 0; i < cotangent.size(); ++i) {
    for (const double x : cotangent[i]) {
      if (!std::isfinite(x)) convert::refuse_field("cotangent", "point " + std::to_string(i) + " must be finite");
    }
  }
  OutcomeCall<Reply>::Task task;
  task.system_id = resolve_system(header.system_id());
  task.prepare = prepare_again(task.system_id);
  const std::size_t bytes = 2 * cotangent.size() * sizeof(Vec3);
  const auto charge =
      std::make_shared<Charge>(memory_.charge(bytes, {"vector-Jacobian product", "raise the server's memory budget", 0}));
  task.compute = [header, charge, field = std::make_shared<const Points>(std::move(cotangent))](const SystemCache::Handle& system,
                                                                                                const RunContext& context) {
    if (field->size() != system->mesh->point_count()) {
      convert::refuse_field("cotangent", "expected " + std::to_string(system->mesh->point_count()) + " points, got " +
                                             std::to_string(field->size()));
    }
    Reply reply;
    for (const double g : system->system->vector_jacobian(values_or_zero(header.variables(), system->setup), *field, context)) {
      reply.add_gradient(g);
    }
    return reply;
  };
  task.on_done = std::move(on_done);
  std::make_shared<OutcomeCall<Reply>>(OutcomeCall<Reply>::Parts{&scheduler_, cache_.get(), &calls_}, std::move(task), call)
      ->begin();
}

}  // namespace deform::server
