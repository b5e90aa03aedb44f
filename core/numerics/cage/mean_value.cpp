// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/cage/mean_value.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr double on_cage = 16 * std::numeric_limits<double>::epsilon();
/// Distances from a side over the height from which on differences from the plane are taken: one and a half digits are lost
/// before.
constexpr double far_side = 30;
/// Gauss-Legendre on [0, 1] with two nodes: with far_side right to 1e-14 of a thirtieth.
constexpr std::array<double, 2> nodes{0.2113248654051871, 0.7886751345948129};

/// A side seen from a place in a plane with it, at the distance q from its line: product is that of the positions of its ends
/// along the line, from the foot of the place.
double angle_at(double q, double length, double product) { return std::atan2(q * length, q * q + product); }

/// d/d(q^2) of angle_at(q) / q.
double slope_at(double q, double length, double product, double squares) {
  const double q2 = q * q;
  const double bent = -length * (q2 - product) / ((q2 + squares) * q2 + product * product);
  return (bent - angle_at(q, length, product) / q) / (2 * q2);
}

using SideView = MeanValue::SideView;

SideView view_of(const Cage::Edge& edge, std::span<const Vec3> to, std::span<const double> distances) {
  const bool first = distances[edge.ends[0]] <= distances[edge.ends[1]];
  const Vec3& a = to[edge.ends[first ? 0 : 1]];
  const double near = dot(a, edge.along), other = first ? near + edge.length : near - edge.length;
  const double r = length(a - near * edge.along);
  SideView view;
  view.product = near * other;
  view.squares = near * near + other * other;
  view.angle = angle_at(r, edge.length, view.product);
  // On the line but not on the side: the limit. On the side the point is on the cage, which its triangles tell.
  view.per_length = r > 0 ? view.angle / r : view.product > 0 ? edge.length / view.product : 0;
  return view;
}

/// Integral of 1 / |p - x| over the spherical triangle, for a height over 0: the sum of p g(r) / (2 height) over the sides, where
/// p is the distance of the foot from a side, r that of x and g(q) = angle_at(q) / q. Of far sides p g(p) is taken off, the angle
/// in the plane, and added again.
double mean_inverse(const FaceView& at, double height, const std::array<const SideView*, 3>& sides,
                    const std::array<double, 3>& lengths) {
  std::array<bool, 3> is_far{};
  double near = 0;
  bool beside = true;
  for (std::size_t k = 0; k < 3; ++k) {
    is_far[k] = std::abs(at.from_sides[k]) > far_side * height;
    if (is_far[k]) continue;
    near += at.from_sides[k] * sides[k]->per_length;
    beside = beside && sides[k]->product > far_side * far_side * height * height;
  }
  if (!is_far[0] && !is_far[1] && !is_far[2]) return 0.5 * near / height;
  // All angles in the plane together are exactly 0 or 2 pi, which matters where the rest is small: those of the far sides are
  // what the near ones leave. Next to a corner, where it does not, those of the near sides are all rounding.
  const bool inside = std::all_of(at.from_sides.begin(), at.from_sides.end(), [](double p) { return p > 0; });
  double angles = beside && inside ? 2 * std::numbers::pi : 0, bent = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const double p = at.from_sides[k], away = std::abs(p);
    if (is_far[k] != beside) {
      const double angle = angle_at(away, lengths[k], sides[k]->product);
      angles += (p > 0) != beside ? angle : -angle;
    }
    if (!is_far[k]) continue;
    double mean = 0;
    for (const double node : nodes) {
      const double q = std::sqrt(away * away + node * height * height);
      mean += 0.5 * slope_at(q, lengths[k], sides[k]->product, sides[k]->squares);
    }
    bent += p * mean;
  }
  return 0.5 * ((angles + near) / height + height * bent);
}

/// Whether x is on the triangle; its barycentric coordinates then.
bool on_face(const Cage::Face& face, const FaceView& at, std::span<double> out) {
  if (std::abs(at.height) > on_cage) return false;
  for (const double p : at.from_sides) {
    if (p < -on_cage) return false;
  }
  std::array<double, 3> values{};
  for (std::size_t k = 0; k < 3; ++k) values[k] = std::max(at.from_sides[k], 0.0) / face.altitudes[k];
  const double sum = values[0] + values[1] + values[2];
  std::fill(out.begin(), out.end(), 0.0);
  for (std::size_t k = 0; k < 3; ++k) out[face.corners[k]] = values[k] / sum;
  return true;
}

/// Adds what a triangle gives to the weights of its corners.
void add_face(const Cage& cage, const Cage::Face& face, const FaceView& at, std::span<const SideView> views,
              std::span<double> weights) {
  const double height = std::abs(at.height), sign = at.height > 0 ? 1 : -1;
  if (height == 0) return;  // beside the triangle in its plane
  std::array<const SideView*, 3> sides{};
  std::array<double, 3> lengths{};
  Vec3 moment{};
  for (std::size_t k = 0; k < 3; ++k) {
    sides[k] = &views[face.sides[k]];
    lengths[k] = cage.edges()[face.sides[k]].length;
    moment = moment + (0.5 * height * sides[k]->per_length) * face.inwards[k];
  }
  const double mean = mean_inverse(at, height, sides, lengths);
  for (std::size_t k = 0; k < 3; ++k) {
    weights[face.corners[k]] += sign * (at.from_sides[k] * mean + dot(face.inwards[k], moment)) / face.altitudes[k];
  }
}

}  // namespace

void MeanValue::evaluate(const Vec3& x, Scratch& scratch, std::span<double> out) const {
  const Vec3 place = cage_.place(x);
  const std::size_t count = cage_.size();
  scratch.to.resize(count);
  scratch.distances.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    scratch.to[i] = cage_.places()[i] - place;
    scratch.distances[i] = length(scratch.to[i]);
  }
  scratch.sides.clear();
  for (const Cage::Edge& edge : cage_.edges()) scratch.sides.push_back(view_of(edge, scratch.to, scratch.distances));
  std::fill(out.begin(), out.end(), 0.0);
  for (const Cage::Face& face : cage_.faces()) {
    const FaceView at = deform::view_of(face, scratch.to, scratch.distances);
    if (on_face(face, at, out)) return;
    add_face(cage_, face, at, scratch.sides, out);
  }
  double sum = 0;
  for (const double weight : out) sum += weight;
  for (double& weight : out) weight /= sum;
}

}  // namespace deform
