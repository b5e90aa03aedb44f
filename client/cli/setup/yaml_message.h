#pragma once

#include <google/protobuf/message.h>

#include <string>

namespace deform::cli {

/// Fills any proto message from YAML text (JSON is YAML): walks the tree next to the message's descriptor, writes JSON and has
/// protobuf's JSON parser read it. `name` stands before the line number in errors. Throws Error(invalid_argument): syntax,
/// unknown key (with the nearest names), repeated key, two members of a oneof, wrong type, number out of range, missing value.
void parse_yaml(const std::string& text, const std::string& name, google::protobuf::Message& message);

}  // namespace deform::cli
