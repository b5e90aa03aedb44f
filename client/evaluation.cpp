// SPDX-License-Identifier: Apache-2.0
#include "client/evaluation.h"

#include <algorithm>
#include <string>
#include <thread>
#include <utility>

#include "proto/convert/base/block.h"

namespace deform::client {

namespace {

[[noreturn]] void refuse_reply(const std::string& what) { throw Error(ErrorCode::data_loss, "reply of the server: " + what); }

}  // namespace

EvaluationCall::EvaluationCall(Attempt& attempt, const v1::EvaluateHeader& header)
    : attempt_(attempt), header_(header), stream_(attempt.stub().Evaluate(&attempt.context)) {}

void EvaluationCall::let_writer_go(bool accepted) {
  if (std::exchange(writer_waits_, false)) accepted_.set_value(accepted);
}

void EvaluationCall::fail(std::exception_ptr error) {
  {
    const std::lock_guard lock(mutex_);
    if (!error_) error_ = std::move(error);
  }
  attempt_.context.TryCancel();
}

v1::EvaluateResult EvaluationCall::run(const PointSource& source, const PointSink& sink) {
  std::thread writer([&] {
    try {
      write(source);
    } catch (...) {
      fail(std::current_exception());
    }
  });
  v1::EvaluateReply reply;
  bool broken = false;
  while (stream_->Read(&reply)) {
    if (broken) continue;  // to the end: Finish() wants nothing unread
    try {
      take(std::move(reply), sink);
    } catch (...) {
      fail(std::current_exception());
      broken = true;
    }
  }
  let_writer_go(false);
  writer.join();
  const grpc::Status status = stream_->Finish();
  if (error_) std::rethrow_exception(error_);
  attempt_.check(status);
  if (!has_result_) refuse_reply("it ends before its result");
  check_result();
  return std::move(result_);
}

void EvaluationCall::write(const PointSource& source) {
  v1::EvaluateRequest message;
  *message.mutable_header() = header_;
  if (!stream_->Write(message)) return;  // the status tells why
  if (!accepted_.get_future().get()) return;
  std::vector<Vec3> points(block_points);
  std::uint64_t first = 0;
  for (std::uint32_t number = 0;; ++number) {
    const std::size_t count = source(points);
    if (count > points.size()) {
      throw Error(ErrorCode::invalid_argument, "evaluate: the source gave " + std::to_string(count) +
                                                   " points, it was asked for at most " + std::to_string(points.size()));
    }
    if (count == 0) break;
    const std::span<const Vec3> block(points.data(), count);
    {
      const std::lock_guard lock(mutex_);
      sent_.emplace_back(block.begin(), block.end());
    }
    v1::Block& to = *message.mutable_points();
    to.Clear();
    to.set_block(number);
    to.set_first(first);
    convert::block_to_proto(codec::encode(block, block, {codec::Encoding::raw_f64, 0}), to);
    if (!stream_->Write(message)) return;
    first += count;
  }
  stream_->WritesDone();
}

void EvaluationCall::take(v1::EvaluateReply&& reply, const PointSink& sink) {
  if (has_result_) refuse_reply("something comes after the result");
  if (reply.part_case() == v1::EvaluateReply::PART_NOT_SET) return;  // of a newer server
  if (reply.has_info() == has_info_) refuse_reply(has_info_ ? "a second header" : "it does not begin with its header");
  if (reply.has_info()) {
    has_info_ = true;
    let_writer_go(true);
  } else if (reply.has_block()) {
    take_block(std::move(*reply.mutable_block()), sink);
  } else {
    result_ = std::move(*reply.mutable_result());
    has_result_ = true;
  }
}

void EvaluationCall::take_block(v1::Block&& message, const PointSink& sink) {
  std::vector<Vec3> sent;
  {
    const std::lock_guard lock(mutex_);
    if (sent_.empty()) refuse_reply("a block that was not asked for");
    sent = std::move(sent_.front());
    sent_.pop_front();
  }
  const std::string name = "block " + std::to_string(message.block());
  if (message.design() != 0 || message.block() != blocks_ || message.first() != points_ || message.count() != sent.size()) {
    refuse_reply(name + " of " + std::to_string(message.count()) + " points from " + std::to_string(message.first()) +
                 " on, block " + std::to_string(blocks_) + " of " + std::to_string(sent.size()) + " points from " +
                 std::to_string(points_) + " on was asked for");
  }
  const bool as_asked = message.encoding() == header_.output().encoding() && !message.fell_back();
  if (!as_asked && !(message.encoding() == v1::RAW_F64 && message.fell_back())) refuse_reply(name + " has another encoding");
  std::vector<Vec3> moved(sent.size());
  const codec::Block block = convert::block_from_proto(std::move(message));
  codec::decode(block, sent, moved);
  checksum_.add(block.checksum);
  sink(points_, moved);
  points_ += moved.size();
  ++blocks_;
}

void EvaluationCall::check_result() const {
  if (!sent_.empty() || result_.points() != points_) {
    refuse_reply("a result on " + std::to_string(result_.points()) + " points after " + std::to_string(points_));
  }
  if (result_.checksum() != checksum_.value()) refuse_reply("the checksum of the result does not match its blocks");
}

}  // namespace deform::client
