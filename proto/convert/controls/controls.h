// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "core/numerics/lattice/lattice_options.h"
#include "core/numerics/motion/variable_motion.h"
#include "deform/v1/setup.pb.h"

namespace deform::convert {

/// Converts a lattice and makes the checks that need no mesh. Throws Error(invalid_argument) with the path of the
/// field ("method.ffd.lattice.points").
LatticeOptions lattice_from_proto(const v1::Lattice& message);

/// The motion of the first handle of a variable. Throws Error(invalid_argument) with the path of the field, which starts with
/// `path`: not exactly one of translate, rotate, scale, vectors without three finite numbers, or an unknown unit.
VariableMotion motion_from_proto(const v1::DesignVariable& message, const std::string& path);
/// The motion of the handle of also[index]. Throws as above.
VariableMotion also_from_proto(const v1::DesignVariable& message, int index, const std::string& path);

}  // namespace deform::convert
