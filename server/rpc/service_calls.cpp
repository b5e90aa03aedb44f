// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/service_calls.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

#include "server/rpc/service_messages.h"
#include "server/rpc/status.h"

namespace deform::server {

namespace {

/// Points per PointChunk: 768 KiB.
constexpr std::size_t chunk_points = 1u << 15;

constexpr std::size_t setup_piece_bytes = 768 * 1024;

/// The interval of reports on one stage; a new stage is always reported.
constexpr std::chrono::milliseconds progress_interval{100};

Error incomplete(const char* what) { return {ErrorCode::invalid_argument, std::string("the stream ended before ") + what}; }

}  // namespace

// ---- JobCall ----

JobCall::JobCall(const char* method, const Incoming& incoming, Submit submit)
    : ReplyStream(method, incoming), submit_(std::move(submit)) {}

void JobCall::begin() {
  scope_.check();
  auto job = submit_(scope_, [weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->wake();
  });
  {
    const std::lock_guard lock(job_mutex_);
    job_ = std::move(job);
  }
  // A cancel that came before there was a job is looked at in the first step, which calls stop() again.
}

JobCall::Next JobCall::next(grpc::ByteBuffer& reply) {
  v1::DeformReply message;
  switch (job_->poll(message)) {
    case DeformJob::Poll::pending:
      return Next::wait;
    case DeformJob::Poll::done:
      if (const auto error = job_->error()) throw *error;
      return Next::end;
    case DeformJob::Poll::reply:
      break;
  }
  reply = serialized(std::move(message));
  return Next::write;
}

void JobCall::stop() noexcept {
  caught([this] {
    std::shared_ptr<DeformJob> job;
    {
      const std::lock_guard lock(job_mutex_);
      job = job_;
    }
    if (job) job->cancel();
  });
}

void JobCall::done() noexcept {
  caught([this] {
    if (job_) note_stats(job_->stats(), scope_.record);
  });
}

// ---- PrepareNews ----

bool PrepareNews::note(const v1::Progress& progress) {
  const std::lock_guard lock(mutex_);
  const auto now = Clock::now();
  if (progress.stage() == stage_ && now - last_progress_ < progress_interval) return false;
  stage_ = progress.stage();
  last_progress_ = now;
  progress_ = progress;
  return true;
}

void PrepareNews::note(Engine::Outcome<v1::SystemInfo> outcome) {
  const std::lock_guard lock(mutex_);
  outcome_ = std::move(outcome);
}

ReplyTurn PrepareNews::next(grpc::ByteBuffer& reply, CallRecord& record) {
  if (reported_) return ReplyTurn::end;
  v1::PrepareReply message;
  {
    const std::lock_guard lock(mutex_);
    if (!outcome_ && !progress_) return ReplyTurn::wait;
    if (outcome_) {
      *message.mutable_system() = taken(*outcome_, record, "the preparation");
      reported_ = true;
    } else {
      *message.mutable_progress() = std::move(*std::exchange(progress_, std::nullopt));
    }
  }
  if (reported_) {
    record.system = message.system().id();
    record.points = message.system().points();
  }
  reply = serialized(message);
  return ReplyTurn::write;
}

// ---- PrepareCall ----

PrepareCall::PrepareCall(Engine& engine, const Incoming& incoming, const grpc::ByteBuffer* request)
    : ReplyStream("Prepare", incoming), engine_(engine), request_(request) {}

void PrepareCall::begin() {
  scope_.check();
  const auto request = received<v1::PrepareRequest>(*request_, scope_.record);
  scope_.record.geometry = request.setup().geometry();
  scope_.note_subject();
  prepare_for(std::static_pointer_cast<PrepareCall>(shared_from_this()), &PrepareCall::news_, engine_, request, scope_.call());
}

PrepareCall::Next PrepareCall::next(grpc::ByteBuffer& reply) { return news_.next(reply, scope_.record); }

// ---- DetectCall ----

DetectCall::DetectCall(Engine& engine, const Incoming& incoming, const grpc::ByteBuffer* request)
    : ReplyStream("Detect", incoming), engine_(engine), request_(request) {}

void DetectCall::begin() {
  scope_.check();
  const auto request = received<v1::DetectRequest>(*request_, scope_.record);
  scope_.record.geometry = request.geometry_id();
  scope_.note_subject();
  const std::weak_ptr<DetectCall> weak = std::static_pointer_cast<DetectCall>(shared_from_this());
  engine_.detect(request, scope_.call(), [weak](Engine::Outcome<Engine::DetectReplies> outcome) {
    if (const auto self = weak.lock()) self->note_outcome(std::move(outcome));
  });
}

void DetectCall::note_outcome(Engine::Outcome<Engine::DetectReplies> outcome) {
  {
    const std::lock_guard lock(news_mutex_);
    outcome_ = std::move(outcome);
  }
  wake();
}

DetectCall::Next DetectCall::next(grpc::ByteBuffer& reply) {
  if (!replies_) {
    const std::lock_guard lock(news_mutex_);
    if (!outcome_) return Next::wait;
    replies_ = taken(*outcome_, scope_.record, "the detection");
  }
  if (sent_ == replies_->size()) return Next::end;
  reply = serialized((*replies_)[sent_++]);
  return Next::write;
}

// ---- BasisCall ----

BasisCall::BasisCall(Engine& engine, const Incoming& incoming, const grpc::ByteBuffer* request)
    : ReplyStream("GetBasis", incoming), engine_(engine), request_(request) {}

void BasisCall::begin() {
  scope_.check();
  const auto request = received<v1::GetBasisRequest>(*request_, scope_.record);
  scope_.record.system = request.system_id();
  const std::weak_ptr<BasisCall> weak = std::static_pointer_cast<BasisCall>(shared_from_this());
  engine_.get_basis(request, scope_.call(), [weak](Engine::Outcome<Records> outcome) {
    if (const auto self = weak.lock()) self->note_outcome(std::move(outcome));
  });
}

void BasisCall::note_outcome(Engine::Outcome<Records> outcome) {
  {
    const std::lock_guard lock(news_mutex_);
    outcome_ = std::move(outcome);
  }
  wake();
}

BasisCall::Next BasisCall::next(grpc::ByteBuffer& reply) {
  v1::BasisReply message;
  if (!records_) {
    {
      const std::lock_guard lock(news_mutex_);
      if (!outcome_) return Next::wait;
      records_ = taken(*outcome_, scope_.record, "the basis");
    }
    *message.mutable_header() = records_->header();
  } else if (!records_->next(*message.mutable_records())) {
    return Next::end;
  }
  reply = serialized(message);
  return Next::write;
}

// ---- SetupCall ----

SetupCall::SetupCall(Engine& engine, const Incoming& incoming, const grpc::ByteBuffer* request)
    : ReplyStream("GetSetup", incoming), engine_(engine), request_(request) {}

void SetupCall::begin() {
  scope_.check();
  const auto request = received<v1::GetSetupRequest>(*request_, scope_.record);
  scope_.record.system = request.system_id();
  scope_.note_subject();
  setup_ = engine_.get_setup(request.system_id(), scope_.call());
  scope_.hold(setup_.size());  // until it is read
}

SetupCall::Next SetupCall::next(grpc::ByteBuffer& reply) {
  if (sent_ == setup_.size()) return Next::end;
  v1::SetupPiece piece;
  piece.set_data(setup_.substr(sent_, setup_piece_bytes));
  sent_ += piece.data().size();
  reply = serialized(piece);
  return Next::write;
}

// ---- PointsCall ----

PointsCall::PointsCall(Engine& engine, const Incoming& incoming, const grpc::ByteBuffer* request)
    : ReplyStream("GetPoints", incoming), engine_(engine), request_(request) {}

void PointsCall::begin() {
  scope_.check();
  const auto request = received<v1::GetPointsRequest>(*request_, scope_.record);
  scope_.record.geometry = request.id();
  scope_.note_subject();
  points_ = engine_.get_points(request.id(), scope_.call());
  scope_.record.points = points_->size();
}

PointsCall::Next PointsCall::next(grpc::ByteBuffer& reply) {
  if (sent_ == points_->size()) return Next::end;
  const std::size_t end = std::min(sent_ + chunk_points, points_->size());
  reply = serialized_chunk(points_, sent_, end);
  sent_ = end;
  return Next::write;
}

// ---- RegisterCall ----

RegisterCall::RegisterCall(Engine& engine, const Incoming& incoming, grpc::ByteBuffer* reply, ThreadPool& pool)
    : RequestStream("RegisterGeometry", incoming, reply, pool), engine_(engine) {}

RegisterCall::Then RegisterCall::message(const grpc::ByteBuffer& bytes) {
  v1::RegisterGeometryRequest request;
  parse(bytes, request);
  if (upload_) {
    upload_->add(request);
    return Then::read;
  }
  if (!request.has_header()) {
    throw Error(ErrorCode::invalid_argument, "the first message of RegisterGeometry must be its header");
  }
  scope_.record.name = request.header().name();
  scope_.call().open->set_subject(request.header().id(), "");
  scope_.record.points = request.header().point_count();
  upload_ = engine_.begin_upload(request.header(), scope_.call());
  if (!upload_->already_stored()) return Then::read;
  half_closed();  // what else the client sends is not needed
  return Then::later;
}

void RegisterCall::half_closed() {
  if (!upload_) throw incomplete("the header of RegisterGeometry");
  const v1::GeometryInfo info = upload_->finish();
  scope_.record.geometry = info.id();
  scope_.record.points = info.points();
  answer(std::nullopt, &info);
}

// ---- VectorJacobianCall ----

VectorJacobianCall::VectorJacobianCall(Engine& engine, const Incoming& incoming, grpc::ByteBuffer* reply, ThreadPool& pool)
    : RequestStream("VectorJacobian", incoming, reply, pool), engine_(engine) {}

VectorJacobianCall::Then VectorJacobianCall::message(const grpc::ByteBuffer& bytes) {
  v1::VectorJacobianRequest request;
  parse(bytes, request);
  if (header_.has_value() == request.has_header()) {
    throw Error(ErrorCode::invalid_argument,
                header_ ? "VectorJacobian: a second header" : "the first message of VectorJacobian must be its header");
  }
  if (request.has_header()) {
    begin(request.header());
  } else {
    append(request.cotangent());
  }
  return Then::read;
}

void VectorJacobianCall::begin(const v1::VectorJacobianHeader& header) {
  header_ = header;
  scope_.record.system = header.system_id();
  scope_.note_subject();
  const std::size_t count = check_cotangent_count(header);
  scope_.record.points = engine_.get_system(header.system_id(), scope_.call()).points();
  expected_points_ = count * scope_.record.points;
}

void VectorJacobianCall::append(const std::string& bytes) {
  const std::size_t room = expected_points_ * sizeof(Vec3) - received_;
  if (bytes.size() > room) {
    throw Error(ErrorCode::invalid_argument, "cotangent: more than " + std::to_string(expected_points_) + " points of 24 bytes");
  }
  // Grows with what has really come, so that a header alone costs nothing.
  scope_.hold(bytes.size());
  cotangent_.resize((received_ + bytes.size() + sizeof(Vec3) - 1) / sizeof(Vec3));
  std::memcpy(reinterpret_cast<char*>(cotangent_.data()) + received_, bytes.data(), bytes.size());
  received_ += bytes.size();
}

void VectorJacobianCall::half_closed() {
  if (!header_) throw incomplete("the header of VectorJacobian");
  if (received_ != expected_points_ * sizeof(Vec3)) {
    throw Error(ErrorCode::invalid_argument, "cotangent: " + std::to_string(received_) + " bytes, " +
                                                 std::to_string(expected_points_) + " points of 24 bytes are needed");
  }
  const std::weak_ptr<VectorJacobianCall> weak = std::static_pointer_cast<VectorJacobianCall>(shared_from_this());
  engine_.vector_jacobian(*header_, std::move(cotangent_), scope_.call(),
                          [weak](Engine::Outcome<v1::VectorJacobianReply> outcome) {
                            const auto self = weak.lock();
                            if (!self) return;
                            if (!outcome.error && !outcome.value) {
                              outcome.error = Error(ErrorCode::internal, "the product ended with neither a value nor an error");
                            }
                            self->answer(outcome.error, outcome.value ? &*outcome.value : nullptr, outcome.stats);
                          });
}

}  // namespace deform::server
