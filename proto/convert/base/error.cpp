// SPDX-License-Identifier: Apache-2.0
#include "proto/convert/base/error.h"

#include <charconv>
#include <utility>

#include "core/base/text.h"

namespace deform::convert {

namespace {

constexpr std::pair<ErrorCode, std::uint32_t> status_numbers[] = {
    {ErrorCode::invalid_argument, 3},    {ErrorCode::not_found, 5},         {ErrorCode::already_exists, 6},
    {ErrorCode::failed_precondition, 9}, {ErrorCode::out_of_budget, 8},     {ErrorCode::numerical_failure, 10},
    {ErrorCode::cancelled, 1},           {ErrorCode::deadline_exceeded, 4}, {ErrorCode::data_loss, 15},
    {ErrorCode::unauthenticated, 16},    {ErrorCode::permission_denied, 7}, {ErrorCode::unavailable, 14},
    {ErrorCode::internal, 13},
};

}  // namespace

std::uint32_t status_number(ErrorCode code) {
  for (const auto& [error, number] : status_numbers) {
    if (error == code) return number;
  }
  return 13;
}

ErrorCode error_code(std::uint32_t status_number) {
  for (const auto& [error, number] : status_numbers) {
    if (number == status_number) return error;
  }
  switch (status_number) {
    case 11:  // OUT_OF_RANGE
      return ErrorCode::invalid_argument;
    case 12:  // UNIMPLEMENTED: a server of another version
      return ErrorCode::failed_precondition;
    default:
      return ErrorCode::internal;
  }
}

std::uint32_t retry_hint(std::string_view text) {
  std::uint32_t value = 0;
  const char* const end = text.data() + text.size();
  const auto [stopped, failure] = std::from_chars(text.data(), end, value);
  return failure == std::errc() && stopped == end ? value : 0;
}

v1::RequestError error_to_proto(const Error& error) {
  v1::RequestError message;
  message.set_code(status_number(error.code()));
  message.set_message(escaped(error.public_message(), max_error_message));
  message.set_retry_after_ms(error.retry_after_ms());
  return message;
}

Error error_from_proto(const v1::RequestError& message) {
  return {error_code(message.code()), message.message(), message.retry_after_ms()};
}

}  // namespace deform::convert
