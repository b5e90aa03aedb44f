// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/sampling/point_tree.h"

#include <nanoflann.hpp>
#include <utility>

#include "core/base/parallel.h"

namespace deform {

namespace {

constexpr std::size_t leaf_points = 10;
constexpr std::size_t places_per_range = 1024;

/// The adaptor from which nanoflann reads points.
struct Cloud {
  std::vector<Vec3> points;
  // Names required by nanoflann.
  std::size_t kdtree_get_point_count() const { return points.size(); }
  double kdtree_get_pt(std::size_t i, std::size_t k) const { return points[i][k]; }
  template <typename Bounds>
  bool kdtree_get_bbox(Bounds& /*bounds*/) const {
    return false;
  }
};

using Metric = nanoflann::L2_Simple_Adaptor<double, Cloud>;
using TreeIndex = nanoflann::KDTreeSingleIndexAdaptor<Metric, Cloud, 3, std::uint32_t>;

/// Collects the points within a distance.
struct Within {
  using DistanceType = double;
  double square;
  std::vector<PointTree::Near>& out;

  std::size_t size() const { return out.size(); }
  bool full() const { return true; }
  bool addPoint(double distance, std::uint32_t point) const {  // NOLINT: nanoflann's name
    if (distance < square) out.push_back({point, distance});
    return true;
  }
  double worstDist() const { return square; }  // NOLINT: nanoflann's name
};

}  // namespace

struct PointTree::Tree {
  explicit Tree(std::span<const Vec3> points)
      : cloud{{points.begin(), points.end()}},
        index(3, cloud, nanoflann::KDTreeSingleIndexAdaptorParams(leaf_points)) {}  // builds it
  Cloud cloud;
  TreeIndex index;
};

PointTree::PointTree(std::span<const Vec3> points) : tree_(std::make_unique<const Tree>(points)) {}
PointTree::~PointTree() = default;
PointTree::PointTree(PointTree&&) noexcept = default;
PointTree& PointTree::operator=(PointTree&&) noexcept = default;

std::size_t PointTree::size() const { return tree_->cloud.points.size(); }
const std::vector<Vec3>& PointTree::points() const { return tree_->cloud.points; }

PointTree::Near PointTree::nearest(const Vec3& x) const {
  Near near{0, 0};
  tree_->index.knnSearch(x.data(), 1, &near.point, &near.square);
  return near;
}

double PointTree::kth_square(const Vec3& x, std::size_t k) const {
  std::vector<std::uint32_t> numbers(k);
  std::vector<double> squares(k);
  tree_->index.knnSearch(x.data(), k, numbers.data(), squares.data());
  return squares.back();
}

void PointTree::within(const Vec3& x, double square, std::vector<Near>& out) const {
  out.clear();
  if (size() == 0) return;
  Within found{square, out};
  tree_->index.radiusSearchCustomCallback(x.data(), found);
}

std::vector<std::uint32_t> nearest_points(const PointTree& tree, std::span<const Vec3> places, const RunContext& context) {
  std::vector<std::uint32_t> nearest(places.size());
  parallel_for(context, places.size(), places_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) nearest[i] = tree.nearest(places[i]).point;
  });
  return nearest;
}

}  // namespace deform
