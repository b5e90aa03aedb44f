// SPDX-License-Identifier: Apache-2.0
#include <pybind11/stl.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "client/design.h"
#include "client/python/binding/arrays.h"
#include "client/python/binding/bind_client.h"
#include "client/python/binding/calls.h"
#include "client/python/binding/population.h"
#include "client/python/binding/record.h"
#include "client/setup/yaml_message.h"

namespace deform::python {

v1::Motion motion_of(const std::string& handle, const Doubles& values) {
  if (values.ndim() == 2 && values.shape(0) == 3 && values.shape(1) == 4) {
    Affine map;
    std::copy(values.data(), values.data() + map.size(), map.begin());
    return client::affine_motion(handle, map);
  }
  return client::displacement_motion(handle, points_view(values, "motions[\"" + handle + "\"]"));
}

namespace {

/// A population with the array that its points go to.
class Run {
 public:
  Run(client::Client& client, Population::Options options, std::optional<py::array> target)
      : stop_(options.stop), target_(std::move(target)), population_(std::make_unique<Population>(client, std::move(options))) {}
  ~Run() { end(); }
  Run(const Run&) = delete;
  Run& operator=(const Run&) = delete;

  /// (number, points or None, record or None, error or None) of the next finished design, or None after the last.
  py::object next() {
    if (!population_ || population_->at_end()) return py::none();
    std::optional<Population::Done> done;
    wait_with_signals(stop_, [&](std::chrono::milliseconds most) {
      done = population_->next(most);
      return done.has_value();
    });
    auto& deformed = done->deformed;
    if (deformed.error) return py::make_tuple(done->design, py::none(), py::none(), exception_of(*deformed.error));
    const py::object points = target_ ? py::object(py::none()) : py::object(points_array(std::move(deformed.points)));
    return py::make_tuple(done->design, points, Record(deformed.result), py::none());
  }

  /// Waits for the last one.
  void wait() const {
    if (population_) wait_with_signals(stop_, [&](std::chrono::milliseconds most) { return population_->wait(most); });
  }

  void end() {
    const py::gil_scoped_release release;
    population_.reset();
  }

 private:
  const std::stop_source stop_;
  const std::optional<py::array> target_;
  std::unique_ptr<Population> population_;
};

using Motions = std::vector<std::pair<std::string, Doubles>>;

std::vector<v1::Design> designs_of(const Doubles& variables, const std::vector<Motions>& motions) {
  if (variables.ndim() != 2) throw Error(ErrorCode::invalid_argument, "designs: an array of other than two axes");
  const auto count = static_cast<std::size_t>(variables.shape(0)), width = static_cast<std::size_t>(variables.shape(1));
  if (!motions.empty() && motions.size() != count) {
    throw Error(ErrorCode::invalid_argument,
                "motions: " + std::to_string(motions.size()) + ", designs: " + std::to_string(count));
  }
  std::vector<v1::Design> designs(count);
  for (std::size_t i = 0; i < count; ++i) {
    designs[i] = client::variables_design({variables.data() + i * width, width});
    if (motions.empty()) continue;
    for (const auto& [handle, values] : motions[i]) *designs[i].add_motions() = motion_of(handle, values);
  }
  return designs;
}

std::span<Vec3> target_of(const std::optional<py::array>& target) {
  if (!target) return {};
  auto array = py::array_t<double>::ensure(*target);
  if (array.ptr() != target->ptr() || !(array.flags() & py::array::c_style) || !array.writeable()) {
    throw Error(ErrorCode::invalid_argument, "out: expected a writeable array of float64 in C order");
  }
  return {reinterpret_cast<Vec3*>(array.mutable_data()), static_cast<std::size_t>(array.size()) / 3};
}

std::unique_ptr<Run> begin(client::Client& client, const std::string& request, const Doubles& variables,
                           const std::vector<Motions>& motions, const std::pair<std::size_t, std::size_t>& batch,
                           const std::optional<py::array>& out, const CallLimits& limits) {
  Population::Options options;
  client::parse_yaml(request, "options", options.request);
  options.request.set_failures(v1::FAILURES_PER_DESIGN);
  options.designs = designs_of(variables, motions);
  options.batch = std::max<std::size_t>(1, batch.first);
  options.requests = std::max<std::size_t>(1, batch.second);
  options.stop = limits.stop();
  options.call = limits.options(options.stop);
  options.target = target_of(out);
  return std::make_unique<Run>(client, std::move(options), out);
}

}  // namespace

void bind_population(py::module_& module) {
  py::class_<Run>(module, "Run").def("next", &Run::next).def("wait", &Run::wait).def("end", &Run::end);
  module.def("deform", &begin, py::arg("client"), py::arg("request"), py::arg("variables"), py::arg("motions"), py::arg("batch"),
             py::arg("out"), py::arg("limits"), py::keep_alive<0, 1>());
}

}  // namespace deform::python
