// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

#include <string>

#include "client/python/binding/arrays.h"
#include "deform/v1/deformation.pb.h"

namespace deform::python {

/// The motion of a handle: a 3 x 4 array is an affine map, an n x 3 array displacements of its points. Throws
/// Error(invalid_argument) naming motions["HANDLE"].
v1::Motion motion_of(const std::string& handle, const Doubles& values);

void bind_client(py::module_& module);
/// After bind_client() and bind_meshes().
void bind_population(py::module_& module);

/// What the context of that name says, or the one in use when the name is empty; None without. Keys as in the file.
pybind11::object find_context(const std::string& name);

}  // namespace deform::python
