#include "client/status.h"

#include <charconv>

namespace deform::client {

ErrorCode to_error_code(int status_code) {
  switch (status_code) {
    case grpc::StatusCode::INVALID_ARGUMENT:
    case grpc::StatusCode::OUT_OF_RANGE:
      return ErrorCode::invalid_argument;
    case grpc::StatusCode::NOT_FOUND:
      return ErrorCode::not_found;
    case grpc::StatusCode::ALREADY_EXISTS:
      return ErrorCode::already_exists;
    case grpc::StatusCode::FAILED_PRECONDITION:
    case grpc::StatusCode::PERMISSION_DENIED:
    case grpc::StatusCode::UNAUTHENTICATED:
    case grpc::StatusCode::UNIMPLEMENTED:
      return ErrorCode::failed_precondition;
    case grpc::StatusCode::RESOURCE_EXHAUSTED:
      return ErrorCode::out_of_budget;
    case grpc::StatusCode::ABORTED:
      return ErrorCode::numerical_failure;
    case grpc::StatusCode::CANCELLED:
      return ErrorCode::cancelled;
    case grpc::StatusCode::DEADLINE_EXCEEDED:
      return ErrorCode::deadline_exceeded;
    case grpc::StatusCode::DATA_LOSS:
      return ErrorCode::data_loss;
    case grpc::StatusCode::UNAVAILABLE:
      return ErrorCode::unavailable;
    default:
      return ErrorCode::internal;
  }
}

namespace {

std::uint32_t retry_hint(const grpc::ClientContext& context) {
  const auto& trailing = context.GetServerTrailingMetadata();
  const auto found = trailing.find("retry-after-ms");
  if (found == trailing.end()) return 0;
  std::uint32_t value = 0;
  const char* begin = found->second.data();
  const char* end = begin + found->second.size();
  const auto [stopped, failure] = std::from_chars(begin, end, value);
  return failure == std::errc() && stopped == end ? value : 0;
}

/// Statuses that gRPC makes itself when there is no connection.
bool not_connected(const std::string& message) {
  for (const char* start : {"failed to connect", "DNS resolution failed", "connections to all backends failing"}) {
    if (message.starts_with(start)) return true;
  }
  return false;
}

}  // namespace

Error to_error(const grpc::Status& status, const grpc::ClientContext& context, const std::string& address) {
  const ErrorCode code = to_error_code(status.error_code());
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
