// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

#include <string>

namespace deform::python {

namespace py = pybind11;

void bind_client(py::module_& module);
/// After bind_client() and bind_meshes().
void bind_population(py::module_& module);

/// What the context of that name says, or the one in use when the name is empty; None without. Keys as in the file.
pybind11::object find_context(const std::string& name);

}  // namespace deform::python
