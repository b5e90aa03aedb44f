// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <string>

#include "core/base/error.h"
#include "core/base/run_context.h"
#include "core/base/types.h"
#include "deform/v1/service.pb.h"
#include "server/engine/memory.h"
#include "server/engine/open_calls.h"
#include "server/store/store_commands.h"
#include "server/store/store_files.h"
#include "server/store/tenant.h"

namespace deform::server {

struct EngineOptions {
  std::filesystem::path data_dir;                 ///< created when missing; locked against a second process
  std::string catalog;                            ///< of PostgreSQL, as a URI: shared with other servers, and so is data_dir
  std::size_t keep_free = std::size_t{16} << 20;  ///< bytes that stay free on its disk: below, nothing is added to the store
  /// Bytes of handle bases in the store, from which systems are restored (core/deformers/stored_form.h); 0: none are kept.
  std::size_t max_stored_bases = std::size_t{16} << 30;
  std::chrono::milliseconds stored_from{1000};  ///< what a preparation takes at least: bases of others are not worth it
  std::size_t memory_budget = 0;                ///< bytes; 0 = 80 % of what the machine (or its cgroup) has
  std::size_t cache_budget = 0;                 ///< bytes of resident systems; 0 = half of memory_budget
  int workers = 0;                              ///< requests computed at once; 0 = number of cores
  std::size_t queue_limit = 256;                ///< requests waiting; more are refused with a retry hint
  std::size_t max_points = 50'000'000;
  std::size_t max_faces = 100'000'000;
  std::size_t max_groups = 10'000;
  std::size_t max_designs = 10'000;
  std::size_t max_handles = 10'000;
  std::size_t max_setup_work = 10'000'000'000;  ///< regions of a setup times points of its geometry, see selection_work.h
  std::size_t block_points = 1u << 15;          ///< per block on the wire; 256..40000, so that a raw block stays below 1 MiB

  /// Throws Error(invalid_argument) naming the option and its limits.
  void validate() const;
};

class WarmStarts;

/// What the transport knows about a call. Its stop token and deadline are watched and reach every loop within about ten
/// milliseconds; several calls may share one token.
struct CallContext {
  std::stop_token stop;
  std::optional<RunContext::Clock::time_point> deadline;
  std::string client;                                 ///< who asks, an identity or a host: requests take turns by client
  std::string tenant = default_tenant;                ///< whose geometries and systems the call sees, adds to and takes away from
  Quota quota = {};                                   ///< of the tenant
  std::shared_ptr<MemoryMeter> in_flight = nullptr;   ///< bytes of the tenant's calls; null: nobody counts them
  std::shared_ptr<WarmStarts> warm_starts = nullptr;  ///< of a stream
  std::shared_ptr<OpenCall> open = nullptr;           ///< what its operator sees of it; may be absent

  TenantShare share() const { return {tenant, in_flight, quota.bytes_in_flight}; }
};

/// What the log line of a call tells, in milliseconds and bytes.
struct CallStats {
  std::string geometry_id, system_id;
  std::size_t designs = 0, points = 0;
  double queue_ms = 0;    ///< until a worker took the request up, waiting for a preparation included
  double prepare_ms = 0;  ///< of which waiting for the system to be prepared (again)
  double solve_ms = 0, encode_ms = 0;
  std::uint64_t bytes = 0;  ///< of block data handed out
};

/// One geometry on its way in. Not thread-safe; destroyed without finish(), it leaves nothing behind.
class GeometryUpload {
 public:
  virtual ~GeometryUpload() = default;
  /// The geometry of the header's id is already there: finish() may be called at once.
  virtual bool already_stored() const = 0;
  /// Next message after the header, as geometry.proto prescribes. Throws Error(invalid_argument).
  virtual void add(const v1::RegisterGeometryRequest& part) = 0;
  /// Validates, stores durably, makes visible.
  virtual v1::GeometryInfo finish() = 0;
};

/// A running deformation: pull-based, so that a slow reader never holds a worker. Letting go of it cancels. Thread-safe; may
/// outlive its engine.
class DeformJob {
 public:
  enum class Poll {
    reply,    ///< `reply` was filled
    pending,  ///< nothing yet; the job's on_ready will be called
    done      ///< nothing more; error() tells how it ended
  };
  virtual ~DeformJob() = default;
  /// Never blocks. Taking replies makes room for the job to go on.
  virtual Poll poll(v1::DeformReply& reply) = 0;
  virtual void cancel() = 0;
  /// After done: empty when all replies were delivered.
  virtual std::optional<Error> error() const = 0;
  /// So far; complete after done.
  virtual CallStats stats() const { return {}; }
};

/// A design that is evaluated at points as they come (Evaluate): pull-based towards the reader, and it says when the next block
/// may come, so that neither a slow reader nor a fast writer takes more memory than was charged. Letting go of it cancels.
/// Thread-safe; add() and finish() by one thread at a time. May outlive its engine.
class EvaluateJob {
 public:
  virtual ~EvaluateJob() = default;
  /// Whether there is room for a block: after the first reply, and again whenever poll() gave a block. One call at a
  /// time.
  virtual bool has_room() = 0;
  /// The next block. Throws Error(invalid_argument) naming it and the limit; the job has to be cancelled then.
  virtual void add(v1::Block&& block) = 0;
  /// There are no more blocks.
  virtual void finish() = 0;
  /// Never blocks.
  virtual DeformJob::Poll poll(v1::EvaluateReply& reply) = 0;
  virtual void cancel() = 0;
  /// After done: empty when all replies were delivered.
  virtual std::optional<Error> error() const = 0;
  /// So far; complete after done.
  virtual CallStats stats() const { return {}; }
};

/// The bytes of a compiled deformation, made as they are asked for. Keeps its system alive. For one thread.
class BasisRecords {
 public:
  virtual ~BasisRecords() = default;
  virtual const v1::BasisHeader& header() const = 0;
  /// The next records, below 1 MiB; false after the last ones. Takes about as long as copying them.
  virtual bool next(std::string& records) = 0;
};

/// The number of cotangents that a header announces. Throws Error(invalid_argument) above most_cotangents.
inline constexpr std::size_t most_cotangents = 1000;
std::size_t check_cotangent_count(const v1::VectorJacobianHeader& header);

/// deformd without a network: everything the service offers, with the semantics of service.proto, for the tenant of each call: an
/// id of another one is as unknown to it as one that nobody has. Thread-safe. Errors are Error;
/// those of asynchronous work arrive through its callback, on a worker thread.
///
///   register -> GeometryStore (durable)
///   prepare  -> Scheduler (bounded queue) -> SystemCache (single flight, byte budget) -> deform::prepare
///   deform   -> Scheduler -> SystemCache -> System::bind -> per step: evaluate + codec::encode -> replies
class Engine {
 public:
  /// Opens the store. Throws Error(invalid_argument) for options, Error(unavailable) when another process has the data directory.
  static std::unique_ptr<Engine> open(const EngineOptions& options);
  virtual ~Engine() = default;

  virtual std::unique_ptr<GeometryUpload> begin_upload(const v1::GeometryHeader& header, const CallContext& call) = 0;
  virtual v1::GeometryInfo get_geometry(const std::string& id, const CallContext& call) = 0;
  virtual v1::ListGeometriesReply list_geometries(const v1::ListGeometriesRequest& request, const CallContext& call) = 0;
  virtual v1::DeleteGeometryReply delete_geometry(const v1::DeleteGeometryRequest& request, const CallContext& call) = 0;
  /// Keeps the points alive.
  virtual std::shared_ptr<const Points> get_points(const std::string& id, const CallContext& call) = 0;

  /// Result of asynchronous work: a value or an error.
  template <typename T>
  struct Outcome {
    std::optional<T> value;
    std::optional<Error> error;
    CallStats stats;
  };

  /// All replies of one detection, in order; each below 1 MiB.
  using DetectReplies = std::shared_ptr<const std::vector<v1::DetectReply>>;
  /// on_done is called exactly once.
  virtual void detect(const v1::DetectRequest& request, const CallContext& call,
                      std::function<void(Outcome<DetectReplies>)> on_done) = 0;

  /// Waits and computes among the preparations. on_done is called exactly once.
  virtual void estimate(v1::EstimateRequest request, const CallContext& call,
                        std::function<void(Outcome<v1::EstimateReply>)> on_done) = 0;
  /// on_progress may be empty; a last call of it may overlap with on_done. on_done is called exactly once.
  virtual void prepare(const v1::PrepareRequest& request, const CallContext& call,
                       std::function<void(const v1::Progress&)> on_progress,
                       std::function<void(Outcome<v1::SystemInfo>)> on_done) = 0;
  virtual v1::SystemInfo get_system(const std::string& id, const CallContext& call) = 0;
  /// The canonical setup of a system, of any size, in the binary format.
  virtual std::string get_setup(const std::string& system_id, const CallContext& call) = 0;
  virtual v1::ListSystemsReply list_systems(const v1::ListSystemsRequest& request, const CallContext& call) = 0;
  virtual v1::ReleaseSystemReply release_system(const v1::ReleaseSystemRequest& request, const CallContext& call) = 0;

  /// Throws when the queue is full or the request is plainly wrong. on_ready (any thread, not while a lock is held, never after
  /// done) says that poll() has something again after it answered pending. request_id is copied into every reply.
  virtual std::shared_ptr<DeformJob> deform(v1::DeformRequest request, std::uint64_t request_id, const CallContext& call,
                                            std::function<void()> on_ready) = 0;
  /// As deform(), for one design at points that are added to the job.
  virtual std::shared_ptr<EvaluateJob> evaluate(v1::EvaluateHeader header, const CallContext& call,
                                                std::function<void()> on_ready) = 0;
  virtual std::shared_ptr<DeformJob> jacobian_vector(v1::JacobianVectorRequest request, const CallContext& call,
                                                     std::function<void()> on_ready) = 0;
  /// `cotangents`: max(1, header.cotangents()) fields, one after the other.
  virtual void vector_jacobian(const v1::VectorJacobianHeader& header, Points cotangents, const CallContext& call,
                               std::function<void(Outcome<v1::VectorJacobianReply>)> on_done) = 0;
  /// on_done is called exactly once. The error failed_precondition says why a system cannot be compiled.
  virtual void get_basis(const v1::GetBasisRequest& request, const CallContext& call,
                         std::function<void(Outcome<std::shared_ptr<BasisRecords>>)> on_done) = 0;

  /// Information on the server, over all tenants.
  virtual v1::ServerInfo info() = 0;
  /// What a tenant has.
  virtual StoredAmount stored(const std::string& tenant) = 0;
  /// Lets go of about so many bytes that only wait for their next use, and gives what is free back to the system.
  virtual void give_back_idle_memory(std::size_t /*bytes*/) {}
  /// Whether geometries and setups can be added now; asked every second.
  virtual v1::StoreInfo store() {
    v1::StoreInfo info;
    info.set_writable(true);
    return info;
  }

  /// What became of the handle bases in the store since the start, and how much disk they take now.
  struct StoredBasisCounts {
    std::uint64_t restored = 0;  ///< systems that needed no preparation
    std::uint64_t refused = 0;   ///< damaged, of another version of the program, or of another mesh or setup
    std::uint64_t written = 0;
    std::uint64_t not_written = 0;  ///< beyond a quota, or the disk did not take them
    std::uint64_t bytes = 0;
  };
  virtual StoredBasisCounts stored_bases() { return {}; }
  /// How long the disk of the store takes.
  virtual SyncTimes sync_times() { return {}; }

  // For the operator of the server.
  struct Evicted {
    std::size_t systems = 0, in_use = 0;  ///< of these, calls still compute with so many
    std::size_t bytes = 0;
  };
  /// Takes systems out of memory: those whose ids begin so, all of them when that is empty; of one tenant, or of all. Throws
  /// Error(not_found) when none is in memory.
  virtual Evicted evict(const std::string& /*id_or_prefix*/, const std::optional<std::string>& /*tenant*/) { return {}; }
  virtual void set_queue_limit(std::size_t /*requests*/) {}
  virtual void set_cache_budget(std::size_t /*bytes*/) {}
  /// As the functions of store_commands.h, beside the work. `to` must be absolute.
  virtual StoreReport check_store(const RunContext& /*context*/) { return {}; }
  virtual StoreReport backup_store(const std::filesystem::path& /*to*/) { return {}; }

  /// No new work is accepted (Error(unavailable)); waits until everything under way is done or the time is over, then cancels the
  /// rest and waits for that. True when nothing had to be cancelled. Idempotent.
  virtual bool drain(std::chrono::milliseconds limit) = 0;
};

}  // namespace deform::server
