// SPDX-License-Identifier: Apache-2.0
#include "client/setup/yaml_message.h"

#include <google/protobuf/descriptor.h>
#include <yaml-cpp/depthguard.h>
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/yaml.h>

#include <charconv>
#include <limits>
#include <optional>
#include <set>
#include <sstream>
#include <string_view>
#include <utility>
#include <vector>

#include "client/setup/numbers.h"
#include "core/base/base64.h"
#include "core/base/error.h"
#include "core/base/text.h"

namespace deform::client {

namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

constexpr int max_depth = 100;
/// Aliases can blow up a short text.
constexpr std::size_t max_content_bytes = std::size_t{1} << 28;

/// Integers whose limits are narrower than those of their type. The server refuses what is beyond them by the same numbers.
struct IntegerLimits {
  std::string_view field;
  std::uint32_t least, most;
};
constexpr IntegerLimits integer_limits[] = {
    {"deform.v1.Grow.rings", 1, 1000},
    {"deform.v1.RbfMethod.polynomial_degree", 0, 2},
    {"deform.v1.RbfMethod.reduction_rings", 1, 100},
    {"deform.v1.SubspaceMethod.centres", 4, 100000},
    {"deform.v1.MlsMethod.surface_samples", 0, 1000000},
    {"deform.v1.MlsMethod.volume_samples", 0, 1000000},
    {"deform.v1.CageMethod.Generate.points", 8, 10000},
    {"deform.v1.Constraint.Rigid.layers", 0, 1000},
    {"deform.v1.ConstraintOptions.iterations", 1, 1000000},
    {"deform.v1.Sector.count", 2, 10000},
};

/// "4 to 1000".
std::string limits_text(const FieldDescriptor& field) {
  if (field.full_name() == "deform.v1.Lattice.points") return "4 to 1000, with basis BERNSTEIN from 2 to 16";
  for (const IntegerLimits& limits : integer_limits) {
    if (limits.field == field.full_name()) return std::to_string(limits.least) + " to " + std::to_string(limits.most);
  }
  return "0 to " + std::to_string(std::numeric_limits<std::uint32_t>::max());
}

std::string shown(const YAML::Node& node) {
  if (node.IsNull()) return "nothing";
  if (node.IsMap()) return "a map";
  if (node.IsSequence()) return "a list";
  constexpr std::size_t most = 40;
  const std::string text = node.Scalar().substr(0, most);
  return "\"" + text + (node.Scalar().size() > most ? "..." : "") + "\"";
}

/// Remembers where maps and lists are first nested deeper than max_depth.
class DepthFinder : public YAML::EventHandler {
 public:
  const YAML::Mark& mark() const { return mark_; }

  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark&, YAML::anchor_t) override {}
  void OnAlias(const YAML::Mark&, YAML::anchor_t) override {}
  void OnScalar(const YAML::Mark&, const std::string&, YAML::anchor_t, const std::string&) override {}
  void OnSequenceStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t, YAML::EmitterStyle::value) override {
    begin(mark);
  }
  void OnSequenceEnd() override { --depth_; }
  void OnMapStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t, YAML::EmitterStyle::value) override { begin(mark); }
  void OnMapEnd() override { --depth_; }

 private:
  void begin(const YAML::Mark& mark) {
    if (++depth_ == max_depth + 1 && mark_.is_null()) mark_ = mark;
  }

  int depth_ = 0;
  YAML::Mark mark_ = YAML::Mark::null_mark();
};

/// The mark of the exception is that of what the parser has read, which is far ahead.
YAML::Mark too_deep(const std::string& text) {
  DepthFinder finder;
  std::istringstream in(text);
  try {
    YAML::Parser(in).HandleNextDocument(finder);
  } catch (const YAML::Exception&) {  // behind it
  }
  return finder.mark();
}

class Walker {
 public:
  Walker(const std::string& name, const ValueFiles& files, Problems& problems)
      : name_(name), files_(files), problems_(problems) {}

  void map(const YAML::Node& node, Message& message, const std::string& path) {
    const Descriptor& type = *message.GetDescriptor();
    if (!node.IsMap()) refuse(node, path, "expected a map of " + keys_of(type) + ", got " + shown(node));
    const Nesting nesting(*this, node, path);
    std::set<std::string> seen;
    std::set<const google::protobuf::OneofDescriptor*> chosen;
    for (const auto& entry : node) {
      problems_.check(path, [&] {
        if (!entry.first.IsScalar()) refuse(entry.first, path, "a key must be a word");
        const std::string key = entry.first.Scalar();
        const FieldDescriptor* field = type.FindFieldByName(key);
        if (field == nullptr) unknown_key(entry.first, key, type, path);
        if (!seen.insert(key).second) refuse(entry.first, path, "the key \"" + key + "\" stands there twice");
        const auto* oneof = field->real_containing_oneof();
        if (oneof != nullptr && !chosen.insert(oneof).second) {
          refuse(entry.first, path, "\"" + key + "\" cannot stand beside another " + oneof->name());
        }
        const std::string inner = path.empty() ? key : path + "." + key;
        // A null may stand on a later line.
        if (entry.second.IsNull()) refuse(entry.first, inner, "expected a value, got nothing");
        member(entry.second, message, *field, inner);
      });
    }
  }

 private:
  /// Bounds depth and size.
  class Nesting {
   public:
    Nesting(Walker& walker, const YAML::Node& node, const std::string& path) : walker_(walker) {
      if (++walker_.depth_ > max_depth)
        walker_.refuse(node, path.substr(0, 80), "nested deeper than " + std::to_string(max_depth));
      if (walker_.content_bytes_ > max_content_bytes) walker_.refuse(node, path.substr(0, 80), "too much content");
    }
    ~Nesting() { --walker_.depth_; }

   private:
    Walker& walker_;
  };

  void member(const YAML::Node& node, Message& message, const FieldDescriptor& field, const std::string& path) {
    if (!field.is_repeated()) return value(node, message, field, path);
    if (files_.ids && node.IsMap() && field.cpp_type() == FieldDescriptor::CPPTYPE_UINT32) {
      return ids_of_file(node, message, field, path);
    }
    if (!node.IsSequence()) refuse(node, path, "expected a list, got " + shown(node));
    const Nesting nesting(*this, node, path);
    std::size_t index = 0;
    for (const auto& item : node) {
      const std::string inner = path + "[" + std::to_string(index++) + "]";
      problems_.check(inner, [&] { value(item, message, field, inner); });
    }
  }

  void ids_of_file(const YAML::Node& node, Message& message, const FieldDescriptor& field, const std::string& path) {
    std::string file, set;
    for (const auto& entry : node) {
      const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : std::string();
      if (key != "file" && key != "set") refuse(entry.first, path, "expected a list, or a map of file, set");
      if (!entry.second.IsScalar() || entry.second.Scalar().empty()) refuse(entry.first, path + "." + key, "expected a text");
      if (!(key == "file" ? file : set).empty()) refuse(entry.first, path, "the key \"" + key + "\" stands there twice");
      (key == "file" ? file : set) = entry.second.Scalar();
    }
    if (file.empty()) refuse(node, path, "expected a list, or a map of file, set");
    std::vector<std::uint32_t> ids;
    try {
      ids = files_.ids(file, set);
    } catch (const Error& error) {
      refuse_file(node, path, error);
    }
    content_bytes_ += sizeof(double) * ids.size();
    const Nesting nesting(*this, node, path);
    const google::protobuf::Reflection& reflection = *message.GetReflection();
    for (const std::uint32_t id : ids) reflection.AddUInt32(&message, &field, id);
  }

  /// Wrong content is reported with the line.
  [[noreturn]] void refuse_file(const YAML::Node& node, const std::string& path, const Error& error) const {
    if (error.code() != ErrorCode::invalid_argument && error.code() != ErrorCode::not_found) throw error;
    refuse(node, path, error.what());
  }

  /// Base64, or the name of a file.
  std::string bytes(const YAML::Node& node, const std::string& path) {
    constexpr const char* expected = "expected a map of file, or bytes in base64";
    if (node.IsScalar()) {
      const auto decoded = base64_decoded(node.Scalar());
      if (!decoded) refuse(node, path, std::string(expected) + ", got " + shown(node));
      return *decoded;
    }
    const YAML::Node file = node.IsMap() && node.size() == 1 ? node["file"] : YAML::Node();
    if (!files_.bytes || !file.IsDefined() || !file.IsScalar() || file.Scalar().empty()) refuse(node, path, expected);
    try {
      return files_.bytes(file.Scalar());
    } catch (const Error& error) {
      refuse_file(node, path, error);
    }
  }

  /// A plain number, or the value of an expression.
  double number(const YAML::Node& node, const std::string& path) const {
    if (const auto plain = parse_number(node.Scalar())) return *plain;
    try {
      return evaluate_expression(node.Scalar(), files_.names);
    } catch (const Error& error) {
      refuse(node, path,
             std::string("expected a finite number, got ") + (node.Tag() == "!" ? "the text " : "") + shown(node) + ": " +
                 error.what());
    }
  }

  /// Sets a field, or appends to it when it is repeated.
  void value(const YAML::Node& node, Message& message, const FieldDescriptor& field, const std::string& path) {
    const google::protobuf::Reflection& reflection = *message.GetReflection();
    content_bytes_ += sizeof(double);
    if (field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      return map(node,
                 *(field.is_repeated() ? reflection.AddMessage(&message, &field) : reflection.MutableMessage(&message, &field)),
                 path);
    }
    if (field.type() == FieldDescriptor::TYPE_BYTES && !field.is_repeated()) {
      std::string content = bytes(node, path);
      content_bytes_ += content.size();
      return reflection.SetString(&message, &field, std::move(content));
    }
    if (!node.IsScalar()) refuse(node, path, "expected " + expectation(field) + ", got " + shown(node));
    const std::string& text = node.Scalar();
    content_bytes_ += text.size();
    if (!is_utf8(text)) refuse(node, path, "the text is not UTF-8");
    const bool quoted = node.Tag() == "!";
    const auto put = [&](auto number, auto set, auto add) {
      if (quoted || !number) return false;
      field.is_repeated() ? (reflection.*add)(&message, &field, *number) : (reflection.*set)(&message, &field, *number);
      return true;
    };
    using google::protobuf::Reflection;
    bool fits = false;
    switch (field.cpp_type()) {
      case FieldDescriptor::CPPTYPE_STRING:
        fits = true;
        field.is_repeated() ? reflection.AddString(&message, &field, text) : reflection.SetString(&message, &field, text);
        break;
      case FieldDescriptor::CPPTYPE_ENUM: {
        const auto* name = enumerator(node, *field.enum_type(), path);
        fits = true;
        field.is_repeated() ? reflection.AddEnum(&message, &field, name) : reflection.SetEnum(&message, &field, name);
        break;
      }
      case FieldDescriptor::CPPTYPE_BOOL:
        fits = put(boolean(text), &Reflection::SetBool, &Reflection::AddBool);
        break;
      case FieldDescriptor::CPPTYPE_DOUBLE:
        if (quoted && parse_number(text)) break;  // a text that looks like a number is a mistake, an expression cannot be one
        fits = true;
        field.is_repeated() ? reflection.AddDouble(&message, &field, number(node, path))
                            : reflection.SetDouble(&message, &field, number(node, path));
        break;
      case FieldDescriptor::CPPTYPE_UINT32:
        fits = put(integer<std::uint32_t>(text), &Reflection::SetUInt32, &Reflection::AddUInt32);
        break;
      case FieldDescriptor::CPPTYPE_UINT64:
        fits = put(integer<std::uint64_t>(text), &Reflection::SetUInt64, &Reflection::AddUInt64);
        break;
      case FieldDescriptor::CPPTYPE_INT32:
        fits = put(integer<std::int32_t>(text), &Reflection::SetInt32, &Reflection::AddInt32);
        break;
      case FieldDescriptor::CPPTYPE_INT64:
        fits = put(integer<std::int64_t>(text), &Reflection::SetInt64, &Reflection::AddInt64);
        break;
      case FieldDescriptor::CPPTYPE_FLOAT:  // no message that people write has one
      case FieldDescriptor::CPPTYPE_MESSAGE:
        break;
    }
    if (!fits) refuse(node, path, "expected " + expectation(field) + ", got " + (quoted ? "the text " : "") + shown(node));
  }

  const google::protobuf::EnumValueDescriptor* enumerator(const YAML::Node& node, const google::protobuf::EnumDescriptor& type,
                                                          const std::string& path) const {
    if (const auto* found = type.FindValueByName(node.Scalar())) return found;
    std::vector<std::string> names;
    std::string all;
    for (int i = 0; i < type.value_count(); ++i) {
      const std::string& name = type.value(i)->name();
      if (name.ends_with("_DEFAULT")) continue;  // what a missing key means; never written
      names.push_back(name);
      all += (all.empty() ? "" : ", ") + name;
    }
    std::string upper = node.Scalar();
    for (char& c : upper) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    const std::string near = nearest_names(upper, names);
    refuse(node, path, shown(node) + " is none of " + all + (near.empty() ? "" : "; did you mean " + near + "?"));
  }

  static bool is_utf8(std::string_view text) {
    while (!text.empty()) {
      const std::size_t length = utf8_length(text);
      if (length == 0) return false;
      text.remove_prefix(length);
    }
    return true;
  }

  static std::optional<bool> boolean(const std::string& text) {
    if (text == "true" || text == "false") return text == "true";
    return std::nullopt;
  }

  template <typename T>
  static std::optional<T> integer(const std::string& text) {
    T number{};
    const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (failure != std::errc() || end != text.data() + text.size()) return std::nullopt;
    return number;
  }

  static std::string expectation(const FieldDescriptor& field) {
    switch (field.cpp_type()) {
      case FieldDescriptor::CPPTYPE_STRING:
        return "a text";
      case FieldDescriptor::CPPTYPE_BOOL:
        return "true or false";
      case FieldDescriptor::CPPTYPE_ENUM:
        return "a name such as " + field.enum_type()->value(field.enum_type()->value_count() > 1 ? 1 : 0)->name();
      case FieldDescriptor::CPPTYPE_DOUBLE:
        return "a finite number";
      case FieldDescriptor::CPPTYPE_UINT32:
        return "an integer from " + limits_text(field);
      case FieldDescriptor::CPPTYPE_UINT64:
        return "an integer from 0 to " + std::to_string(std::numeric_limits<std::uint64_t>::max());
      default:
        return "an integer";
    }
  }

  static std::vector<std::string> names_of(const Descriptor& type) {
    std::vector<std::string> names;
    for (int i = 0; i < type.field_count(); ++i) names.push_back(type.field(i)->name());
    return names;
  }

  static std::string keys_of(const Descriptor& type) {
    std::string all;
    for (const auto& name : names_of(type)) all += (all.empty() ? "" : ", ") + name;
    return all;
  }

  [[noreturn]] void unknown_key(const YAML::Node& node, const std::string& key, const Descriptor& type, const std::string& path) {
    const std::string near = nearest_names(key, names_of(type));
    refuse(node, path,
           "unknown key \"" + key + "\"; " + (near.empty() ? "expected one of " + keys_of(type) : "did you mean " + near + "?"));
  }

  [[noreturn]] void refuse(const YAML::Node& node, const std::string& path, const std::string& why) const {
    throw Error(ErrorCode::invalid_argument,
                name_ + ":" + std::to_string(node.Mark().line + 1) + ": " + (path.empty() ? "" : path + ": ") + why);
  }

  const std::string& name_;
  const ValueFiles& files_;
  Problems& problems_;
  std::size_t content_bytes_ = 0;
  int depth_ = 0;
};

}  // namespace

std::string top_level_text(const std::string& text, const std::string& key) {
  try {
    const YAML::Node root = YAML::Load(text);
    if (!root.IsMap()) return {};
    const YAML::Node value = root[key];
    return value.IsDefined() && value.IsScalar() ? value.Scalar() : std::string();
  } catch (const YAML::Exception&) {
    return {};
  }
}

void parse_yaml(const std::string& text, const std::string& name, Message& message) {
  Problems problems(Problems::Mode::throw_first);
  parse_yaml(text, name, message, {}, problems);
}

void parse_yaml(const std::string& text, const std::string& name, Message& message, const ValueFiles& files, Problems& problems) {
  YAML::Node root;
  try {
    root = YAML::Load(text);
  } catch (const YAML::DeepRecursion&) {  // the parser's own limit, which is above ours
    const YAML::Mark mark = too_deep(text);
    throw Error(ErrorCode::invalid_argument, name + ":" + std::to_string(mark.line + 1) + ": column " +
                                                 std::to_string(mark.column + 1) + ": nested deeper than " +
                                                 std::to_string(max_depth));
  } catch (const YAML::Exception& error) {
    throw Error(ErrorCode::invalid_argument, name + ":" + std::to_string(error.mark.line + 1) + ": " + error.msg);
  }
  if (!root.IsDefined() || root.IsNull()) throw Error(ErrorCode::invalid_argument, name + ":1: the file is empty");
  message.Clear();
  problems.check("", [&] { Walker(name, files, problems).map(root, message, ""); });
}

}  // namespace deform::client
