// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/constraints/detection/detect.h"

namespace deform::detection {

/// Fills in `lies_on` of the edges, and `implied_by` of the sets whose constraint follows from those of other sets under any
/// deformation:
///  - a line on two planes that meet at an angle: two planes meet in a line;
///  - a circle or arc on a plane and a sphere, or on two spheres: these meet in a circle;
///  - a circle or arc on a plane and a cylinder or cone, if a longer one on the same two is constrained already. The longest one
///    is not implied: a plane cuts a cylinder in an ellipse, and only the circle keeps the two perpendicular;
///  - a plane whose points are all on one constrained circle: a circle is planar.
/// "On" refers to all points. Sets without a constraint (too few points) imply nothing. Requires the names to be set.
void find_implied(Detection& detection);

}  // namespace deform::detection
