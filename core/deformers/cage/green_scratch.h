// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "core/deformers/cage/green_system.h"

namespace deform {

/// What computing the coordinates of a tile takes.
struct GreenSystem::Scratch {
  Green::Scratch views;
  std::vector<double> phi, psi;  ///< of a point
  std::vector<double> values;    ///< of a tile
};

}  // namespace deform
