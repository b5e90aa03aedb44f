// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "core/deformers/setup.h"
#include "deform/v1/setup.pb.h"

namespace deform::convert {

/// Converts a constraint. Throws Error(invalid_argument) with the path of the field, see setup.h. The numbers of regions and
/// points and all limits are checked by validate().
Constraint constraint_from_proto(const v1::Constraint& message, const std::string& path);

/// The options of a setup. What else it says decides what they mean where it was stored before there was `exact_steps`.
ConstraintOptions constraint_options_from_proto(const v1::Setup& message);

/// Fill in defaults, see canonical_setup(). Those of the method must not have been filled in before those of the options.
void canonicalize_constraint(v1::Constraint& message);
void canonicalize_constraint_options(v1::Setup& message);

}  // namespace deform::convert
