// SPDX-License-Identifier: GPL-3.0-or-later
#include "proto/convert/method_traits.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <cctype>
#include <string_view>

#include "core/base/error.h"
#include "core/deformers/methods.h"

namespace deform::convert {

namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

/// The field of Method that is set, null if none is.
const FieldDescriptor* kind_of(const v1::Method& method) {
  return method.GetReflection()->GetOneofFieldDescriptor(method, v1::Method::descriptor()->FindOneofByName("kind"));
}

/// The options of the method; of an empty message those of rbf.
const Message& options_of(const v1::Method& method) {
  const FieldDescriptor* const kind = kind_of(method);
  if (kind == nullptr) return v1::RbfMethod::default_instance();
  return method.GetReflection()->GetMessage(method, kind);
}

/// The value of a field of options of this enum, the first enumerator where there is none.
int enum_value(const Message& options, const char* name, const google::protobuf::EnumDescriptor* type) {
  const FieldDescriptor* const field = options.GetDescriptor()->FindFieldByName(name);
  if (field == nullptr || field->enum_type() != type) return 0;
  return options.GetReflection()->GetEnumValue(options, field);
}

}  // namespace

std::string method_name(const v1::Method& message) {
  const FieldDescriptor* const kind = kind_of(message);
  return kind == nullptr ? std::string(RbfMethod::name) : std::string(kind->name());
}

MethodFeatures method_features(const v1::Method& message) {
  const std::string name = method_name(message);
  std::optional<MethodFeatures> found;
  Methods::for_each([&]<Method M>() {
    if (M::name == name) found = M::features;
  });
  if (!found) throw Error(ErrorCode::internal, "method." + name + ": not a method of this program");
  return *found;
}

const v1::Energy* energy_of(const v1::Method& message) {
  const Message& options = options_of(message);
  const FieldDescriptor* const field = options.GetDescriptor()->FindFieldByName("energy");
  if (field == nullptr || field->message_type() != v1::Energy::descriptor()) return nullptr;
  return static_cast<const v1::Energy*>(&options.GetReflection()->GetMessage(options, field));
}

v1::BasisMode basis_of(const v1::Method& message) {
  if (const v1::Energy* const energy = energy_of(message)) return energy->basis();
  return static_cast<v1::BasisMode>(enum_value(options_of(message), "basis", v1::BasisMode_descriptor()));
}

bool manipulates_directly(const v1::Method& message) {
  return enum_value(options_of(message), "control", v1::FfdControl_descriptor()) == v1::MESH;
}

std::optional<Kernel> kernel_named_as(std::string name) {
  for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return kernel_named(name);
}

}  // namespace deform::convert
