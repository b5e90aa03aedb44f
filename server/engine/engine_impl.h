// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string>

#include "server/engine/call.h"
#include "server/engine/deform_call.h"
#include "server/engine/engine.h"
#include "server/engine/memory.h"
#include "server/engine/mesh_cache.h"
#include "server/engine/scheduler.h"
#include "server/engine/stored_bases.h"
#include "server/engine/system_cache.h"
#include "server/engine/system_factory.h"
#include "server/store/store.h"

namespace deform::server {

/// See engine.h. Meshes and systems in memory are found by tenant and id, like what is stored: that another tenant has the same
/// one in memory must not make an answer quicker. Owns all parts; the order of the members is the order in which they depend on
/// each other.
class EngineImpl : public Engine {
 public:
  explicit EngineImpl(const EngineOptions& options);
  ~EngineImpl() override;

  std::unique_ptr<GeometryUpload> begin_upload(const v1::GeometryHeader& header, const CallContext& call) override;
  v1::GeometryInfo get_geometry(const std::string& id, const CallContext& call) override;
  v1::ListGeometriesReply list_geometries(const v1::ListGeometriesRequest& request, const CallContext& call) override;
  v1::DeleteGeometryReply delete_geometry(const v1::DeleteGeometryRequest& request, const CallContext& call) override;
  std::shared_ptr<const Points> get_points(const std::string& id, const CallContext& call) override;

  void detect(const v1::DetectRequest& request, const CallContext& call,
              std::function<void(Outcome<DetectReplies>)> on_done) override;

  void estimate(v1::EstimateRequest request, const CallContext& call,
                std::function<void(Outcome<v1::EstimateReply>)> on_done) override;
  void prepare(const v1::PrepareRequest& request, const CallContext& call, std::function<void(const v1::Progress&)> on_progress,
               std::function<void(Outcome<v1::SystemInfo>)> on_done) override;
  v1::SystemInfo get_system(const std::string& id, const CallContext& call) override;
  std::string get_setup(const std::string& system_id, const CallContext& call) override;
  v1::ListSystemsReply list_systems(const v1::ListSystemsRequest& request, const CallContext& call) override;
  v1::ReleaseSystemReply release_system(const v1::ReleaseSystemRequest& request, const CallContext& call) override;

  std::shared_ptr<DeformJob> deform(v1::DeformRequest request, std::uint64_t request_id, const CallContext& call,
                                    std::function<void()> on_ready) override;
  std::shared_ptr<EvaluateJob> evaluate(v1::EvaluateHeader header, const CallContext& call,
                                        std::function<void()> on_ready) override;
  std::shared_ptr<DeformJob> jacobian_vector(v1::JacobianVectorRequest request, const CallContext& call,
                                             std::function<void()> on_ready) override;
  void vector_jacobian(const v1::VectorJacobianHeader& header, Points cotangent, const CallContext& call,
                       std::function<void(Outcome<v1::VectorJacobianReply>)> on_done) override;
  void get_basis(const v1::GetBasisRequest& request, const CallContext& call,
                 std::function<void(Outcome<std::shared_ptr<BasisRecords>>)> on_done) override;

  v1::ServerInfo info() override;
  StoredAmount stored(const std::string& tenant) override { return store_->amount_of(tenant); }
  void give_back_idle_memory(std::size_t bytes) override;
  v1::StoreInfo store() override;
  StoredBasisCounts stored_bases() override { return bases_.counts(); }
  Evicted evict(const std::string& id_or_prefix, const std::optional<std::string>& tenant) override;
  void set_queue_limit(std::size_t requests) override { scheduler_.set_queue_limit(requests); }
  void set_cache_budget(std::size_t bytes) override { cache_->set_budget(bytes); }
  StoreReport check_store(const RunContext& context) override;
  SyncTimes sync_times() override { return store_->sync_times(); }
  StoreReport backup_store(const std::filesystem::path& to) override;
  bool drain(std::chrono::milliseconds limit) override;

 private:
  using Needs = SystemFactory::Needs;

  OwnedId resolve_system(const std::string& tenant, const std::string& id);
  RowsGone forget_in(SystemCache::Forgotten& forgotten);
  std::shared_ptr<const Mesh> mesh_of(const OwnedId& geometry) { return meshes_.get(key_of(geometry)); }
  std::shared_ptr<const Mesh> load_mesh(const OwnedId& id);
  SetupRecord stored_setup(const std::string& id, const CallContext& call);
  v1::SystemInfo stored_info(const SetupRecord& record);
  std::shared_ptr<DeformJob> begin_job(DeformTask task, Needs needs, const CallContext& call, std::function<void()> on_ready);
  void check_open() const;
  Catalog::Counts counts();

  const EngineOptions options_;  // without zeros: defaults are filled in
  const RunContext::Clock::time_point opened_ = RunContext::Clock::now();
  MemoryBudget memory_;
  const std::unique_ptr<Store> store_;
  std::mutex counts_mutex_;
  Catalog::Counts counts_;  // under counts_mutex_: the last ones that could be read
  StoredBases bases_;
  MeshCache meshes_;
  Scheduler scheduler_;
  CallRegistry calls_;
  SystemFactory factory_;
  const std::shared_ptr<SystemCache> cache_;
  std::atomic<std::uint64_t> designs_served_{0};
};

}  // namespace deform::server
