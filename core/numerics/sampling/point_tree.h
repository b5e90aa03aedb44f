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

/// Nearest-neighbour and radius search (k-d tree of nanoflann) in a copy of the points, which keeps all coincident points.
/// Immutable; any number of threads may search at once.
class PointTree {
 public:
  struct Near {
    std::uint32_t point;
    double square;  ///< squared distance
  };

  explicit PointTree(std::span<const Vec3> points);
  ~PointTree();
  PointTree(PointTree&&) noexcept;
  PointTree& operator=(PointTree&&) noexcept;

  std::size_t size() const;
  const std::vector<Vec3>& points() const;

  /// The point nearest to x. The tree must not be empty.
  Near nearest(const Vec3& x) const;
  /// Squared distance from x to the k-th nearest point, 1 <= k <= size().
  double kth_square(const Vec3& x, std::size_t k) const;
  /// Stores all points with a squared distance from x below `square` in `out`, in an order that depends on the points only.
  void within(const Vec3& x, double square, std::vector<Near>& out) const;

 private:
  struct Tree;
  std::unique_ptr<const Tree> tree_;
};

/// The nearest point of the tree for each place, in parallel.
std::vector<std::uint32_t> nearest_points(const PointTree& tree, std::span<const Vec3> places, const RunContext& context = {});

}  // namespace deform
