// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

#include "core/base/types.h"

namespace deform {

/// Says that the box of all points is over a million times as long as that of most of them: "most points lie within 1.2, but the
/// bounding box is 1e+15 long". What is computed in units of the box has six digits less for such a model, and from about 1e10
/// times on the model is nothing but a point. Empty otherwise. Most points are those between the 5th and the 95th percentile of
/// each coordinate, of at most 100,000 that are spread evenly over the ids. Nothing is said of fewer than 100 points. Any thread.
std::string stray_points_warning(std::span<const Vec3> points);

}  // namespace deform
