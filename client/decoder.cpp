// SPDX-License-Identifier: Apache-2.0
#include "client/decoder.h"

#include <time.h>

#include <cmath>
#include <utility>

#include "core/codec/block.h"
#include "proto/convert/base/block.h"
#include "proto/convert/base/error.h"

namespace deform::client {

namespace {

/// Blocks of fewer points are decoded at once: handing them to another thread costs more.
constexpr std::size_t inline_points = 1024;
/// Finished designs that may wait for a slow sink.
constexpr std::size_t waiting_designs = 2;

double thread_cpu_ms() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
}

[[noreturn]] void refuse(const std::string& what) { throw Error(ErrorCode::data_loss, "reply of the server: " + what); }

std::string text(std::uint64_t number) { return std::to_string(number); }

}  // namespace

ReplyDecoder::ReplyDecoder(Options options, ThreadPool& pool) : options_(std::move(options)), pool_(pool) {
  if (!options_.sink) outcome_.designs.resize(options_.designs);
}

void ReplyDecoder::add(v1::DeformReply&& reply) {
  {
    std::unique_lock lock(mutex_);
    if (error_ || done_) return;  // what still arrives has no reader
    if (complete_) refuse("a message after the summary");
    room_.wait(lock, [this] { return finished_.size() < waiting_designs || error_; });
  }
  if (reply.part_case() != v1::DeformReply::kHeader && !registered_) refuse("the header does not come first");
  switch (reply.part_case()) {
    case v1::DeformReply::kHeader:
      return add_header(reply.header());
    case v1::DeformReply::kBlock:
      return add_block(std::move(*reply.mutable_block()));
    case v1::DeformReply::kResult:
      return add_result(reply.result());
    case v1::DeformReply::kSummary:
      return add_summary(std::move(*reply.mutable_summary()));
    default:
      refuse("an empty message");
  }
}

void ReplyDecoder::add_header(const v1::DeformHeader& header) {
  if (registered_) refuse("a second header");
  if (header.designs() != options_.designs) {
    refuse(text(header.designs()) + " designs, asked were " + text(options_.designs));
  }
  auto points = options_.points_of(header.geometry_id());
  if (header.points() != points->size()) {
    refuse(text(header.points()) + " points, the registered geometry has " + text(points->size()));
  }
  designs_ = std::make_unique<DesignState[]>(options_.designs);
  registered_ = std::move(points);
  const std::lock_guard lock(mutex_);
  unfinished_ = options_.designs;
}

ReplyDecoder::DesignState& ReplyDecoder::checked_design(std::uint32_t design, const char* part) {
  if (design >= options_.designs) {
    refuse(std::string(part) + " of design " + text(design) + ", asked were " + text(options_.designs));
  }
  if (designs_[design].has_result) refuse(std::string(part) + " of design " + text(design) + " after its result");
  return designs_[design];
}

void ReplyDecoder::check_block(const v1::Block& block, const DesignState& state) const {
  const std::string name = "block " + text(block.block()) + " of design " + text(block.design());
  if (block.block() != state.next_block || block.first() != state.next_point) {
    refuse(name + " begins at point " + text(block.first()) + ", expected was block " + text(state.next_block) + " at point " +
           text(state.next_point));
  }
  if (block.count() == 0 || block.count() > codec::max_block_points || block.count() > registered_->size() - block.first()) {
    refuse(name + " has " + text(block.count()) + " points, " + text(registered_->size() - block.first()) +
           " are left and a block has at most " + text(codec::max_block_points));
  }
  const bool raw_instead = block.fell_back() && block.encoding() == v1::RAW_F64;
  const v1::Encoding asked = convert::resolved(options_.encoding);
  if (block.encoding() != asked && !raw_instead) {
    refuse(name + " is " + v1::Encoding_Name(block.encoding()) + ", asked was " + v1::Encoding_Name(asked));
  }
}

void ReplyDecoder::add_block(v1::Block&& block) {
  DesignState& state = checked_design(block.design(), "a block");
  check_block(block, state);
  ++state.next_block;
  state.next_point += block.count();
  state.checksums.push_back(block.checksum());
  {
    const std::lock_guard lock(mutex_);
    ++running_;
    ++state.pending;
  }
  const std::size_t design = block.design();
  if (block.count() <= inline_points) {
    decode(design, block);
    return;
  }
  auto shared = std::make_shared<v1::Block>(std::move(block));
  pool_.post_or_help([self = shared_from_this(), design, shared] { self->decode(design, *shared); });
}

void ReplyDecoder::allocate(std::size_t design, DesignState& state) const {
  const std::size_t points = registered_->size();
  if (!options_.memory) {
    state.design.points.resize(points);
    state.points = state.design.points;
    return;
  }
  state.points = options_.memory(design);
  if (state.points.size() != points) {
    throw Error(ErrorCode::invalid_argument,
                "memory for " + text(state.points.size()) + " points, the registered geometry has " + text(points));
  }
}

void ReplyDecoder::decode(std::size_t design, v1::Block& message) {
  const double started = thread_cpu_ms();
  DesignState& state = designs_[design];
  std::exception_ptr error;
  try {
    // Here and not in the thread that reads: filling the pages takes as long as decoding.
    std::call_once(state.allocated, [&] { allocate(design, state); });
    const std::size_t first = message.first();
    const codec::Block block = convert::block_from_proto(std::move(message));
    codec::decode(block, std::span(*registered_).subspan(first, block.count), state.points.subspan(first, block.count));
  } catch (const Error& e) {
    error =
        std::make_exception_ptr(Error(e.code(), "design " + text(design) + ", block " + text(message.block()) + ": " + e.what()));
  } catch (...) {
    error = std::current_exception();
  }
  std::unique_lock lock(mutex_);
  outcome_.decode_ms += thread_cpu_ms() - started;
  --state.pending;
  if (error) note_failure(lock, error);
  --running_;  // not before: as long as a task runs, what on_failed uses is there
  if (error) {
    room_.notify_all();
  } else if (state.has_result && state.pending == 0) {
    finish_design(lock, design);
  }
  settle(lock);
}

void ReplyDecoder::check_whole(const v1::DesignResult& result, const DesignState& state) const {
  if (state.next_point != registered_->size()) {
    refuse("the result of design " + text(result.design()) + " comes after " + text(state.next_point) + " of " +
           text(registered_->size()) + " points");
  }
  if (codec::fold_checksums(state.checksums) != result.checksum()) {
    refuse("the checksum of design " + text(result.design()) + " does not match its blocks");
  }
  if (!(result.max_error() >= 0)) refuse("the encoding error of design " + text(result.design()) + " is not a distance");
}

void ReplyDecoder::check_failed(const v1::DesignResult& result, const DesignState& state) const {
  const std::string name = "design " + text(result.design());
  if (options_.failures != v1::FAILURES_PER_DESIGN) {
    refuse(name + " has an error, which was to fail the request: " + result.error().message());
  }
  if (state.next_block != 0) refuse(name + " has blocks and an error");
  if (result.error().code() == 0) refuse(name + " has an error without a code");
  v1::DesignResult rest = result;
  rest.clear_design();
  rest.clear_error();
  if (rest.ByteSizeLong() != 0) refuse(name + " has an error and findings about its deformation");
}

void ReplyDecoder::add_result(const v1::DesignResult& result) {
  DesignState& state = checked_design(result.design(), "a result");
  if (result.has_error()) {
    check_failed(result, state);
    state.design.error = convert::error_from_proto(result.error());
  } else {
    check_whole(result, state);
  }
  state.checksums = {};
  std::unique_lock lock(mutex_);
  state.design.result = result;
  state.has_result = true;
  if (state.pending == 0) finish_design(lock, result.design());
  settle(lock);
}

void ReplyDecoder::add_summary(v1::DeformSummary&& summary) {
  for (std::size_t d = 0; d < options_.designs; ++d) {
    if (!designs_[d].has_result) refuse("the summary comes before the result of design " + text(d));
  }
  std::unique_lock lock(mutex_);
  outcome_.summary = std::move(summary);
  complete_ = true;
  settle(lock);
}

void ReplyDecoder::finish_design(std::unique_lock<std::mutex>& lock, std::size_t design) {
  if (!options_.sink) {
    outcome_.designs[design] = std::move(designs_[design].design);
    --unfinished_;
    return;
  }
  finished_.push_back(design);
  deliver(lock);
}

/// A thread that finishes a design while no other one delivers does so, for those that come meanwhile too: one thread at a time,
/// in order.
void ReplyDecoder::deliver(std::unique_lock<std::mutex>& lock) {
  if (delivering_) return;
  delivering_ = true;
  while (!finished_.empty() && !error_) {
    const std::size_t design = finished_.front();
    delivered_ = true;
    lock.unlock();
    std::exception_ptr error;
    try {
      options_.sink(design, std::move(designs_[design].design));
    } catch (...) {
      error = std::current_exception();
    }
    designs_[design].design = {};
    lock.lock();
    finished_.pop_front();
    --unfinished_;
    room_.notify_all();
    if (error) note_failure(lock, error);
  }
  delivering_ = false;
}

void ReplyDecoder::note_failure(std::unique_lock<std::mutex>& lock, std::exception_ptr error) {
  if (error_) return;
  error_ = std::move(error);
  room_.notify_all();
  if (!options_.on_failed) return;
  lock.unlock();
  options_.on_failed();
  lock.lock();
}

void ReplyDecoder::fail(std::exception_ptr error) {
  std::unique_lock lock(mutex_);
  if (!error_) error_ = std::move(error);
  room_.notify_all();
  settle(lock);
}

/// Ends with the lock released when everything is over.
void ReplyDecoder::settle(std::unique_lock<std::mutex>& lock) {
  const bool over = error_ ? true : complete_ && unfinished_ == 0;
  if (done_ || !over || running_ > 0 || delivering_) return;
  done_ = true;
  DeformOutcome outcome;
  if (!error_) {
    outcome = std::move(outcome_);
    const std::chrono::duration<double, std::milli> wall = RunContext::Clock::now() - started_;
    outcome.wall_ms = wall.count();
  }
  const std::exception_ptr error = error_;
  lock.unlock();
  options_.on_done(std::move(outcome), error);
}

bool ReplyDecoder::complete() const {
  const std::lock_guard lock(mutex_);
  return complete_;
}

bool ReplyDecoder::delivered() const {
  const std::lock_guard lock(mutex_);
  return delivered_;
}

}  // namespace deform::client
