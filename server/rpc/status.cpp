// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/status.h"

#include <new>
#include <string>

#include "core/base/text.h"
#include "proto/convert/base/error.h"

namespace deform::server {

grpc::Status to_status(const Error& error) {
  return {static_cast<grpc::StatusCode>(convert::status_number(error.code())),
          escaped(error.public_message(), convert::max_error_message)};
}

Error to_error(const std::exception_ptr& exception) {
  try {
    std::rethrow_exception(exception);
  } catch (const Error& error) {
    return error;
  } catch (const std::bad_alloc&) {
    return Error(ErrorCode::out_of_budget, "not enough memory for this request").refused_for(Refusal::memory);
  } catch (const std::exception& error) {
    return {ErrorCode::internal, error.what()};
  } catch (...) {
    return {ErrorCode::internal, "unknown failure"};
  }
}

}  // namespace deform::server
