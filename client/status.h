// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/client_context.h>
#include <grpcpp/support/status.h>

#include <string>

#include "core/base/error.h"

namespace deform::client {

/// A connection that somebody answered and that came to nothing: not one that nobody listened to.
bool failed_handshake(const grpc::Status& status);

/// A status that is not OK as an Error with the server's message; the retry hint is read from the trailing metadata of the
/// finished call. `address` names the server when it cannot be reached.
Error to_error(const grpc::Status& status, const grpc::ClientContext& context, const std::string& address);

}  // namespace deform::client
