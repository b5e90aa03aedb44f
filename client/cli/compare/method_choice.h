// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/mesh/mesh.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli {

/// A method chosen for the comparison.
struct MethodChoice {
  std::string label;   ///< unique: the name of the method, or of the file without folders and extension
  std::string kind;    ///< the field of Method: "rbf"
  std::string source;  ///< source of its options: "defaults", "the setup", or the name of a file
  v1::Method method;
};

/// The methods of --methods: names of methods, with the options of the setup where it has that method and the defaults otherwise,
/// and setup files that hold nothing but `method`. None named: the method of the setup, and all others but cage, which has no
/// defaults. Throws Error(invalid_argument): neither a name nor a file (with the nearest names), a file with other keys or
/// without a method, the same twice; and what reading the file throws. mesh: for cages of files that are generated.
std::vector<MethodChoice> method_choices(const std::vector<std::string>& names, const v1::Setup& setup,
                                         const std::shared_ptr<const Mesh>& mesh = nullptr);

}  // namespace deform::cli
