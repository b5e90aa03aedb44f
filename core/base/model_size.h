// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

#include "core/base/types.h"

namespace deform {

/// How large a model is, model units.
struct ModelSize {
  /// The diagonal of the bounding box, or of that of most points if some have strayed. Motions and errors are judged by it.
  double judged_by = 0;
  /// That points have strayed: "most points lie within 1.2, but the bounding box is 1e+15 long, ..."; empty if none has.
  std::string stray;
};

/// Points have strayed if the box of all is over a million times as long as that of most. What is computed in units of the box
/// has six digits less for such a model, and from about 1e10 times on the model is nothing but a point. Most points are those
/// between the 5th and the 95th percentile of each coordinate, of at most 100,000 that are spread evenly over the ids. Of fewer
/// than 100 points none has strayed. Any thread.
ModelSize model_size(std::span<const Vec3> points);

}  // namespace deform
