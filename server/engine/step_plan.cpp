// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/step_plan.h"

namespace deform::server {

void StepPlan::spread(int workers) {
  const std::size_t wanted = (2 * static_cast<std::size_t>(workers) + blocks() - 1) / blocks();
  most_designs = std::max<std::size_t>(1, std::min(most_designs, (designs + wanted - 1) / wanted));
}

std::size_t StepPlan::high_water(int workers) const {
  constexpr std::size_t smallest_buffer = 8u << 20;
  return std::max(smallest_buffer, 2 * static_cast<std::size_t>(workers) * step_bytes());
}

// What waits, and the evaluated points of the steps that run.
std::size_t StepPlan::buffer_bytes(int workers) const {
  const std::size_t everything = designs * points * sizeof(Vec3);
  const std::size_t waiting = std::min(everything, high_water(workers));
  if (gathers()) return waiting + std::min(everything, open_groups(workers) * group_bytes());
  return waiting + std::min(everything, static_cast<std::size_t>(workers) * step_bytes()) + (whole() ? group_bytes() : 0);
}

}  // namespace deform::server
