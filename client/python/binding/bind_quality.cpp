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

#include "client/design_measures.h"
#include "client/python/binding/arrays.h"
#include "client/python/binding/bind_mesh.h"
#include "client/python/binding/calls.h"
#include "client/python/binding/record.h"
#include "core/base/error.h"
#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/quality/flipped_faces.h"
#include "core/quality/mesh_quality.h"
#include "core/quality/report.h"
#include "core/quality/safe_amplitude.h"

namespace deform::python {

namespace {

/// A mesh with what is prepared to find its flipped faces. Immutable; any thread.
class FaceCheck {
 public:
  /// Throws Error(invalid_argument) for a mesh without faces.
  explicit FaceCheck(std::shared_ptr<const Mesh> mesh) : mesh_(checked(std::move(mesh))), flips_(*mesh_, mesh_->points) {}

  std::size_t points() const { return mesh_->point_count(); }
  std::size_t faces() const { return flips_.face_count(); }

  /// The number of flipped faces of each design, or nothing where its points are not finite, which is how designs that could not
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

/// A mesh with what is prepared to find its inverted cells. Immutable; any thread.
class CellCheck {
 public:
  /// Throws Error(invalid_argument) for a mesh without cells.
  explicit CellCheck(std::shared_ptr<const Mesh> mesh) : mesh_(std::move(mesh)), check_(mesh_->points, cells_of(*mesh_)) {}

  std::size_t points() const { return mesh_->point_count(); }
  std::size_t cells() const { return check_.cell_count(); }
  std::size_t inverted(std::span<const Vec3> points, const RunContext& context) const {
    return check_.inverted(points, context).count;
  }

 private:
  static CellSet cells_of(const Mesh& mesh) {
    const std::optional<CellSet> cells = cell_set(mesh);
    if (!cells) throw Error(ErrorCode::invalid_argument, "mesh: it has no cells");
    return *cells;
  }

  std::shared_ptr<const Mesh> mesh_;
  InversionCheck check_;  ///< refers to the mesh
};

RunContext context_of(const client::CallOptions& call, int threads) {
  RunContext context;
  context.stop = call.stop;
  context.threads = threads;
  return context;
}

std::shared_ptr<QualityCheck> quality_check(const MeshSource& source, const std::vector<std::string>& walls) {
  return run_call({}, [&](const client::CallOptions& call) {
    return std::make_shared<QualityCheck>(source.mesh, walls, context_of(call, 0));
  });
}

/// In the order of `wanted`.
std::vector<double> values_of(const QualityCheck& check, const Doubles& points, const std::vector<std::string>& wanted,
                              int threads) {
  const auto view = points_view(points, "points");
  return run_call({}, [&](const client::CallOptions& call) { return check.values(view, wanted, context_of(call, threads)); });
}

/// (name, label, value, id or None, whether tables for people have it) of each row.
py::list rows_of(const QualityCheck& check, const Doubles& points, int threads) {
  const auto view = points_view(points, "points");
  const QualityReport report =
      run_call({}, [&](const client::CallOptions& call) { return check.report(view, context_of(call, threads)); });
  py::list rows;
  for (const QualityRow& row : report.rows) rows.append(py::make_tuple(row.name, row.label, row.value, row.id, row.in_table));
  return rows;
}

/// (name, whether it counts) of everything that gates and studies may name.
template <typename Names>
std::vector<std::pair<std::string, bool>> name_pairs(const Names& names) {
  std::vector<std::pair<std::string, bool>> pairs;
  for (const auto& each : names) pairs.emplace_back(each.name, each.counts);
  return pairs;
}

std::optional<double> design_measure(const std::string& name, const Record& record) {
  const auto* result = dynamic_cast<const v1::DesignResult*>(&record.message());
  if (result == nullptr) throw Error(ErrorCode::invalid_argument, "report: expected that on a design");
  return client::find_design_measure(name).of(*result);
}

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
  py::class_<CellCheck, std::shared_ptr<CellCheck>>(module, "CellCheck")
      .def(py::init([](const MeshSource& source) {
             const py::gil_scoped_release release;
             return std::make_shared<CellCheck>(source.mesh);
           }),
           py::arg("mesh"))
      .def_property_readonly("points", &CellCheck::points)
      .def_property_readonly("cells", &CellCheck::cells)
      .def(
          "inverted",
          [](const CellCheck& self, const Doubles& points, int threads) {
            const auto view = points_view(points, "points");
            return run_call({}, [&](const client::CallOptions& call) { return self.inverted(view, context_of(call, threads)); });
          },
          py::arg("points"), py::arg("threads"));
  py::class_<QualityCheck, std::shared_ptr<QualityCheck>>(module, "QualityCheck")
      .def(py::init(&quality_check), py::arg("mesh"), py::arg("walls"))
      .def_property_readonly("points", &QualityCheck::point_count)
      .def_property_readonly("names", [](const QualityCheck& self) { return name_pairs(self.names()); })
      .def("check", &QualityCheck::check, py::arg("name"))
      .def("values", &values_of, py::arg("points"), py::arg("names"), py::arg("threads"))
      .def("rows", &rows_of, py::arg("points"), py::arg("threads"));
  module.def("quality_names", [] { return name_pairs(quality_names()); });
  module.def("design_measures", [] { return name_pairs(client::design_measures()); });
  module.def("design_measure", &design_measure, py::arg("name"), py::arg("report"));
}

}  // namespace deform::python
