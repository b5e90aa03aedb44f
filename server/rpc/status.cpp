#include "server/rpc/status.h"

#include <charconv>
#include <new>
#include <string>

#include "core/base/text.h"

namespace deform::server {

static_assert(status_number(ErrorCode::invalid_argument) == grpc::StatusCode::INVALID_ARGUMENT);
static_assert(status_number(ErrorCode::not_found) == grpc::StatusCode::NOT_FOUND);
static_assert(status_number(ErrorCode::already_exists) == grpc::StatusCode::ALREADY_EXISTS);
static_assert(status_number(ErrorCode::failed_precondition) == grpc::StatusCode::FAILED_PRECONDITION);
static_assert(status_number(ErrorCode::out_of_budget) == grpc::StatusCode::RESOURCE_EXHAUSTED);
static_assert(status_number(ErrorCode::numerical_failure) == grpc::StatusCode::ABORTED);
static_assert(status_number(ErrorCode::cancelled) == grpc::StatusCode::CANCELLED);
static_assert(status_number(ErrorCode::deadline_exceeded) == grpc::StatusCode::DEADLINE_EXCEEDED);
static_assert(status_number(ErrorCode::data_loss) == grpc::StatusCode::DATA_LOSS);
static_assert(status_number(ErrorCode::unavailable) == grpc::StatusCode::UNAVAILABLE);
static_assert(status_number(ErrorCode::internal) == grpc::StatusCode::INTERNAL);

grpc::StatusCode to_status_code(ErrorCode code) { return static_cast<grpc::StatusCode>(status_number(code)); }

ErrorCode to_error_code(grpc::StatusCode code) {
  for (const auto& [error, number] : status_numbers) {
    if (static_cast<grpc::StatusCode>(number) == code) return error;
  }
  switch (code) {
    case grpc::StatusCode::OUT_OF_RANGE:
      return ErrorCode::invalid_argument;
    case grpc::StatusCode::PERMISSION_DENIED:
    case grpc::StatusCode::UNAUTHENTICATED:
    case grpc::StatusCode::UNIMPLEMENTED:  // a server of another version
      return ErrorCode::failed_precondition;
    default:
      return ErrorCode::internal;
  }
}

grpc::Status to_status(const Error& error) { return {to_status_code(error.code()), escaped(error.what(), max_status_message)}; }

Error to_error(const grpc::Status& status, const Metadata& trailing) {
  std::uint32_t retry_after_ms = 0;
  if (const auto found = trailing.find(retry_after_key); found != trailing.end()) {
    // A hint that is no number is no hint.
    const grpc::string_ref text = found->second;
    std::uint32_t value = 0;
    const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (failure == std::errc() && end == text.data() + text.size()) retry_after_ms = value;
  }
  return {to_error_code(status.error_code()), status.error_message(), retry_after_ms};
}

Error to_error(const std::exception_ptr& exception) {
  try {
    std::rethrow_exception(exception);
  } catch (const Error& error) {
    return error;
  } catch (const std::bad_alloc&) {
    return {ErrorCode::out_of_budget, "not enough memory for this request"};
  } catch (const std::exception& error) {
    return {ErrorCode::internal, error.what()};
  } catch (...) {
    return {ErrorCode::internal, "unknown failure"};
  }
}

}  // namespace deform::server
