// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "server/engine/engine.h"

namespace deform::support {

/// A job the test plays by hand.
class FakeJob : public server::DeformJob {
 public:
  FakeJob(v1::DeformRequest request, std::uint64_t request_id, server::CallContext call, std::function<void()> on_ready);

  // the test's side
  void push(v1::DeformReply reply);
  /// A block of `bytes` bytes with the given number.
  void push_block(std::uint32_t block, std::size_t bytes = 10);
  void end(std::optional<Error> error = std::nullopt);
  bool cancelled() const { return cancelled_; }
  bool ended() const;
  std::size_t delivered() const { return delivered_; }  ///< replies that were polled
  const v1::DeformRequest& request() const { return request_; }
  const server::CallContext& call() const { return call_; }
  std::uint64_t request_id() const { return request_id_; }

  // the service's side
  Poll poll(v1::DeformReply& reply) override;
  void cancel() override;
  std::optional<Error> error() const override;

 private:
  const v1::DeformRequest request_;
  const std::uint64_t request_id_;
  const server::CallContext call_;
  const std::function<void()> on_ready_;
  std::atomic<bool> cancelled_{false};
  std::atomic<std::size_t> delivered_{0};
  mutable std::mutex mutex_;
  // under mutex_
  std::deque<v1::DeformReply> replies_;
  bool ended_ = false;
  bool wanted_ = false;  ///< answered pending, so on_ready is due
  std::optional<Error> error_;
};

/// Records what the service asks and answers as the test says. Thread-safe.
class FakeEngine : public server::Engine {
 public:
  /// What the fake upload does; the last message and finish() are visible to the test.
  struct Upload {
    std::atomic<int> parts{0};
    std::atomic<bool> finished{false};
    std::atomic<bool> destroyed{false};
  };

  // ---- scripts: set before the calls ----
  std::function<void(const server::CallContext*)> before;  ///< at the start of everything that blocks; may throw or wait
  std::function<void(FakeJob&)> on_job;                    ///< when a job has been made, on the service's thread
  std::function<void(const v1::PrepareRequest&, const server::CallContext&, std::function<void(const v1::Progress&)>,
                     std::function<void(Outcome<v1::SystemInfo>)>)>
      on_prepare;
  std::function<void(const v1::EstimateRequest&, const server::CallContext&, std::function<void(Outcome<v1::EstimateReply>)>)>
      on_estimate;  ///< empty: answers at once
  std::function<void(const v1::DetectRequest&, const server::CallContext&, std::function<void(Outcome<DetectReplies>)>)>
      on_detect;
  std::function<void(Points, const server::CallContext&, std::function<void(Outcome<v1::VectorJacobianReply>)>)>
      on_vector_jacobian;
  std::function<void(const v1::GetBasisRequest&, const server::CallContext&,
                     std::function<void(Outcome<std::shared_ptr<server::BasisRecords>>)>)>
      on_get_basis;
  std::function<std::shared_ptr<server::EvaluateJob>(const v1::EvaluateHeader&, const server::CallContext&,
                                                     std::function<void()>)>
      on_evaluate;
  std::optional<Error> deform_error;
  bool already_stored = false;
  std::size_t point_count = 100'000;  ///< of every geometry

  // ---- what happened ----
  /// Waits until n jobs were made.
  std::shared_ptr<FakeJob> job(std::size_t n);
  std::size_t job_count();
  std::shared_ptr<Upload> upload(std::size_t n);
  std::size_t upload_count();
  /// The tenant of each call that reached the engine, in order.
  std::vector<std::string> tenants();

  // ---- Engine ----
  std::unique_ptr<server::GeometryUpload> begin_upload(const v1::GeometryHeader& header,
                                                       const server::CallContext& call) override;
  v1::GeometryInfo get_geometry(const std::string& id, const server::CallContext& call) override;
  v1::ListGeometriesReply list_geometries(const v1::ListGeometriesRequest& request, const server::CallContext& call) override;
  v1::DeleteGeometryReply delete_geometry(const v1::DeleteGeometryRequest& request, const server::CallContext& call) override;
  std::shared_ptr<const Points> get_points(const std::string& id, const server::CallContext& call) override;
  void detect(const v1::DetectRequest& request, const server::CallContext& call,
              std::function<void(Outcome<DetectReplies>)> on_done) override;
  void estimate(v1::EstimateRequest request, const server::CallContext& call,
                std::function<void(Outcome<v1::EstimateReply>)> on_done) override;
  void prepare(const v1::PrepareRequest& request, const server::CallContext& call,
               std::function<void(const v1::Progress&)> on_progress,
               std::function<void(Outcome<v1::SystemInfo>)> on_done) override;
  v1::SystemInfo get_system(const std::string& id, const server::CallContext& call) override;
  std::string get_setup(const std::string& system_id, const server::CallContext& call) override;
  v1::ListSystemsReply list_systems(const v1::ListSystemsRequest& request, const server::CallContext& call) override;
  v1::ReleaseSystemReply release_system(const v1::ReleaseSystemRequest& request, const server::CallContext& call) override;
  std::shared_ptr<server::DeformJob> deform(v1::DeformRequest request, std::uint64_t request_id, const server::CallContext& call,
                                            std::function<void()> on_ready) override;
  std::shared_ptr<server::EvaluateJob> evaluate(v1::EvaluateHeader header, const server::CallContext& call,
                                                std::function<void()> on_ready) override;
  std::shared_ptr<server::DeformJob> jacobian_vector(v1::JacobianVectorRequest request, const server::CallContext& call,
                                                     std::function<void()> on_ready) override;
  void vector_jacobian(const v1::VectorJacobianHeader& header, Points cotangent, const server::CallContext& call,
                       std::function<void(Outcome<v1::VectorJacobianReply>)> on_done) override;
  void get_basis(const v1::GetBasisRequest& request, const server::CallContext& call,
                 std::function<void(Outcome<std::shared_ptr<server::BasisRecords>>)> on_done) override;
  v1::ServerInfo info() override;
  server::StoredAmount stored(const std::string& tenant) override;
  bool drain(std::chrono::milliseconds limit) override;

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  // under mutex_
  std::vector<std::shared_ptr<FakeJob>> jobs_;
  std::vector<std::shared_ptr<Upload>> uploads_;
  std::vector<std::string> tenants_;
  bool draining_ = false;

  void note(const server::CallContext& call);
};

/// Polls until `condition` holds; false when it does not within ten seconds.
bool eventually(const std::function<bool()>& condition);

}  // namespace deform::support
