// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/admin_service.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "core/base/text.h"
#include "deform/v1/admin.grpc.pb.h"
#include "server/rpc/service_calls.h"
#include "server/rpc/service_messages.h"

namespace deform::server {

namespace {

/// Limits of a reply, which stays below 1 MiB.
constexpr std::size_t most_entries = 1000, longest_line = 900, longest_reason = 200;
constexpr int threads = 2;
constexpr std::size_t waiting_calls = 64;

using Rpc = v1::Admin;
using Raw1 = Rpc::WithRawCallbackMethod_ListCalls<
    Rpc::WithRawCallbackMethod_CancelCall<Rpc::WithRawCallbackMethod_Drain<Rpc::WithRawCallbackMethod_Undrain<Rpc::Service>>>>;
using Raw2 = Rpc::WithRawCallbackMethod_Evict<
    Rpc::WithRawCallbackMethod_ListConnections<Rpc::WithRawCallbackMethod_ListLimits<Rpc::WithRawCallbackMethod_SetLimit<Raw1>>>>;
using RawService = Rpc::WithRawCallbackMethod_CheckStore<Rpc::WithRawCallbackMethod_BackupStore<Raw2>>;

using Context = grpc::CallbackServerContext;
using Bytes = grpc::ByteBuffer;

/// Whose calls and systems an operator looks after: those of everybody, or of its own tenant.
std::optional<std::string> whose(const CallScope& scope) {
  const std::string& tenant = scope.call().tenant;
  return tenant == default_tenant ? std::nullopt : std::optional(tenant);
}

void require_whole_server(const CallScope& scope) {
  if (!whose(scope)) return;
  throw Error(ErrorCode::permission_denied, scope.record.method + " is about the whole server, \"" + scope.record.identity +
                                                "\" is the operator of tenant \"" + scope.call().tenant + "\" alone");
}

/// Who did it and what, for the log.
void log_act(const CallScope& scope, const std::string& what) {
  const CallRecord& record = scope.record;
  spdlog::warn("operator {} at {}: {}", record.identity.empty() ? "(not asked for an identity)" : escaped(record.identity, 100),
               escaped(record.client, 100), escaped(what, 1000));
}

/// As gRPC writes an address, without the escapes of its brackets.
std::string plain_peer(std::string peer) {
  for (const auto& [escaped, bracket] : {std::pair{"%5B", "["}, std::pair{"%5D", "]"}}) {
    if (const auto at = peer.find(escaped); at != std::string::npos) peer.replace(at, 3, bracket);
  }
  return peer;
}

v1::StoreReply reply_of(const StoreReport& report) {
  v1::StoreReply reply;
  reply.set_well(report.outcome == StoreReport::Outcome::well);
  const std::size_t left_out = report.lines.size() - std::min(report.lines.size(), most_entries);
  if (left_out > 0) reply.add_lines(std::to_string(left_out) + " lines are left out before these");
  for (std::size_t i = left_out; i < report.lines.size(); ++i) reply.add_lines(escaped(report.lines[i], longest_line));
  return reply;
}

}  // namespace

/// One function per RPC.
class AdminService::Methods final : public RawService {
 public:
  Methods(Engine& engine, OpenCalls& calls, Admit admit)
      : engine_(engine), calls_(calls), admit_(std::move(admit)), pool_(threads, waiting_calls), store_(1, waiting_calls) {}

  void set_actions(AdminActions actions) { actions_ = std::move(actions); }

  grpc::ServerUnaryReactor* ListCalls(Context* context, const Bytes* bytes, Bytes* reply) override {
    return answer<v1::ListCallsRequest>("ListCalls", context, bytes, reply, [this](CallScope& scope, const auto&) {
      return calls_.list(whose(scope), scope.call().open->id(), most_entries);
    });
  }

  grpc::ServerUnaryReactor* CancelCall(Context* context, const Bytes* bytes, Bytes* reply) override {
    return answer<v1::CancelCallRequest>("CancelCall", context, bytes, reply, [this](CallScope& scope, const auto& request) {
      if (request.reason().size() > longest_reason) {
        throw Error(ErrorCode::invalid_argument, "reason: has " + std::to_string(request.reason().size()) + " bytes, at most " +
                                                     std::to_string(longest_reason) + " are allowed");
      }
      const std::string reason = request.reason().empty() ? "" : ": " + request.reason();
      v1::CancelCallReply cancelled;
      *cancelled.mutable_call() = calls_.end(
          request.id(), whose(scope), Error(ErrorCode::cancelled, "the operator of the server cancelled this call" + reason));
      const v1::CallInfo& call = cancelled.call();
      log_act(scope, "cancels call " + std::to_string(call.id()) + ", " + call.method() + " of " +
                         (call.identity().empty() ? call.peer() : call.identity()) + reason);
      return cancelled;
    });
  }

  grpc::ServerUnaryReactor* Drain(Context* context, const Bytes* bytes, Bytes* reply) override {
    return answer<v1::DrainRequest>("Drain", context, bytes, reply, [this](CallScope& scope, const auto&) {
      require_whole_server(scope);
      log_act(scope, "drains the server: new work is refused");
      actions_.drain();
      v1::DrainReply drained;
      drained.set_calls(calls_.size() - 1);
      return drained;
    });
  }

  grpc::ServerUnaryReactor* Undrain(Context* context, const Bytes* bytes, Bytes* reply) override {
    return answer<v1::UndrainRequest>("Undrain", context, bytes, reply, [this](CallScope& scope, const auto&) {
      require_whole_server(scope);
      log_act(scope, "ends draining: work is taken again");
      actions_.undrain();
      return v1::UndrainReply();
    });
  }

  grpc::ServerUnaryReactor* Evict(Context* context, const Bytes* bytes, Bytes* reply) override {
    return answer<v1::EvictRequest>("Evict", context, bytes, reply, [this](CallScope& scope, const auto& request) {
      if (request.system_id().empty() != request.all()) {
        throw Error(ErrorCode::invalid_argument, "system_id: name a system, or say all, and not both");
      }
      scope.record.system = request.system_id();
      const Engine::Evicted evicted = engine_.evict(request.system_id(), whose(scope));
      log_act(scope, "evicts " + std::to_string(evicted.systems) + " systems of " + std::to_string(evicted.bytes) + " bytes");
      v1::EvictReply done;
      done.set_systems(evicted.systems);
      done.set_bytes(evicted.bytes);
      done.set_in_use(evicted.in_use);
      return done;
    });
  }

  grpc::ServerUnaryReactor* ListConnections(Context* context, const Bytes* bytes, Bytes* reply) override {
    return answer<v1::ListConnectionsRequest>("ListConnections", context, bytes, reply, [this](CallScope& scope, const auto&) {
      require_whole_server(scope);
      struct OfPeer {
        std::uint64_t calls = 0;
        std::set<std::string> identities;
      };
      std::map<std::string, OfPeer> peers;
      constexpr std::size_t all = std::numeric_limits<std::size_t>::max();
      const v1::ListCallsReply open = calls_.list(std::nullopt, scope.call().open->id(), all);
      for (const auto& call : open.calls()) {
        if (call.stream() != 0) continue;  // its stream counts
        OfPeer& of = peers[plain_peer(call.peer())];
        ++of.calls;
        if (!call.identity().empty() && of.identities.size() < 10) of.identities.insert(call.identity());
      }
      v1::ListConnectionsReply connections = actions_.connections();
      for (auto& connection : *connections.mutable_connections()) {
        const auto found = connection.peer().empty() ? peers.end() : peers.find(connection.peer());
        if (found == peers.end()) continue;
        connection.set_calls(found->second.calls);
        for (const auto& identity : found->second.identities) connection.add_identities(identity);
      }
      return connections;
    });
  }

  grpc::ServerUnaryReactor* ListLimits(Context* context, const Bytes* bytes, Bytes* reply) override {
    return answer<v1::ListLimitsRequest>("ListLimits", context, bytes, reply, [this](CallScope& scope, const auto&) {
      require_whole_server(scope);
      return actions_.limits();
    });
  }

  grpc::ServerUnaryReactor* SetLimit(Context* context, const Bytes* bytes, Bytes* reply) override {
    return answer<v1::SetLimitRequest>("SetLimit", context, bytes, reply, [this](CallScope& scope, const auto& request) {
      require_whole_server(scope);
      const v1::SetLimitReply changed = actions_.set_limit(request);
      log_act(scope, "sets " + changed.limit().name() + " to " + changed.limit().value() + ", before " + changed.before() +
                         "; until a restart");
      return changed;
    });
  }

  grpc::ServerUnaryReactor* CheckStore(Context* context, const Bytes* bytes, Bytes* reply) override {
    return answer_on<v1::CheckStoreRequest>(store_, "CheckStore", context, bytes, reply, [this](CallScope& scope, const auto&) {
      require_whole_server(scope);
      log_act(scope, "checks the store");
      RunContext limits;
      limits.stop = scope.call().stop;
      limits.deadline = scope.call().deadline;
      return reply_of(engine_.check_store(limits));
    });
  }

  grpc::ServerUnaryReactor* BackupStore(Context* context, const Bytes* bytes, Bytes* reply) override {
    return answer_on<v1::BackupStoreRequest>(store_, "BackupStore", context, bytes, reply,
                                             [this](CallScope& scope, const auto& request) {
                                               require_whole_server(scope);
                                               log_act(scope, "copies the store to " + request.directory());
                                               return reply_of(engine_.backup_store(request.directory()));
                                             });
  }

 private:
  /// work(scope, request) -> reply message.
  template <typename Request, typename Work>
  grpc::ServerUnaryReactor* answer_on(ThreadPool& pool, const char* method, Context* context, const Bytes* bytes, Bytes* reply,
                                      Work work) {
    return UnaryCall::launch(pool, method, admit_(context, bytes), reply, [bytes, work = std::move(work)](CallScope& scope) {
      const auto request = received<Request>(*bytes, scope.record);
      return serialized(work(scope, request));
    });
  }
  template <typename Request, typename Work>
  grpc::ServerUnaryReactor* answer(const char* method, Context* context, const Bytes* bytes, Bytes* reply, Work work) {
    return answer_on<Request>(pool_, method, context, bytes, reply, std::move(work));
  }

  Engine& engine_;
  OpenCalls& calls_;
  const Admit admit_;
  AdminActions actions_;
  // last: their threads end before the rest goes
  ThreadPool pool_;
  ThreadPool store_;  ///< reads for minutes
};

AdminService::AdminService(Engine& engine, OpenCalls& calls, Admit admit)
    : methods_(std::make_unique<Methods>(engine, calls, std::move(admit))) {}
AdminService::~AdminService() = default;
grpc::Service& AdminService::grpc_service() { return *methods_; }
void AdminService::set_actions(AdminActions actions) { methods_->set_actions(std::move(actions)); }

}  // namespace deform::server
