// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
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

/// What there is too little of, where a server refuses what it could do at another time or for another caller.
enum class Refusal {
  none,      ///< not refused for the state of the server
  queue,     ///< places among those that wait
  memory,    ///< memory, or memory within the budget
  held,      ///< memory for requests and answers that are held
  quota,     ///< what the tenant may store or do at once
  rate,      ///< requests per second of the tenant
  disk,      ///< room on the disk
  draining,  ///< the server ends, or takes no new work
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
  /// The same error, of which clients get other words: what() is then for those who look after the server, and names what is
  /// nobody else's business, such as the folders of its machine.
  Error with_public_message(const std::string& message) const {
    Error error(*this);
    error.public_ = std::make_shared<const std::string>(message);
    return error;
  }
  /// The same error as a refusal of that kind, which is counted by it.
  Error refused_for(Refusal reason) const {
    Error error(*this);
    error.refusal_ = reason;
    return error;
  }
  /// What there was too little of, if it is a refusal.
  Refusal refusal() const { return refusal_; }
  /// The words for clients: what(), unless with_public_message() gave it other words.
  const char* public_message() const { return public_ ? public_->c_str() : what(); }

 private:
  ErrorCode code_;
  std::uint32_t retry_after_ms_;
  Refusal refusal_ = Refusal::none;
  std::shared_ptr<const std::string> public_;  // null: what(); shared, so that copying cannot fail
};

/// The name of the code in snake case ("invalid_argument").
const char* to_string(ErrorCode code);
const char* to_string(Refusal reason);

/// For "did you mean" hints: up to three of `candidates` nearest to `name` by edit distance, quoted and separated by commas;
/// empty if none is near.
std::string nearest_names(const std::string& name, const std::vector<std::string>& candidates);

}  // namespace deform
