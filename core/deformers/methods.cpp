// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/methods.h"

#include <string>

#include "core/base/error.h"

namespace deform {

namespace {

/// "method.shell, method.subspace or method.mls": those that have a feature.
std::string methods_with(bool MethodFeatures::*feature) {
  std::vector<std::string> names;
  Methods::for_each([&]<Method M>() {
    if (M::features.*feature) names.push_back("method." + std::string(M::name));
  });
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i) {
    text += (i == 0 ? "" : i + 1 == names.size() ? " or " : ", ") + names[i];
  }
  return text;
}

}  // namespace

void validate_method(const Setup& setup, const Mesh& mesh) {
  with_method(setup, [&]<Method M>(const typename M::Options& options) {
    const auto refuse = [](const std::string& field, const std::string& what, const std::string& use) {
      throw Error(ErrorCode::invalid_argument,
                  field + ": method." + std::string(M::name) + " does not take " + what + "; use " + use);
    };
    if (!setup.symmetry.empty() && !M::features.symmetry) {
      refuse("symmetry", "symmetry planes", methods_with(&MethodFeatures::symmetry) + ", or deform the whole model");
    }
    if (!setup.constraints.empty() && !M::features.constraints) {
      refuse("constraints", "geometric constraints", methods_with(&MethodFeatures::constraints));
    }
    M::validate(options, setup, mesh);
  });
}

std::optional<std::vector<PointId>> known_centres(const Mesh& mesh, const Setup& setup) {
  const SelectedRegions regions = validate(setup, mesh);
  return with_method(setup,
                     [&]<Method M>(const typename M::Options& options) { return M::known_centres(options, mesh, regions); });
}

}  // namespace deform
