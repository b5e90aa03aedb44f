// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

#include <chrono>
#include <functional>
#include <future>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>

#include "client/client.h"

namespace deform::python {

namespace py = pybind11;

/// What every call takes from Python: seconds for the whole call, and what another thread may stop it by.
struct CallLimits {
  std::optional<double> timeout;
  std::optional<std::stop_source> cancel;

  /// With the token of `stop`. Throws Error(invalid_argument) for a timeout that is not over 0.
  client::CallOptions options(const std::stop_source& stop) const;
  /// `cancel`, or a new one.
  std::stop_source stop() const { return cancel.value_or(std::stop_source()); }
};

/// The error as an object of its class in deformd.errors. With the GIL.
py::object exception_of(const Error& error);

/// Lets Python raise deform::Error as the classes of deformd.errors.
void register_errors();

/// Whether Python runs signal handlers on this thread. With the GIL.
bool on_main_thread();

/// Waits until done(how long to wait at most) says so, without the GIL. On the main thread signal handlers run meanwhile; what
/// one raises (KeyboardInterrupt) requests the stop, and is thrown when everything is done. With the GIL.
void wait_with_signals(std::stop_source stop, const std::function<bool(std::chrono::milliseconds)>& done);

/// Runs body(options) without the GIL, so that Ctrl-C cancels it. With the GIL.
template <typename Body>
auto run_call(const CallLimits& limits, const Body& body) {
  const std::stop_source stop = limits.stop();
  const client::CallOptions options = limits.options(stop);
  if (!on_main_thread()) {
    const py::gil_scoped_release release;
    return body(options);
  }
  std::packaged_task task([&] { return body(options); });
  auto result = task.get_future();
  std::thread thread(std::ref(task));
  try {
    wait_with_signals(stop, [&](std::chrono::milliseconds most) { return result.wait_for(most) == std::future_status::ready; });
  } catch (...) {
    thread.join();
    throw;
  }
  thread.join();
  return result.get();
}

/// A Python callable as a function for threads of ours: takes the GIL; what it raises requests the stop and is kept for
/// rethrow().
class Callback {
 public:
  /// `callable` may be None.
  Callback(py::object callable, std::stop_source stop) : callable_(std::move(callable)), stop_(std::move(stop)) {}
  bool given() const { return !callable_.is_none(); }
  template <typename... Arguments>
  void operator()(Arguments&&... arguments) {
    const py::gil_scoped_acquire acquire;
    if (raised_) return;
    try {
      callable_(std::forward<Arguments>(arguments)...);
    } catch (py::error_already_set& error) {
      raised_ = std::move(error);
      stop_.request_stop();
    }
  }
  /// Throws what the callable raised, if it did. With the GIL.
  void rethrow() {
    if (raised_) throw std::move(*raised_);
  }

 private:
  py::object callable_;
  std::stop_source stop_;
  std::optional<py::error_already_set> raised_;
};

}  // namespace deform::python
