// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/streams/large_setups.h"

#include <google/protobuf/io/zero_copy_stream_impl.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <deque>
#include <utility>

#include "core/base/number_text.h"
#include "proto/convert/base/parsed_size.h"
#include "server/rpc/service_messages.h"
#include "server/rpc/status.h"

namespace deform::server {

namespace {

constexpr std::size_t most_growth = 8;  ///< of a setup that is parsed
constexpr std::uint32_t busy_retry_ms = 200;

/// The pieces as one stream of bytes.
class JoinedPieces {
 public:
  explicit JoinedPieces(const std::vector<std::string>& pieces) {
    for (const std::string& piece : pieces) {
      streams_.emplace_back(piece.data(), static_cast<int>(piece.size()));
      pointers_.push_back(&streams_.back());
    }
    joined_.emplace(pointers_.data(), static_cast<int>(pointers_.size()));
  }
  google::protobuf::io::ZeroCopyInputStream& stream() { return *joined_; }

 private:
  std::deque<google::protobuf::io::ArrayInputStream> streams_;
  std::vector<google::protobuf::io::ZeroCopyInputStream*> pointers_;
  std::optional<google::protobuf::io::ConcatenatingInputStream> joined_;
};

/// One message of either call.
template <typename Message, typename Request>
void take_part(Message&& message, Request& request, SetupPieces& pieces, const CallScope& scope) {
  if (message.has_header()) {
    if (pieces.begun()) throw Error(ErrorCode::invalid_argument, "header: sent twice");
    if (message.header().request().has_setup()) {
      throw Error(ErrorCode::invalid_argument, "header.request.setup: must be absent, its bytes come in pieces");
    }
    pieces.begin(message.header().setup(), scope);
    request = std::move(*message.mutable_header()->mutable_request());
  } else if (message.setup().empty()) {
    throw Error(ErrorCode::invalid_argument, "neither header nor setup is set");
  }
  pieces.add(std::move(*message.mutable_setup()), scope);
}

void note_setup(const v1::Setup& setup, CallScope& scope) {
  scope.record.geometry = setup.geometry();
  scope.note_subject();
}

}  // namespace

// ---- SetupPieces ----

void SetupPieces::begin(const v1::LargeSetupHeader& header, const CallScope& scope) {
  if (header.bytes() == 0 || header.bytes() > most_) {
    throw Error(ErrorCode::invalid_argument, "header.setup.bytes: " + std::to_string(header.bytes()) + ", expected 1 to " +
                                                 std::to_string(most_) + " (--max-setup-bytes of the server)");
  }
  scope.take(header.bytes());  // given back at once: what counts is what comes
  expected_ = header.bytes();
}

void SetupPieces::add(std::string&& piece, const CallScope& scope) {
  if (!begun()) throw Error(ErrorCode::invalid_argument, "setup: the first message must have the header");
  if (piece.size() > expected_ - received_) {
    throw Error(ErrorCode::invalid_argument,
                "setup: more than the " + std::to_string(expected_) + " bytes that the header announced");
  }
  if (piece.empty()) return;
  held_.push_back(scope.take(piece.capacity() + sizeof(piece)));
  received_ += piece.size();
  pieces_.push_back(std::move(piece));
  scope.call().open->set_request_bytes(received_);
}

void SetupPieces::take(v1::Setup& setup, CallScope& scope) {
  if (!begun()) throw Error(ErrorCode::invalid_argument, "the stream ended before its header");
  if (received_ != expected_) {
    throw Error(ErrorCode::invalid_argument, "setup: " + std::to_string(received_) + " of the " + std::to_string(expected_) +
                                                 " bytes that the header announced arrived");
  }
  const std::size_t most_parsed = most_growth * most_;
  const std::size_t parsed = convert::parsed_size(JoinedPieces(pieces_).stream(), *v1::Setup::descriptor(), most_parsed);
  if (parsed > most_parsed) {
    throw Error(ErrorCode::invalid_argument,
                "setup: it has so many parts that it would take more than " + std::to_string(most_parsed) + " bytes of memory");
  }
  scope.hold(parsed);
  if (!setup.ParseFromZeroCopyStream(&JoinedPieces(pieces_).stream())) {
    throw Error(ErrorCode::invalid_argument, "setup: the " + std::to_string(received_) +
                                                 " bytes are not a deform.v1.Setup (damaged, nested deeper than 100, or text "
                                                 "that is not UTF-8)");
  }
  pieces_.clear();
  held_.clear();
}

// ---- LargeEstimateCall ----

LargeEstimateCall::LargeEstimateCall(Engine& engine, std::size_t most_bytes, const Incoming& incoming, grpc::ByteBuffer* reply,
                                     ThreadPool& pool)
    : RequestStream("EstimateLarge", incoming, reply, pool), engine_(engine), pieces_(most_bytes) {}

LargeEstimateCall::Then LargeEstimateCall::message(const grpc::ByteBuffer& bytes) {
  v1::EstimateLargeRequest message;
  parse(bytes, message);
  take_part(std::move(message), request_, pieces_, scope_);
  return Then::read;
}

void LargeEstimateCall::half_closed() {
  pieces_.take(*request_.mutable_setup(), scope_);
  note_setup(request_.setup(), scope_);
  const std::weak_ptr<LargeEstimateCall> weak = std::static_pointer_cast<LargeEstimateCall>(shared_from_this());
  engine_.estimate(std::move(request_), scope_.call(), [weak](Engine::Outcome<v1::EstimateReply> outcome) {
    const auto self = weak.lock();
    if (!self) return;
    if (!outcome.error && !outcome.value) {
      outcome.error = Error(ErrorCode::internal, "the estimate ended with neither a result nor an error");
    }
    if (outcome.value) outcome.stats.system_id = outcome.value->system_id();
    self->answer(outcome.error, outcome.value ? &*outcome.value : nullptr, outcome.stats);
  });
}

// ---- LargePrepareCall ----

LargePrepareCall::LargePrepareCall(Engine& engine, std::size_t most_bytes, const Incoming& incoming, ThreadPool& pool)
    : ReplyWriter("PrepareLarge", incoming), engine_(engine), pool_(pool), pieces_(most_bytes) {}

void LargePrepareCall::begin() { read(); }

void LargePrepareCall::read() {
  scope_.await(OpenCall::Client::sends);
  StartRead(&message_);
}

void LargePrepareCall::OnReadDone(bool ok) {
  scope_.came(OpenCall::Client::sends);
  auto error = caught([&] { ok ? take(message_) : half_closed(); });
  message_.Clear();  // the next one may never come, and this one is charged no longer
  if (!error) return ok ? read() : void();
  {
    const std::lock_guard lock(mutex_);
    failure_ = std::move(error);
  }
  wake();
}

void LargePrepareCall::take(const grpc::ByteBuffer& bytes) {
  scope_.check_access();  // the caller may have been struck out since the stream was opened
  scope_.check();
  const auto held = scope_.hold(bytes);
  ++messages_in_;
  bytes_in_ += bytes.Length();
  v1::PrepareLargeRequest message;
  parse(bytes, message);
  take_part(std::move(message), request_, pieces_, scope_);
}

/// What follows takes a while, and the engine asks the disk.
void LargePrepareCall::half_closed() {
  {
    const std::lock_guard lock(mutex_);
    all_read_ = true;
  }
  const auto self = std::static_pointer_cast<LargePrepareCall>(shared_from_this());
  if (pool_.try_post([self] { self->wake(); })) return;
  throw Error(ErrorCode::out_of_budget, "too many calls are waiting, try again later", busy_retry_ms).refused_for(Refusal::queue);
}

void LargePrepareCall::ask() {
  scope_.check();
  pieces_.take(*request_.mutable_setup(), scope_);
  note_setup(request_.setup(), scope_);
  prepare_for(std::static_pointer_cast<LargePrepareCall>(shared_from_this()), &LargePrepareCall::news_, engine_, request_,
              scope_.call());
  request_.Clear();
}

LargePrepareCall::Next LargePrepareCall::next(grpc::ByteBuffer& reply) {
  {
    const std::lock_guard lock(mutex_);
    if (failure_) throw Error(*failure_);
    if (!all_read_) return Next::wait;
  }
  if (!std::exchange(asked_, true)) ask();
  return news_.next(reply, scope_.record);
}

void LargePrepareCall::done() noexcept {
  scope_.record.messages_in = messages_in_;
  scope_.record.bytes_in = bytes_in_;
}

}  // namespace deform::server
