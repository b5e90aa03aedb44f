// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/error_json.h"

#include <nlohmann/json.hpp>

#include "client/call_error.h"
#include "client/error_field.h"

namespace deform::cli {

namespace {

using nlohmann::ordered_json;

const char* name_of(ErrorCode code) {
  switch (code) {
    case ErrorCode::invalid_argument:
      return "INVALID_ARGUMENT";
    case ErrorCode::not_found:
      return "NOT_FOUND";
    case ErrorCode::already_exists:
      return "ALREADY_EXISTS";
    case ErrorCode::failed_precondition:
      return "FAILED_PRECONDITION";
    case ErrorCode::unauthenticated:
      return "UNAUTHENTICATED";
    case ErrorCode::permission_denied:
      return "PERMISSION_DENIED";
    case ErrorCode::out_of_budget:
      return "RESOURCE_EXHAUSTED";
    case ErrorCode::numerical_failure:
      return "ABORTED";
    case ErrorCode::cancelled:
      return "CANCELLED";
    case ErrorCode::deadline_exceeded:
      return "DEADLINE_EXCEEDED";
    case ErrorCode::data_loss:
      return "DATA_LOSS";
    case ErrorCode::unavailable:
      return "UNAVAILABLE";
    case ErrorCode::internal:
      break;
  }
  return "INTERNAL";
}

ordered_json error(const char* code, const std::string& message) {
  ordered_json json;
  json["code"] = code;
  json["message"] = message;
  json["field"] = client::field_of(message);
  return json;
}

}  // namespace

ordered_json error_json(ErrorCode code, const std::string& message) { return error(name_of(code), message); }

ordered_json error_json(const Error& thrown) {
  ordered_json json = error(name_of(thrown.code()), thrown.what());
  if (const std::string id = client::request_id_of(thrown); !id.empty()) json["request_id"] = id;
  return json;
}

ordered_json usage_error_json(const std::string& message) { return error("USAGE", message); }

ordered_json verdict_error_json(const std::string& message) { return error("VERDICT", message); }

}  // namespace deform::cli
