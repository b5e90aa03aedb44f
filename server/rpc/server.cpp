// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/server.h"

#include <google/protobuf/stubs/logging.h>
#include <grpc/grpc.h>
#include <grpc/support/log.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <limits>
#include <mutex>
#include <string>
#include <thread>
#include <unordered_set>
#include <utility>
#include <vector>

#include "core/base/text.h"
#include "server/engine/memory.h"
#include "server/rpc/connection_calls.h"
#include "server/rpc/flood_guard.h"
#include "server/rpc/listener.h"
#include "server/rpc/operations_port.h"
#include "server/rpc/option_text.h"
#include "server/rpc/running_limits.h"

namespace deform::server {

namespace {

constexpr char service_name[] = "deform.v1.DeformService";
/// Can geometries and setups be added? Without room on its disk the server still serves what it has.
constexpr char write_service_name[] = "deform.v1.DeformService/write";
constexpr std::chrono::milliseconds memory_interval{40};
/// While the process occupies more than a quarter of its budget: a flood of calls fills the rest within a fifth of a second.
constexpr std::chrono::milliseconds filling_interval{10};
constexpr std::chrono::milliseconds give_back_interval{500};
constexpr std::chrono::milliseconds shed_interval{200};
/// A thread that has not come round for so long hangs.
constexpr std::chrono::seconds watch_patience{10};
constexpr int watch_turns = 25;  ///< every so many of these the store, the identities and calls that stall are looked at
constexpr double full_memory = 0.9;
/// Looking at connections takes at most a twentieth of the time.
constexpr int look_pause = 20;
/// Connections whose calls are counted at a look.
constexpr std::size_t most_looked_at = 32;
/// Why a connection is closed.
constexpr char resets[] = "it begins calls and resets them";
/// For the last messages to leave.
constexpr std::chrono::milliseconds last_words{250};
constexpr int reflection_threads = 16;
/// For a connection to speak HTTP/2 (and TLS).
constexpr std::chrono::seconds handshake_time{20};

/// As gRPC wants a time; 0 means that it never comes.
int milliseconds_or_never(std::chrono::seconds time) {
  return time.count() == 0 ? std::numeric_limits<int>::max() : static_cast<int>(time.count() * 1000);
}

/// Takes reflection, which every server of the process gets, from one of them.
class WithoutReflection final : public grpc::ServerBuilderOption {
  void UpdateArguments(grpc::ChannelArguments*) override {}
  void UpdatePlugins(std::vector<std::unique_ptr<grpc::ServerBuilderPlugin>>* plugins) override {
    std::erase_if(*plugins, [](const auto& plugin) {
      return dynamic_cast<const grpc::reflection::ProtoServerReflectionPlugin*>(plugin.get()) != nullptr;
    });
  }
};

ServiceOptions with_certificates(const ServerOptions& options) {
  ServiceOptions service = options.service;
  if (options.tls.client_ca.empty()) service.access.certificates = Access::Certificates::never_seen;
  service.access.client_ca = options.tls.client_ca;
  service.access.client_crl = options.tls.client_crl;
  return service;
}

/// What an address beyond this machine lets everybody do.
void warn_of_exposure(const ServerOptions& options) {
  if (!beyond_loopback(options.address)) return;
  if (!options.tls.on()) {
    spdlog::warn(
        "insecure: {} is plain text beyond this machine. Nothing is encrypted, the server proves no identity and asks nobody for "
        "one: "
        "whoever reaches it or the way to it can read and change what travels, use every call and delete every geometry. "
        "--tls-cert and --tls-key encrypt; --tls-client-ca or --identities ask who calls",
        options.address);
  } else if (options.tls.client_ca.empty() && options.service.access.identities.empty()) {
    spdlog::warn(
        "{} is encrypted, but nobody is asked who calls: whoever reaches it can use every call. --tls-client-ca or "
        "--identities ask",
        options.address);
  }
}

/// What the libraries keep per process, before the first builder: reflection, health, and protobuf's complaints about what
/// clients send, which are answered by a status and would only fill the log. What may show a token is not logged.
void set_up_libraries() {
  static std::once_flag once;
  std::call_once(once, [] {
    grpc_init();  // for good: taking gRPC down with its last server may wait ten seconds for a poller
    google::protobuf::SetLogHandler(nullptr);
    gpr_set_log_function([](gpr_log_func_args* entry) {
      const auto level = entry->severity == GPR_LOG_SEVERITY_ERROR ? spdlog::level::warn : spdlog::level::debug;
      const bool secret = lower_case(entry->message).find("authorization") != std::string::npos;
      log_library(level, secret ? "(a message about authorization)" : escaped(entry->message, 500));
    });
    grpc::EnableDefaultHealthCheckService(false);  // ours bounds the calls that stay open
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  });
}

/// Why a call of the health service fails; empty when it is answered in time.
std::string failed_health_call(grpc::Server& server) {
  constexpr std::chrono::seconds patience{2};
  grpc::GenericStub stub(server.InProcessChannel(grpc::ChannelArguments()));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + patience);
  const grpc::Slice nothing;
  const grpc::ByteBuffer request(&nothing, 1);
  grpc::CompletionQueue queue;
  const auto call = stub.PrepareUnaryCall(&context, "/grpc.health.v1.Health/Check", request, &queue);
  call->StartCall();
  grpc::ByteBuffer reply;
  grpc::Status status;
  call->Finish(&reply, &status, nullptr);
  void* tag = nullptr;
  bool ok = false;
  queue.Next(&tag, &ok);
  return status.ok() ? "" : "a call within the server failed: " + status.error_message();
}

class GrpcServer final : public RunningServer {
 public:
  GrpcServer(const ServerOptions& options, std::unique_ptr<Engine> engine)
      : engine_(std::move(engine)),
        service_(*engine_, with_certificates(options)),
        address_(options.address),
        on_failure_(options.on_failure) {
    set_up_libraries();
    credentials_ = options.tls.on() ? tls_credentials(options.tls) : grpc::InsecureServerCredentials();
    warn_of_exposure(options);
    grpc::ServerBuilder builder;
    configure(builder, options);
    if (!options.address.empty()) {
      const std::size_t limit = connection_limit(options.max_connections);
      connection_limit_ = limit;
      listener_ = std::make_unique<Listener>(Listener::Options{options.address, limit, options.keep_alive_timeout});
      acceptor_ = builder.experimental().AddExternalConnectionAcceptor(
          grpc::ServerBuilder::experimental_type::ExternalConnectionType::FROM_FD, credentials_);
      spdlog::info("connections: at most {}", limit);
    }
    add_limits(options);
    service_.set_admin_actions({[this] { set_draining(true); }, [this] { set_draining(false); }, [this] { return connections(); },
                                [this] { return limits_.list(); },
                                [this](const v1::SetLimitRequest& request) {
                                  return limits_.set(request.name(), request.value(), RunningLimits::By::request);
                                }});
    builder.RegisterService(&service_.grpc_service());
    builder.RegisterService(&service_.admin_service());
    builder.RegisterService(&service_.health().grpc_service());
    server_ = builder.BuildAndStart();
    if (!server_) throw Error(ErrorCode::internal, "gRPC does not start a server");
    if (listener_) {
      service_.on_flood([this](const std::string& peer) { listener_->cut_off(peer, resets); });
      listener_->start([this](int fd) { hand_over(fd); });
    }
    if (port() > 0) address_ = options.address.substr(0, options.address.rfind(':') + 1) + std::to_string(port());
    // Asked once: what the watcher compares with must be what the health service has.
    const bool writable = engine_->store().writable();
    set_serving(true, writable);
    const std::uint64_t budget = engine_->info().memory_budget();
    engine_budgeted_ = budget != 0;
    memory_start_ = resident_set_bytes();
    memory_limit_ = memory_start_ + static_cast<std::size_t>(full_memory * static_cast<double>(budget));
    memory_end_ = memory_start_ + budget;
    most_live_calls_ = static_cast<std::uint64_t>(options.max_calls_per_connection);
    watched_ = now();
    if (!options.metrics_address.empty()) open_operations_port(options.metrics_address);
    watch_ = std::thread([this, writable] { watch(writable); });  // last: what throws after it would leave it running
  }

  ~GrpcServer() override { stop(std::chrono::milliseconds(0)); }

  std::string address() const override { return address_; }
  int port() const override { return listener_ ? listener_->port() : 0; }
  Engine& engine() override { return *engine_; }
  std::optional<std::string> take_over(const std::string& option, const std::string& value) override {
    if (!limits_.is_changeable(option)) return std::nullopt;
    return limits_.set(option, value == "0" ? meant_by_zero(option) : value, RunningLimits::By::options).before();
  }
  std::shared_ptr<grpc::Channel> in_process_channel() override { return server_->InProcessChannel(grpc::ChannelArguments()); }

  bool stop(std::chrono::milliseconds grace) override {
    const std::lock_guard lock(stop_mutex_);
    if (stopped_) return clean_;
    const auto deadline = std::chrono::steady_clock::now() + grace;
    draining_ = true;
    {
      const std::lock_guard watch_lock(watch_mutex_);
      stopping_ = true;
    }
    stopping_changed_.notify_all();
    watch_.join();
    set_serving(false, false);
    service_.health().end_watches();
    service_.drain();
    clean_ = engine_->drain(grace);
    clean_ = service_.wait_for_none(deadline) && clean_;
    if (listener_) listener_->stop();
    operations_.reset();
    // Calls that still run are cancelled; each then finishes by itself. Not given the rest of the grace: gRPC would wait for idle
    // connections, too.
    server_->Shutdown(std::chrono::system_clock::now() + last_words);
    server_->Wait();
    stopped_ = true;
    return clean_;
  }

 private:
  static void configure(grpc::ServerBuilder& builder, const ServerOptions& options) {
    if (options.reflection == Reflection::off) builder.SetOption(std::make_unique<WithoutReflection>());
    // Each call of gRPC's own reflection has a thread until it ends; nothing else of this server is served so.
    builder.SetResourceQuota(grpc::ResourceQuota().SetMaxThreads(reflection_threads));
    builder.SetDefaultCompressionAlgorithm(GRPC_COMPRESS_NONE);  // blocks are compressed already
    // The receive limit stays at gRPC's 4 MiB: the contract allows 1 MiB.
    builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, options.max_calls_per_connection);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, static_cast<int>(options.keep_alive.count() * 1000));
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, static_cast<int>(options.keep_alive_timeout.count() * 1000));
    builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, milliseconds_or_never(handshake_time));
    builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_IDLE_MS, milliseconds_or_never(options.connection_idle));
    builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_MS, milliseconds_or_never(options.connection_age));
    builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_GRACE_MS, milliseconds_or_never(options.connection_age_grace));
    // Clients may watch their connection at the same rate without being taken for an attack.
    builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 10'000);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  }

  /// A new connection to gRPC, which closes it.
  void hand_over(int fd) {
    grpc::experimental::ExternalConnectionAcceptor::NewConnectionParameters connection;
    connection.fd = fd;
    acceptor_->HandleNewConnection(&connection);
  }

  void set_serving(bool serving, bool writable) {
    HealthService& health = service_.health();
    health.set_serving("", serving);
    health.set_serving(service_name, serving);
    health.set_serving(write_service_name, serving && writable);
  }

  /// The operator sends clients elsewhere, or takes them again.
  void set_draining(bool draining) {
    if (draining_) throw Error(ErrorCode::unavailable, "the server is shutting down");
    const std::lock_guard lock(drain_mutex_);
    drained_ = draining;
    service_.set_draining(draining);
    set_serving(!draining, engine_->store().writable());
  }

  v1::ListConnectionsReply connections() {
    constexpr std::size_t most_connections = 1000;
    v1::ListConnectionsReply reply;
    if (!listener_) return reply;
    const auto open = listener_->connections();
    const auto now = std::chrono::steady_clock::now();
    for (std::size_t i = 0; i < std::min(open.size(), most_connections); ++i) {
      v1::ConnectionInfo& info = *reply.add_connections();
      info.set_peer(open[i].peer);
      const auto age = std::chrono::duration_cast<std::chrono::milliseconds>(now - open[i].since);
      info.set_milliseconds(static_cast<std::uint64_t>(age.count()));
    }
    reply.set_open(open.size());
    reply.set_limit(connection_limit_);
    reply.set_refused(listener_->refused());
    reply.set_cut_off(listener_->cut_off_count());
    return reply;
  }

  /// Those that change while the server runs, and what else the caller of start_server() knows of.
  void add_limits(const ServerOptions& options) {
    const auto not_zero = [](std::size_t value) {
      if (value == 0) throw Error(ErrorCode::invalid_argument, "0 is left to options; give a number");
      return value;
    };
    const v1::ServerInfo info = engine_->info();
    limits_.add(
        "log-level", "", [](const std::string& value) { set_log_level(parse_level(value)); },
        [] { return to_text(spdlog::default_logger()->level()); });
    limits_.add("queue-limit", std::to_string(info.queue_limit()), [this, not_zero](const std::string& value) {
      engine_->set_queue_limit(not_zero(parse_number<std::uint32_t>(value)));
    });
    limits_.add("cache-budget", to_text(info.cache_budget()), [this](const std::string& value) {
      const std::size_t bytes = parse_bytes(value), most = engine_->info().memory_budget();
      if (bytes > most) throw Error(ErrorCode::invalid_argument, "more than the memory budget of " + to_text(most));
      engine_->set_cache_budget(bytes);
    });
    limits_.add("max-deadline", to_seconds(options.service.max_deadline),
                [this](const std::string& value) { service_.set_max_deadline(parse_seconds(value)); });
    if (listener_) {
      limits_.add("max-connections", std::to_string(connection_limit_), [this, not_zero](const std::string& value) {
        const std::size_t most = connection_limit(not_zero(parse_number<std::uint32_t>(value)));
        listener_->set_limit(most);
        connection_limit_ = most;
      });
    }
    limits_.add("memory-budget", to_text(info.memory_budget()));
    limits_.add("workers", std::to_string(info.workers()));
    for (const auto& [name, value] : options.limits) limits_.add(name, value);
  }

  /// What options leave to the server.
  std::string meant_by_zero(const std::string& option) {
    if (option == "cache-budget") return to_text(engine_->info().memory_budget() / 2);
    if (option == "max-connections") return std::to_string(connection_limit(0));
    return "0";
  }

  static std::chrono::steady_clock::rep now() { return std::chrono::steady_clock::now().time_since_epoch().count(); }

  void open_operations_port(const std::string& address) {
    operations_ = std::make_unique<OperationsPort>(
        address, OperationsPort::Answers{[this] { return metrics_text(); }, [this] { return live_checks(); },
                                         [this] { return ready_checks(); }});
    spdlog::info("metrics: /metrics, /livez and /readyz on port {}", operations_->port());
  }

  std::string metrics_text() const {
    Metrics::Levels levels;
    levels.server = engine_->info();
    levels.bases = engine_->stored_bases();
    levels.memory_full = service_.memory_full();
    levels.max_connections = connection_limit_;
    levels.held_request_bytes = service_.held_request_bytes();
    levels.syncs = engine_->sync_times();
    levels.open_connections = listener_ ? listener_->open_count() : 0;
    levels.refused_connections = listener_ ? listener_->refused() : 0;
    levels.cut_off_connections = listener_ ? listener_->cut_off_count() : 0;
    return service_.metrics().text(levels);
  }

  /// Does a call get through gRPC, and does the thread that looks after memory and store still turn?
  std::vector<HealthCheck> live_checks() const {
    const std::chrono::steady_clock::duration silent(now() - watched_);
    const bool turns = draining_ || silent < watch_patience;
    const std::string call = failed_health_call(*server_);
    const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(silent).count();
    return {{"calls", call.empty(), call},
            {"watch", turns, "nobody has looked at memory and store for " + std::to_string(seconds) + " s"}};
  }

  std::vector<HealthCheck> ready_checks() const {
    const v1::StoreInfo store = engine_->store();
    std::string refuses = accept_trouble();
    if (drained_) refuses = "draining: its operator sends clients elsewhere";
    if (draining_) refuses = "the server shuts down";
    return {{"accepting", refuses.empty(), refuses},
            {"store", store.writable(), store.reason()},
            {"memory", !service_.memory_full(), "the process occupies more memory than --memory-budget allows for"}};
  }

  std::string accept_trouble() const {
    const std::lock_guard lock(trouble_mutex_);
    return accept_trouble_;
  }

  /// Does the thread that accepts still turn, and its socket still listen?
  void watch_listener() {
    if (!listener_ || !accept_trouble().empty()) return;
    const std::string why = listener_->trouble();
    if (why.empty()) return;
    spdlog::critical("connections: no more are accepted: {}", why);
    {
      const std::lock_guard lock(trouble_mutex_);
      accept_trouble_ = why;
    }
    if (on_failure_) on_failure_("no more connections are accepted: " + why);
  }

  /// What the process occupies beyond what it did at its start counts against the budget, whatever was charged. `busy`: the
  /// connections that send much.
  void watch_memory(const std::vector<Listener::Busy>& busy) {
    std::size_t resident = resident_set_bytes();
    // Not at every turn: asking the allocator takes longer than the next turn is away, and a flood does not wait.
    if (resident > memory_limit_ && std::chrono::steady_clock::now() - gave_back_ >= give_back_interval) {
      engine_->give_back_idle_memory(resident - memory_limit_);
      resident = resident_set_bytes();
      gave_back_ = std::chrono::steady_clock::now();
    }
    const bool full = resident > memory_limit_;
    filling_ = resident - std::min(resident, memory_start_) > (memory_end_ - memory_start_) / 4;
    if (filling_) shed_connections(resident, busy);
    if (full == memory_full_) return;
    memory_full_ = full;
    service_.set_memory_full(full);
    if (full) {
      spdlog::error("memory: the process occupies {} bytes, the limit is {}: calls that compute or add are refused", resident,
                    memory_limit_);
    } else {
      spdlog::info("memory: the process occupies {} bytes, calls are taken again", resident);
    }
  }

  /// What gRPC holds for connections is bounded by nothing else: calls that are begun and reset, pings whose answers nobody
  /// reads. It is what nobody was charged for.
  void shed_connections(std::size_t resident, const std::vector<Listener::Busy>& busy) {
    const std::size_t budget = memory_end_ - memory_start_;
    const bool growing = resident > shed_at_;
    const bool uncharged = resident > memory_start_ + engine_->info().memory_in_use() + budget / 2;
    shed_at_ = resident;
    const auto now = std::chrono::steady_clock::now();
    const bool settled = now - cut_off_ >= shed_interval;  // what closed connections have sent is still worked on
    const bool all = resident > memory_end_;
    if (busy.empty() || !(all || (growing && uncharged && settled))) return;
    std::uint64_t most = 0;
    for (const Listener::Busy& one : busy) most = std::max(most, one.bytes);
    for (const Listener::Busy& one : busy) {
      if (all || 2 * one.bytes >= most) {
        listener_->cut_off(one, "the process occupies more memory than it may, and this one goes on sending");
      }
    }
    cut_off_ = now;
  }

  /// Those that send much, without what cut_off_resetting() closes. Nothing where there was not time enough since the last look.
  std::vector<Listener::Busy> watch_connections() {
    const auto start = std::chrono::steady_clock::now();
    if (!listener_ || (!filling_ && start < next_look_)) return {};
    std::vector<Listener::Busy> busy = listener_->busy();
    cut_off_resetting(busy);
    const auto end = std::chrono::steady_clock::now();
    next_look_ = end + look_pause * (end - start);
    return busy;
  }

  /// Those that have more calls than they may at once: they have reset the others, which gRPC holds until it finds the time to
  /// clean up. FloodGuard sees a reset only then, too late for a flood that keeps all cores busy. What has come but was not read
  /// yet counts for nobody as busy: who had too many calls once is looked at until they are gone.
  void cut_off_resetting(std::vector<Listener::Busy>& busy) {
    std::sort(busy.begin(), busy.end(), [](const auto& a, const auto& b) { return a.bytes > b.bytes; });
    const auto turn = std::min(suspects_.size(), most_looked_at);
    const auto next = suspects_.begin() + static_cast<std::ptrdiff_t>(turn);
    std::unordered_set<std::string> peers(suspects_.begin(), next);
    suspects_.erase(suspects_.begin(), next);
    for (const Listener::Busy& one : busy) {
      if (!one.peer.empty() && peers.size() < most_looked_at) peers.insert(one.peer);
    }
    for (const auto& [peer, calls] : calls_.of(peers)) {
      if (calls > most_live_calls_ + FloodGuard::most_resets) {
        listener_->cut_off(peer, resets);
        std::erase_if(busy, [&peer = peer](const Listener::Busy& one) { return one.peer == peer; });
      } else if (calls > most_live_calls_) {
        suspects_.push_back(peer);
      }
    }
  }

  /// What the libraries have freed goes back to the system, too: asked for once a second while the process occupies more than is
  /// charged, more and more rarely when that gives nothing.
  void trim_memory() {
    constexpr std::size_t worth = std::size_t{16} << 20;
    constexpr int longest_wait = 16;
    const std::size_t resident = resident_set_bytes();
    if (resident < memory_start_ + engine_->info().memory_in_use() + worth) return;
    if (--trim_wait_ > 0 && resident < trimmed_ + worth) return;
    return_freed_memory(freed_bytes_worth_returning);
    const bool gave = resident_set_bytes() + worth / 16 < resident;
    trim_pause_ = gave ? 1 : std::min(2 * trim_pause_, longest_wait);
    trim_wait_ = trim_pause_;
    trimmed_ = resident_set_bytes();
  }

  /// The memory of the process, the store and the files of who may call.
  void watch(bool writable) {
    std::unique_lock lock(watch_mutex_);
    int turn = 0;
    while (!stopping_changed_.wait_for(lock, filling_ ? filling_interval : memory_interval, [this] { return stopping_; })) {
      watch_listener();
      const std::vector<Listener::Busy> busy = watch_connections();
      if (engine_budgeted_) watch_memory(busy);
      watched_ = now();
      if (filling_ && ++filling_turn_ % (memory_interval / filling_interval) != 0) continue;
      turn = (turn + 1) % watch_turns;
      if (turn != 0) continue;
      trim_memory();
      service_.end_stalled_calls();
      service_.refresh_access();
      const v1::StoreInfo store = engine_->store();
      if (store.writable() == writable) continue;
      writable = store.writable();
      if (writable) {
        spdlog::info("store: there is room again, geometries and setups can be added");
      } else {
        spdlog::error("store: geometries and setups can only be deleted: {}", store.reason());
      }
      const std::lock_guard drain_lock(drain_mutex_);
      service_.health().set_serving(write_service_name, writable && !drained_);
    }
  }

  // In this order: calls use the service, the service uses the engine.
  std::unique_ptr<Engine> engine_;
  DeformService service_;
  std::shared_ptr<grpc::ServerCredentials> credentials_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor> acceptor_;
  std::unique_ptr<Listener> listener_;
  std::string address_;
  const std::function<void(const std::string&)> on_failure_;
  std::atomic<std::size_t> connection_limit_{0};
  mutable std::mutex trouble_mutex_;
  std::string accept_trouble_;  ///< under trouble_mutex_: why no connection is accepted any more
  RunningLimits limits_;
  std::mutex drain_mutex_;                                  ///< one change of health at a time
  std::atomic<bool> drained_{false};                        ///< by the operator
  std::atomic<std::chrono::steady_clock::rep> watched_{0};  ///< when the thread that watches came round last
  std::atomic<bool> draining_{false};
  bool engine_budgeted_ = false;
  std::size_t memory_start_ = 0;       ///< resident bytes before the first call
  std::size_t memory_limit_ = 0;       ///< from which on calls are refused
  std::size_t memory_end_ = 0;         ///< and connections are closed
  std::uint64_t most_live_calls_ = 0;  ///< of a connection that resets none
  // of the thread that watches
  std::size_t trimmed_ = 0;  ///< resident bytes after the allocator was last asked for what is free
  bool filling_ = false;     ///< more than a quarter of the budget is occupied
  int filling_turn_ = 0;
  std::chrono::steady_clock::time_point gave_back_{}, cut_off_{}, next_look_{};
  ConnectionCalls calls_;
  std::vector<std::string> suspects_;  ///< peers that have more calls than they may
  std::size_t shed_at_ = 0;            ///< resident bytes when connections were last looked at
  int trim_wait_ = 0;                  ///< turns until it is asked again
  int trim_pause_ = 1;
  bool memory_full_ = false;  ///< of the thread that watches
  std::thread watch_;
  std::mutex watch_mutex_;
  std::condition_variable stopping_changed_;
  bool stopping_ = false;  // under watch_mutex_
  std::unique_ptr<OperationsPort> operations_;
  std::mutex stop_mutex_;
  // under stop_mutex_
  bool stopped_ = false;
  bool clean_ = true;
};

}  // namespace

void ServerOptions::validate() const {
  if (!address.empty()) check_address(address);
  if (!metrics_address.empty()) check_metrics_address(metrics_address);
  tls.validate();
  if (!tls.on() && beyond_loopback(address)) {
    if (!service.access.identities.empty()) {
      throw Error(ErrorCode::invalid_argument,
                  "option identities: on " + address +
                      " tokens would travel in plain text; encrypt (--tls-cert, --tls-key) or listen "
                      "on 127.0.0.1");
    }
    if (security == TransportSecurity::loopback_only) {
      throw Error(ErrorCode::invalid_argument, "option address: " + address +
                                                   " lets other machines connect without encryption; encrypt (--tls-cert, "
                                                   "--tls-key), listen on 127.0.0.1 or say that this is wanted (--insecure)");
    }
  }
  if (max_calls_per_connection < 1) throw Error(ErrorCode::invalid_argument, "option max_calls_per_connection: at least 1");
  if (keep_alive.count() < 1 || keep_alive_timeout.count() < 1) {
    throw Error(ErrorCode::invalid_argument, "option keep_alive: at least 1 second");
  }
  service.validate();
}

std::unique_ptr<RunningServer> start_server(const ServerOptions& options) {
  options.validate();
  return start_server(options, Engine::open(options.engine));
}

std::unique_ptr<RunningServer> start_server(const ServerOptions& options, std::unique_ptr<Engine> engine) {
  options.validate();
  return std::make_unique<GrpcServer>(options, std::move(engine));
}

}  // namespace deform::server
