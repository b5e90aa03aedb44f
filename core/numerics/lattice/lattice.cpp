// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/lattice/lattice.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr double rounding = 1e-12;     // of the frame: points that count as inside
constexpr double least_volume = 1e-9;  // of the product of the lengths of the axes
constexpr std::size_t points_per_range = 1024;

std::array<Vec3, 3> dual_axes(const LatticeFrame& frame) {
  const auto& [a, b, c] = frame.axes;
  const double volume = dot(a, cross(b, c)), size = norm(a) * norm(b) * norm(c);
  if (!is_finite(frame.origin) || !std::isfinite(size) || !(std::abs(volume) > least_volume * size)) {
    throw Error(ErrorCode::invalid_argument, "the axes of a lattice must be finite, not zero and independent of each other");
  }
  return {cross(b, c) / volume, cross(c, a) / volume, cross(a, b) / volume};
}

}  // namespace

Lattice::Lattice(const LatticeFrame& frame, const std::array<std::size_t, 3>& points, LatticeBasis basis)
    : frame_(frame),
      axes_{SplineAxis(basis, points[0]), SplineAxis(basis, points[1]), SplineAxis(basis, points[2])},
      dual_(dual_axes(frame)) {}

Vec3 Lattice::abscissae(std::size_t number) const {
  const std::size_t l = axes_[0].size(), m = axes_[1].size();
  return {axes_[0].greville(number % l), axes_[1].greville(number / l % m), axes_[2].greville(number / l / m)};
}

std::vector<Vec3> Lattice::control_points() const {
  std::vector<Vec3> result(size());
  for (std::size_t p = 0; p < result.size(); ++p) result[p] = control_point(p);
  return result;
}

Vec3 Lattice::place(const Vec3& u) const {
  return frame_.origin + u[0] * frame_.axes[0] + u[1] * frame_.axes[1] + u[2] * frame_.axes[2];
}

Vec3 Lattice::coordinates(const Vec3& x) const {
  const Vec3 from = x - frame_.origin;
  return {dot(dual_[0], from), dot(dual_[1], from), dot(dual_[2], from)};
}

std::optional<Vec3> Lattice::inside(const Vec3& x) const {
  Vec3 u = coordinates(x);
  for (double& value : u) {
    if (!(value >= -rounding && value <= 1 + rounding)) return std::nullopt;
    value = std::clamp(value, 0.0, 1.0);
  }
  return u;
}

LatticeWeights Lattice::weights(const Vec3& u, const std::array<std::size_t, 3>& derivatives) const {
  LatticeWeights at;
  for (std::size_t k = 0; k < 3; ++k) {
    at.first[k] = axes_[k].span(u[k]);
    axes_[k].evaluate(at.first[k], u[k], derivatives[k], at.along[k].data());
  }
  return at;
}

Vec3 Lattice::sum(std::span<const Vec3> values, const Vec3& u, const std::array<std::size_t, 3>& derivatives) const {
  Vec3 result{};
  for_each(weights(u, derivatives), [&](std::size_t p, double weight) { result = result + weight * values[p]; });
  return result;
}

LatticeCoordinates coordinates_in(const Lattice& lattice, std::span<const Vec3> points, const RunContext& context) {
  LatticeCoordinates result{std::vector<Vec3>(points.size()), {}};
  std::vector<char> out(points.size(), 0);
  parallel_for(context, points.size(), points_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const std::optional<Vec3> u = lattice.inside(points[i]);
      out[i] = u ? 0 : 1;
      if (u) result.u[i] = *u;
    }
  });
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (out[i] != 0) result.outside.push_back(static_cast<std::uint32_t>(i));
  }
  return result;
}

}  // namespace deform
