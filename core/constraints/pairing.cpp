// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/pairing.h"

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>

#include "core/base/vectors.h"
#include "core/constraints/fit_starts.h"

namespace deform {

namespace {

/// A balanced k-d tree: the middle of a range divides it across its longest side.
class PointTree {
 public:
  explicit PointTree(std::span<const Vec3> points) : points_(points), order_(points.size()), axis_(points.size()) {
    std::iota(order_.begin(), order_.end(), 0u);
    split(0, points.size());
  }

  std::uint32_t nearest(const Vec3& x) const {
    Best best;
    search(x, 0, order_.size(), best);
    return best.id;
  }

 private:
  struct Best {
    double square = std::numeric_limits<double>::infinity();
    std::uint32_t id = std::numeric_limits<std::uint32_t>::max();
  };

  void split(std::size_t begin, std::size_t end) {
    if (end - begin < 2) return;
    const Box box = bounding_box(points_, {order_.data() + begin, end - begin});
    const auto axis = static_cast<std::uint8_t>(box.longest_axis());
    const std::size_t middle = begin + (end - begin) / 2;
    const auto at = [&](std::size_t k) { return order_.begin() + static_cast<std::ptrdiff_t>(k); };
    std::nth_element(at(begin), at(middle), at(end), [&](std::uint32_t a, std::uint32_t b) {
      return points_[a][axis] != points_[b][axis] ? points_[a][axis] < points_[b][axis] : a < b;
    });
    axis_[middle] = axis;
    split(begin, middle);
    split(middle + 1, end);
  }

  void search(const Vec3& x, std::size_t begin, std::size_t end, Best& best) const {
    if (begin == end) return;
    const std::size_t middle = begin + (end - begin) / 2;
    const std::uint32_t id = order_[middle];
    const double square = squared_distance(x, points_[id]);
    if (square < best.square || (square == best.square && id < best.id)) best = {square, id};
    const double beyond = x[axis_[middle]] - points_[id][axis_[middle]];
    const bool below = beyond < 0;
    search(x, below ? begin : middle + 1, below ? middle : end, best);
    // Equally near ones count too: the result does not depend on the tree.
    if (beyond * beyond <= best.square) search(x, below ? middle + 1 : begin, below ? end : middle, best);
  }

  std::span<const Vec3> points_;
  std::vector<std::uint32_t> order_;
  std::vector<std::uint8_t> axis_;
};

Vec3 mirrored(const Vec3& x, const MirrorPlane& plane) {
  const Eigen::Vector3d n = to_eigen(plane.normal);
  return to_vec3(to_eigen(x) - 2 * n.dot(to_eigen(x) - to_eigen(plane.point)) * n);
}

}  // namespace

std::vector<std::uint32_t> nearest_points(std::span<const Vec3> from, std::span<const Vec3> to) {
  const PointTree tree(to);
  std::vector<std::uint32_t> nearest;
  nearest.reserve(from.size());
  for (const Vec3& x : from) nearest.push_back(tree.nearest(x));
  return nearest;
}

std::vector<std::pair<std::uint32_t, std::uint32_t>> mutual_pairs(std::span<const Vec3> a, std::span<const Vec3> b) {
  const auto to_b = nearest_points(a, b), to_a = nearest_points(b, a);
  std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs;
  for (std::uint32_t i = 0; i < a.size(); ++i) {
    if (to_a[to_b[i]] == i) pairs.emplace_back(i, to_b[i]);
  }
  return pairs;
}

MirrorPairs mirror_pairs(std::span<const Vec3> x, std::size_t first, const MirrorPlane& plane, double tolerance) {
  Points images;
  for (const Vec3& p : x) images.push_back(mirrored(p, plane));
  MirrorPairs pairs;
  const bool two = first < x.size();
  const auto nearest_in = [&](std::size_t begin, std::size_t count, std::size_t of_begin, std::size_t of_count) {
    const auto nearest = nearest_points(std::span(images).subspan(begin, count), x.subspan(of_begin, of_count));
    for (const std::uint32_t k : nearest) pairs.partner.push_back(k + static_cast<std::uint32_t>(of_begin));
  };
  nearest_in(0, first, two ? first : 0, two ? x.size() - first : first);
  if (two) nearest_in(first, x.size() - first, 0, first);
  for (std::size_t i = 0; i < x.size(); ++i) {
    const std::uint32_t k = pairs.partner[i];
    if (pairs.partner[k] == i && squared_distance(images[i], x[k]) <= tolerance * tolerance) continue;
    if (pairs.unmatched++ == 0) pairs.first_unmatched = i;
  }
  return pairs;
}

std::optional<MirrorPlane> find_mirror_plane(std::span<const Vec3> x, std::size_t first, double tolerance) {
  if (first < x.size()) {
    const Eigen::Vector3d a = spread({x.first(first)}).mean, b = spread({x.subspan(first)}).mean;
    if (!((b - a).norm() > 4 * tolerance)) return {};
    return MirrorPlane{to_vec3(0.5 * (a + b)), to_vec3((b - a).normalized())};
  }
  const PrincipalAxes axes = principal_axes(x);
  for (const int k : {2, 1, 0}) {
    const MirrorPlane plane{to_vec3(axes.mean), to_vec3(axes.axes.col(k))};
    if (mirror_pairs(x, first, plane, tolerance).unmatched == 0) return plane;
  }
  return {};
}

}  // namespace deform
