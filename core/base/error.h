// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace deform {

/// Says where the fault lies and what the caller can do about it. Mapped to a gRPC status in server/rpc/status.cpp only.
enum class ErrorCode {
  invalid_argument,     ///< the caller's input is wrong; the message names field, index and limit
  not_found,            ///< no object has this id or name
  already_exists,       ///< the name is already in use
  failed_precondition,  ///< valid input in the wrong state (a geometry is still in use, ...)
  unauthenticated,      ///< the server requires an identity, and the call has none or an unknown one
  permission_denied,    ///< the caller is known and may not do this
  out_of_budget,        ///< more memory, queue space or time needed than allowed; the message gives the numbers
  numerical_failure,    ///< the mathematics broke down (singular system, ...)
  cancelled,            ///< the caller cancelled
  deadline_exceeded,    ///< the caller's deadline passed
  data_loss,            ///< stored or transmitted bytes violate their checksum or format
  unavailable,          ///< temporary; try again
  internal,             ///< a bug
};

/// The one exception type of core, codec, server and client. Not converging is a result, never an Error.
class Error : public std::runtime_error {
 public:
  /// The message is made of whole sentences that can be shown to a user. For retry_after_ms see the accessor.
  Error(ErrorCode code, const std::string& message, std::uint32_t retry_after_ms = 0)
      : std::runtime_error(message), code_(code), retry_after_ms_(retry_after_ms) {}
  /// The kind of error.
  ErrorCode code() const { return code_; }
  /// For out_of_budget and unavailable: the time in milliseconds after which the same request may succeed. 0 means that only a
  /// different request can succeed.
  std::uint32_t retry_after_ms() const { return retry_after_ms_; }

 private:
  ErrorCode code_;
  std::uint32_t retry_after_ms_;
};

/// The name of the code in snake case ("invalid_argument").
const char* to_string(ErrorCode code);

/// For "did you mean" hints: up to three of `candidates` nearest to `name` by edit distance, quoted and separated by commas;
/// empty if none is near.
std::string nearest_names(const std::string& name, const std::vector<std::string>& candidates);

}  // namespace deform
