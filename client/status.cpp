// SPDX-License-Identifier: Apache-2.0
#include "client/status.h"

#include <algorithm>
#include <iterator>
#include <string_view>

#include "client/call_error.h"
#include "proto/convert/base/error.h"

namespace deform::client {

namespace {

std::uint32_t retry_hint(const grpc::ClientContext& context) {
  const auto& trailing = context.GetServerTrailingMetadata();
  const auto found = trailing.find(convert::retry_after_key);
  return found == trailing.end() ? 0 : convert::retry_hint({found->second.data(), found->second.size()});
}

constexpr std::string_view reset = "Received RST_STREAM with error code";

/// The connection went, or a proxy lost the server behind it. gRPC has UNKNOWN and INTERNAL for some of these.
bool lost_stream(const grpc::Status& status) {
  const std::string message = status.error_message();
  switch (status.error_code()) {
    case grpc::StatusCode::UNAVAILABLE:
      return message == "Socket closed" || message.starts_with(reset) || message.find("recvmsg") != std::string::npos;
    case grpc::StatusCode::UNKNOWN:
      return message == "Stream removed";
    case grpc::StatusCode::INTERNAL:
    case grpc::StatusCode::CANCELLED:  // by a proxy; what is cancelled here says something else
      return message.starts_with(reset);
    default:
      return false;
  }
}

/// What gRPC says of an answer that is none of its own.
constexpr std::string_view of_proxy = "Received http2 header with status: ";

/// Statuses that gRPC makes itself when there is no connection.
bool not_connected(const std::string& message) {
  for (const char* start : {"failed to connect", "DNS resolution failed", "connections to all backends failing"}) {
    if (message.starts_with(start)) return true;
  }
  return false;
}

struct Obstacle {
  const char* sign;    ///< in gRPC's message
  const char* reason;  ///< for people
  bool answered;       ///< somebody took the connection and said something, or closed it
  bool silent;         ///< the time passed
};

constexpr char closed[] = "it closed the connection: it has too many, wants TLS, or is not deformd";
constexpr char late[] = "it did not answer in time: it is busy, out of reach, or not deformd";
constexpr char no_such_file[] = "No such file";
constexpr Obstacle obstacles[] = {
    {"Connection refused", "nobody listens there", false, false},
    {no_such_file, "there is no such socket", false, false},
    {"DNS resolution", "no machine of that name is known", false, false},
    {"timed out", late, false, true},
    {"imeout", late, false, true},
    {"http1.x", "something other than deformd answers", true, false},
    {"Socket closed", closed, true, false},
    {"reset by peer", closed, true, false},
};

const Obstacle* find_obstacle(const std::string& message) {
  return std::find_if(std::begin(obstacles), std::end(obstacles),
                      [&](const Obstacle& one) { return message.find(one.sign) != std::string::npos; });
}

/// gRPC 1.51 looks at errno after other work than connect(), which may have left ENOENT there: a connection that is coming about
/// then counts as failed. Only sockets with a path can be missing.
bool misread(const std::string& address, const Obstacle& obstacle) {
  return obstacle.sign == no_such_file && !address.starts_with("unix:");
}

/// The reason for a status without a connection: what is known, else gRPC's own words.
NotConnected unreached(const std::string& address, const std::string& message) {
  const auto* known = find_obstacle(message);
  const bool none = known == std::end(obstacles);
  const bool waits = !none && (known->silent || misread(address, *known));
  const std::string reason = none || waits != known->silent ? message : known->reason;
  return {"cannot reach deformd at " + address + " (" + reason + "); start it, or name another server", waits};
}

}  // namespace

bool cut_short(const grpc::Status& status) {
  return status.error_code() == grpc::StatusCode::CANCELLED && status.error_message().starts_with(reset);
}

bool failed_handshake(const grpc::Status& status) {
  const std::string message = status.error_message();
  if (status.error_code() != grpc::StatusCode::UNAVAILABLE || !not_connected(message)) return false;
  const auto* known = find_obstacle(message);
  return known == std::end(obstacles) || known->answered;
}

void throw_error(const grpc::Status& status, const grpc::ClientContext& context, const std::string& address,
                 const std::string& request_id) {
  const ErrorCode code = convert::error_code(static_cast<std::uint32_t>(status.error_code()));
  std::string message = status.error_message();
  if (code == ErrorCode::unavailable && not_connected(message)) throw unreached(address, message);
  if (lost_stream(status)) {
    throw CallError(Error(ErrorCode::unavailable, "lost the connection to deformd at " + address), request_id);
  }
  if (message.starts_with(of_proxy)) {
    message = "a proxy answers at " + address + ", with HTTP status " + message.substr(of_proxy.size()) +
              ": it has no deformd that takes work, or refuses this client";
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
  throw CallError(Error(code, message, retry_hint(context)), request_id);
}

}  // namespace deform::client
