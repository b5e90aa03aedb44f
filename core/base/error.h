// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace deform {

/// Whose fault an error is and what the caller can do about it. Mapped to gRPC status in server/rpc/status.cpp only.
enum class ErrorCode {
  invalid_argument,     ///< the caller's input is wrong; the message names field, index and limit
  not_found,            ///< an id or name that nothing has
  already_exists,       ///< a name that is taken
  failed_precondition,  ///< right input at the wrong time (a geometry that systems still use, ...)
  out_of_budget,        ///< would need more memory, queue or time than allowed; the message gives the numbers
  numerical_failure,    ///< the mathematics broke down (singular system, ...)
  cancelled,            ///< the caller cancelled
  deadline_exceeded,    ///< the caller's deadline passed
  data_loss,            ///< checksum or format violation of stored or transmitted bytes
  unavailable,          ///< temporary; try again
  internal,             ///< a bug
};

/// The one exception type of core, codec, server and client. Not converging is a result, never an Error.
class Error : public std::runtime_error {
 public:
  /// The message is one sentence or more for people; retry_after_ms is the hint below.
  Error(ErrorCode code, const std::string& message, std::uint32_t retry_after_ms = 0)
      : std::runtime_error(message), code_(code), retry_after_ms_(retry_after_ms) {}
  /// What kind of error it is.
  ErrorCode code() const { return code_; }
  /// With out_of_budget and unavailable: after so long the same request may succeed. 0: no hint, only another request can.
  std::uint32_t retry_after_ms() const { return retry_after_ms_; }

 private:
  ErrorCode code_;
  std::uint32_t retry_after_ms_;
};

/// Lower-case snake name of the code ("invalid_argument").
const char* to_string(ErrorCode code);

/// "did you mean": up to three of `candidates` nearest to `name` by edit distance, quoted and comma-separated; empty if none is
/// near.
std::string nearest_names(const std::string& name, const std::vector<std::string>& candidates);

}  // namespace deform
