// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/error_json.h"

#include <google/protobuf/descriptor.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>

#include "deform/v1/service.pb.h"

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

void add_names(const google::protobuf::Descriptor& message, std::set<std::string>& names) {
  for (int i = 0; i < message.field_count(); ++i) names.insert(message.field(i)->name());
  for (int i = 0; i < message.nested_type_count(); ++i) add_names(*message.nested_type(i), names);
}

void add_names(const google::protobuf::FileDescriptor& file, std::set<std::string>& names) {
  for (int i = 0; i < file.message_type_count(); ++i) add_names(*file.message_type(i), names);
  for (int i = 0; i < file.dependency_count(); ++i) add_names(*file.dependency(i), names);
}

/// The names of all fields of all messages. They tell "fixed[0]" from "ahmed.obj".
std::set<std::string> field_names() {
  std::set<std::string> names;
  add_names(*v1::ServerInfo::descriptor()->file(), names);
  return names;
}

/// Takes "name" or "name[3]" from the front.
bool take_name(std::string_view& path, const std::set<std::string>& names) {
  const std::size_t end = std::min(path.find_first_not_of("abcdefghijklmnopqrstuvwxyz_0123456789"), path.size());
  if (!names.contains(std::string(path.substr(0, end)))) return false;
  path.remove_prefix(end);
  if (!path.starts_with('[')) return true;
  const std::size_t close = path.find(']');
  if (close == std::string_view::npos || close == 1 || path.substr(1, close - 1).find_first_not_of("0123456789") < close)
    return false;
  path.remove_prefix(close + 1);
  return true;
}

ordered_json error(const char* code, const std::string& message) {
  ordered_json json;
  json["code"] = code;
  json["message"] = message;
  json["field"] = field_of(message);
  return json;
}

}  // namespace

std::string field_of(const std::string& message) {
  const std::string_view all = message;
  const std::string_view front = all.substr(0, std::min(all.find(": "), all.size()));
  if (front.size() == all.size()) return {};
  const auto names = field_names();
  std::string_view rest = front;
  while (take_name(rest, names)) {
    if (rest.empty() || rest.starts_with(" (")) return std::string(front.substr(0, front.size() - rest.size()));
    if (!rest.starts_with('.')) return {};
    rest.remove_prefix(1);
  }
  return {};
}

ordered_json error_json(ErrorCode code, const std::string& message) { return error(name_of(code), message); }

ordered_json usage_error_json(const std::string& message) { return error("USAGE", message); }

ordered_json verdict_error_json(const std::string& message) { return error("VERDICT", message); }

}  // namespace deform::cli
