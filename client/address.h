// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "deform/v1/deformation.pb.h"

namespace deform::client {

/// The address as gRPC wants it. Accepts HOST:PORT, [IPv6]:PORT and unix:PATH; anything else is Error(invalid_argument) that says
/// what was expected.
std::string checked_address(const std::string& address);

/// The items of a list with commas, each one checked. Throws Error(invalid_argument), also for one that stands there twice.
std::vector<std::string> addresses_of(const std::string& list);

/// Whether an address that checked_address() accepts is certain to be on this machine: a unix socket, "localhost", or a loopback
/// address in numbers (127.0.0.0/8, ::1, and the former mapped into IPv6). Looks no name up.
bool is_local(const std::string& address);

/// What suits the way to an address, or to all of a list: bytes cost nothing on this machine, so RAW_F64; elsewhere DELTA_ZSTD,
/// which takes a few milliseconds and a fraction of the bytes.
v1::Encoding encoding_for(const std::string& list);

}  // namespace deform::client
