// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

namespace deform::cad {

/// Whether this program was built with OpenCASCADE. Without it everything in this folder that does something only throws.
bool available();

/// Throws Error(failed_precondition) with the option and the packages that bring OpenCASCADE where it is not available(). To be
/// called before anything else is read.
void require();

}  // namespace deform::cad
