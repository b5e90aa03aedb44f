// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/cage/green.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr double rounding = std::numeric_limits<double>::epsilon();
/// Distance below which a point is on the cage, in multiples of rounding errors.
constexpr double roundings_on_cage = 16;
/// Fraction of the full solid angle: needles at a vertex of the cage below it count as nothing.
constexpr double least_angle = 1e-9;
constexpr double full_angle = 4 * std::numbers::pi;

using GreenSide = Green::SideView;

/// The integral of 1 / r along a side is log((a + b + l) / (a + b - l)), with the distances a and b of its ends. The denominator
/// is a sum of positive terms: a - |s| = d^2 / (a + |s|) for the position s of an end from the foot of the point on the line and
/// the distance d from the line.
GreenSide side_view(const Cage::Edge& edge, std::span<const Vec3> to, std::span<const double> distances) {
  const bool first = distances[edge.ends[0]] <= distances[edge.ends[1]];
  const std::uint32_t near = edge.ends[first ? 0 : 1], far = edge.ends[first ? 1 : 0];
  const double position = dot(to[near], edge.along);
  const double other = first ? position + edge.length : position - edge.length;
  const Vec3 across = to[near] - position * edge.along;
  const double d2 = dot(across, across), a = distances[near], b = distances[far];
  const bool between = position * other <= 0;
  const double from_far = d2 / (b + std::abs(other));
  const double less = from_far + (between ? d2 / (a + std::abs(position)) : a + std::abs(position));
  // On the side it is infinite, but only its product with 0 counts.
  return {less > 0 ? std::log1p(2 * edge.length / less) : 0, between ? std::sqrt(d2) : a};
}

/// The solid angle of a triangle seen from x (Van Oosterom and Strackee 1983), of the sign of the height.
double solid_angle(const Cage::Face& face, double twice_area, double height, std::span<const Vec3> to,
                   std::span<const double> distances) {
  const auto& [i, j, k] = face.corners;
  const double a = distances[i], b = distances[j], c = distances[k];
  const double below = a * b * c + dot(to[i], to[j]) * c + dot(to[j], to[k]) * a + dot(to[k], to[i]) * b;
  return 2 * std::atan2(twice_area * height, below);
}

bool is_on(const FaceView& at, double tolerance) {
  return std::abs(at.height) <= tolerance &&
         std::all_of(at.from_sides.begin(), at.from_sides.end(), [&](double p) { return p >= -tolerance; });
}

/// Adds `missing` to the solid angles, most of it to those that have the largest rounding errors.
void return_missing(double missing, std::span<const double> nearness, std::span<double> angles) {
  double sum = 0;
  for (const double near : nearness) sum += near;
  for (std::size_t t = 0; t < angles.size(); ++t) angles[t] += missing * (nearness[t] / sum);
}

}  // namespace

int Green::evaluate(const Vec3& x, Scratch& scratch, std::span<double> phi, std::span<double> psi) const {
  const Vec3 place = cage_.place(x);
  const std::size_t count = cage_.size(), faces = cage_.faces().size();
  scratch.to.resize(count);
  scratch.distances.resize(count);
  scratch.views.resize(faces);
  scratch.angles.resize(faces);
  scratch.nearness.resize(faces);
  for (std::size_t i = 0; i < count; ++i) {
    scratch.to[i] = cage_.places()[i] - place;
    scratch.distances[i] = length(scratch.to[i]);
  }
  scratch.sides.clear();
  for (const Cage::Edge& edge : cage_.edges()) scratch.sides.push_back(side_view(edge, scratch.to, scratch.distances));

  // The coordinates as given are rounded as well, far from the origin by more than those of the cage.
  const double largest = std::max({std::abs(x[0]), std::abs(x[1]), std::abs(x[2])}) / cage_.scale();
  const double tolerance = roundings_on_cage * rounding * std::max(1.0, largest);
  scratch.under.clear();
  double sum = 0;
  for (std::size_t t = 0; t < faces; ++t) {
    const Cage::Face& face = cage_.faces()[t];
    FaceView& view = scratch.views[t];
    view = view_of(face, scratch.to, scratch.distances);
    const bool on = is_on(view, tolerance);
    if (on) scratch.under.push_back(t);
    const double twice_area = face.altitudes[0] * cage_.edges()[face.sides[0]].length;
    scratch.angles[t] = on ? 0 : solid_angle(face, twice_area, view.height, scratch.to, scratch.distances);
    sum += scratch.angles[t];
    double nearest = scratch.distances[face.corners[0]], side = scratch.sides[face.sides[0]].distance;
    for (std::size_t k = 1; k < 3; ++k) {
      nearest = std::min(nearest, scratch.distances[face.corners[k]]);
      side = std::min(side, scratch.sides[face.sides[k]].distance);
    }
    const double near = side > 0 ? nearest / side : 0;
    scratch.nearness[t] = near * near;
  }

  int winding = 0;
  if (scratch.under.empty()) {
    const double turns = std::round(sum / full_angle);
    winding = static_cast<int>(turns);
    return_missing(full_angle * turns - sum, scratch.nearness, scratch.angles);
  } else {
    // What the other triangles leave of the full angle is the one inside, at the point on the cage.
    const double turns = std::floor(sum / full_angle + least_angle) + 1;
    winding = static_cast<int>(turns);
    for (const std::size_t t : scratch.under) {
      scratch.angles[t] = (full_angle * turns - sum) / static_cast<double>(scratch.under.size());
    }
  }

  std::fill(phi.begin(), phi.end(), 0.0);
  for (std::size_t t = 0; t < faces; ++t) {
    const Cage::Face& face = cage_.faces()[t];
    const FaceView& view = scratch.views[t];
    Vec3 gradient{};
    double layer = -view.height * scratch.angles[t];
    for (std::size_t e = 0; e < 3; ++e) {
      const double inverse = scratch.sides[face.sides[e]].inverse;
      layer += view.from_sides[e] * inverse;
      gradient = gradient + (view.height * inverse) * face.inwards[e];
    }
    psi[t] = layer / full_angle * cage_.scale();
    for (std::size_t k = 0; k < 3; ++k) {
      const double value = view.from_sides[k] * scratch.angles[t] + dot(face.inwards[k], gradient);
      phi[face.corners[k]] += value / (face.altitudes[k] * full_angle);
    }
  }
  return winding;
}

}  // namespace deform
