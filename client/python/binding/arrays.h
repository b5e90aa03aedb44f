// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/base/types.h"

namespace deform::python {

namespace py = pybind11;

/// Doubles in C order; other types and orders are converted.
using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Ids = py::array_t<std::uint32_t, py::array::c_style>;

/// The rows of an n x 3 array, which must outlive it. Throws Error(invalid_argument) naming `what` for another shape.
std::span<const Vec3> points_view(const Doubles& array, const std::string& what);
/// The numbers of a one-dimensional array. Throws as points_view().
std::span<const double> numbers_view(const Doubles& array, const std::string& what);
/// The numbers of a one-dimensional array of ids.
std::span<const std::uint32_t> ids_view(const Ids& array, const std::string& what);

/// Points as an n x 3 array that takes their memory over.
py::array points_array(Points&& points);
/// Points that `owner` keeps alive, as an n x 3 array that cannot be written to.
py::array points_array(const std::shared_ptr<const void>& owner, std::span<const Vec3> points);
py::array ids_array(std::span<const std::uint32_t> ids);

}  // namespace deform::python
