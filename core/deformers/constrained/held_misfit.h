// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>

#include "core/constraints/projection.h"

namespace deform {

/// The errors of a constraint that its held points cause by themselves: those at the places of the other points where the squares
/// are least. The shape is fitted to the held points, and the others lie on it where they can. `held` has a number for each of
/// the points x, not 0 for held ones; `shape` is that fitted at x, or empty. Found by alternation between shapes and places from
/// x on, so it is at most the misfit at x, and of several minima the one near x. O(n) for each of up to 200 projections.
Projection::Misfit held_misfit(const Projection& projection, std::span<const Vec3> x, std::span<const char> held,
                               ShapeParameters shape);

}  // namespace deform
