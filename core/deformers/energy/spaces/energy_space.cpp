// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/energy_space.h"

#include <utility>

namespace deform {

void swap(EnergyModel& a, EnergyModel& b) {
  a.space.values.swap(b.space.values);
  a.space.energy.swap(b.space.energy);
  a.space.linear.swap(b.space.linear);
  a.space.notes.swap(b.space.notes);
  std::swap(a.space.samples, b.space.samples);
  std::swap(a.space.cubature_points, b.space.cubature_points);
  a.held.swap(b.held);
  std::swap(a.eliminated, b.eliminated);
  a.coupling.swap(b.coupling);
  std::swap(a.may_crack, b.may_crack);
}

}  // namespace deform
