// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <google/protobuf/message.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "client/setup/expression.h"
#include "core/base/problems.h"

namespace deform::client {

/// Fills a proto message from YAML text (JSON is YAML) by reflection: keys are names of fields, enums are given by name. `name`
/// stands before the line number in errors. Throws Error(invalid_argument): syntax, unknown key (with the nearest names),
/// repeated key, two members of a oneof, wrong type, number out of range, missing value, text that is not UTF-8. Bytes are
/// base64. A floating-point number may be given as an expression (expression.h).
void parse_yaml(const std::string& text, const std::string& name, google::protobuf::Message& message);

/// What stands for a list of integers: {file: NAME, set: NAME}, the latter empty where it is left out. Throws
/// Error(invalid_argument) or Error(not_found), which are reported with the line.
using ReadIds = std::function<std::vector<std::uint32_t>(const std::string& file, const std::string& set)>;
/// What stands for bytes: {file: NAME}. Throws as ReadIds.
using ReadBytes = std::function<std::string(const std::string& file)>;
/// Values from files; without a function none are.
struct ValueFiles {
  ReadIds ids;
  ReadBytes bytes;
  NamedValue names{};  ///< that expressions may use, besides pi
};

/// The text of a top-level key of a YAML map; empty if the key is missing or the text is no YAML.
std::string top_level_text(const std::string& text, const std::string& key);

/// The same, where lists of integers and bytes may also be taken from files, and what is wrong goes to `problems`: collecting,
/// the message lacks what could not be read. Text that is no YAML is an Error all the same.
void parse_yaml(const std::string& text, const std::string& name, google::protobuf::Message& message, const ValueFiles& files,
                Problems& problems);

}  // namespace deform::client
