// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/extent.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/constraints/fitting.h"

namespace deform {

namespace {

constexpr double none = std::numeric_limits<double>::infinity();

/// Point i at height a . x_i stays in [h + low_i, h + high_i], h free. The energy is convex in h and its derivative piecewise
/// linear and ascending: Newton's method with a bracket ends after finitely many steps.
class ExtentProjection final : public Projection {
 public:
  struct Range {
    double low = -none, high = none;
  };

  ExtentProjection(const Vec3& axis, std::vector<Range> ranges) : axis_(to_eigen(axis)), ranges_(std::move(ranges)) {}

  std::string_view kind() const override { return "extent"; }
  std::size_t point_count() const override { return ranges_.size(); }
  bool has_bounds() const override { return true; }

  double project(std::span<const Vec3> x, std::span<Vec3> out, ShapeParameters& shape) const override {
    std::vector<double> heights(x.size());
    for (std::size_t i = 0; i < x.size(); ++i) heights[i] = axis_.dot(to_eigen(x[i]));
    shape = {offset(heights)};
    double energy = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const double out_by = excess(i, heights[i], shape[0]);
      out[i] = to_vec3(to_eigen(x[i]) - out_by * axis_);
      energy += out_by * out_by;
    }
    return energy;
  }

  void derivative(std::span<const Vec3> x, const ShapeParameters& shape, std::span<const Vec3> dx,
                  std::span<Vec3> out) const override {
    double sum = 0, count = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      if (excess(i, axis_.dot(to_eigen(x[i])), shape[0]) == 0) continue;
      sum += axis_.dot(to_eigen(dx[i]));
      count += 1;
    }
    const double shift = count > 0 ? sum / count : 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const Eigen::Vector3d d = to_eigen(dx[i]);
      const bool moves = excess(i, axis_.dot(to_eigen(x[i])), shape[0]) != 0;
      out[i] = moves ? to_vec3(d - (axis_.dot(d) - shift) * axis_) : dx[i];
    }
  }

  Linearization linearize(std::span<const Vec3> x, const ShapeParameters& shape) const override {
    Linearization result;
    result.normals.assign(x.size(), Vec3{});
    result.residual.setZero(static_cast<Eigen::Index>(x.size()));
    result.parameters.setZero(result.residual.size(), 1);
    for (std::size_t i = 0; i < x.size(); ++i) {
      const double out_by = excess(i, axis_.dot(to_eigen(x[i])), shape[0]);
      if (out_by == 0) continue;
      const auto row = static_cast<Eigen::Index>(i);
      result.normals[i] = to_vec3(axis_);
      result.residual[row] = out_by;
      result.parameters(row, 0) = -1;
    }
    return result;
  }

 private:
  /// How far a height is above (or, negative, below) its range.
  double excess(std::size_t i, double height, double offset) const {
    const Range& range = ranges_[i];
    return std::max(height - offset - range.high, 0.0) + std::min(height - offset - range.low, 0.0);
  }

  double offset(const std::vector<double>& heights) const {
    // Points ask for at least `low` or for at most `high`.
    double low = -none, high = none;
    for (std::size_t i = 0; i < heights.size(); ++i) {
      low = std::max(low, heights[i] - ranges_[i].high);
      high = std::min(high, heights[i] - ranges_[i].low);
    }
    double at = 0.5 * (low + high);
    if (low <= high) return at;
    std::swap(low, high);  // infeasible for all points: the optimum is in between
    for (int step = 0; step < 200; ++step) {
      double slope = 0, count = 0;
      for (std::size_t i = 0; i < heights.size(); ++i) {
        const double out_by = excess(i, heights[i], at);
        slope -= out_by;
        count += out_by != 0 ? 1 : 0;
      }
      (slope > 0 ? high : low) = at;
      const double newton = at - slope / count;
      const double next = newton >= low && newton <= high ? newton : 0.5 * (low + high);
      if (count == 0 || std::abs(next - at) <= 1e-16 * (std::abs(at) + high - low)) break;
      at = next;
    }
    return at;
  }

  Eigen::Vector3d axis_;
  std::vector<Range> ranges_;
};

}  // namespace

std::unique_ptr<const Projection> largest_extent_projection(const Vec3& axis, double value, std::size_t points) {
  return std::make_unique<ExtentProjection>(axis, std::vector<ExtentProjection::Range>(points, {0, value}));
}

std::unique_ptr<const Projection> least_extent_projection(const Vec3& axis, double value, const ExtentEnds& ends,
                                                          std::size_t points) {
  std::vector<ExtentProjection::Range> ranges(points);
  for (const std::size_t i : ends.lower) ranges.at(i).high = 0;
  for (const std::size_t i : ends.upper) ranges.at(i).low = value;
  return std::make_unique<ExtentProjection>(axis, std::move(ranges));
}

ExtentEnds extent_ends(std::span<const Vec3> x, const Vec3& axis, double share) {
  const Eigen::Vector3d a = to_eigen(axis);
  double low = none, high = -none;
  for (const Vec3& p : x) {
    low = std::min(low, a.dot(to_eigen(p)));
    high = std::max(high, a.dot(to_eigen(p)));
  }
  ExtentEnds ends;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double height = a.dot(to_eigen(x[i]));
    if (height <= low + share * (high - low)) {
      ends.lower.push_back(i);
    } else if (height >= high - share * (high - low)) {
      ends.upper.push_back(i);
    }
  }
  return ends;
}

}  // namespace deform
