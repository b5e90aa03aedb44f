// SPDX-License-Identifier: Apache-2.0
#include "client/python/binding/bind_quality.h"

#include <pybind11/stl.h>

#include <cmath>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/python/binding/arrays.h"
#include "client/python/binding/bind_mesh.h"
#include "core/base/error.h"
#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/quality/flipped_faces.h"

namespace deform::python {

namespace {

/// A mesh with what is prepared to find its flipped faces. Immutable; any thread.
class FaceCheck {
 public:
  /// Throws Error(invalid_argument) for a mesh without faces.
  explicit FaceCheck(std::shared_ptr<const Mesh> mesh) : mesh_(checked(std::move(mesh))), flips_(*mesh_, mesh_->points) {}

  std::size_t points() const { return mesh_->point_count(); }
  std::size_t faces() const { return flips_.face_count(); }

  /// Of each design the number of flipped faces, or nothing where its points are not finite, which is how designs that could not
  /// be evaluated are kept. points: m x n x 3.
  template <typename T>
  std::vector<std::optional<std::size_t>> flipped(std::span<const T> points, int threads) const {
    const std::size_t stride = 3 * mesh_->point_count();
    if (points.size() % stride != 0) {
      throw Error(ErrorCode::invalid_argument, "points: " + std::to_string(points.size()) + " numbers, expected a multiple of " +
                                                   std::to_string(stride) + ", those of a design");
    }
    RunContext context;
    context.threads = threads;
    std::vector<std::optional<std::size_t>> counts;
    Points design(mesh_->point_count());
    for (std::size_t first = 0; first < points.size(); first += stride) {
      bool finite = true;
      for (std::size_t i = 0; i < stride; ++i) {
        design[i / 3][i % 3] = static_cast<double>(points[first + i]);
        finite = finite && std::isfinite(design[i / 3][i % 3]);
      }
      counts.push_back(finite ? std::optional(flips_.flipped(design, context).size()) : std::nullopt);
    }
    return counts;
  }

 private:
  static std::shared_ptr<const Mesh> checked(std::shared_ptr<const Mesh> mesh) {
    if (mesh->face_count() == 0) throw Error(ErrorCode::invalid_argument, "mesh: it has no faces");
    return mesh;
  }

  std::shared_ptr<const Mesh> mesh_;
  FlipCheck flips_;  ///< refers to the mesh
};

template <typename T>
std::vector<std::optional<std::size_t>> flipped(const FaceCheck& check, const py::array_t<T, py::array::c_style>& points,
                                                int threads) {
  const std::span values(points.data(), static_cast<std::size_t>(points.size()));
  const py::gil_scoped_release release;
  return check.flipped(values, threads);
}

}  // namespace

void bind_quality(py::module_& module) {
  py::class_<FaceCheck, std::shared_ptr<FaceCheck>>(module, "FaceCheck")
      .def(py::init([](const MeshSource& source) {
             const py::gil_scoped_release release;
             return std::make_shared<FaceCheck>(source.mesh);
           }),
           py::arg("mesh"))
      .def_property_readonly("points", &FaceCheck::points)
      .def_property_readonly("faces", &FaceCheck::faces)
      .def("flipped", &flipped<float>, py::arg("points").noconvert(), py::arg("threads"))
      .def("flipped", &flipped<double>, py::arg("points").noconvert(), py::arg("threads"));
}

}  // namespace deform::python
