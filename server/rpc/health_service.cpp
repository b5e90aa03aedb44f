// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/health_service.h"

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <map>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "proto/convert/base/error.h"
#include "server/rpc/service_messages.h"
#include "server/rpc/status.h"

namespace deform::server {

namespace {

namespace health = grpc::health::v1;
using ServingStatus = health::HealthCheckResponse::ServingStatus;

constexpr std::size_t longest_service_name = 200;

/// Bytes, as the service has them: the reasons are in service_messages.h. And a call that is reset before its request has come is
/// seen, too.
using HealthRpc = health::Health;
using RawHealth = HealthRpc::WithRawCallbackMethod_Check<HealthRpc::WithRawCallbackMethod_Watch<HealthRpc::Service>>;
using Context = grpc::CallbackServerContext;
using Bytes = grpc::ByteBuffer;

/// Throws Error(invalid_argument) for bytes that are no request and for names that are too long.
std::string service_of(const Bytes& bytes) {
  health::HealthCheckRequest request;
  parse(bytes, request);
  const std::string& service = request.service();
  if (service.size() <= longest_service_name) return service;
  throw Error(ErrorCode::invalid_argument, "service: has " + std::to_string(service.size()) + " bytes, at most " +
                                               std::to_string(longest_service_name) + " are allowed");
}

Bytes health_reply(ServingStatus status) {
  health::HealthCheckResponse reply;
  reply.set_status(status);
  return serialized(reply);
}

}  // namespace

class HealthService::Methods final : public RawHealth {
 public:
  Methods(LiveCalls& live, FloodGuard& floods, const TrustedProxies& proxies) : live_(live), floods_(floods), proxies_(proxies) {}

  void set_serving(const std::string& service, bool serving) {
    {
      const std::lock_guard lock(mutex_);
      serving_[service] = serving;
    }
    wake_watches();
  }

  void end_watches() {
    {
      const std::lock_guard lock(mutex_);
      ended_ = true;
    }
    wake_watches();
  }

  grpc::ServerUnaryReactor* Check(Context* context, const Bytes* request, Bytes* reply) override;
  grpc::ServerWriteReactor<Bytes>* Watch(Context* context, const Bytes* request) override;

 private:
  class CheckCall;
  class WatchCall;

  struct State {
    ServingStatus status = health::HealthCheckResponse::SERVICE_UNKNOWN;
    bool ended = false;
  };
  State state(const std::string& service) const {
    const std::lock_guard lock(mutex_);
    const auto found = serving_.find(service);
    if (found == serving_.end()) return {health::HealthCheckResponse::SERVICE_UNKNOWN, ended_};
    return {found->second ? health::HealthCheckResponse::SERVING : health::HealthCheckResponse::NOT_SERVING, ended_};
  }
  void wake_watches();

  LiveCalls& live_;
  FloodGuard& floods_;
  const TrustedProxies& proxies_;
  mutable std::mutex mutex_;
  // under mutex_
  std::map<std::string, bool> serving_;
  std::map<WatchCall*, std::weak_ptr<WatchCall>> watches_;
  bool ended_ = false;
};

// ---- Check ----

class HealthService::Methods::CheckCall final : public grpc::ServerUnaryReactor {
 public:
  CheckCall(Methods& methods, Context* context) : methods_(methods), context_(context) {}

 private:
  void OnDone() override {
    if (context_->IsCancelled()) methods_.floods_.note_reset(context_->peer());
    delete this;
  }

  Methods& methods_;
  Context* const context_;
};

grpc::ServerUnaryReactor* HealthService::Methods::Check(Context* context, const Bytes* request, Bytes* reply) {
  auto* call = new CheckCall(*this, context);
  const auto refused = caught([&] {
    const ServingStatus status = state(service_of(*request)).status;
    if (status == health::HealthCheckResponse::SERVICE_UNKNOWN) {
      throw Error(ErrorCode::not_found, "this server has no service of that name");
    }
    *reply = health_reply(status);
  });
  call->Finish(refused ? to_status(*refused) : grpc::Status::OK);
  return call;
}

// ---- Watch ----

/// Owns itself from launch() to OnDone. What changes while a status is written is looked at afterwards.
class HealthService::Methods::WatchCall final : public grpc::ServerWriteReactor<Bytes>,
                                                public std::enable_shared_from_this<WatchCall> {
 public:
  WatchCall(Methods& methods, Context* context)
      : methods_(methods), context_(context), client_(methods.proxies_.host_of(*context)) {
    methods_.live_.enter(client_, LiveCalls::Stop::cuts_off);
  }

  static WatchCall* launch(const std::shared_ptr<WatchCall>& call, const Bytes& request) {
    call->self_ = call;
    const auto refused = caught([&] {
      call->service_ = service_of(request);
      call->methods_.live_.check(call->client_);
    });
    if (refused) {
      call->finish(*refused);
    } else {
      call->advance();
    }
    return call.get();
  }

  /// The status may be another one. Any thread, while a shared_ptr is held.
  void wake() {
    {
      const std::lock_guard lock(mutex_);
      if (turn_ != Turn::idle) {
        woken_ = true;
        return;
      }
      turn_ = Turn::working;
    }
    advance();
  }

 private:
  enum class Turn { working, idle, writing, finished };

  /// Called by whoever has the turn.
  void advance() {
    for (;;) {
      {
        const std::lock_guard lock(mutex_);
        woken_ = false;
        if (cancelled_) turn_ = Turn::finished;
      }
      if (turn_ == Turn::finished) return Finish(grpc::Status::CANCELLED);
      const State now = methods_.state(service_);
      if (sent_ != now.status) {
        sent_ = now.status;
        reply_ = health_reply(now.status);
        {
          const std::lock_guard lock(mutex_);
          turn_ = Turn::writing;
        }
        return StartWrite(&reply_);
      }
      if (now.ended) return finish(Error(ErrorCode::unavailable, "the server is shutting down"));
      const std::lock_guard lock(mutex_);
      if (woken_ || cancelled_) continue;
      turn_ = Turn::idle;
      return;
    }
  }

  void finish(const Error& error) {
    {
      const std::lock_guard lock(mutex_);
      turn_ = Turn::finished;
    }
    if (const std::uint32_t hint = error.retry_after_ms(); hint != 0) {
      context_->AddTrailingMetadata(convert::retry_after_key, std::to_string(hint));
    }
    Finish(to_status(error));
  }

  void OnWriteDone(bool ok) override {
    {
      const std::lock_guard lock(mutex_);
      if (!ok) cancelled_ = true;
      turn_ = Turn::working;
    }
    advance();
  }

  void OnCancel() override {
    {
      const std::lock_guard lock(mutex_);
      cancelled_ = true;
    }
    wake();
  }

  void OnDone() override {
    { const std::lock_guard lock(mutex_); }  // whoever called Finish has left it
    if (context_->IsCancelled()) methods_.floods_.note_reset(context_->peer());
    {
      const std::lock_guard lock(methods_.mutex_);
      methods_.watches_.erase(this);
    }
    methods_.live_.leave(client_, LiveCalls::Stop::cuts_off);
    self_.reset();
  }

  Methods& methods_;
  Context* const context_;
  std::string service_;
  const std::string client_;
  std::shared_ptr<WatchCall> self_;
  std::optional<ServingStatus> sent_;  ///< last
  Bytes reply_;
  std::mutex mutex_;
  // under mutex_
  Turn turn_ = Turn::working;
  bool woken_ = false, cancelled_ = false;
};

grpc::ServerWriteReactor<Bytes>* HealthService::Methods::Watch(Context* context, const Bytes* request) {
  const auto call = std::make_shared<WatchCall>(*this, context);
  {
    const std::lock_guard lock(mutex_);
    watches_.emplace(call.get(), call);
  }
  return WatchCall::launch(call, *request);
}

void HealthService::Methods::wake_watches() {
  std::vector<std::shared_ptr<WatchCall>> live;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [key, weak] : watches_) {
      if (auto call = weak.lock()) live.push_back(std::move(call));
    }
  }
  for (const auto& call : live) call->wake();
}

// ---- HealthService ----

HealthService::HealthService(LiveCalls& live, FloodGuard& floods, const TrustedProxies& proxies)
    : methods_(std::make_unique<Methods>(live, floods, proxies)) {}
HealthService::~HealthService() = default;
grpc::Service& HealthService::grpc_service() { return *methods_; }
void HealthService::set_serving(const std::string& service, bool serving) { methods_->set_serving(service, serving); }
void HealthService::end_watches() { methods_->end_watches(); }

}  // namespace deform::server
