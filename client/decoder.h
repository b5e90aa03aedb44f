// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "client/client.h"
#include "core/base/thread_pool.h"

namespace deform::client {

/// Turns the replies to one request (deformation.proto, DeformReply) into designs, while they come. Knows no network.
///
///   add(header), add(block) ... add(result), add(summary)      one thread at a time, in order
///        `-> blocks are decoded and verified in the pool -> finished designs go to the sink -> on_done
///
/// Nothing that a reply claims is believed: numbers of points and designs are compared with what the caller holds, so memory is
/// bounded by the designs asked for. Held by shared_ptr: tasks in the pool keep it alive.
class ReplyDecoder : public std::enable_shared_from_this<ReplyDecoder> {
 public:
  /// What was asked for, and who takes the answer.
  struct Options {
    std::size_t designs = 1;                       ///< asked for
    v1::Encoding encoding = v1::ENCODING_DEFAULT;  ///< asked for; RAW_F64 is always accepted when a block fell back to it
    v1::Failures failures = v1::FAILURES_DEFAULT;  ///< asked for; designs with errors are refused but for FAILURES_PER_DESIGN
    DesignSink sink;                               ///< may be empty
    DesignMemory memory = {};                      ///< may be empty
    /// The registered points of a geometry. Called once, with the header, in add().
    std::function<std::shared_ptr<const Points>(const std::string& geometry_id)> points_of;
    std::function<void()> on_failed;  ///< a task or the sink failed: nothing more needs to come. May be empty; any thread
    /// Exactly once, when everything is decoded and delivered or the first failure is known and no task runs: outcome or error.
    /// Any thread, no lock held; must not throw.
    std::function<void(DeformOutcome&& outcome, std::exception_ptr error)> on_done;
  };

  /// The pool must outlive the decoder.
  ReplyDecoder(Options options, ThreadPool& pool);

  /// Next reply; its content is moved out. Throws Error(data_loss) for what breaks the contract; fail() must follow then. Blocks
  /// while finished designs wait for a slow sink.
  void add(v1::DeformReply&& reply);
  /// Nothing more comes. The first error counts.
  void fail(std::exception_ptr error);
  /// The header was seen. Of the thread that adds.
  bool started() const { return registered_ != nullptr; }
  /// The summary was seen.
  bool complete() const;
  /// The sink took a design: repeating the request would hand it over twice.
  bool delivered() const;

 private:
  struct DesignState {
    // of the thread that adds
    std::uint64_t next_point = 0;
    std::uint32_t next_block = 0;
    std::vector<std::uint64_t> checksums;
    // shared with the tasks; they write disjoint ranges of the points
    std::once_flag allocated;
    DeformedDesign design;
    std::span<Vec3> points;  ///< of the design, or the memory that was given
    // under mutex_
    std::size_t pending = 0;
    bool has_result = false;
  };

  void add_header(const v1::DeformHeader& header);
  void add_block(v1::Block&& block);
  void add_result(const v1::DesignResult& result);
  void check_whole(const v1::DesignResult& result, const DesignState& state) const;
  void check_failed(const v1::DesignResult& result, const DesignState& state) const;
  void add_summary(v1::DeformSummary&& summary);
  DesignState& checked_design(std::uint32_t design, const char* part);
  void check_block(const v1::Block& block, const DesignState& state) const;
  void decode(std::size_t design, v1::Block& block);
  void allocate(std::size_t design, DesignState& state) const;
  void finish_design(std::unique_lock<std::mutex>& lock, std::size_t design);
  void deliver(std::unique_lock<std::mutex>& lock);
  void note_failure(std::unique_lock<std::mutex>& lock, std::exception_ptr error);
  void settle(std::unique_lock<std::mutex>& lock);

  const Options options_;
  ThreadPool& pool_;
  const RunContext::Clock::time_point started_ = RunContext::Clock::now();
  // of the thread that adds; constant once tasks exist
  std::shared_ptr<const Points> registered_;
  std::unique_ptr<DesignState[]> designs_;

  mutable std::mutex mutex_;
  // under mutex_
  std::condition_variable room_;
  std::deque<std::size_t> finished_;  ///< wait for the sink
  std::size_t unfinished_ = 0;        ///< designs
  std::size_t running_ = 0;           ///< tasks
  bool delivering_ = false;
  bool delivered_ = false;
  bool complete_ = false;
  bool done_ = false;
  std::exception_ptr error_;
  DeformOutcome outcome_;
};

}  // namespace deform::client
