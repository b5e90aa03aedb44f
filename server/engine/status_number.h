#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>

#include "core/base/error.h"

namespace deform::server {

/// Messages of errors are cut at so many bytes.
inline constexpr std::size_t max_status_message = 2000;

/// Our codes and the gRPC status codes that they travel as. server/rpc/status.cpp holds the numbers against gRPC's own.
inline constexpr std::pair<ErrorCode, std::uint32_t> status_numbers[] = {
    {ErrorCode::invalid_argument, 3},    {ErrorCode::not_found, 5},         {ErrorCode::already_exists, 6},
    {ErrorCode::failed_precondition, 9}, {ErrorCode::out_of_budget, 8},     {ErrorCode::numerical_failure, 10},
    {ErrorCode::cancelled, 1},           {ErrorCode::deadline_exceeded, 4}, {ErrorCode::data_loss, 15},
    {ErrorCode::unavailable, 14},        {ErrorCode::internal, 13},
};

constexpr std::uint32_t status_number(ErrorCode code) {
  for (const auto& [error, number] : status_numbers) {
    if (error == code) return number;
  }
  return 13;
}

}  // namespace deform::server
