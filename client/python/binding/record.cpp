// SPDX-License-Identifier: Apache-2.0
#include "client/python/binding/record.h"

#include <google/protobuf/descriptor.h>

#include "core/base/error.h"
#include "deform/v1/service.pb.h"

namespace deform::python {

namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

/// Field `at` of a repeated field, or a single field for at < 0.
template <typename Single, typename Repeated>
auto pick(const Message& message, const FieldDescriptor& field, int at, Single single, Repeated repeated) {
  const Reflection& reflection = *message.GetReflection();
  return at < 0 ? (reflection.*single)(message, &field) : (reflection.*repeated)(message, &field, at);
}

py::object scalar(const Message& message, const FieldDescriptor& field, int at) {
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_INT32:
      return py::int_(pick(message, field, at, &Reflection::GetInt32, &Reflection::GetRepeatedInt32));
    case FieldDescriptor::CPPTYPE_INT64:
      return py::int_(pick(message, field, at, &Reflection::GetInt64, &Reflection::GetRepeatedInt64));
    case FieldDescriptor::CPPTYPE_UINT32:
      return py::int_(pick(message, field, at, &Reflection::GetUInt32, &Reflection::GetRepeatedUInt32));
    case FieldDescriptor::CPPTYPE_UINT64:
      return py::int_(pick(message, field, at, &Reflection::GetUInt64, &Reflection::GetRepeatedUInt64));
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return py::float_(pick(message, field, at, &Reflection::GetDouble, &Reflection::GetRepeatedDouble));
    case FieldDescriptor::CPPTYPE_FLOAT:
      return py::float_(pick(message, field, at, &Reflection::GetFloat, &Reflection::GetRepeatedFloat));
    case FieldDescriptor::CPPTYPE_BOOL:
      return py::bool_(pick(message, field, at, &Reflection::GetBool, &Reflection::GetRepeatedBool));
    case FieldDescriptor::CPPTYPE_ENUM: {
      const int number = pick(message, field, at, &Reflection::GetEnumValue, &Reflection::GetRepeatedEnumValue);
      const auto* known = field.enum_type()->FindValueByNumber(number);
      return known != nullptr ? py::object(py::str(known->name())) : py::object(py::int_(number));  // of a newer server
    }
    case FieldDescriptor::CPPTYPE_STRING: {
      const std::string text = pick(message, field, at, &Reflection::GetString, &Reflection::GetRepeatedString);
      return field.type() == FieldDescriptor::TYPE_BYTES ? py::object(py::bytes(text)) : py::object(py::str(text));
    }
    case FieldDescriptor::CPPTYPE_MESSAGE:
      break;
  }
  return py::none();
}

py::object plain(const py::handle& value) {
  if (py::isinstance<Record>(value)) return value.cast<const Record&>().to_dict();
  if (!py::isinstance<py::tuple>(value)) return py::reinterpret_borrow<py::object>(value);
  py::list items;
  for (const auto& item : value) items.append(plain(item));
  return items;
}

std::string shown(const Record& record) {
  return "<" + record.message().GetDescriptor()->name() + " " + py::str(record.to_dict()).cast<std::string>() + ">";
}

/// A message of any type of the contract, by its name there.
Record from_bytes(const std::string& type, const std::string& bytes) {
  const auto* descriptor = google::protobuf::DescriptorPool::generated_pool()->FindMessageTypeByName(type);
  if (descriptor == nullptr) throw Error(ErrorCode::invalid_argument, "record: there is no message " + type);
  const Message& prototype = *google::protobuf::MessageFactory::generated_factory()->GetPrototype(descriptor);
  std::shared_ptr<Message> message(prototype.New());
  if (!message->ParseFromString(bytes)) throw Error(ErrorCode::data_loss, "record: these bytes are no " + type);
  const Message* whole = message.get();
  return {std::move(message), whole};
}

}  // namespace

py::object Record::value(const FieldDescriptor& field) const {
  const Reflection& reflection = *message_->GetReflection();
  const bool is_message = field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE;
  if (field.is_repeated()) {
    const int size = reflection.FieldSize(*message_, &field);
    py::tuple items(static_cast<std::size_t>(size));
    for (int i = 0; i < size; ++i) {
      items[static_cast<std::size_t>(i)] = is_message
                                               ? py::cast(Record(owner_, &reflection.GetRepeatedMessage(*message_, &field, i)))
                                               : scalar(*message_, field, i);
    }
    return items;
  }
  if (field.has_presence() && !reflection.HasField(*message_, &field)) return py::none();
  if (is_message) return py::cast(Record(owner_, &reflection.GetMessage(*message_, &field)));
  return scalar(*message_, field, -1);
}

py::object Record::get(const std::string& name) const {
  const auto* field = message_->GetDescriptor()->FindFieldByName(name);
  if (field == nullptr) throw py::attribute_error(message_->GetDescriptor()->name() + " has no field \"" + name + "\"");
  return value(*field);
}

py::dict Record::to_dict() const {
  const auto& type = *message_->GetDescriptor();
  py::dict all;
  for (int i = 0; i < type.field_count(); ++i) all[py::str(type.field(i)->name())] = plain(value(*type.field(i)));
  return all;
}

void bind_record(py::module_& module) {
  py::class_<Record>(module, "Record", "A message of the contract; its fields are attributes.")
      .def("__getattr__", &Record::get)
      .def("to_dict", &Record::to_dict)
      .def("__repr__", &shown)
      .def("__dir__",
           [](const Record& record) {
             const auto& type = *record.message().GetDescriptor();
             py::list names;
             for (int i = 0; i < type.field_count(); ++i) names.append(type.field(i)->name());
             names.append("to_dict");
             return names;
           })
      .def("__eq__",
           [](const Record& a, const py::object& other) {
             if (!py::isinstance<Record>(other)) return false;
             const auto& b = other.cast<const Record&>();
             return a.message().GetDescriptor() == b.message().GetDescriptor() &&
                    a.message().SerializeAsString() == b.message().SerializeAsString();
           })
      .def("__hash__", [](const Record& record) { return std::hash<std::string>()(record.message().SerializeAsString()); })
      .def(py::pickle(
          [](const Record& record) {
            return py::make_tuple(record.message().GetDescriptor()->full_name(), py::bytes(record.message().SerializeAsString()));
          },
          [](const py::tuple& state) { return from_bytes(state[0].cast<std::string>(), state[1].cast<std::string>()); }));
}

}  // namespace deform::python
