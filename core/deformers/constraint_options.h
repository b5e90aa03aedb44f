#pragma once

#include "core/deformers/setup.h"

namespace deform {

/// Whether or not there are constraints. Throws Error(invalid_argument) naming the field ("constraint_options.tolerance"), its
/// value and the limits.
void validate_constraint_options(const ConstraintOptions& options);

}  // namespace deform
