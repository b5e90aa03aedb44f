// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/setup_schema.h"

#include <google/protobuf/descriptor.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <string>

#include "deform/v1/setup.pb.h"

namespace deform::cli {

namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::OneofDescriptor;
using SchemaJson = nlohmann::ordered_json;

/// "Lattice.Frame" of deform.v1.Lattice.Frame.
std::string type_name(const Descriptor& type) { return type.full_name().substr(type.file()->package().size() + 1); }

/// {file: NAME} and, where there is one, {set: NAME}.
SchemaJson file_schema(bool with_set) {
  const SchemaJson text = {{"type", "string"}, {"minLength", 1}};
  SchemaJson schema = {
      {"type", "object"}, {"properties", {{"file", text}}}, {"required", {"file"}}, {"additionalProperties", false}};
  if (with_set) schema["properties"]["set"] = text;
  return schema;
}

SchemaJson number_schema(const FieldDescriptor& field) {
  SchemaJson schema = {{"type", "integer"}};
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_UINT32:
      schema["minimum"] = 0;
      schema["maximum"] = std::numeric_limits<std::uint32_t>::max();
      break;
    case FieldDescriptor::CPPTYPE_UINT64:
      schema["minimum"] = 0;
      schema["maximum"] = std::numeric_limits<std::uint64_t>::max();
      break;
    default:
      break;
  }
  return schema;
}

SchemaJson names_schema(const google::protobuf::EnumDescriptor& type) {
  SchemaJson names = SchemaJson::array();
  for (int i = 0; i < type.value_count(); ++i) names.push_back(type.value(i)->name());
  return {{"enum", names}};
}

/// The schema of one value.
SchemaJson value_schema(const FieldDescriptor& field) {
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return {{"$ref", "#/$defs/" + type_name(*field.message_type())}};
    case FieldDescriptor::CPPTYPE_STRING:
      if (field.type() != FieldDescriptor::TYPE_BYTES) return {{"type", "string"}};
      return {{"anyOf", {{{"type", "string"}, {"contentEncoding", "base64"}}, file_schema(false)}}};
    case FieldDescriptor::CPPTYPE_BOOL:
      return {{"type", "boolean"}};
    case FieldDescriptor::CPPTYPE_ENUM:
      return names_schema(*field.enum_type());
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return {{"$ref", "#/$defs/number"}};
    default:
      return number_schema(field);
  }
}

SchemaJson field_schema(const FieldDescriptor& field) {
  if (!field.is_repeated()) return value_schema(field);
  SchemaJson list = {{"type", "array"}, {"items", value_schema(field)}};
  if (field.cpp_type() != FieldDescriptor::CPPTYPE_UINT32) return list;
  return {{"anyOf", {list, file_schema(true)}}};
}

/// At most one of the members.
SchemaJson choice_schema(const OneofDescriptor& choice) {
  SchemaJson ways = SchemaJson::array(), all = SchemaJson::array();
  for (int i = 0; i < choice.field_count(); ++i) all.push_back({{"required", {choice.field(i)->name()}}});
  ways = all;
  ways.push_back({{"not", {{"anyOf", all}}}});
  return {{"oneOf", ways}};
}

/// The schema of a message, and of those that it holds, into `types`.
void add_type(const Descriptor& type, SchemaJson& types) {
  const std::string name = type_name(type);
  if (types.contains(name)) return;
  types[name] = SchemaJson::object();  // regions hold regions
  SchemaJson schema = {{"type", "object"}, {"properties", SchemaJson::object()}, {"additionalProperties", false}};
  for (int i = 0; i < type.field_count(); ++i) {
    const FieldDescriptor& field = *type.field(i);
    schema["properties"][field.name()] = field_schema(field);
    if (field.message_type() != nullptr) add_type(*field.message_type(), types);
  }
  for (int i = 0; i < type.real_oneof_decl_count(); ++i) schema["allOf"].push_back(choice_schema(*type.oneof_decl(i)));
  if (&type == v1::Region::descriptor()) schema["minProperties"] = schema["maxProperties"] = 1;
  types[name] = std::move(schema);
}

}  // namespace

nlohmann::ordered_json setup_schema() {
  const Descriptor& setup = *v1::Setup::descriptor();
  SchemaJson types = SchemaJson::object();
  types["number"] = {
      {"anyOf",
       {{{"type", "number"}}, {{"type", "string"}, {"description", "an expression of numbers, pi, L, Lx, Ly and Lz: 0.05*L"}}}}};
  add_type(setup, types);
  SchemaJson schema = {{"$schema", "https://json-schema.org/draft/2020-12/schema"}, {"title", "Setup of deformd"}};
  for (const auto& [key, value] : types.at(type_name(setup)).items()) schema[key] = value;
  schema["required"] = {"geometry"};
  types.erase(type_name(setup));
  schema["$defs"] = std::move(types);
  return schema;
}

}  // namespace deform::cli
