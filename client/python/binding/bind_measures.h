// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

namespace deform::python {

/// After bind_meshes().
void bind_measures(pybind11::module_& module);

}  // namespace deform::python
