// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/service.h"

#include <algorithm>
#include <atomic>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "core/base/checks.h"
#include "deform/v1/service.grpc.pb.h"
#include "server/rpc/service_calls.h"
#include "server/rpc/service_messages.h"
#include "server/rpc/streams/evaluate_stream.h"
#include "server/rpc/streams/large_setups.h"
#include "server/rpc/streams/service_stream.h"

namespace deform::server {

namespace {

template <template <typename> class... Layers>
struct Stacked;
template <>
struct Stacked<> {
  using Type = v1::DeformService::Service;
};
template <template <typename> class Layer, template <typename> class... Layers>
struct Stacked<Layer, Layers...> {
  using Type = Layer<typename Stacked<Layers...>::Type>;
};

/// Every method gets and gives bytes (see service_messages.h).
using Rpc = v1::DeformService;
using RawService =
    Stacked<Rpc::WithRawCallbackMethod_RegisterGeometry, Rpc::WithRawCallbackMethod_GetGeometry,
            Rpc::WithRawCallbackMethod_ListGeometries, Rpc::WithRawCallbackMethod_DeleteGeometry,
            Rpc::WithRawCallbackMethod_GetPoints, Rpc::WithRawCallbackMethod_Detect, Rpc::WithRawCallbackMethod_Estimate,
            Rpc::WithRawCallbackMethod_Prepare, Rpc::WithRawCallbackMethod_EstimateLarge, Rpc::WithRawCallbackMethod_PrepareLarge,
            Rpc::WithRawCallbackMethod_GetSetup, Rpc::WithRawCallbackMethod_GetSystem, Rpc::WithRawCallbackMethod_ListSystems,
            Rpc::WithRawCallbackMethod_ReleaseSystem, Rpc::WithRawCallbackMethod_Deform, Rpc::WithRawCallbackMethod_DeformStream,
            Rpc::WithRawCallbackMethod_Evaluate, Rpc::WithRawCallbackMethod_JacobianVector,
            Rpc::WithRawCallbackMethod_VectorJacobian, Rpc::WithRawCallbackMethod_GetBasis,
            Rpc::WithRawCallbackMethod_GetServerInfo>::Type;

using Context = grpc::CallbackServerContext;
using Bytes = grpc::ByteBuffer;

/// What requests may take while they are held, beside the memory budget; 0 for an engine without one.
std::size_t held_limit(std::size_t budget) {
  constexpr std::size_t share = 8;
  constexpr std::size_t least = std::size_t{16} << 20;
  return budget == 0 ? 0 : std::max(budget / share, least);
}

std::size_t call_limit(std::size_t option, std::size_t budget) {
  constexpr std::size_t share = 8, least = 1024;
  return option != 0 || budget == 0 ? option : std::max(budget / share / LiveCalls::bytes_of_one, least);
}

void refuse_continued_designs(const v1::DeformRequest& request) {
  for (int i = 0; i < request.designs_size(); ++i) {
    if (request.designs(i).continues()) {
      throw Error(ErrorCode::invalid_argument, "designs[" + std::to_string(i) + "].continues: only in DeformStream");
    }
  }
}

}  // namespace

void ServiceOptions::validate() const {
  check_range(stream.open_requests, 1, 1'000'000, "option max_open_requests");
  check_range(stream.running_requests, 1, 100'000, "option max_running_requests");
  check_range(stream.buffered_bytes, std::size_t{4} << 20, std::size_t{1} << 40, "option max_buffered_bytes");
  check_range(static_cast<std::size_t>(std::max(call_threads, 0)), 1, 1024, "option call_threads");
  check_range(waiting_calls, 1, 1'000'000, "option max_waiting_calls");
  check_range(max_setup_bytes, std::size_t{1} << 20, std::size_t{1} << 30, "option max_setup_bytes");
}

/// One function per RPC.
class DeformService::Methods final : public RawService {
 public:
  Methods(Engine& engine, const ServiceOptions& options)
      : engine_(engine),
        options_(options),
        max_deadline_ms_(options.max_deadline.count()),
        access_(options.access),
        held_(held_limit(engine.info().memory_budget())),
        live_(call_limit(options.max_calls, engine.info().memory_budget())),
        health_(live_, floods_, options_.proxies),
        pool_(options.call_threads, options.waiting_calls),
        transfers_(options.call_threads, options.waiting_calls),
        admin_(engine, calls_,
               [this](Context* context, const Bytes* request) { return incoming(Role::operate, context, request); }) {}

  void drain();
  void refresh_access() { access_.refresh(); }
  void set_draining(bool draining);
  void set_max_deadline(std::chrono::milliseconds limit) { max_deadline_ms_ = limit.count(); }
  void end_stalled_calls() {
    if (options_.stall_timeout.count() > 0) calls_.end_stalled(options_.stall_timeout);
  }
  AdminService& admin() { return admin_; }
  HealthService& health() { return health_; }
  void set_memory_full(bool full) { memory_full_ = full; }
  void on_flood(std::function<void(const std::string&)> action) { floods_.on_flood(std::move(action)); }
  bool memory_full() const { return memory_full_; }
  std::size_t held_request_bytes() const { return held_.in_use(); }
  const Metrics& metrics() const { return metrics_; }
  bool wait_for_none(std::chrono::steady_clock::time_point deadline) { return live_.wait_for_none(deadline); }

  grpc::ServerReadReactor<Bytes>* RegisterGeometry(Context* context, Bytes* reply) override {
    return RequestStream::launch(std::make_shared<RegisterCall>(engine_, incoming(Role::use, context), reply, transfers_));
  }

  grpc::ServerUnaryReactor* GetGeometry(Context* context, const Bytes* bytes, Bytes* reply) override {
    return unary("GetGeometry", Role::read, context, bytes, reply, [this, bytes](CallRecord& record, const CallContext& call) {
      const auto request = received<v1::GetGeometryRequest>(*bytes, record);
      record.geometry = request.id();
      return engine_.get_geometry(request.id(), call);
    });
  }

  grpc::ServerUnaryReactor* ListGeometries(Context* context, const Bytes* bytes, Bytes* reply) override {
    return unary("ListGeometries", Role::read, context, bytes, reply, [this, bytes](CallRecord& record, const CallContext& call) {
      return engine_.list_geometries(received<v1::ListGeometriesRequest>(*bytes, record), call);
    });
  }

  grpc::ServerUnaryReactor* DeleteGeometry(Context* context, const Bytes* bytes, Bytes* reply) override {
    return unary("DeleteGeometry", Role::own, context, bytes, reply, [this, bytes](CallRecord& record, const CallContext& call) {
      const auto request = received<v1::DeleteGeometryRequest>(*bytes, record);
      record.geometry = request.id();
      return engine_.delete_geometry(request, call);
    });
  }

  grpc::ServerWriteReactor<Bytes>* GetPoints(Context* context, const Bytes* bytes) override {
    return ReplyStream::launch(std::make_shared<PointsCall>(engine_, incoming(Role::read, context, bytes), bytes), transfers_);
  }

  grpc::ServerWriteReactor<Bytes>* Detect(Context* context, const Bytes* bytes) override {
    return ReplyStream::launch(std::make_shared<DetectCall>(engine_, incoming(Role::use, context, bytes), bytes), pool_);
  }

  grpc::ServerUnaryReactor* Estimate(Context* context, const Bytes* bytes, Bytes* reply) override {
    const auto begin = [this, bytes](CallScope& scope, UnaryCall::Answer answer) {
      auto request = received<v1::EstimateRequest>(*bytes, scope.record);
      scope.record.geometry = request.setup().geometry();
      scope.note_subject();
      engine_.estimate(std::move(request), scope.call(), [answer](Engine::Outcome<v1::EstimateReply> outcome) {
        answer([&](CallScope& answered) {
          const v1::EstimateReply estimate = taken(outcome, answered.record, "the estimate");
          answered.record.system = estimate.system_id();
          return serialized(estimate);
        });
      });
    };
    return UnaryCall::launch_later(transfers_, "Estimate", incoming(Role::use, context, bytes), reply, begin);
  }

  grpc::ServerWriteReactor<Bytes>* Prepare(Context* context, const Bytes* bytes) override {
    return ReplyStream::launch(std::make_shared<PrepareCall>(engine_, incoming(Role::use, context, bytes), bytes), transfers_);
  }

  grpc::ServerReadReactor<Bytes>* EstimateLarge(Context* context, Bytes* reply) override {
    return RequestStream::launch(
        std::make_shared<LargeEstimateCall>(engine_, options_.max_setup_bytes, incoming(Role::use, context), reply, transfers_));
  }

  grpc::ServerBidiReactor<Bytes, Bytes>* PrepareLarge(Context* context) override {
    return LargePrepareCall::launch(
        std::make_shared<LargePrepareCall>(engine_, options_.max_setup_bytes, incoming(Role::use, context), transfers_));
  }

  grpc::ServerWriteReactor<Bytes>* GetSetup(Context* context, const Bytes* bytes) override {
    return ReplyStream::launch(std::make_shared<SetupCall>(engine_, incoming(Role::read, context, bytes), bytes), pool_);
  }

  grpc::ServerUnaryReactor* GetSystem(Context* context, const Bytes* bytes, Bytes* reply) override {
    return unary("GetSystem", Role::read, context, bytes, reply, [this, bytes](CallRecord& record, const CallContext& call) {
      const auto request = received<v1::GetSystemRequest>(*bytes, record);
      record.system = request.id();
      v1::SystemInfo info = engine_.get_system(request.id(), call);
      if (request.omit_setup()) info.clear_setup();
      return info;
    });
  }

  grpc::ServerUnaryReactor* ListSystems(Context* context, const Bytes* bytes, Bytes* reply) override {
    return unary("ListSystems", Role::read, context, bytes, reply, [this, bytes](CallRecord& record, const CallContext& call) {
      const auto request = received<v1::ListSystemsRequest>(*bytes, record);
      record.geometry = request.geometry_id();
      return engine_.list_systems(request, call);
    });
  }

  grpc::ServerUnaryReactor* ReleaseSystem(Context* context, const Bytes* bytes, Bytes* reply) override {
    return unary("ReleaseSystem", Role::own, context, bytes, reply, [this, bytes](CallRecord& record, const CallContext& call) {
      const auto request = received<v1::ReleaseSystemRequest>(*bytes, record);
      record.system = request.id();
      return engine_.release_system(request, call);
    });
  }

  grpc::ServerWriteReactor<Bytes>* Deform(Context* context, const Bytes* bytes) override {
    return job("Deform", Role::use, context, bytes, [this, bytes](CallScope& scope, JobCall::Ready ready) {
      auto request = received<v1::DeformRequest>(*bytes, scope.record);
      scope.record.system = request.system_id();
      refuse_continued_designs(request);
      return engine_.deform(std::move(request), 0, scope.call(), std::move(ready));
    });
  }

  grpc::ServerBidiReactor<Bytes, Bytes>* DeformStream(Context* context) override;

  grpc::ServerBidiReactor<Bytes, Bytes>* Evaluate(Context* context) override {
    return EvaluateStreamCall::launch(std::make_shared<EvaluateStreamCall>(engine_, incoming(Role::use, context)));
  }

  grpc::ServerWriteReactor<Bytes>* JacobianVector(Context* context, const Bytes* bytes) override {
    return job("JacobianVector", Role::use, context, bytes, [this, bytes](CallScope& scope, JobCall::Ready ready) {
      auto request = received<v1::JacobianVectorRequest>(*bytes, scope.record);
      scope.record.system = request.system_id();
      return engine_.jacobian_vector(std::move(request), scope.call(), std::move(ready));
    });
  }

  grpc::ServerReadReactor<Bytes>* VectorJacobian(Context* context, Bytes* reply) override {
    return RequestStream::launch(std::make_shared<VectorJacobianCall>(engine_, incoming(Role::use, context), reply, pool_));
  }

  grpc::ServerWriteReactor<Bytes>* GetBasis(Context* context, const Bytes* bytes) override {
    return ReplyStream::launch(std::make_shared<BasisCall>(engine_, incoming(Role::use, context, bytes), bytes), pool_);
  }

  grpc::ServerUnaryReactor* GetServerInfo(Context* context, const Bytes* bytes, Bytes* reply) override {
    return unary("GetServerInfo", Role::read, context, bytes, reply, [this, bytes](CallRecord& record, const CallContext& call) {
      received<v1::GetServerInfoRequest>(*bytes, record);
      v1::ServerInfo info = engine_.info();
      const StoredAmount own = engine_.stored(call.tenant);  // not those of others
      info.set_geometries(own.geometries);
      info.set_setups(own.setups);
      info.mutable_limits()->set_max_streams_per_call(options_.stream.open_requests);
      info.mutable_limits()->set_max_setup_bytes(options_.max_setup_bytes);
      info.set_draining(info.draining() || refusing_);
      return info;
    });
  }

 private:
  Incoming incoming(Role needed, Context* context, const Bytes* request = nullptr) {
    Incoming call;
    call.context = context;
    call.needed = needed;
    call.live = &live_;
    call.access = &access_;
    call.proxies = &options_.proxies;
    call.memory_full = &memory_full_;
    call.draining = &refusing_;
    call.calls = &calls_;
    call.overdue = &overdue_;
    call.metrics = &metrics_;
    call.held = &held_;
    call.floods = &floods_;
    call.rates = &rates_;
    call.in_flight = &in_flight_;
    call.max_deadline = max_deadline();
    call.stall_timeout = options_.stall_timeout;
    call.request = request;
    return call;
  }
  std::chrono::milliseconds max_deadline() const { return std::chrono::milliseconds(max_deadline_ms_); }
  /// work(record, call) -> reply message.
  template <typename Work>
  grpc::ServerUnaryReactor* unary(const char* method, Role needed, Context* context, const Bytes* bytes, Bytes* reply,
                                  Work work) {
    return UnaryCall::launch(pool_, method, incoming(needed, context, bytes), reply,
                             [work = std::move(work)](CallScope& scope) { return serialized(work(scope.record, scope.call())); });
  }
  grpc::ServerWriteReactor<Bytes>* job(const char* method, Role needed, Context* context, const Bytes* bytes,
                                       JobCall::Submit submit) {
    return ReplyStream::launch(std::make_shared<JobCall>(method, incoming(needed, context, bytes), std::move(submit)));
  }

  Engine& engine_;
  const ServiceOptions options_;
  std::atomic<std::chrono::milliseconds::rep> max_deadline_ms_;
  Access access_;
  std::atomic<bool> memory_full_{false};
  std::atomic<bool> refusing_{false};  ///< the operator drains the server
  OpenCalls calls_;
  OverdueCalls overdue_;
  Metrics metrics_;
  HeldRequests held_;
  FloodGuard floods_;
  RequestRates rates_;
  TenantMeters in_flight_;
  LiveCalls live_;
  HealthService health_;
  std::mutex streams_mutex_;
  // under streams_mutex_
  std::map<DeformStreamCall*, std::weak_ptr<DeformStreamCall>> streams_;
  bool draining_ = false;
  // last: its threads end before the rest goes
  ThreadPool pool_;
  ThreadPool transfers_;  ///< of meshes and setups, which take long where the disk does: no question waits for them
  AdminService admin_;
};

grpc::ServerBidiReactor<Bytes, Bytes>* DeformService::Methods::DeformStream(Context* context) {
  Incoming stream = incoming(Role::use, context);
  stream.max_deadline = {};  // of its requests, not of the stream
  StreamLimits limits = options_.stream;
  limits.max_deadline = max_deadline();
  auto call = std::make_shared<DeformStreamCall>(engine_, limits, stream, [this](DeformStreamCall* ended) {
    const std::lock_guard lock(streams_mutex_);
    streams_.erase(ended);
  });
  bool draining = false;
  {
    const std::lock_guard lock(streams_mutex_);
    streams_.emplace(call.get(), call);
    draining = draining_;
  }
  auto* reactor = DeformStreamCall::launch(call);
  if (draining) call->drain();
  return reactor;
}

void DeformService::Methods::drain() {
  std::vector<std::shared_ptr<DeformStreamCall>> live;
  {
    const std::lock_guard lock(streams_mutex_);
    draining_ = true;
    for (const auto& [key, weak] : streams_) {
      if (auto call = weak.lock()) live.push_back(std::move(call));
    }
  }
  for (const auto& call : live) call->drain();
}

void DeformService::Methods::set_draining(bool draining) {
  refusing_ = draining;
  if (draining) return drain();
  const std::lock_guard lock(streams_mutex_);
  draining_ = false;
}

DeformService::DeformService(Engine& engine, const ServiceOptions& options)
    : methods_(std::make_unique<Methods>(engine, options)) {}
DeformService::~DeformService() = default;
grpc::Service& DeformService::grpc_service() { return *methods_; }
grpc::Service& DeformService::admin_service() { return methods_->admin().grpc_service(); }
HealthService& DeformService::health() { return methods_->health(); }
void DeformService::set_admin_actions(AdminActions actions) { methods_->admin().set_actions(std::move(actions)); }
void DeformService::drain() { methods_->drain(); }
void DeformService::set_draining(bool draining) { methods_->set_draining(draining); }
void DeformService::end_stalled_calls() { methods_->end_stalled_calls(); }

void DeformService::set_max_deadline(std::chrono::milliseconds limit) { methods_->set_max_deadline(limit); }
void DeformService::set_memory_full(bool full) { methods_->set_memory_full(full); }
void DeformService::on_flood(std::function<void(const std::string&)> action) { methods_->on_flood(std::move(action)); }
bool DeformService::memory_full() const { return methods_->memory_full(); }
std::size_t DeformService::held_request_bytes() const { return methods_->held_request_bytes(); }
const Metrics& DeformService::metrics() const { return methods_->metrics(); }
void DeformService::refresh_access() { methods_->refresh_access(); }
bool DeformService::wait_for_none(std::chrono::steady_clock::time_point deadline) { return methods_->wait_for_none(deadline); }

}  // namespace deform::server
