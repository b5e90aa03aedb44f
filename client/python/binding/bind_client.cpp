// SPDX-License-Identifier: Apache-2.0
#include "client/python/binding/bind_client.h"

#include <pybind11/stl.h>

#include <vector>

#include "client/client.h"
#include "client/design.h"
#include "client/python/binding/arrays.h"
#include "client/python/binding/bind_mesh.h"
#include "client/python/binding/calls.h"
#include "client/python/binding/record.h"
#include "client/setup/contexts.h"
#include "client/setup/yaml_message.h"

namespace deform::python {

namespace {

v1::Encoding encoding_named(const std::string& name) {
  v1::Encoding encoding = v1::ENCODING_DEFAULT;
  if (name.empty() || v1::Encoding_Parse(name, &encoding)) return encoding;
  throw Error(ErrorCode::invalid_argument,
              "encoding: there is no \"" + name + "\", expected RAW_F64, RAW_F32, DRACO or DELTA_ZSTD");
}

struct ClientSettings {
  std::string address;
  bool replicas;
  double connect_timeout;
  int max_attempts;
  std::optional<double> patience;
  int threads;
  std::string encoding;
  std::uint64_t retry_seed;
  bool tls;
  std::string ca, cert, key, server_name, token_file;
};

client::ClientOptions options_of(const ClientSettings& settings) {
  client::ClientOptions options;
  options.address = settings.address;
  options.replicas = settings.replicas;
  options.connect_timeout = std::chrono::milliseconds(static_cast<std::int64_t>(settings.connect_timeout * 1000));
  options.max_attempts = settings.max_attempts;
  if (settings.patience) options.patience = std::chrono::milliseconds(static_cast<std::int64_t>(*settings.patience * 1000));
  options.decode_threads = settings.threads;
  options.encoding = encoding_named(settings.encoding);
  options.retry_seed = settings.retry_seed;
  if (settings.tls) options.tls = client::TlsOptions{settings.ca, settings.cert, settings.key, settings.server_name};
  options.token_file = settings.token_file;
  return options;
}

py::list records(const auto& messages) {
  py::list list;
  for (const auto& message : messages) list.append(Record(message));
  return list;
}

/// What the callback raised goes before what the call says about it.
template <typename Call>
Record call_with(Callback& callback, const Call& call) {
  std::optional<Record> record;
  try {
    record = call();
  } catch (const Error&) {
    callback.rethrow();
    throw;
  }
  callback.rethrow();
  return *record;
}

Record register_mesh(client::Client& client, const MeshSource& source, const std::string& name, const py::object& progress,
                     const CallLimits& limits) {
  CallLimits given = limits;
  given.cancel = limits.stop();
  Callback callback(progress, *given.cancel);
  std::function<void(double)> on_progress;
  if (callback.given()) on_progress = [&](double fraction) { callback(std::string("upload"), fraction); };
  return call_with(callback, [&] {
    return Record(run_call(given, [&](const client::CallOptions& call) {
      const Mesh& mesh = *source.mesh;
      client::GeometryArrays arrays;
      arrays.points = mesh.points;
      arrays.face_sizes = mesh.face_sizes;
      arrays.face_points = mesh.face_points;
      for (const auto& group : mesh.groups) arrays.groups.push_back({group.name, group.points, group.faces});
      arrays.name = name;
      arrays.cells = mesh.cells_view();
      const auto info = client.register_geometry(arrays, call, on_progress);
      client.keep_points(info.id(), std::shared_ptr<const Points>(source.mesh, &mesh.points));  // no copy stays
      return info;
    }));
  });
}

Record prepare(client::Client& client, const ReadSetup& setup, const py::object& progress, const CallLimits& limits) {
  CallLimits given = limits;
  given.cancel = limits.stop();
  Callback callback(progress, *given.cancel);
  std::function<void(const std::string&, double)> on_progress;
  if (callback.given()) on_progress = [&](const std::string& stage, double fraction) { callback(stage, fraction); };
  return call_with(callback, [&] {
    return Record(
        run_call(given, [&](const client::CallOptions& call) { return client.prepare(setup.setup, call, on_progress); }));
  });
}

py::array jacobian_vector(client::Client& client, const std::string& system, const Doubles& variables, const Doubles& direction,
                          const CallLimits& limits) {
  v1::JacobianVectorRequest request;
  request.set_system_id(system);
  const auto x = numbers_view(variables, "variables"), v = numbers_view(direction, "direction");
  request.mutable_variables()->Add(x.begin(), x.end());
  request.mutable_direction()->Add(v.begin(), v.end());
  return points_array(run_call(limits, [&](const client::CallOptions& call) { return client.jacobian_vector(request, call); }));
}

py::array vector_jacobian(client::Client& client, const std::string& system, const Doubles& variables, const Doubles& cotangent,
                          const CallLimits& limits) {
  const auto x = numbers_view(variables, "variables");
  const auto w = points_view(cotangent, "cotangent");
  const auto gradient =
      run_call(limits, [&](const client::CallOptions& call) { return client.vector_jacobian(system, x, w, call); });
  return py::array_t<double>(static_cast<py::ssize_t>(gradient.size()), gradient.data());
}

/// m x n x 3 to m x k.
py::array vector_jacobians(client::Client& client, const std::string& system, const Doubles& variables, const Doubles& cotangents,
                           const CallLimits& limits) {
  const auto x = numbers_view(variables, "variables");
  if (cotangents.ndim() != 3 || cotangents.shape(2) != 3) {
    throw Error(ErrorCode::invalid_argument, "cotangents: expected an array of shape (m, n, 3)");
  }
  const auto count = static_cast<std::size_t>(cotangents.shape(0));
  const std::span<const Vec3> w(reinterpret_cast<const Vec3*>(cotangents.data()),
                                count * static_cast<std::size_t>(cotangents.shape(1)));
  const auto gradients =
      run_call(limits, [&](const client::CallOptions& call) { return client.vector_jacobians(system, x, w, count, call); });
  const std::size_t columns = count == 0 ? 0 : gradients.size() / count;
  return py::array_t<double>({static_cast<py::ssize_t>(count), static_cast<py::ssize_t>(columns)}, gradients.data());
}

v1::Design design_of(const Doubles& variables, const std::vector<std::pair<std::string, Doubles>>& motions) {
  v1::Design design = client::variables_design(numbers_view(variables, "variables"));
  for (const auto& [handle, values] : motions) *design.add_motions() = motion_of(handle, values);
  return design;
}

/// Moved points, and the server's report on them.
py::tuple evaluate(client::Client& client, const std::string& system, const Doubles& variables,
                   const std::vector<std::pair<std::string, Doubles>>& motions, const Doubles& points,
                   const std::string& encoding, double tolerance, double solver_tolerance, const CallLimits& limits) {
  v1::EvaluateHeader header;
  header.set_system_id(system);
  *header.mutable_design() = design_of(variables, motions);
  header.mutable_output()->set_encoding(encoding_named(encoding));
  header.mutable_output()->set_tolerance(tolerance);
  header.set_solver_tolerance(solver_tolerance);
  const auto from = points_view(points, "points");
  Points moved(from.size());
  Record report(
      run_call(limits, [&](const client::CallOptions& call) { return client.evaluate(header, from, std::span(moved), call); }));
  return py::make_tuple(points_array(std::move(moved)), std::move(report));
}

py::array registered_points(client::Client& client, const std::string& id, const CallLimits& limits) {
  auto points = std::make_shared<const Points>(
      run_call(limits, [&](const client::CallOptions& call) { return client.get_points(id, call); }));
  return points_array(points, *points);
}

v1::EstimateRequest estimate_request(const ReadSetup& setup, bool list_problems) {
  v1::EstimateRequest request;
  *request.mutable_setup() = setup.setup;
  request.set_list_problems(list_problems);
  return request;
}

}  // namespace

py::object find_context(const std::string& name) {
  const auto contexts = client::read_contexts(client::contexts_file());
  const std::string& used = name.empty() ? contexts.current : name;
  if (used.empty()) return py::none();
  const client::Context& found = contexts.find(used);
  py::dict out;
  out["server"] = found.server;
  out["replicas"] = found.replicas;
  out["tls"] = found.tls;
  out["ca"] = found.ca;
  out["cert"] = found.cert;
  out["key"] = found.key;
  out["server_name"] = found.server_name;
  out["token_file"] = found.token_file;
  return out;
}

void bind_client(py::module_& module) {
  using client::CallOptions;
  using client::Client;

  py::class_<std::stop_source>(module, "Cancel", "Ends the calls that it is given to, from any thread.")
      .def(py::init<>())
      .def(
          "cancel", [](std::stop_source& source) { source.request_stop(); }, py::call_guard<py::gil_scoped_release>(),
          "Ends the calls, for good.")
      .def_property_readonly("cancelled", &std::stop_source::stop_requested, "Whether that was done.");
  py::class_<CallLimits>(module, "Limits")
      .def(py::init([](std::optional<double> timeout, std::optional<std::stop_source> cancel) {
             return CallLimits{timeout, std::move(cancel)};
           }),
           py::arg("timeout") = py::none(), py::arg("cancel") = py::none());

  py::class_<Client>(module, "Client")
      .def(py::init([](const std::string& address, bool replicas, double connect_timeout, int max_attempts,
                       std::optional<double> patience, int threads, const std::string& encoding, std::uint64_t retry_seed,
                       bool tls, const std::string& ca, const std::string& cert, const std::string& key,
                       const std::string& server_name, const std::string& token_file) {
             return std::make_unique<Client>(options_of({address, replicas, connect_timeout, max_attempts, patience, threads,
                                                         encoding, retry_seed, tls, ca, cert, key, server_name, token_file}));
           }),
           py::arg("address"), py::arg("replicas"), py::arg("connect_timeout"), py::arg("max_attempts"), py::arg("patience"),
           py::arg("threads"), py::arg("encoding"), py::arg("retry_seed"), py::arg("tls"), py::arg("ca"), py::arg("cert"),
           py::arg("key"), py::arg("server_name"), py::arg("token_file"))
      .def_property_readonly("encoding", [](const Client& client) { return v1::Encoding_Name(client.encoding()); })
      .def("register", &register_mesh, py::arg("mesh"), py::arg("name"), py::arg("progress"), py::arg("limits"))
      .def("points", &registered_points, py::arg("id"), py::arg("limits"))
      .def("geometry",
           [](Client& client, const std::string& id, const CallLimits& limits) {
             return Record(run_call(limits, [&](const CallOptions& call) { return client.get_geometry(id, call); }));
           })
      .def("geometries",
           [](Client& client, const CallLimits& limits) {
             return records(run_call(limits, [&](const CallOptions& call) { return client.list_geometries(call); }));
           })
      .def("delete_geometry",
           [](Client& client, const std::string& id, bool systems, const CallLimits& limits) {
             v1::DeleteGeometryRequest request;
             request.set_id(id);
             request.set_with_setups(systems);
             return Record(run_call(limits, [&](const CallOptions& call) { return client.delete_geometry(request, call); }));
           })
      .def("estimate",
           [](Client& client, const ReadSetup& setup, bool list_problems, const CallLimits& limits) {
             const auto request = estimate_request(setup, list_problems);
             return Record(run_call(limits, [&](const CallOptions& call) { return client.estimate(request, call); }));
           })
      .def("prepare", &prepare, py::arg("setup"), py::arg("progress"), py::arg("limits"))
      .def("system",
           [](Client& client, const std::string& id, const CallLimits& limits) {
             return Record(run_call(limits, [&](const CallOptions& call) { return client.get_system(id, call); }));
           })
      .def("systems",
           [](Client& client, const CallLimits& limits) {
             return records(run_call(limits, [&](const CallOptions& call) { return client.list_systems(call); }));
           })
      .def("release",
           [](Client& client, const std::string& id, bool forget, const CallLimits& limits) {
             v1::ReleaseSystemRequest request;
             request.set_id(id);
             request.set_forget(forget);
             return Record(run_call(limits, [&](const CallOptions& call) { return client.release_system(request, call); }));
           })
      .def("jacobian_vector", &jacobian_vector)
      .def("vector_jacobian", &vector_jacobian)
      .def("vector_jacobians", &vector_jacobians)
      .def("evaluate", &evaluate)
      .def("server_info", [](Client& client, const CallLimits& limits) {
        return Record(run_call(limits, [&](const CallOptions& call) { return client.server_info(call); }));
      });
}

}  // namespace deform::python
