// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gmock/gmock-matchers.h>
#include <grpcpp/grpcpp.h>

#include <ostream>

namespace grpc {

/// What a failed expectation prints: the message, which alone tells why.
inline void PrintTo(const Status& status, std::ostream* out) {
  *out << "code " << status.error_code() << ", \"" << status.error_message() << "\"";
}

}  // namespace grpc

namespace deform::server {

/// A grpc::Status with this code.
MATCHER_P(EndedWith, code, "ended with code " + testing::PrintToString(static_cast<int>(code))) {
  return arg.error_code() == code;
}

}  // namespace deform::server
