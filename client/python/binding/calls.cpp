// SPDX-License-Identifier: Apache-2.0
#include "client/python/binding/calls.h"

#include <cmath>

#include "client/error_field.h"
#include "core/base/number_text.h"

namespace deform::python {

client::CallOptions CallLimits::options(const std::stop_source& stop) const {
  client::CallOptions options;
  options.stop = stop.get_token();
  if (!timeout) return options;
  constexpr double longest = 1e9;
  if (!(*timeout > 0)) {
    throw Error(ErrorCode::invalid_argument, "timeout: " + number_digits(*timeout) + ", expected seconds over 0");
  }
  options.timeout = std::chrono::milliseconds(static_cast<std::int64_t>(std::ceil(std::min(*timeout, longest) * 1000)));
  return options;
}

py::object exception_of(const Error& error) {
  return py::module_::import("deformd.errors")
      .attr("_error")(to_string(error.code()), error.what(), client::field_of(error.what()), error.retry_after_ms(),
                      client::request_id_of(error));
}

void register_errors() {
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const Error& error) {
      const py::object exception = exception_of(error);
      PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(exception.ptr())), exception.ptr());
    }
  });
}

bool on_main_thread() {
  const py::object main = py::module_::import("threading").attr("main_thread")();
  return main.attr("ident").cast<unsigned long>() == PyThread_get_thread_ident();
}

void wait_with_signals(std::stop_source stop, const std::function<bool(std::chrono::milliseconds)>& done) {
  constexpr std::chrono::milliseconds period{50};
  const bool signals = on_main_thread();
  std::optional<py::error_already_set> raised;
  try {
    const py::gil_scoped_release release;
    while (!done(period)) {
      if (!signals || raised) continue;
      const py::gil_scoped_acquire acquire;
      if (PyErr_CheckSignals() == 0) continue;
      raised.emplace();
      stop.request_stop();
    }
  } catch (const Error&) {
    if (!raised) throw;  // else it was cancelled
  }
  if (raised) throw std::move(*raised);
}

}  // namespace deform::python
