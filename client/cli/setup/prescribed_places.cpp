// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/prescribed_places.h"

#include <cmath>
#include <limits>
#include <optional>

#include "client/cli/output/format.h"
#include "client/cli/setup/reading.h"
#include "client/cli/setup/region_points.h"
#include "core/base/bounds.h"
#include "core/base/vectors.h"
#include "proto/convert/controls/controls.h"

namespace deform::cli {

namespace {

/// How a variable moves a handle, if it does.
std::optional<VariableMotion> motion_of(const v1::DesignVariable& variable, const std::string& handle) {
  const std::string what = "variable \"" + variable.name() + "\"";
  if (variable.handle() == handle) return convert::motion_from_proto(variable, what);
  for (int i = 0; i < variable.also_size(); ++i) {
    if (variable.also(i).handle() == handle) return convert::also_from_proto(variable, i, what);
  }
  return std::nullopt;
}

/// The motion at v, within the bounds of the variable.
Affine motion_within(const v1::DesignVariable& variable, const VariableMotion& motion, double v) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  const double lower = variable.has_lower() ? variable.lower() : -infinity;
  const double upper = variable.has_upper() ? variable.upper() : infinity;
  const auto value = within_bounds(v, lower, upper);
  if (!value) {
    refuse("variable \"" + variable.name() + "\": " + number_text(v) + " is outside of its bounds [" + number_text(lower) + ", " +
           number_text(upper) + "]");
  }
  return motion_at(motion, *value);
}

}  // namespace

Affine handle_motion(const v1::Setup& setup, const std::string& handle, std::span<const double> values) {
  Affine motion = identity_affine;
  for (int k = 0; k < setup.variables_size(); ++k) {
    const auto moved = motion_of(setup.variables(k), handle);
    if (moved) motion = compose(motion_within(setup.variables(k), *moved, values[static_cast<std::size_t>(k)]), motion);
  }
  return motion;
}

PrescribedPlaces::PrescribedPlaces(const v1::Setup& setup, const Mesh& mesh) : setup_(setup), mesh_(mesh) {
  for (const auto& handle : setup.handles()) handles_.push_back(handle_points(setup, handle.name(), mesh));
  const std::vector<std::uint32_t> labels = region_labels(setup, mesh);
  for (PointId id = 0; id < labels.size(); ++id) {
    if (labels[id] == ResolvedRegions::fixed) fixed_.push_back(id);
  }
}

Misfit PrescribedPlaces::misfit(std::span<const double> values, std::span<const Vec3> points) const {
  Misfit result;
  double sum = 0;
  std::size_t count = 0;
  const auto add = [&](PointId id, const Vec3& place) {
    const double away = distance(points[id], place);
    sum += away * away;
    ++count;
    if (!(away <= result.largest)) result.largest = away, result.point = id;
  };
  for (std::size_t h = 0; h < handles_.size(); ++h) {
    const Affine motion = handle_motion(setup_, setup_.handles(static_cast<int>(h)).name(), values);
    for (const PointId id : handles_[h])
      add(id, motion == identity_affine ? mesh_.points[id] : transformed(motion, mesh_.points[id]));
  }
  for (const PointId id : fixed_) add(id, mesh_.points[id]);
  result.rms = count == 0 ? 0 : std::sqrt(sum / static_cast<double>(count));
  return result;
}

}  // namespace deform::cli
