// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "client/connection.h"

namespace deform::client {

/// Setups travel in one message where it stays below 1 MiB, else in pieces. A server of a version that takes no pieces gets one
/// message, of which gRPC takes up to 4 MiB.

/// One attempt of preparing a system. on_progress: stage and fraction of it; may be empty.
v1::SystemInfo prepare(Connection& connection, Attempt& attempt, const RunContext& limits, const v1::Setup& setup,
                       SetupInInfo in_info, const std::function<void(const std::string& stage, double fraction)>& on_progress);

/// One attempt of estimating.
v1::EstimateReply estimate(Connection& connection, Attempt& attempt, const RunContext& limits,
                           const v1::EstimateRequest& request);

/// A call that gets the setup of a system.
v1::Setup fetch_setup(Connection& connection, const std::string& system_id, const CallOptions& options);

/// Gets the setup where the server left it out because it is large, and drops one that is not wanted.
void complete(Connection& connection, v1::SystemInfo& system, SetupInInfo in_info, const CallOptions& options);

}  // namespace deform::client
