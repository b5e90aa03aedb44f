#pragma once

#include <grpcpp/support/status.h>
#include <grpcpp/support/string_ref.h>

#include <cstdint>
#include <exception>
#include <map>
#include <optional>

#include "core/base/error.h"
#include "server/engine/status_number.h"

namespace deform::server {

/// The one translation between Error and what goes over the wire, both directions side by side. Every code survives the round
/// trip; the message is made printable and cut at max_status_message bytes; the retry hint travels beside the status.

/// Trailing metadata that carries Error::retry_after_ms(), decimal.
inline constexpr char retry_after_key[] = "retry-after-ms";

using Metadata = std::multimap<grpc::string_ref, grpc::string_ref>;

grpc::Status to_status(const Error& error);
/// status must not be OK. Codes that deformd never sends (a proxy's, a broken transport's) become the nearest of ours.
Error to_error(const grpc::Status& status, const Metadata& trailing = {});

grpc::StatusCode to_status_code(ErrorCode code);
ErrorCode to_error_code(grpc::StatusCode code);

/// An exception that reached the boundary of a call: Error as it is, no memory as out_of_budget, anything else as internal.
Error to_error(const std::exception_ptr& exception);

/// Runs body; what it throws comes back as a value. Nothing passes it.
template <typename Body>
std::optional<Error> caught(Body&& body) noexcept {
  try {
    body();
    return std::nullopt;
  } catch (...) {
    return to_error(std::current_exception());
  }
}

}  // namespace deform::server
