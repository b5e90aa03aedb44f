// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <exception>
#include <future>
#include <mutex>
#include <vector>

#include "client/client.h"
#include "client/connection.h"
#include "core/codec/block.h"

namespace deform::client {

/// One attempt of Evaluate: a thread of its own writes the blocks that a source fills, the calling thread reads the answers. The
/// server reads ahead by a few blocks only, so that no more than these are in memory. The source is asked once the server has
/// accepted the design, so that a call that is refused can be repeated.
class EvaluationCall {
 public:
  /// Points per block sent: 768 KiB.
  static constexpr std::size_t block_points = std::size_t{1} << 15;

  /// The header names its encoding.
  EvaluationCall(Attempt& attempt, const v1::EvaluateHeader& header);

  /// Runs to the end. Throws what source and sink throw, Error(data_loss) for answers that are none, and the Error of the status.
  v1::EvaluateResult run(const PointSource& source, const PointSink& sink);

 private:
  void write(const PointSource& source);
  void take(v1::EvaluateReply&& reply, const PointSink& sink);
  void take_block(v1::Block&& message, const PointSink& sink);
  void check_result() const;
  void fail(std::exception_ptr error);
  void let_writer_go(bool accepted);

  Attempt& attempt_;
  const v1::EvaluateHeader header_;
  const std::unique_ptr<grpc::ClientReaderWriterInterface<v1::EvaluateRequest, v1::EvaluateReply>> stream_;
  // of the reader
  bool has_info_ = false, has_result_ = false;
  bool writer_waits_ = true;
  std::uint64_t points_ = 0;
  std::uint32_t blocks_ = 0;
  codec::ChecksumFold checksum_;
  v1::EvaluateResult result_;

  std::promise<bool> accepted_;  ///< whether points are wanted, once that is known

  std::mutex mutex_;
  // under mutex_
  std::deque<std::vector<Vec3>> sent_;  ///< blocks that wait for their answers
  std::exception_ptr error_;            ///< the first one
};

}  // namespace deform::client
