// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "core/base/error.h"
#include "deform/v1/deformation.pb.h"

namespace deform::convert {

/// The length in bytes to which messages of errors are cut.
inline constexpr std::size_t max_error_message = 2000;

/// The key of the trailing metadata that carries Error::retry_after_ms() in decimal.
inline constexpr char retry_after_key[] = "retry-after-ms";

/// The gRPC status code of an error. Each ErrorCode has its own.
std::uint32_t status_number(ErrorCode code);
/// The inverse of status_number(). Status codes that deformd never sends (from a proxy or a broken transport) become the
/// closest ErrorCode.
ErrorCode error_code(std::uint32_t status_number);

/// The milliseconds of a retry hint; 0, meaning no hint, if the text is not a number.
std::uint32_t retry_hint(std::string_view text);

/// Makes the words for a client printable and cuts it.
v1::RequestError error_to_proto(const Error& error);
Error error_from_proto(const v1::RequestError& message);

}  // namespace deform::convert
