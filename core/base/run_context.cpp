// SPDX-License-Identifier: Apache-2.0
#include "core/base/run_context.h"

#include "core/base/error.h"

namespace deform {

void RunContext::check() const {
  if (stop.stop_requested()) throw Error(ErrorCode::cancelled, "cancelled by the caller");
  if (deadline && Clock::now() >= *deadline) throw Error(ErrorCode::deadline_exceeded, "deadline exceeded");
}

}  // namespace deform
