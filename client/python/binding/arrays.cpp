// SPDX-License-Identifier: Apache-2.0
#include "client/python/binding/arrays.h"

#include "core/base/error.h"

namespace deform::python {

namespace {

[[noreturn]] void refuse_shape(const py::array& array, const std::string& what, const char* expected) {
  const auto shape = py::str(array.attr("shape")).cast<std::string>();
  throw Error(ErrorCode::invalid_argument, what + ": an array of shape " + shape + ", expected " + expected);
}

template <typename T>
py::capsule keeper(T* owned) {
  return py::capsule(owned, [](void* pointer) { delete static_cast<T*>(pointer); });
}

std::vector<py::ssize_t> shape_of(std::size_t points) { return {static_cast<py::ssize_t>(points), 3}; }

}  // namespace

std::span<const Vec3> points_view(const Doubles& array, const std::string& what) {
  if (array.ndim() != 2 || array.shape(1) != 3) refuse_shape(array, what, "(n, 3)");
  static_assert(sizeof(Vec3) == 3 * sizeof(double));
  return {reinterpret_cast<const Vec3*>(array.data()), static_cast<std::size_t>(array.shape(0))};
}

std::span<const double> numbers_view(const Doubles& array, const std::string& what) {
  if (array.ndim() != 1) refuse_shape(array, what, "one axis");
  return {array.data(), static_cast<std::size_t>(array.shape(0))};
}

std::span<const std::uint32_t> ids_view(const Ids& array, const std::string& what) {
  if (array.ndim() != 1) refuse_shape(array, what, "one axis");
  return {array.data(), static_cast<std::size_t>(array.shape(0))};
}

py::array points_array(Points&& points) {
  auto owned = std::make_unique<Points>(std::move(points));
  const Points& content = *owned;
  const py::capsule keep = keeper(owned.release());
  return py::array_t<double>(shape_of(content.size()), content.data()->data(), keep);
}

py::array points_array(const std::shared_ptr<const void>& owner, std::span<const Vec3> points) {
  const py::capsule keep = keeper(new std::shared_ptr<const void>(owner));
  py::array_t<double> array(shape_of(points.size()), reinterpret_cast<const double*>(points.data()), keep);
  array.attr("setflags")(py::arg("write") = false);
  return array;
}

py::array ids_array(std::span<const std::uint32_t> ids) {
  return py::array_t<std::uint32_t>(static_cast<py::ssize_t>(ids.size()), ids.data());
}

}  // namespace deform::python
