// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/energy_space.h"

#include <utility>

namespace deform {

std::size_t EnergySpace::value_bytes() const {
  constexpr std::size_t entry = sizeof(double) + sizeof(std::int64_t);
  return static_cast<std::size_t>(values.nonZeros()) * entry +
         static_cast<std::size_t>(values.outerSize() + 1) * sizeof(std::int64_t) + (computed != nullptr ? computed->bytes() : 0) +
         (in_space != nullptr ? in_space->bytes() : 0);
}

void swap(EnergyModel& a, EnergyModel& b) {
  a.space.values.swap(b.space.values);
  a.space.computed.swap(b.space.computed);
  a.space.in_space.swap(b.space.in_space);
  a.space.only_on_mesh.swap(b.space.only_on_mesh);
  a.space.energy.swap(b.space.energy);
  a.space.linear.swap(b.space.linear);
  a.space.notes.swap(b.space.notes);
  std::swap(a.space.samples, b.space.samples);
  std::swap(a.space.cubature_points, b.space.cubature_points);
  a.held.swap(b.held);
  std::swap(a.eliminated, b.eliminated);
  a.coupling.swap(b.coupling);
  std::swap(a.may_crack, b.may_crack);
  std::swap(a.motions, b.motions);
}

}  // namespace deform
