// SPDX-License-Identifier: Apache-2.0
#include "client/call_error.h"

#include <utility>

namespace deform::client {

CallError::CallError(const Error& error, std::string request_id)
    : Error(error), request_id_(std::make_shared<const std::string>(std::move(request_id))) {}

std::string request_id_of(const Error& error) {
  const auto* of_call = dynamic_cast<const CallError*>(&error);
  return of_call == nullptr ? std::string() : of_call->request_id();
}

void throw_reworded(const Error& error, const std::string& message) {
  const Error reworded(error.code(), message, error.retry_after_ms());
  const std::string id = request_id_of(error);
  if (id.empty()) throw reworded;
  throw CallError(reworded, id);
}

}  // namespace deform::client
