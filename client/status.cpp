// SPDX-License-Identifier: Apache-2.0
#include "client/status.h"

#include "proto/convert/base/error.h"

namespace deform::client {

namespace {

std::uint32_t retry_hint(const grpc::ClientContext& context) {
  const auto& trailing = context.GetServerTrailingMetadata();
  const auto found = trailing.find(convert::retry_after_key);
  return found == trailing.end() ? 0 : convert::retry_hint({found->second.data(), found->second.size()});
}

/// Statuses that gRPC makes itself when there is no connection.
bool not_connected(const std::string& message) {
  for (const char* start : {"failed to connect", "DNS resolution failed", "connections to all backends failing"}) {
    if (message.starts_with(start)) return true;
  }
  return false;
}

}  // namespace

bool failed_handshake(const grpc::Status& status) {
  const std::string message = status.error_message();
  if (status.error_code() != grpc::StatusCode::UNAVAILABLE || !not_connected(message)) return false;
  for (const char* nobody : {"Connection refused", "No such file", "DNS resolution"}) {
    if (message.find(nobody) != std::string::npos) return false;
  }
  return true;
}

Error to_error(const grpc::Status& status, const grpc::ClientContext& context, const std::string& address) {
  const ErrorCode code = convert::error_code(static_cast<std::uint32_t>(status.error_code()));
  std::string message = status.error_message();
  if (code == ErrorCode::unavailable && not_connected(message)) {
    message = "cannot reach deformd at " + address + "; start it, or name another server";
  } else if (code == ErrorCode::unavailable && (message == "Socket closed" || message.find("recvmsg") != std::string::npos)) {
    message = "lost the connection to deformd at " + address;
  } else if (code == ErrorCode::deadline_exceeded && message == "Deadline Exceeded") {
    message = "deformd at " + address + " did not answer before the deadline";
  } else if (code == ErrorCode::cancelled && (message.empty() || message == "CANCELLED")) {
    message = "cancelled";
  } else if (status.error_code() == grpc::StatusCode::UNIMPLEMENTED) {
    message = "the server at " + address + " does not offer this call; is it deformd of another version?";
  } else if (message.empty()) {
    message =
        "the server at " + address + " ended the call without a message (status " + std::to_string(status.error_code()) + ")";
  }
  return {code, message, retry_hint(context)};
}

}  // namespace deform::client
