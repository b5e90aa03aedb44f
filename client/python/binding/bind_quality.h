// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

namespace deform::python {

/// FaceCheck: counts flipped faces of many designs; CellCheck: inverted cells of one. QualityCheck: measures them by the names of
/// `deform quality`; design_measure: their reports by those of --fail-on.
void bind_quality(pybind11::module_& module);

}  // namespace deform::python
