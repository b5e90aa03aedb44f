// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/sliding_checks.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/deformers/option_checks.h"

namespace deform {

namespace {

/// The size of the terms of a rate.
double term_size(const Affine& rate, const Vec3& x) {
  double size = 0;
  for (std::size_t i = 0; i < 12; ++i) size = std::max(size, std::abs(rate[i] * (i % 4 == 3 ? 1.0 : x[i % 4])));
  return size;
}

/// Throws for the first point of a handle that these rates lead out of its plane, beyond their rounding.
void check_rates(const Setup& setup, const SlidingPlaces& at, const std::vector<Affine>& rates, const std::string& what) {
  const Symmetry& symmetry = at.symmetry;
  for (std::size_t h = 0; h < rates.size() && h < at.handles.size(); ++h) {
    if (rates[h] == Affine{}) continue;
    for (const PointId id : at.handles[h]) {
      const Vec3& x = at.places[id];
      const auto exit = plane_exit(symmetry, symmetry.on(x), rates[h], x, at.diagonal);
      if (!exit) continue;
      refuse_argument(what + ": moves " + at.point_word + " " + std::to_string(id) + " of handle \"" + setup.handles[h].name +
                      "\" out of symmetry[" + std::to_string(exit->plane) + "], at a rate of " + number_digits(exit->rate) +
                      "; points on a symmetry plane only slide in it: move them along it, or take them out of the handle with "
                      "`difference`");
    }
  }
}

/// check(rates, field) of each variable at rest, and at both bounds or 1 where there is none.
template <typename Check>
void check_each(const Setup& setup, Problems& problems, const Check& check) {
  for (std::size_t k = 0; k < setup.variables.size(); ++k) {
    const DesignVariable& variable = setup.variables[k];
    const std::string field = "variables[" + std::to_string(k) + "]";
    problems.check(field, [&] {
      for (const double value :
           {0.0, std::isfinite(variable.lower) ? variable.lower : -1.0, std::isfinite(variable.upper) ? variable.upper : 1.0}) {
        std::vector<double> values(setup.variables.size(), 0.0);
        values[k] = value;
        check(handle_motion_derivative(setup, values, k), field + " (\"" + variable.name + "\")");
      }
    });
  }
}

}  // namespace

std::optional<PlaneExit> plane_exit(const Symmetry& symmetry, unsigned on, const Affine& rate, const Vec3& x, double diagonal) {
  if (on == 0) return std::nullopt;
  const double size = term_size(rate, x);
  const Vec3 across = symmetry.to_frame(transformed(rate, x));
  for (std::size_t k = 0; k < symmetry.planes(); ++k) {
    if ((on >> k & 1u) != 0 && std::abs(across[k]) * diagonal > symmetry.reach(k) * size) return PlaneExit{k, across[k]};
  }
  return std::nullopt;
}

void check_variables_slide(const Setup& setup, const SlidingPlaces& at, Problems& problems) {
  if (at.symmetry.planes() == 0) return;
  check_each(setup, problems,
             [&](const std::vector<Affine>& rates, const std::string& what) { check_rates(setup, at, rates, what); });
}

void check_variables_flat(const FlatCase& flat, const Setup& setup, const SlidingPlaces& at, Problems& problems) {
  if (!flat.exists()) return;
  check_each(setup, problems, [&](const std::vector<Affine>& rates, const std::string& what) {
    for (std::size_t h = 0; h < rates.size() && h < at.handles.size(); ++h) {
      for (const PointId id : at.handles[h]) {
        const Vec3& x = at.places[id];
        const std::string reason = flat.leaves(transformed(rates[h], x), term_size(rates[h], x));
        if (reason.empty()) continue;
        refuse_argument(what + ": " + at.point_word + " " + std::to_string(id) + " of handle \"" + setup.handles[h].name + "\" " +
                        reason);
      }
    }
  });
}

void check_one_sided(const FlatCase& flat, const Setup& setup, const SelectedRegions& regions) {
  if (!flat.exists() || regions.of == SelectedRegions::Of::control_points) return;
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    const std::string reason = flat.one_sided(regions.handles[h]);
    if (!reason.empty())
      refuse_argument("handles[" + std::to_string(h) + "].region (\"" + setup.handles[h].name + "\"): " + reason);
  }
  const std::string reason = flat.one_sided(regions.fixed);
  if (!reason.empty()) refuse_argument("fixed: " + reason);
}

}  // namespace deform
