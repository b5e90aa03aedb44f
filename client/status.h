// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/client_context.h>
#include <grpcpp/support/status.h>

#include <string>

#include "core/base/error.h"

namespace deform::client {

/// No connection came about: nothing was sent, so that any call may be repeated.
class NotConnected : public Error {
 public:
  /// silent: as the accessor.
  NotConnected(const std::string& message, bool silent) : Error(ErrorCode::unavailable, message), silent_(silent) {}
  /// The time of an attempt to connect passed, or gRPC gave it up for no reason: the server may be busy, and waiting helps.
  bool silent() const { return silent_; }

 private:
  bool silent_;
};

/// Whether a connection was answered and came to nothing, rather than that no process listened at the address or answered in
/// time.
bool failed_handshake(const grpc::Status& status);

/// A proxy reset the call without a status: the server behind it went, or ended the call before all of the request had come, of
/// which haproxy 2.6 drops the status (its issue 1219).
bool cut_short(const grpc::Status& status);

/// Throws a status that is not OK as an Error with the server's message; the retry hint is read from the trailing metadata of the
/// finished call. Where there was no connection to `address`, a NotConnected that says why; else a CallError with the id.
[[noreturn]] void throw_error(const grpc::Status& status, const grpc::ClientContext& context, const std::string& address,
                              const std::string& request_id);

}  // namespace deform::client
