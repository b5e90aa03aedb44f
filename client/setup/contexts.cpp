// SPDX-License-Identifier: Apache-2.0
#include "client/setup/contexts.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cstdlib>
#include <system_error>
#include <vector>

#include "client/setup/refuse.h"
#include "core/base/small_file.h"
#include "core/base/text.h"

namespace deform::client {

namespace {

constexpr std::size_t longest_name = 64;

struct ContextKey {
  const char* name;
  std::string Context::*field;
  bool file;
};

constexpr ContextKey context_keys[] = {
    {"server", &Context::server, false},
    {"ca", &Context::ca, true},
    {"cert", &Context::cert, true},
    {"key", &Context::key, true},
    {"server_name", &Context::server_name, false},
    {"token_file", &Context::token_file, true},
};

/// Reads the file; errors name the line.
class ContextsReader {
 public:
  explicit ContextsReader(const std::filesystem::path& file) : file_(file) {}

  Contexts read() const {
    Contexts out;
    out.file = file_;
    const YAML::Node root = YAML::Load(read_small_file(file_, "contexts"));
    if (root.IsNull()) return out;
    expect_map(root, "the file");
    for (const auto& entry : root) {
      const auto key = scalar(entry.first, "a key");
      if (key == "current") {
        if (!entry.second.IsNull()) out.current = scalar(entry.second, key);
      } else if (key == "contexts") {
        read_all(entry.second, out);
      } else {
        fail(entry.first, "unknown key \"" + key + "\", expected current or contexts");
      }
    }
    if (!out.current.empty() && !out.known.contains(out.current)) {
      fail(root["current"], "current: there is no context \"" + out.current + "\"");
    }
    return out;
  }

 private:
  void read_all(const YAML::Node& node, Contexts& out) const {
    if (node.IsNull()) return;
    expect_map(node, "contexts");
    for (const auto& entry : node) {
      const auto name = scalar(entry.first, "a name");
      try {
        check_context_name(name);
      } catch (const Error& error) {
        fail(entry.first, error.what());
      }
      expect_map(entry.second, name);
      if (!out.known.emplace(name, read_one(entry.second)).second) fail(entry.first, "\"" + name + "\" is there twice");
    }
  }

  Context read_one(const YAML::Node& node) const {
    Context out;
    for (const auto& entry : node) {
      const auto name = scalar(entry.first, "a key");
      if (name == "tls" || name == "replicas") {
        bool& value = name == "tls" ? out.tls : out.replicas;
        if (!YAML::convert<bool>::decode(entry.second, value)) fail(entry.second, name + ": expected true or false");
        continue;
      }
      const auto* key =
          std::find_if(std::begin(context_keys), std::end(context_keys), [&](const auto& k) { return name == k.name; });
      if (key == std::end(context_keys)) {
        std::vector<std::string> names = {"replicas", "tls"};
        for (const auto& one : context_keys) names.emplace_back(one.name);
        const std::string near = nearest_names(name, names);
        fail(entry.first, "unknown key \"" + name + "\"" + (near.empty() ? "" : "; did you mean " + near + "?"));
      }
      std::string& value = out.*(key->field);
      value = scalar(entry.second, name);
      if (key->file && !value.empty()) value = (file_.parent_path() / value).lexically_normal().string();
    }
    return out;
  }

  void expect_map(const YAML::Node& node, const std::string& what) const {
    if (!node.IsMap()) fail(node, what + ": expected a mapping");
  }
  std::string scalar(const YAML::Node& node, const std::string& what) const {
    if (!node.IsScalar()) fail(node, what + ": expected a text");
    return node.Scalar();
  }
  [[noreturn]] void fail(const YAML::Node& node, const std::string& why) const {
    refuse(file_.string() + ":" + std::to_string(node.Mark().line + 1) + ": " + why);
  }

  const std::filesystem::path& file_;
};

}  // namespace

const Context& Contexts::find(const std::string& name) const {
  const auto found = known.find(name);
  if (found != known.end()) return found->second;
  std::string names;
  for (const auto& entry : known) names += (names.empty() ? "" : ", ") + entry.first;
  throw Error(ErrorCode::not_found, "context: there is no \"" + printable(name) + "\" in " + file.string() +
                                        (names.empty() ? "; deform context add makes one" : ", only " + names));
}

std::filesystem::path contexts_file() {
  const auto set = [](const char* variable) {
    const char* value = std::getenv(variable);
    return std::filesystem::path(value == nullptr ? "" : value);
  };
  if (const auto named = set("DEFORM_CONFIG"); !named.empty()) return named;
  if (const auto folder = set("XDG_CONFIG_HOME"); folder.is_absolute()) return folder / "deform" / "contexts.yaml";
  const auto home = set("HOME");
  return home.empty() ? home : home / ".config" / "deform" / "contexts.yaml";
}

Contexts read_contexts(const std::filesystem::path& file) {
  std::error_code none;
  if (file.empty() || !std::filesystem::exists(file, none)) {
    Contexts out;
    out.file = file;
    return out;
  }
  try {
    return ContextsReader(file).read();
  } catch (const YAML::Exception& error) {
    refuse(file.string() + ":" + std::to_string(error.mark.line + 1) + ": " + error.msg);
  }
}

std::string to_yaml(const Contexts& contexts) {
  YAML::Emitter out;
  out << YAML::BeginMap;
  if (!contexts.current.empty()) out << YAML::Key << "current" << YAML::Value << contexts.current;
  out << YAML::Key << "contexts" << YAML::Value << YAML::BeginMap;
  for (const auto& [name, context] : contexts.known) {
    out << YAML::Key << name << YAML::Value << YAML::BeginMap;
    for (const auto& key : context_keys) {
      if (const std::string& value = context.*(key.field); !value.empty()) out << YAML::Key << key.name << YAML::Value << value;
    }
    if (context.replicas) out << YAML::Key << "replicas" << YAML::Value << true;
    if (context.tls) out << YAML::Key << "tls" << YAML::Value << true;
    out << YAML::EndMap;
  }
  out << YAML::EndMap << YAML::EndMap;
  return std::string(out.c_str(), out.size()) + "\n";
}

void check_context_name(const std::string& name) {
  const bool good = !name.empty() && name.size() <= longest_name && std::all_of(name.begin(), name.end(), [](unsigned char c) {
    return (c < 128 && std::isalnum(c) != 0) || c == '-' || c == '_' || c == '.';
  });
  if (!good) {
    refuse("context: \"" + printable(name.substr(0, longest_name)) + "\" is no name: 1 to " + std::to_string(longest_name) +
           " letters, digits, '-', '_' and '.' were expected");
  }
}

}  // namespace deform::client
