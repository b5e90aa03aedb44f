// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <google/protobuf/message.h>
#include <pybind11/pybind11.h>

#include <memory>
#include <string>
#include <utility>

namespace deform::python {

namespace py = pybind11;

/// A message of the contract as a Python object: its fields are attributes, converted when they are asked for. Numbers and text
/// as they are, enumerators by name, messages as records, None where they are absent, repeated fields as tuples. Immutable.
class Record {
 public:
  /// A copy of its own.
  explicit Record(const google::protobuf::Message& message) : owner_(message.New()), message_(owner_.get()) {
    owner_->CopyFrom(message);
  }
  /// A part of a message that `owner` keeps alive.
  Record(std::shared_ptr<google::protobuf::Message> owner, const google::protobuf::Message* part)
      : owner_(std::move(owner)), message_(part) {}

  const google::protobuf::Message& message() const { return *message_; }
  /// Throws AttributeError.
  py::object get(const std::string& name) const;
  /// All fields, with those of the messages inside, as plain Python values.
  py::dict to_dict() const;

 private:
  friend void bind_record(py::module_& module);
  py::object value(const google::protobuf::FieldDescriptor& field) const;

  std::shared_ptr<google::protobuf::Message> owner_;
  const google::protobuf::Message* message_;
};

void bind_record(py::module_& module);

}  // namespace deform::python
