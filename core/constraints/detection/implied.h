// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/constraints/detection/detect.h"

namespace deform::detection {

/// Fills in `lies_on` of the edges, and `implied_by` of sets whose constraint follows from those of other sets, wherever these
/// move and however they bend:
///  - a line on two planes that meet at an angle: two planes meet in a line;
///  - a circle or arc on a plane and a sphere, or on two spheres: these meet in a circle;
///  - a circle or arc on a plane and a cylinder or cone between which a longer one is kept already. The first of them is not
///    implied: a plane cuts a cylinder in an ellipse, and only the circle keeps the two at right angles;
///  - a plane whose points are all on one circle that is kept: a circle is flat.
/// "On" means all points. Sets without a constraint (too few points) imply nothing. Names have been given.
void find_implied(Detection& detection);

}  // namespace deform::detection
