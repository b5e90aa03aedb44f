// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "deform/v1/deformation.pb.h"

namespace deform::client {

/// The address as gRPC wants it. Accepts HOST:PORT, [IPv6]:PORT and unix:PATH; anything else is Error(invalid_argument) that says
/// what was expected.
std::string checked_address(const std::string& address);

/// Whether an address that checked_address() accepts is certain to be on this machine: a unix socket, "localhost", or a loopback
/// address in numbers (127.0.0.0/8, ::1, and the former mapped into IPv6). Looks no name up.
bool is_local(const std::string& address);

/// What suits the way to an address: bytes cost nothing on this machine, so RAW_F64; elsewhere DELTA_ZSTD, which takes a few
/// milliseconds and a fraction of the bytes.
v1::Encoding encoding_for(const std::string& address);

}  // namespace deform::client
