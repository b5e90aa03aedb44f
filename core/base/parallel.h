// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>

#include "core/base/run_context.h"

namespace deform {

/// Calls body(begin, end) for disjoint ranges covering [0, count), each at most `grain` long (except that a range is never split
/// below it), on at most context.threads threads; runs inline when count <= grain. Checks the context before every range, and the
/// first exception thrown by any range leaves from here. The split into ranges depends only on count and grain, never on the
/// number of threads: range k is [k * grain, min((k + 1) * grain, count)), so a body that writes only to its own range is
/// deterministic.
void parallel_for(const RunContext& context, std::size_t count, std::size_t grain,
                  const std::function<void(std::size_t begin, std::size_t end)>& body);

/// Number of threads a call with this context uses at most.
int thread_count(const RunContext& context);

}  // namespace deform
