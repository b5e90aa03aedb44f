// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/deform_job.h"

#include <utility>

namespace deform::server {

namespace {

class JobHandle : public DeformJob {
 public:
  explicit JobHandle(std::shared_ptr<DeformCall> call) : call_(std::move(call)) {}
  ~JobHandle() override { cancel(); }
  JobHandle(const JobHandle&) = delete;
  JobHandle& operator=(const JobHandle&) = delete;

  Poll poll(v1::DeformReply& reply) override { return call_->poll(reply); }
  void cancel() override { call_->fail(Error(ErrorCode::cancelled, "cancelled by the caller")); }
  std::optional<Error> error() const override { return call_->error(); }
  CallStats stats() const override { return call_->stats(); }

 private:
  const std::shared_ptr<DeformCall> call_;
};

}  // namespace

std::shared_ptr<DeformJob> make_deform_job(std::shared_ptr<DeformCall> call) {
  return std::make_shared<JobHandle>(std::move(call));
}

}  // namespace deform::server
