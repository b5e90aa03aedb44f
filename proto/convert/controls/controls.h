// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "core/numerics/lattice/lattice_options.h"
#include "core/numerics/motion/variable_motion.h"
#include "deform/v1/setup.pb.h"

namespace deform::convert {

/// Throws Error(invalid_argument) with the path of the field ("method.ffd.lattice.points"): what can be told without a mesh.
LatticeOptions lattice_from_proto(const v1::Lattice& message);

/// How the variable moves its first handle. Throws Error(invalid_argument) with the path of the field, which starts with `path`:
/// not exactly one of translate, rotate, scale, vectors without three finite numbers, an unknown unit.
VariableMotion motion_from_proto(const v1::DesignVariable& message, const std::string& path);
/// How it moves the handle of also[index]. Throws as above.
VariableMotion also_from_proto(const v1::DesignVariable& message, int index, const std::string& path);

}  // namespace deform::convert
