// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

namespace deform::python {

namespace py = pybind11;

/// Compiled deformations. After bind_client().
void bind_compiled(py::module_& module);

}  // namespace deform::python
