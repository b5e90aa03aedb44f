// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "core/base/error.h"
#include "deform/v1/deformation.pb.h"

namespace deform::convert {

/// Messages of errors are cut at so many bytes.
inline constexpr std::size_t max_error_message = 2000;

/// Trailing metadata of a call that carries Error::retry_after_ms(), decimal.
inline constexpr char retry_after_key[] = "retry-after-ms";

/// The gRPC status code that an error travels as. Every code of ours has its own.
std::uint32_t status_number(ErrorCode code);
/// Its inverse. Status codes that deformd never sends (a proxy's, a broken transport's) become the nearest of ours.
ErrorCode error_code(std::uint32_t status_number);

/// The milliseconds of a retry hint; a text that is no number is no hint, 0.
std::uint32_t retry_hint(std::string_view text);

/// The message is made printable and cut.
v1::RequestError error_to_proto(const Error& error);
Error error_from_proto(const v1::RequestError& message);

}  // namespace deform::convert
