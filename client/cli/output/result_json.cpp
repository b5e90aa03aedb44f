// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/result_json.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <iostream>
#include <nlohmann/json.hpp>
#include <string_view>

#include "core/base/base64.h"
#include "core/base/text.h"

namespace deform::cli {

namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using Json = nlohmann::ordered_json;

enum class Fields {
  all,     ///< plain fields set or not, so that scripts find every key
  present  ///< what was set
};

Json message_json(const Message& message, Fields fields);

/// One value of a field: the index counts for repeated fields only.
Json value_json(const Message& message, const FieldDescriptor& field, int index, Fields fields) {
  const auto& reflection = *message.GetReflection();
  const bool many = field.is_repeated();
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return many ? reflection.GetRepeatedDouble(message, &field, index) : reflection.GetDouble(message, &field);
    case FieldDescriptor::CPPTYPE_FLOAT:
      return many ? reflection.GetRepeatedFloat(message, &field, index) : reflection.GetFloat(message, &field);
    case FieldDescriptor::CPPTYPE_UINT32:
      return many ? reflection.GetRepeatedUInt32(message, &field, index) : reflection.GetUInt32(message, &field);
    case FieldDescriptor::CPPTYPE_UINT64:
      return many ? reflection.GetRepeatedUInt64(message, &field, index) : reflection.GetUInt64(message, &field);
    case FieldDescriptor::CPPTYPE_INT32:
      return many ? reflection.GetRepeatedInt32(message, &field, index) : reflection.GetInt32(message, &field);
    case FieldDescriptor::CPPTYPE_INT64:
      return many ? reflection.GetRepeatedInt64(message, &field, index) : reflection.GetInt64(message, &field);
    case FieldDescriptor::CPPTYPE_BOOL:
      return many ? reflection.GetRepeatedBool(message, &field, index) : reflection.GetBool(message, &field);
    case FieldDescriptor::CPPTYPE_ENUM:
      return (many ? reflection.GetRepeatedEnum(message, &field, index) : reflection.GetEnum(message, &field))->name();
    case FieldDescriptor::CPPTYPE_STRING: {
      const std::string text =
          many ? reflection.GetRepeatedString(message, &field, index) : reflection.GetString(message, &field);
      return field.type() == FieldDescriptor::TYPE_BYTES ? base64_encoded(text) : text;
    }
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return message_json(many ? reflection.GetRepeatedMessage(message, &field, index) : reflection.GetMessage(message, &field),
                          fields);
  }
  return nullptr;
}

Json message_json(const Message& message, Fields fields) {
  Json json = Json::object();
  const auto& type = *message.GetDescriptor();
  const auto& reflection = *message.GetReflection();
  for (int i = 0; i < type.field_count(); ++i) {
    const FieldDescriptor& field = *type.field(i);
    if (field.is_repeated()) {
      if (fields == Fields::present && reflection.FieldSize(message, &field) == 0) continue;
      Json list = Json::array();
      for (int k = 0; k < reflection.FieldSize(message, &field); ++k) list.push_back(value_json(message, field, k, fields));
      json[field.name()] = std::move(list);
      continue;
    }
    const bool always = fields == Fields::all && !field.has_presence();
    if (always || reflection.HasField(message, &field)) json[field.name()] = value_json(message, field, 0, fields);
  }
  return json;
}

}  // namespace

Json to_json(const v1::GeometryInfo& info) { return message_json(info, Fields::all); }

Json to_json(const v1::SystemInfo& info) {
  v1::SystemInfo without = info;
  without.clear_setup();
  return message_json(without, Fields::all);
}

Json to_json(const v1::EstimateReply& estimate) { return message_json(estimate, Fields::all); }

Json to_json(const v1::ServerInfo& info) { return message_json(info, Fields::all); }

Json to_json(const Message& message) { return message_json(message, Fields::all); }

Json to_json(const v1::CellReport& report) { return message_json(report, Fields::all); }

Json to_json(const v1::QualityReport& report) { return message_json(report, Fields::all); }

Json to_json(const v1::SplitReport& report) { return message_json(report, Fields::all); }

Json to_json(const v1::ConstraintsReport& report) { return message_json(report, Fields::all); }

// Escaped down to ASCII: the controls of terminals and of the direction of text, too.
void print(const Json& json) { std::cout << json.dump(2, ' ', true, Json::error_handler_t::replace) << std::endl; }

std::string setup_text(const v1::Setup& setup) {
  const std::string json = message_json(setup, Fields::present).dump(2, ' ', false, Json::error_handler_t::replace);
  // Names stay legible, but what would be escaped on its way to a terminal is escaped as JSON does, so that it can be read again.
  std::string text;
  for (std::string_view rest = json; !rest.empty();) {
    const std::string_view before = rest;
    const std::string shown = take_printable(rest);
    const std::string_view plain = before.substr(0, before.size() - rest.size());
    if (plain == "\n" || shown == plain) {
      text += plain;
    } else {
      const std::string digits = shown.substr(shown.find_first_not_of("\\xu{"));
      const std::string hexadecimal = digits.substr(0, digits.find('}'));
      text += "\\u" + std::string(4 - hexadecimal.size(), '0') + hexadecimal;
    }
  }
  return text;
}

}  // namespace deform::cli
