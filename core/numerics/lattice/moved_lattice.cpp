// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/lattice/moved_lattice.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/numerics/sampling/point_tree.h"

namespace deform {

namespace {

constexpr std::size_t samples_per_span = 4;
constexpr std::size_t starts = 12;  // nearest samples that are tried
constexpr int most_steps = 60;
constexpr double tolerance = 1e-13;   // of the diagonal, of x(u) - x
constexpr double least_step = 1e-16;  // of u
constexpr double smallest_damping = 1e-6;
constexpr double same_coordinates = 1e-6;  // of u, two solutions that are one
constexpr std::size_t moved_points_per_range = 256;

[[noreturn]] void refuse(const std::string& what) {
  throw Error(ErrorCode::invalid_argument, "the lattice folds over where the point lies: " + what);
}

}  // namespace

/// A grid in u, and where its nodes are.
struct MovedLattice::Samples {
  std::vector<Vec3> u;
  PointTree tree;
};

MovedLattice::MovedLattice(const Lattice& lattice, std::vector<Vec3> control_points)
    : lattice_(lattice), control_points_(std::move(control_points)) {
  if (control_points_.size() != lattice_.size()) {
    throw Error(ErrorCode::invalid_argument,
                std::to_string(control_points_.size()) + " control points for a lattice of " + std::to_string(lattice_.size()));
  }
  for (std::size_t p = 0; p < control_points_.size(); ++p) {
    if (!is_finite(control_points_[p])) {
      throw Error(ErrorCode::invalid_argument, "control point " + std::to_string(p) + " is not finite");
    }
  }
  diagonal_ = bounding_box(control_points_).diagonal();
  std::array<std::size_t, 3> cells{};
  // A Bernstein basis has one span, however many points there are.
  for (std::size_t k = 0; k < 3; ++k) cells[k] = samples_per_span * (lattice_.axis(k).size() - 1);
  std::vector<Vec3> u, x;
  for (std::size_t c = 0; c <= cells[2]; ++c) {
    for (std::size_t b = 0; b <= cells[1]; ++b) {
      for (std::size_t a = 0; a <= cells[0]; ++a) {
        u.push_back({static_cast<double>(a) / static_cast<double>(cells[0]),
                     static_cast<double>(b) / static_cast<double>(cells[1]),
                     static_cast<double>(c) / static_cast<double>(cells[2])});
        x.push_back(place(u.back()));
      }
    }
  }
  samples_ = std::make_unique<const Samples>(Samples{std::move(u), PointTree(x)});
}

MovedLattice::~MovedLattice() = default;

std::size_t MovedLattice::bytes() const {
  constexpr std::size_t node = 32;  // of the tree, for a sample
  return samples_->u.size() * (2 * sizeof(Vec3) + node) + control_points_.size() * sizeof(Vec3);
}

/// Steps are shortened to stay in the domain and until they help.
std::optional<Vec3> MovedLattice::from_start(const Vec3& x, Vec3 u) const {
  Vec3 missing = x - place(u);
  for (int step = 0; step < most_steps; ++step) {
    if (norm(missing) <= 1e-2 * tolerance * diagonal_) return u;
    Eigen::Matrix3d J;
    for (std::size_t k = 0; k < 3; ++k) {
      std::array<std::size_t, 3> derivatives{};
      derivatives[k] = 1;
      const Vec3 column = lattice_.sum(control_points_, u, derivatives);
      J.col(static_cast<Eigen::Index>(k)) << column[0], column[1], column[2];
    }
    const Eigen::Vector3d full = J.fullPivLu().solve(Eigen::Vector3d(missing[0], missing[1], missing[2]));
    if (!full.allFinite()) return std::nullopt;
    double damping = 1;
    bool better = false;
    Vec3 next = u, left = missing;
    for (; damping >= smallest_damping && !better; damping /= 2) {
      for (std::size_t k = 0; k < 3; ++k) next[k] = std::clamp(u[k] + damping * full[static_cast<Eigen::Index>(k)], 0.0, 1.0);
      left = x - place(next);
      better = norm(left) < norm(missing);
    }
    if (!better || distance(next, u) < least_step) break;
    u = next;
    missing = left;
  }
  return norm(missing) <= tolerance * diagonal_ ? std::optional<Vec3>(u) : std::nullopt;
}

std::optional<Vec3> MovedLattice::coordinates(const Vec3& x) const {
  const PointTree& tree = samples_->tree;
  std::vector<PointTree::Near> near;
  const double square = tree.kth_square(x, std::min(starts, tree.size()));
  tree.within(x, std::nextafter(square, 2 * square + 1), near);
  std::sort(near.begin(), near.end(),
            [](const auto& a, const auto& b) { return a.square != b.square ? a.square < b.square : a.point < b.point; });
  const auto cell = [&](std::size_t k) { return 1.0 / static_cast<double>(samples_per_span * (lattice_.axis(k).size() - 1)); };
  const auto neighbours = [&](const Vec3& a, const Vec3& b) {
    for (std::size_t k = 0; k < 3; ++k) {
      if (std::abs(a[k] - b[k]) > 3.5 * cell(k)) return false;
    }
    return true;
  };
  std::optional<Vec3> found;
  for (const PointTree::Near& sample : near) {
    const Vec3& start = samples_->u[sample.point];
    // Samples beside a solution lead to it again.
    if (found && neighbours(*found, start)) continue;
    const std::optional<Vec3> u = from_start(x, start);
    if (!u) continue;
    if (found && norm(*u - *found) > same_coordinates) refuse("it has two different coordinates");
    if (!found) found = u;
  }
  if (!found) return std::nullopt;
  std::array<Vec3, 3> J;
  for (std::size_t k = 0; k < 3; ++k) {
    std::array<std::size_t, 3> derivatives{};
    derivatives[k] = 1;
    J[k] = lattice_.sum(control_points_, *found, derivatives);
  }
  const auto& axes = lattice_.frame().axes;
  // A frame may be left-handed: the lattice at rest says what is positive.
  const double rest = dot(axes[0], cross(axes[1], axes[2]));
  if (!(dot(J[0], cross(J[1], J[2])) / rest > 0)) refuse("det dx/du is not positive");
  return found;
}

LatticeCoordinates MovedLattice::coordinates(std::span<const Vec3> points, const RunContext& context) const {
  LatticeCoordinates result{std::vector<Vec3>(points.size()), {}};
  std::vector<char> out(points.size(), 0);
  parallel_for(context, points.size(), moved_points_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      try {
        const std::optional<Vec3> u = coordinates(points[i]);
        out[i] = u ? 0 : 1;
        if (u) result.u[i] = *u;
      } catch (const Error& error) {
        throw Error(error.code(), "point " + std::to_string(i) + ": " + error.what());
      }
    }
  });
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (out[i] != 0) result.outside.push_back(static_cast<std::uint32_t>(i));
  }
  return result;
}

}  // namespace deform
