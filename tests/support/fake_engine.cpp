// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/support/fake_engine.h"

#include <stdexcept>
#include <thread>
#include <utility>

namespace deform::support {

using server::CallContext;

bool eventually(const std::function<bool()>& condition) {
  const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > limit) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

// ---- FakeJob ----

FakeJob::FakeJob(v1::DeformRequest request, std::uint64_t request_id, CallContext call, std::function<void()> on_ready)
    : request_(std::move(request)), request_id_(request_id), call_(std::move(call)), on_ready_(std::move(on_ready)) {}

void FakeJob::push(v1::DeformReply reply) {
  bool wanted = false;
  {
    const std::lock_guard lock(mutex_);
    reply.set_request_id(request_id_);
    replies_.push_back(std::move(reply));
    wanted = std::exchange(wanted_, false);
  }
  if (wanted) on_ready_();
}

void FakeJob::push_block(std::uint32_t block, std::size_t bytes) {
  v1::DeformReply reply;
  reply.mutable_block()->set_block(block);
  reply.mutable_block()->set_data(std::string(bytes, 'b'));
  push(std::move(reply));
}

void FakeJob::end(std::optional<Error> error) {
  bool wanted = false;
  {
    const std::lock_guard lock(mutex_);
    if (ended_) return;
    ended_ = true;
    error_ = std::move(error);
    wanted = std::exchange(wanted_, false);
  }
  if (wanted) on_ready_();
}

server::DeformJob::Poll FakeJob::poll(v1::DeformReply& reply) {
  const std::lock_guard lock(mutex_);
  if (!replies_.empty()) {
    reply = std::move(replies_.front());
    replies_.pop_front();
    ++delivered_;
    return Poll::reply;
  }
  if (ended_) return Poll::done;
  wanted_ = true;
  return Poll::pending;
}

void FakeJob::cancel() {
  cancelled_ = true;
  end(Error(ErrorCode::cancelled, "cancelled"));
}

bool FakeJob::ended() const {
  const std::lock_guard lock(mutex_);
  return ended_;
}

std::optional<Error> FakeJob::error() const {
  const std::lock_guard lock(mutex_);
  return error_;
}

// ---- FakeEngine ----

namespace {

class FakeUpload : public server::GeometryUpload {
 public:
  FakeUpload(FakeEngine& engine, std::shared_ptr<FakeEngine::Upload> seen, CallContext call, std::size_t bytes)
      : engine_(engine), seen_(std::move(seen)), call_(std::move(call)), missing_(bytes) {}
  ~FakeUpload() override { seen_->destroyed = true; }
  bool already_stored() const override { return engine_.already_stored; }
  void add(const v1::RegisterGeometryRequest& part) override {
    if (engine_.before) engine_.before(&call_);
    missing_ -= part.points().xyz().size();
    ++seen_->parts;
  }
  v1::GeometryInfo finish() override {
    if (!engine_.already_stored && missing_ != 0) throw Error(ErrorCode::invalid_argument, "points: incomplete");
    seen_->finished = true;
    v1::GeometryInfo info;
    info.set_id("abc");
    info.set_existed(engine_.already_stored);
    return info;
  }

 private:
  FakeEngine& engine_;
  const std::shared_ptr<FakeEngine::Upload> seen_;
  const CallContext call_;
  std::size_t missing_;  // bytes of points
};

}  // namespace

std::shared_ptr<FakeJob> FakeEngine::job(std::size_t n) {
  std::unique_lock lock(mutex_);
  if (!changed_.wait_for(lock, std::chrono::seconds(10), [&] { return jobs_.size() > n; })) {
    throw std::runtime_error("the service asked for no such job");
  }
  return jobs_[n];
}

std::size_t FakeEngine::job_count() {
  const std::lock_guard lock(mutex_);
  return jobs_.size();
}

std::shared_ptr<FakeEngine::Upload> FakeEngine::upload(std::size_t n) {
  std::unique_lock lock(mutex_);
  if (!changed_.wait_for(lock, std::chrono::seconds(10), [&] { return uploads_.size() > n; })) {
    throw std::runtime_error("the service began no such upload");
  }
  return uploads_[n];
}

std::size_t FakeEngine::upload_count() {
  const std::lock_guard lock(mutex_);
  return uploads_.size();
}

std::vector<std::string> FakeEngine::tenants() {
  const std::lock_guard lock(mutex_);
  return tenants_;
}

void FakeEngine::note(const CallContext& call) {
  const std::lock_guard lock(mutex_);
  tenants_.push_back(call.tenant);
}

server::StoredAmount FakeEngine::stored(const std::string& tenant) {
  const std::lock_guard lock(mutex_);
  tenants_.push_back(tenant);
  return {tenant.size(), 2, 3};
}

std::unique_ptr<server::GeometryUpload> FakeEngine::begin_upload(const v1::GeometryHeader& header, const CallContext& call) {
  note(call);
  auto seen = std::make_shared<Upload>();
  {
    const std::lock_guard lock(mutex_);
    uploads_.push_back(seen);
  }
  changed_.notify_all();
  return std::make_unique<FakeUpload>(*this, std::move(seen), call, header.point_count() * sizeof(Vec3));
}

v1::GeometryInfo FakeEngine::get_geometry(const std::string& id, const server::CallContext& call) {
  note(call);
  if (before) before(nullptr);
  v1::GeometryInfo info;
  info.set_id(id);
  info.set_points(point_count);
  return info;
}

v1::ListGeometriesReply FakeEngine::list_geometries(const v1::ListGeometriesRequest& request, const server::CallContext& call) {
  note(call);
  v1::ListGeometriesReply reply;
  reply.set_next_page_token(request.page_token() + "+");
  return reply;
}

v1::DeleteGeometryReply FakeEngine::delete_geometry(const v1::DeleteGeometryRequest& request, const server::CallContext& call) {
  note(call);
  v1::DeleteGeometryReply reply;
  reply.set_setups_deleted(request.with_setups() ? 2 : 0);
  return reply;
}

std::shared_ptr<const Points> FakeEngine::get_points(const std::string&, const server::CallContext& call) {
  note(call);
  auto points = std::make_shared<Points>(point_count);
  for (std::size_t i = 0; i < point_count; ++i) (*points)[i] = {double(i), 0.5, -double(i)};
  return points;
}

void FakeEngine::detect(const v1::DetectRequest& request, const CallContext& call,
                        std::function<void(Outcome<DetectReplies>)> on_done) {
  note(call);
  on_detect(request, call, std::move(on_done));
}

void FakeEngine::estimate(v1::EstimateRequest request, const CallContext& call,
                          std::function<void(Outcome<v1::EstimateReply>)> on_done) {
  note(call);
  if (before) before(&call);
  if (on_estimate) return on_estimate(request, call, std::move(on_done));
  v1::EstimateReply reply;
  reply.set_system_id("of " + request.setup().geometry());
  on_done({std::move(reply), std::nullopt, {}});
}

void FakeEngine::prepare(const v1::PrepareRequest& request, const CallContext& call,
                         std::function<void(const v1::Progress&)> on_progress,
                         std::function<void(Outcome<v1::SystemInfo>)> on_done) {
  note(call);
  on_prepare(request, call, std::move(on_progress), std::move(on_done));
}

std::string FakeEngine::get_setup(const std::string& system_id, const server::CallContext& call) {
  note(call);
  v1::Setup setup;
  setup.set_geometry(system_id);
  return setup.SerializeAsString();
}

v1::SystemInfo FakeEngine::get_system(const std::string& id, const server::CallContext& call) {
  note(call);
  v1::SystemInfo info;
  info.set_id(id);
  info.set_points(point_count);
  return info;
}

v1::ListSystemsReply FakeEngine::list_systems(const v1::ListSystemsRequest& request, const server::CallContext& call) {
  note(call);
  v1::ListSystemsReply reply;
  reply.set_next_page_token(request.geometry_id());
  return reply;
}

v1::ReleaseSystemReply FakeEngine::release_system(const v1::ReleaseSystemRequest& request, const server::CallContext& call) {
  note(call);
  v1::ReleaseSystemReply reply;
  reply.set_bytes_released(request.forget() ? 7 : 6);
  return reply;
}

std::shared_ptr<server::DeformJob> FakeEngine::deform(v1::DeformRequest request, std::uint64_t request_id,
                                                      const CallContext& call, std::function<void()> on_ready) {
  note(call);
  if (deform_error) throw *deform_error;
  {
    const std::lock_guard lock(mutex_);
    if (draining_) throw Error(ErrorCode::unavailable, "the server is shutting down");
  }
  auto job = std::make_shared<FakeJob>(std::move(request), request_id, call, std::move(on_ready));
  if (on_job) on_job(*job);
  {
    const std::lock_guard lock(mutex_);
    jobs_.push_back(job);
  }
  changed_.notify_all();
  return job;
}

std::shared_ptr<server::EvaluateJob> FakeEngine::evaluate(v1::EvaluateHeader header, const CallContext& call,
                                                          std::function<void()> on_ready) {
  note(call);
  if (!on_evaluate) throw Error(ErrorCode::not_found, "system " + header.system_id() + ": unknown id");
  return on_evaluate(header, call, std::move(on_ready));
}

std::shared_ptr<server::DeformJob> FakeEngine::jacobian_vector(v1::JacobianVectorRequest request, const CallContext& call,
                                                               std::function<void()> on_ready) {
  v1::DeformRequest asked;
  asked.set_system_id(request.system_id());
  return deform(std::move(asked), 0, call, std::move(on_ready));
}

void FakeEngine::vector_jacobian(const v1::VectorJacobianHeader&, Points cotangent, const CallContext& call,
                                 std::function<void(Outcome<v1::VectorJacobianReply>)> on_done) {
  note(call);
  on_vector_jacobian(std::move(cotangent), call, std::move(on_done));
}

void FakeEngine::get_basis(const v1::GetBasisRequest& request, const CallContext& call,
                           std::function<void(Outcome<std::shared_ptr<server::BasisRecords>>)> on_done) {
  note(call);
  on_get_basis(request, call, std::move(on_done));
}

v1::ServerInfo FakeEngine::info() {
  v1::ServerInfo info;
  info.set_version("fake");
  return info;
}

bool FakeEngine::drain(std::chrono::milliseconds limit) {
  std::vector<std::shared_ptr<FakeJob>> jobs;
  {
    const std::lock_guard lock(mutex_);
    draining_ = true;
    jobs = jobs_;
  }
  const auto deadline = std::chrono::steady_clock::now() + limit;
  bool clean = true;
  for (const auto& job : jobs) {
    // A fake job is under way until the test ends it.
    while (!job->ended() && std::chrono::steady_clock::now() < deadline) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    if (job->ended()) continue;
    clean = false;
    job->cancel();
  }
  return clean;
}

}  // namespace deform::support
