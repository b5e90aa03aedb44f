// SPDX-License-Identifier: Apache-2.0
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "client/client.h"
#include "client/python/binding/bind_client.h"
#include "client/python/binding/bind_compiled.h"
#include "client/python/binding/bind_measures.h"
#include "client/python/binding/bind_mesh.h"
#include "client/python/binding/bind_quality.h"
#include "client/python/binding/calls.h"
#include "client/python/binding/record.h"
#include "core/base/error.h"
#include "core/base/version.h"

PYBIND11_MODULE(_deformd, module) {
  using namespace deform;
  module.doc() = "The C++ client library; the package deformd is the interface.";
  module.attr("version") = version();
  module.attr("pybind11_version") = PYBIND11_VERSION_HEX;
  module.def("nearest_names", &nearest_names);
  module.def("find_context", &python::find_context, pybind11::arg("name"));
  module.def("connected", &client::grpc_at_work);
  module.def("keep", [](const pybind11::object& it) { pybind11::object(it).release(); });  // is never destroyed
  python::register_errors();
  python::bind_record(module);
  python::bind_client(module);
  python::bind_compiled(module);
  python::bind_meshes(module);
  python::bind_setups(module);
  python::bind_measures(module);
  python::bind_population(module);
  python::bind_quality(module);
}
