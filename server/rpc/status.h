// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/support/status.h>

#include <exception>
#include <optional>

#include "core/base/error.h"

namespace deform::server {

/// The status that a call ends with: every code has its own, the message is made printable and cut; the retry hint travels beside
/// it (convert::retry_after_key).
grpc::Status to_status(const Error& error);

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
