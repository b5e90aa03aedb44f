// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace deform::client {

/// The address as gRPC wants it. Accepts HOST:PORT, [IPv6]:PORT and unix:PATH; anything else is Error(invalid_argument) that says
/// what was expected.
std::string checked_address(const std::string& address);

}  // namespace deform::client
