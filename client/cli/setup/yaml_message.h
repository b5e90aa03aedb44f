// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <google/protobuf/message.h>

#include <string>

namespace deform::cli {

/// Fills a proto message from YAML text (JSON is YAML) by reflection: keys are names of fields, enums are given by name. `name`
/// stands before the line number in errors. Throws Error(invalid_argument): syntax, unknown key (with the nearest names),
/// repeated key, two members of a oneof, wrong type, number out of range, missing value, text that is not UTF-8.
void parse_yaml(const std::string& text, const std::string& name, google::protobuf::Message& message);

}  // namespace deform::cli
