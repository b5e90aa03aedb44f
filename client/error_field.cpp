// SPDX-License-Identifier: Apache-2.0
#include "client/error_field.h"

#include <google/protobuf/descriptor.h>

#include <algorithm>
#include <set>
#include <string_view>

#include "deform/v1/service.pb.h"

namespace deform::client {

namespace {

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

}  // namespace

std::string field_of(const std::string& message) {
  std::string_view all = message;
  // The line of a setup comes first: "car.yaml:3: ", "setup:1: ".
  const std::size_t place = std::min(all.find(": "), all.size());
  const std::size_t colon = all.substr(0, place).rfind(':');
  if (colon != std::string_view::npos && colon + 1 < place &&
      all.substr(colon + 1, place - colon - 1).find_first_not_of("0123456789") == std::string_view::npos) {
    all.remove_prefix(std::min(place + 2, all.size()));
  }
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

}  // namespace deform::client
