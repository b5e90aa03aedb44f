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
#include "server/rpc/status.h"

namespace deform::server {

namespace {

namespace health = grpc::health::v1;
using ServingStatus = health::HealthCheckResponse::ServingStatus;

constexpr std::size_t longest_service_name = 200;

std::optional<Error> refused_name(const std::string& service) {
  if (service.size() <= longest_service_name) return std::nullopt;
  return Error(ErrorCode::invalid_argument, "service: has " + std::to_string(service.size()) + " bytes, at most " +
                                                std::to_string(longest_service_name) + " are allowed");
}

}  // namespace

class HealthService::Methods final : public health::Health::CallbackService {
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

  grpc::ServerUnaryReactor* Check(grpc::CallbackServerContext* context, const health::HealthCheckRequest* request,
                                  health::HealthCheckResponse* reply) override;
  grpc::ServerWriteReactor<health::HealthCheckResponse>* Watch(grpc::CallbackServerContext* context,
                                                               const health::HealthCheckRequest* request) override;

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
  CheckCall(Methods& methods, grpc::CallbackServerContext* context) : methods_(methods), context_(context) {}

 private:
  void OnDone() override {
    if (context_->IsCancelled()) methods_.floods_.note_reset(context_->peer());
    delete this;
  }

  Methods& methods_;
  grpc::CallbackServerContext* const context_;
};

grpc::ServerUnaryReactor* HealthService::Methods::Check(grpc::CallbackServerContext* context,
                                                        const health::HealthCheckRequest* request,
                                                        health::HealthCheckResponse* reply) {
  auto* call = new CheckCall(*this, context);
  const ServingStatus status = state(request->service()).status;
  if (const auto refused = refused_name(request->service())) {
    call->Finish(to_status(*refused));
  } else if (status == health::HealthCheckResponse::SERVICE_UNKNOWN) {
    call->Finish(to_status(Error(ErrorCode::not_found, "this server has no service of that name")));
  } else {
    reply->set_status(status);
    call->Finish(grpc::Status::OK);
  }
  return call;
}

// ---- Watch ----

/// Owns itself from launch() to OnDone. What changes while a status is written is looked at afterwards.
class HealthService::Methods::WatchCall final : public grpc::ServerWriteReactor<health::HealthCheckResponse>,
                                                public std::enable_shared_from_this<WatchCall> {
 public:
  WatchCall(Methods& methods, grpc::CallbackServerContext* context, std::string service)
      : methods_(methods), context_(context), service_(std::move(service)), client_(methods.proxies_.host_of(*context)) {
    methods_.live_.enter(client_, LiveCalls::Stop::cuts_off);
  }

  static WatchCall* launch(const std::shared_ptr<WatchCall>& call, std::optional<Error> refused) {
    call->self_ = call;
    if (!refused) {
      try {
        call->methods_.live_.check(call->client_);
      } catch (const Error& error) {
        refused = error;
      }
    }
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
      if (reply_.status() != now.status) {
        reply_.set_status(now.status);
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
  grpc::CallbackServerContext* const context_;
  const std::string service_;
  const std::string client_;
  std::shared_ptr<WatchCall> self_;
  health::HealthCheckResponse reply_;  ///< what was sent last
  std::mutex mutex_;
  // under mutex_
  Turn turn_ = Turn::working;
  bool woken_ = false, cancelled_ = false;
};

grpc::ServerWriteReactor<health::HealthCheckResponse>* HealthService::Methods::Watch(grpc::CallbackServerContext* context,
                                                                                     const health::HealthCheckRequest* request) {
  auto refused = refused_name(request->service());
  const auto call = std::make_shared<WatchCall>(*this, context, refused ? std::string() : request->service());
  {
    const std::lock_guard lock(mutex_);
    watches_.emplace(call.get(), call);
  }
  return WatchCall::launch(call, std::move(refused));
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
