#include "client/cli/setup/yaml_message.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/util/json_util.h>
#include <yaml-cpp/yaml.h>

#include <charconv>
#include <cmath>
#include <limits>
#include <set>
#include <vector>

#include "client/cli/output/numbers.h"
#include "core/base/error.h"

namespace deform::cli {

namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;

constexpr int max_depth = 100;
/// Aliases can blow up a short text.
constexpr std::size_t max_json_bytes = std::size_t{1} << 28;

std::string json_string(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      result += '\\';
      result += c;
    } else if (static_cast<unsigned char>(c) < 0x20) {
      const char* digits = "0123456789abcdef";
      result += "\\u00";
      result += digits[static_cast<unsigned char>(c) >> 4];
      result += digits[static_cast<unsigned char>(c) & 15];
    } else {
      result += c;
    }
  }
  return result + "\"";
}

std::string shown(const YAML::Node& node) {
  if (node.IsNull()) return "nothing";
  if (node.IsMap()) return "a map";
  if (node.IsSequence()) return "a list";
  constexpr std::size_t most = 40;
  const std::string text = node.Scalar().substr(0, most);
  return "\"" + text + (node.Scalar().size() > most ? "..." : "") + "\"";
}

class Walker {
 public:
  explicit Walker(const std::string& name) : name_(name) {}

  std::string json() && { return std::move(json_); }

  void map(const YAML::Node& node, const Descriptor& type, const std::string& path) {
    if (!node.IsMap()) refuse(node, path, "expected a map of " + keys_of(type) + ", got " + shown(node));
    const Nesting nesting(*this, node, path);
    std::set<std::string> seen;
    std::set<const google::protobuf::OneofDescriptor*> chosen;
    json_ += '{';
    for (const auto& entry : node) {
      if (!entry.first.IsScalar()) refuse(entry.first, path, "a key must be a word");
      const std::string key = entry.first.Scalar();
      const FieldDescriptor* field = type.FindFieldByName(key);
      if (field == nullptr) unknown_key(entry.first, key, type, path);
      if (!seen.insert(key).second) refuse(entry.first, path, "the key \"" + key + "\" stands there twice");
      const auto* oneof = field->real_containing_oneof();
      if (oneof != nullptr && !chosen.insert(oneof).second) {
        refuse(entry.first, path, "\"" + key + "\" cannot stand beside another " + oneof->name());
      }
      if (seen.size() > 1) json_ += ',';
      json_ += json_string(key) + ":";
      const std::string inner = path.empty() ? key : path + "." + key;
      if (entry.second.IsNull()) refuse(entry.first, inner, "expected a value, got nothing");  // a null may stand on a later line
      member(entry.second, *field, inner);
    }
    json_ += '}';
  }

 private:
  /// Bounds depth and size.
  class Nesting {
   public:
    Nesting(Walker& walker, const YAML::Node& node, const std::string& path) : walker_(walker) {
      if (++walker_.depth_ > max_depth)
        walker_.refuse(node, path.substr(0, 80), "nested deeper than " + std::to_string(max_depth));
      if (walker_.json_.size() > max_json_bytes) walker_.refuse(node, path.substr(0, 80), "too much content");
    }
    ~Nesting() { --walker_.depth_; }

   private:
    Walker& walker_;
  };

  void member(const YAML::Node& node, const FieldDescriptor& field, const std::string& path) {
    if (!field.is_repeated()) return value(node, field, path);
    if (!node.IsSequence()) refuse(node, path, "expected a list, got " + shown(node));
    const Nesting nesting(*this, node, path);
    json_ += '[';
    std::size_t index = 0;
    for (const auto& item : node) {
      if (index > 0) json_ += ',';
      value(item, field, path + "[" + std::to_string(index++) + "]");
    }
    json_ += ']';
  }

  void value(const YAML::Node& node, const FieldDescriptor& field, const std::string& path) {
    if (field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) return map(node, *field.message_type(), path);
    if (!node.IsScalar()) refuse(node, path, "expected " + expectation(field) + ", got " + shown(node));
    const std::string& text = node.Scalar();
    const bool quoted = node.Tag() == "!";
    bool fits = false;
    switch (field.cpp_type()) {
      case FieldDescriptor::CPPTYPE_STRING:
        fits = true;
        json_ += json_string(text);
        break;
      case FieldDescriptor::CPPTYPE_BOOL:
        fits = !quoted && (text == "true" || text == "false");
        json_ += text;
        break;
      case FieldDescriptor::CPPTYPE_ENUM:
        fits = enumerator(node, *field.enum_type(), path);
        break;
      case FieldDescriptor::CPPTYPE_DOUBLE:
      case FieldDescriptor::CPPTYPE_FLOAT:
        fits = !quoted && floating(text);
        break;
      case FieldDescriptor::CPPTYPE_UINT32:
        fits = !quoted && integer<std::uint32_t>(text);
        break;
      case FieldDescriptor::CPPTYPE_UINT64:
        fits = !quoted && integer<std::uint64_t>(text);
        break;
      case FieldDescriptor::CPPTYPE_INT32:
        fits = !quoted && integer<std::int32_t>(text);
        break;
      case FieldDescriptor::CPPTYPE_INT64:
        fits = !quoted && integer<std::int64_t>(text);
        break;
      case FieldDescriptor::CPPTYPE_MESSAGE:
        break;
    }
    if (!fits) refuse(node, path, "expected " + expectation(field) + ", got " + (quoted ? "the text " : "") + shown(node));
  }

  bool enumerator(const YAML::Node& node, const google::protobuf::EnumDescriptor& type, const std::string& path) {
    if (type.FindValueByName(node.Scalar()) != nullptr) {
      json_ += json_string(node.Scalar());
      return true;
    }
    std::vector<std::string> names;
    std::string all;
    for (int i = 0; i < type.value_count(); ++i) {
      names.push_back(type.value(i)->name());
      all += (i > 0 ? ", " : "") + names.back();
    }
    std::string upper = node.Scalar();
    for (char& c : upper) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    const std::string near = nearest_names(upper, names);
    refuse(node, path, shown(node) + " is none of " + all + (near.empty() ? "" : "; did you mean " + near + "?"));
  }

  bool floating(const std::string& text) {
    const auto number = parse_number(text);
    if (!number) return false;
    char shortest[32];
    const auto end = std::to_chars(shortest, shortest + sizeof(shortest), *number).ptr;
    json_.append(shortest, end);
    return true;
  }

  template <typename T>
  bool integer(const std::string& text) {
    T number{};
    const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (failure != std::errc() || end != text.data() + text.size()) return false;
    json_ += std::to_string(number);
    return true;
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
      case FieldDescriptor::CPPTYPE_FLOAT:
        return "a finite number";
      case FieldDescriptor::CPPTYPE_UINT32:
        return "an integer from 0 to " + std::to_string(std::numeric_limits<std::uint32_t>::max());
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
  std::string json_;
  int depth_ = 0;
};

}  // namespace

void parse_yaml(const std::string& text, const std::string& name, google::protobuf::Message& message) {
  YAML::Node root;
  try {
    root = YAML::Load(text);
  } catch (const YAML::Exception& error) {
    throw Error(ErrorCode::invalid_argument, name + ":" + std::to_string(error.mark.line + 1) + ": " + error.msg);
  }
  if (!root.IsDefined() || root.IsNull()) throw Error(ErrorCode::invalid_argument, name + ":1: the file is empty");
  Walker walker(name);
  walker.map(root, *message.GetDescriptor(), "");
  const std::string json = std::move(walker).json();
  const auto status = google::protobuf::util::JsonStringToMessage(json, &message);
  if (!status.ok()) throw Error(ErrorCode::invalid_argument, name + ": " + std::string(status.message()));
}

}  // namespace deform::cli
