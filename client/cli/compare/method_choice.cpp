// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/compare/method_choice.h"

#include <google/protobuf/descriptor.h>

#include <algorithm>
#include <filesystem>
#include <set>

#include "client/cli/setup/reading.h"
#include "core/base/error.h"

namespace deform::cli {

namespace {

using google::protobuf::FieldDescriptor;

std::vector<std::string> method_names() {
  const auto& kinds = *v1::Method::descriptor()->FindOneofByName("kind");
  std::vector<std::string> names;
  for (int i = 0; i < kinds.field_count(); ++i) names.push_back(kinds.field(i)->name());
  return names;
}

/// The name of the method of a message; that of no method is rbf.
std::string kind_of(const v1::Method& method) {
  const FieldDescriptor* field =
      method.GetReflection()->GetOneofFieldDescriptor(method, v1::Method::descriptor()->FindOneofByName("kind"));
  return field == nullptr ? "rbf" : field->name();
}

MethodChoice named_method(const std::string& name, const v1::Setup& setup) {
  if (kind_of(setup.method()) == name) return {name, name, "the setup", setup.method()};
  MethodChoice choice{name, name, "defaults", {}};
  choice.method.GetReflection()->MutableMessage(&choice.method, v1::Method::descriptor()->FindFieldByName(name));
  return choice;
}

MethodChoice method_of_file(const std::filesystem::path& path, const std::shared_ptr<const Mesh>& mesh) {
  const v1::Method method = read_method_file(path, mesh);
  return {path.stem().string(), kind_of(method), path.string(), method};
}

std::vector<std::string> automatic_names(const v1::Setup& setup) {
  const std::string own = kind_of(setup.method());
  std::vector<std::string> names{own};
  for (const std::string& name : method_names()) {
    if (name != own && name != "cage") names.push_back(name);
  }
  return names;
}

}  // namespace

std::vector<MethodChoice> method_choices(const std::vector<std::string>& names, const v1::Setup& setup,
                                         const std::shared_ptr<const Mesh>& mesh) {
  const std::vector<std::string> known = method_names();
  std::vector<MethodChoice> choices;
  std::set<std::string> labels;
  for (const std::string& name : names.empty() ? automatic_names(setup) : names) {
    if (std::find(known.begin(), known.end(), name) != known.end()) {
      choices.push_back(named_method(name, setup));
    } else if (std::filesystem::is_regular_file(name)) {
      choices.push_back(method_of_file(name, mesh));
    } else {
      std::string all;
      for (const auto& each : known) all += (all.empty() ? "" : ", ") + each;
      const std::string near = nearest_names(name, known);
      refuse("--methods " + name + ": neither a file nor one of " + all + (near.empty() ? "" : "; did you mean " + near + "?"));
    }
    if (!labels.insert(choices.back().label).second) {
      refuse("--methods: \"" + choices.back().label + "\" is there twice; files are called by their names without extension");
    }
  }
  return choices;
}

}  // namespace deform::cli
