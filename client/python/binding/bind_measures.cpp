// SPDX-License-Identifier: Apache-2.0
#include "client/python/binding/bind_measures.h"

#include <pybind11/stl.h>

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/python/binding/arrays.h"
#include "client/python/binding/bind_mesh.h"
#include "client/python/binding/calls.h"
#include "core/base/error.h"
#include "core/measures/clearance.h"
#include "core/measures/integrals.h"
#include "core/measures/sobolev_filter.h"
#include "core/measures/thickness.h"

namespace deform::python {

namespace {

using measures::FaceChoice;
using measures::FaceSource;
using measures::Measure;
using measures::Rims;
using Names = std::vector<std::string>;

/// The value of the table with that name. Throws Error(invalid_argument) naming the field.
template <typename Value, std::size_t count>
Value named(const char* field, const std::string& name, const std::pair<const char*, Value> (&table)[count]) {
  std::string all;
  for (const auto& [known, value] : table) {
    if (name == known) return value;
    all += std::string(all.empty() ? "" : " or ") + "\"" + known + "\"";
  }
  throw Error(ErrorCode::invalid_argument, std::string(field) + ": \"" + name + "\", expected " + all);
}

FaceChoice choice_of(const Names& groups, const std::string& of) {
  static constexpr std::pair<const char*, FaceSource> sources[] = {{"faces", FaceSource::faces}, {"cells", FaceSource::cells}};
  return {groups, named("of", of, sources)};
}

Rims rims_of(const std::string& rims) {
  static constexpr std::pair<const char*, Rims> kinds[] = {{"refuse", Rims::refuse}, {"close", Rims::close}};
  return named("rims", rims, kinds);
}

/// Prepares without the GIL, so that Ctrl-C stops it where it takes a context.
template <typename Make>
std::shared_ptr<const Measure> prepared(const Make& make) {
  return run_call({}, [&](const client::CallOptions& call) {
    RunContext context;
    context.stop = call.stop;
    return std::shared_ptr<const Measure>(make(context));
  });
}

std::shared_ptr<const Measure> volume(const MeshSource& source, const Names& groups, const std::string& of,
                                      const std::string& rims) {
  return prepared([&](const RunContext&) { return make_volume(*source.mesh, choice_of(groups, of), rims_of(rims)); });
}

std::shared_ptr<const Measure> centre_of_gravity(const MeshSource& source, const Names& groups, const std::string& of,
                                                 const std::string& rims) {
  return prepared([&](const RunContext&) { return make_centre_of_gravity(*source.mesh, choice_of(groups, of), rims_of(rims)); });
}

std::shared_ptr<const Measure> area(const MeshSource& source, const Names& groups, const std::string& of) {
  return prepared([&](const RunContext&) { return make_area(*source.mesh, choice_of(groups, of)); });
}

std::shared_ptr<const Measure> projected_area(const MeshSource& source, const Names& groups, const std::string& of,
                                              const Vec3& direction) {
  return prepared([&](const RunContext&) { return make_projected_area(*source.mesh, choice_of(groups, of), direction); });
}

struct ThicknessArguments {
  Names groups, at;
  std::string of, rims, method;
  double tolerance, opposing_degrees;
};

std::shared_ptr<const Measure> thickness(const MeshSource& source, const ThicknessArguments& given) {
  static constexpr std::pair<const char*, measures::ThicknessMethod> methods[] = {
      {"rays", measures::ThicknessMethod::rays}, {"spheres", measures::ThicknessMethod::spheres}};
  return prepared([&](const RunContext& context) {
    measures::ThicknessOptions options{choice_of(given.groups, given.of),      rims_of(given.rims), given.at,
                                       named("method", given.method, methods), given.tolerance,     given.opposing_degrees};
    return make_thickness(*source.mesh, options, context);
  });
}

std::shared_ptr<const Measure> clearance(const MeshSource& source, const Names& groups, const std::string& of,
                                         const measures::KeepOut& keep_out, double tolerance) {
  return prepared([&](const RunContext&) { return make_clearance(*source.mesh, choice_of(groups, of), keep_out, tolerance); });
}

RunContext context_of(const client::CallOptions& call, int threads) {
  RunContext context;
  context.stop = call.stop;
  context.threads = threads;
  return context;
}

/// (values (m,), gradients of (n, 3), least or None)
py::tuple values_of(const Measure& measure, const Doubles& points, bool gradients, int threads) {
  const auto view = points_view(points, "points");
  measures::Measurement found = run_call({}, [&](const client::CallOptions& call) {
    return measure.evaluate(view, gradients ? measures::Gradients::wanted : measures::Gradients::left_out,
                            context_of(call, threads));
  });
  py::list fields;
  for (Points& field : found.gradients) fields.append(points_array(std::move(field)));
  py::object least = py::none();
  if (found.least) {
    const measures::Least& one = *found.least;
    least = py::make_tuple(one.value, one.at, one.index, one.tolerance, one.samples, one.covering);
  }
  return py::make_tuple(found.values, fields, least);
}

/// (field of the shape of the given one, residual, iterations, converged)
py::tuple filter(const measures::SobolevFilter& sobolev, const Doubles& field, const std::string& form, int threads) {
  static constexpr std::pair<const char*, measures::SobolevForm> forms[] = {{"density", measures::SobolevForm::density},
                                                                            {"derivative", measures::SobolevForm::derivative},
                                                                            {"transposed", measures::SobolevForm::transposed}};
  if (field.ndim() < 1 || field.ndim() > 2 || static_cast<std::size_t>(field.shape(0)) != sobolev.point_count()) {
    throw Error(ErrorCode::invalid_argument,
                "field: an array of shape " + py::str(field.attr("shape")).cast<std::string>() +
                    ", expected (n,) or (n, components) with n = " + std::to_string(sobolev.point_count()));
  }
  const std::size_t components = field.ndim() == 1 ? 1 : static_cast<std::size_t>(field.shape(1));
  const std::span values(field.data(), static_cast<std::size_t>(field.size()));
  const auto chosen = named("form", form, forms);
  const measures::Filtered found = run_call(
      {}, [&](const client::CallOptions& call) { return sobolev.apply(values, components, chosen, context_of(call, threads)); });
  const std::vector<py::ssize_t> shape(field.shape(), field.shape() + field.ndim());
  return py::make_tuple(py::array_t<double>(shape, found.field.data()), found.residual, found.iterations, found.converged);
}

std::shared_ptr<measures::SobolevFilter> sobolev_filter(const MeshSource& source, const Doubles& points,
                                                        const measures::SobolevOptions& options) {
  const auto view = points_view(points, "points");
  const py::gil_scoped_release release;
  return std::make_shared<measures::SobolevFilter>(*source.mesh, view, options);
}

}  // namespace

void bind_measures(py::module_& module) {
  py::class_<Measure, std::shared_ptr<Measure>>(module, "Measure")
      .def_static("volume", &volume, py::arg("mesh"), py::arg("groups"), py::arg("of"), py::arg("rims"))
      .def_static("centre_of_gravity", &centre_of_gravity, py::arg("mesh"), py::arg("groups"), py::arg("of"), py::arg("rims"))
      .def_static("area", &area, py::arg("mesh"), py::arg("groups"), py::arg("of"))
      .def_static("projected_area", &projected_area, py::arg("mesh"), py::arg("groups"), py::arg("of"), py::arg("direction"))
      .def_static(
          "thickness",
          [](const MeshSource& mesh, const Names& groups, const std::string& of, const std::string& rims, const Names& at,
             const std::string& method, double tolerance, double opposing_degrees) {
            return thickness(mesh, {groups, at, of, rims, method, tolerance, opposing_degrees});
          },
          py::arg("mesh"), py::arg("groups"), py::arg("of"), py::arg("rims"), py::arg("at"), py::arg("method"),
          py::arg("tolerance"), py::arg("opposing_degrees"))
      .def_static(
          "clearance_of_box",
          [](const MeshSource& mesh, const Names& groups, const std::string& of, const Vec3& min, const Vec3& max,
             double tolerance) {
            return clearance(mesh, groups, of, Box{min, max}, tolerance);
          },
          py::arg("mesh"), py::arg("groups"), py::arg("of"), py::arg("min"), py::arg("max"), py::arg("tolerance"))
      .def_static(
          "clearance_of_mesh",
          [](const MeshSource& mesh, const Names& groups, const std::string& of, const MeshSource& keep_out, double tolerance) {
            return clearance(mesh, groups, of, *keep_out.mesh, tolerance);
          },
          py::arg("mesh"), py::arg("groups"), py::arg("of"), py::arg("keep_out"), py::arg("tolerance"))
      .def_property_readonly("point_count", &Measure::point_count)
      .def_property_readonly("value_count", &Measure::value_count)
      .def("evaluate", &values_of, py::arg("points"), py::arg("gradients"), py::arg("threads"));
  py::class_<measures::SobolevFilter, std::shared_ptr<measures::SobolevFilter>>(module, "SobolevFilter")
      .def(py::init([](const MeshSource& mesh, const Doubles& points, double length, const Names& groups, const std::string& of,
                       double tolerance, std::size_t iterations) {
             return sobolev_filter(mesh, points, {length, choice_of(groups, of), tolerance, iterations});
           }),
           py::arg("mesh"), py::arg("points"), py::arg("length"), py::arg("groups"), py::arg("of"), py::arg("tolerance"),
           py::arg("iterations"))
      .def_property_readonly("areas",
                             [](const measures::SobolevFilter& self) {
                               const std::vector<double> areas = self.areas();
                               return py::array_t<double>(static_cast<py::ssize_t>(areas.size()), areas.data());
                             })
      .def("apply", &filter, py::arg("field"), py::arg("form"), py::arg("threads"));
}

}  // namespace deform::python
