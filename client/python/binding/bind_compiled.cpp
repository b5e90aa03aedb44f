// SPDX-License-Identifier: Apache-2.0
#include "client/python/binding/bind_compiled.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "client/client.h"
#include "client/python/binding/arrays.h"
#include "client/python/binding/calls.h"
#include "core/base/error.h"
#include "core/base/small_file.h"
#include "core/base/vectors.h"
#include "core/compiled/deformation.h"
#include "core/compiled/reader.h"
#include "core/compiled/records.h"
#include "core/quality/displacement.h"

namespace deform::python {

namespace {

using Bytes = std::vector<std::byte>;

/// A compiled deformation that can be written again. Immutable; any thread.
class Compiled {
 public:
  /// Throws as compiled::read_content().
  explicit Compiled(Bytes bytes) : evaluator_(compiled::read_content(bytes)) {
    if (bytes.size() != compiled::Records(evaluator_.content()).bytes()) file_ = std::move(bytes);
  }

  const compiled::Deformation& evaluator() const { return evaluator_; }
  const compiled::Content& content() const { return evaluator_.content(); }

  /// Gives the bytes of the file to `sink`, piece by piece.
  template <typename Sink>
  void write(const Sink& sink) const {
    if (!file_.empty()) {
      for (std::size_t first = 0; first < file_.size(); first += compiled::Records::piece_bytes) {
        sink(std::span(file_).subspan(first, std::min(compiled::Records::piece_bytes, file_.size() - first)));
      }
      return;
    }
    compiled::Records records(content());
    for (Bytes piece; records.next(piece);) sink(std::span<const std::byte>(piece));
  }

 private:
  compiled::Deformation evaluator_;
  Bytes file_;  ///< where its content takes more bytes than the file: a basis in codes
};

py::bytes python_bytes(std::span<const std::byte> bytes) { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }

std::shared_ptr<Compiled> load(const std::filesystem::path& path) {
  const py::gil_scoped_release release;
  if (const std::string why = why_unreadable(path); !why.empty()) {
    throw Error(ErrorCode::not_found, path.string() + ": cannot be read: " + why);
  }
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  Bytes bytes(static_cast<std::size_t>(file.tellg()));
  file.seekg(0).read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  if (!file) throw Error(ErrorCode::data_loss, path.string() + ": cannot be read");
  try {
    return std::make_shared<Compiled>(std::move(bytes));
  } catch (const Error& error) {
    throw Error(error.code(), path.string() + ": " + error.what());
  }
}

std::shared_ptr<Compiled> parse(const py::bytes& bytes) {
  const auto view = static_cast<std::string_view>(bytes);
  const auto* const begin = reinterpret_cast<const std::byte*>(view.data());
  const py::gil_scoped_release release;
  return std::make_shared<Compiled>(Bytes(begin, begin + view.size()));
}

std::shared_ptr<Compiled> compile(client::Client& client, const std::string& system, const std::string& mesh,
                                  const CallLimits& limits) {
  v1::GetBasisRequest request;
  request.set_system_id(system);
  request.set_mesh(mesh);
  return run_call(limits, [&](const client::CallOptions& call) {
    Bytes bytes;
    client.get_basis(
        request, [&](std::span<const std::byte> piece) { bytes.insert(bytes.end(), piece.begin(), piece.end()); }, call);
    return std::make_shared<Compiled>(std::move(bytes));
  });
}

/// Calls body(memory) with an array of doubles or floats that is to be filled.
template <typename Body>
void with_memory(py::array& array, const Body& body) {
  const auto size = static_cast<std::size_t>(array.size());
  const bool in_order = (array.flags() & py::array::c_style) != 0 && array.writeable();
  if (in_order && py::isinstance<py::array_t<double>>(array)) {
    return body(std::span(static_cast<double*>(array.mutable_data()), size));
  }
  if (in_order && py::isinstance<py::array_t<float>>(array)) {
    return body(std::span(static_cast<float*>(array.mutable_data()), size));
  }
  throw Error(ErrorCode::invalid_argument, "out: expected a writeable array of float64 or float32 in C order");
}

void evaluate_designs(const Compiled& compiled, const Doubles& designs, py::array out, int threads) {
  const std::span values(designs.data(), static_cast<std::size_t>(designs.size()));
  with_memory(out, [&](auto points) {
    const py::gil_scoped_release release;
    compiled.evaluator().evaluate(values, points, threads);
  });
}

void derivative_along(const Compiled& compiled, const Doubles& variables, const Doubles& direction, py::array out, int threads) {
  const auto x = numbers_view(variables, "variables"), v = numbers_view(direction, "direction");
  with_memory(out, [&](auto vectors) {
    const py::gil_scoped_release release;
    compiled.evaluator().jacobian_vector(x, v, vectors, threads);
  });
}

template <typename T>
py::array pull_back(const Compiled& compiled, const Doubles& variables, const py::array_t<T, py::array::c_style>& cotangent,
                    int threads) {
  const auto x = numbers_view(variables, "variables");
  std::vector<double> gradient(compiled.evaluator().variables());
  {
    const std::span w(cotangent.data(), static_cast<std::size_t>(cotangent.size()));
    const py::gil_scoped_release release;
    compiled.evaluator().vector_jacobian(x, w, gradient, threads);
  }
  return py::array_t<double>(static_cast<py::ssize_t>(gradient.size()), gradient.data());
}

struct Report {
  compiled::Report solution;
  double largest_displacement = 0;         ///< of the points as they are given, model units
  std::size_t points_across_symmetry = 0;  ///< of the same
};

template <typename T>
double largest_displacement(const Points& rest, std::span<const T> points) {
  const auto place = [&](std::size_t i) {
    return Vec3{static_cast<double>(points[3 * i]), static_cast<double>(points[3 * i + 1]),
                static_cast<double>(points[3 * i + 2])};
  };
  return largest_distance(rest.size(), place, rest).value;
}

template <typename T>
std::size_t points_across_symmetry(const compiled::Deformation& evaluator, std::span<const T> points) {
  if (evaluator.sides().empty()) return 0;
  const double rounding =
      std::is_same_v<T, float> ? 4.0 * std::numeric_limits<T>::epsilon() * evaluator.content().largest_coordinate : 0.0;
  PlaneSides::Crossings found;
  std::array<Vec3, 512> some;
  for (std::size_t first = 0; first < evaluator.points(); first += some.size()) {
    const std::size_t count = std::min(some.size(), evaluator.points() - first);
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t k = 0; k < 3; ++k) some[i][k] = static_cast<double>(points[3 * (first + i) + k]);
    }
    found.add(evaluator.sides().crossings(std::span(some).first(count), first, rounding));
  }
  return found.points;
}

/// Evaluates those designs that can be; the others are NaN, and have an error for a report.
template <typename T>
std::vector<std::variant<Report, Error>> deformed(const compiled::Deformation& evaluator, std::span<const double> designs,
                                                  std::span<T> points, int threads) {
  const std::size_t k = evaluator.variables(), stride = 3 * evaluator.points();
  const std::size_t count = k == 0 ? 0 : designs.size() / k;
  if (points.size() != count * stride) {
    throw Error(ErrorCode::invalid_argument,
                "out: expected " + std::to_string(count * stride) + " numbers, got " + std::to_string(points.size()));
  }
  std::vector<std::variant<Report, Error>> reports;
  for (std::size_t i = 0; i < count; ++i) {
    try {
      reports.emplace_back(Report{evaluator.report(designs.subspan(i * k, k))});
    } catch (const Error& error) {
      reports.emplace_back(error);
    }
  }
  for (std::size_t i = 0, end = 0; i < count; i = end) {
    const bool usable = std::holds_alternative<Report>(reports[i]);
    for (end = i + 1; end < count && std::holds_alternative<Report>(reports[end]) == usable;) ++end;
    const auto part = points.subspan(i * stride, (end - i) * stride);
    if (usable) {
      evaluator.evaluate(designs.subspan(i * k, (end - i) * k), part, threads);
    } else {
      std::fill(part.begin(), part.end(), std::numeric_limits<T>::quiet_NaN());
    }
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (auto* const report = std::get_if<Report>(&reports[i])) {
      const std::span<const T> design = points.subspan(i * stride, stride);
      report->largest_displacement = largest_displacement<T>(evaluator.content().rest, design);
      report->points_across_symmetry = points_across_symmetry<T>(evaluator, design);
    }
  }
  return reports;
}

py::list deform(const Compiled& compiled, const Doubles& designs, py::array out, int threads) {
  const std::span values(designs.data(), static_cast<std::size_t>(designs.size()));
  std::vector<std::variant<Report, Error>> reports;
  with_memory(out, [&](auto points) {
    const py::gil_scoped_release release;
    reports = deformed(compiled.evaluator(), values, points, threads);
  });
  py::list list;
  for (const auto& one : reports) {
    if (const auto* const report = std::get_if<Report>(&one)) {
      const compiled::Report& solution = report->solution;
      list.append(py::make_tuple(solution.error, report->largest_displacement, solution.prescribed_displacement,
                                 solution.interpolation_residual, solution.converged, report->points_across_symmetry,
                                 py::tuple(py::cast(solution.doubts))));
    } else {
      list.append(exception_of(std::get<Error>(one)));
    }
  }
  return list;
}

py::list variables(const Compiled& compiled) {
  py::list list;
  for (const compiled::Variable& variable : compiled.content().variables) {
    list.append(py::make_tuple(variable.name, compiled.content().handles[variable.handle].name, variable.lower, variable.upper));
  }
  return list;
}

py::bytes file_bytes(const Compiled& compiled) {
  std::string bytes;
  compiled.write(
      [&](std::span<const std::byte> piece) { bytes.append(reinterpret_cast<const char*>(piece.data()), piece.size()); });
  return bytes;
}

}  // namespace

void bind_compiled(py::module_& module) {
  py::class_<Compiled, std::shared_ptr<Compiled>>(module, "Compiled")
      .def_static("load", &load, py::arg("path"))
      .def_static("parse", &parse, py::arg("bytes"))
      .def_property_readonly("variables", &variables)
      .def_property_readonly("rest",
                             [](const std::shared_ptr<Compiled>& self) { return points_array(self, self->content().rest); })
      .def_property_readonly("diagonal", [](const Compiled& self) { return self.content().diagonal; })
      .def_property_readonly("judged_by", [](const Compiled& self) { return self.evaluator().size().judged_by; })
      .def_property_readonly("system_id", [](const Compiled& self) { return self.content().system_id; })
      .def_property_readonly("geometry_id", [](const Compiled& self) { return self.content().geometry_id; })
      .def_property_readonly("method", [](const Compiled& self) { return self.content().method; })
      .def_property_readonly("mesh", [](const Compiled& self) { return self.content().mesh; })
      .def_property_readonly("notes", [](const Compiled& self) { return self.content().notes; })
      .def(
          "write",
          [](const Compiled& self, const py::object& sink) {
            self.write([&](std::span<const std::byte> piece) { sink(python_bytes(piece)); });
          },
          py::arg("sink"))
      .def("to_bytes", &file_bytes)
      .def("evaluate", &evaluate_designs, py::arg("designs"), py::arg("out").noconvert(), py::arg("threads"))
      .def("deform", &deform, py::arg("designs"), py::arg("out").noconvert(), py::arg("threads"))
      .def("jacobian_vector", &derivative_along, py::arg("variables"), py::arg("direction"), py::arg("out").noconvert(),
           py::arg("threads"))
      .def("vector_jacobian", &pull_back<float>, py::arg("variables"), py::arg("cotangent").noconvert(), py::arg("threads"))
      .def("vector_jacobian", &pull_back<double>, py::arg("variables"), py::arg("cotangent").noconvert(), py::arg("threads"));
  module.def("compile", &compile, py::arg("client"), py::arg("system"), py::arg("mesh"), py::arg("limits"));
}

}  // namespace deform::python
