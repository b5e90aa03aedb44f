// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>

#include "core/base/run_context.h"

namespace deform {

/// Calls body(begin, end) for disjoint ranges that cover [0, count), on at most context.threads threads. Range k is [k * grain,
/// min((k + 1) * grain, count)), whatever the number of threads, so a body that writes only to its own range is deterministic.
/// Runs inline if count <= grain. Checks the context before every range and rethrows the first exception that any range throws.
void parallel_for(const RunContext& context, std::size_t count, std::size_t grain,
                  const std::function<void(std::size_t begin, std::size_t end)>& body);

/// The largest number of threads that a call with this context uses.
int thread_count(const RunContext& context);

}  // namespace deform
