// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/held_misfit.h"

#include <vector>

#include "core/deformers/constrained/anderson.h"

namespace deform {

/// Places and projections by turns; both lower the squares. Steps are accelerated, since they become slow where few points are
/// held; one that raises the squares is replaced by the plain one.
Projection::Misfit held_misfit(const Projection& projection, std::span<const Vec3> x, std::span<const char> held,
                               ShapeParameters shape) {
  constexpr int most_projections = 200, most_idle = 5;
  constexpr double negligible = 1e-5;  // of the squares
  std::vector<Vec3> at(x.begin(), x.end()), onto(x.size()), best = at, next;
  const auto place = [&](const std::vector<Vec3>& to) {
    std::vector<Vec3> places = to;
    for (std::size_t i = 0; i < places.size(); ++i) {
      if (held[i] != 0) places[i] = x[i];
    }
    return places;
  };
  Anderson window;
  double least = projection.project(at, onto, shape);
  next = place(onto);  // the plain step from the best places
  ShapeParameters best_shape = shape;
  window.add(at, next);
  at = next;
  bool accelerated = false;
  for (int count = 1, idle = 0; count < most_projections && idle < most_idle && least > 0; ++count) {
    shape = best_shape;
    const double squares = projection.project(at, onto, shape);
    if (!(squares < least)) {
      if (!accelerated) break;
      window.clear();
      accelerated = false;
      at = next;
      continue;
    }
    idle = squares > (1 - negligible) * least ? idle + 1 : 0;
    least = squares;
    best = at;
    best_shape = shape;
    next = place(onto);
    window.add(at, next);
    accelerated = window.size() > 0;
    at = accelerated ? place(window.next()) : next;
  }
  projection.project(best, onto, best_shape);
  return projection.misfit(best, onto);
}

}  // namespace deform
