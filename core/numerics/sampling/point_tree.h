// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"

namespace deform {

/// Nearest points and points within a distance (k-d tree of nanoflann). Keeps its own copy of the points. Coincident points are
/// all kept. Immutable; any number of threads may search at once.
class PointTree {
 public:
  struct Near {
    std::uint32_t point;
    double square;  ///< of the distance
  };

  explicit PointTree(std::span<const Vec3> points);
  ~PointTree();
  PointTree(PointTree&&) noexcept;
  PointTree& operator=(PointTree&&) noexcept;

  std::size_t size() const;
  const std::vector<Vec3>& points() const;

  /// The point nearest to x, which need not be one of them; there must be a point.
  Near nearest(const Vec3& x) const;
  /// Squared distance from x to the k-th nearest point, 1 <= k <= size().
  double kth_square(const Vec3& x, std::size_t k) const;
  /// All points whose squared distance from x is less than `square`, in an order that depends on the points only.
  void within(const Vec3& x, double square, std::vector<Near>& out) const;

 private:
  struct Tree;
  std::unique_ptr<const Tree> tree_;
};

/// For every one of `places` the nearest point of the tree, in parallel.
std::vector<std::uint32_t> nearest_points(const PointTree& tree, std::span<const Vec3> places, const RunContext& context = {});

}  // namespace deform
