// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

namespace deform::python {

namespace py = pybind11;

void bind_client(py::module_& module);
/// After bind_client() and bind_meshes().
void bind_population(py::module_& module);

}  // namespace deform::python
