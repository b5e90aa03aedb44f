// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/distance.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/constraints/fitting.h"

namespace deform {

namespace {

class DistanceProjection final : public Projection {
 public:
  DistanceProjection(std::vector<PointPair> pairs, std::size_t points) : pairs_(std::move(pairs)), points_(points) {}

  std::string_view kind() const override { return "distance"; }
  std::size_t point_count() const override { return points_; }
  bool has_bounds() const override {
    return std::any_of(pairs_.begin(), pairs_.end(), [](const PointPair& pair) { return pair.least != pair.most; });
  }

  double project(std::span<const Vec3> x, std::span<Vec3> out, ShapeParameters& shape) const override {
    shape.clear();
    std::copy(x.begin(), x.end(), out.begin());
    double energy = 0;
    for (const PointPair& pair : pairs_) {
      const State at = state(pair, x);
      const Eigen::Vector3d half = 0.5 * at.excess * at.direction;
      out[pair.a] = to_vec3(to_eigen(x[pair.a]) - half);
      out[pair.b] = to_vec3(to_eigen(x[pair.b]) + half);
      energy += 0.5 * at.excess * at.excess;
    }
    return energy;
  }

  void derivative(std::span<const Vec3> x, const ShapeParameters&, std::span<const Vec3> dx, std::span<Vec3> out) const override {
    std::copy(dx.begin(), dx.end(), out.begin());
    for (const PointPair& pair : pairs_) {
      const State at = state(pair, x);
      if (!at.counts) continue;
      const Eigen::Vector3d d = to_eigen(dx[pair.a]) - to_eigen(dx[pair.b]);
      const double lengthened = at.direction.dot(d);
      // The direction turns with the pair.
      const double turning = at.excess / std::max(at.length, 1e-9 * pair.least);
      const Eigen::Vector3d half = 0.5 * (lengthened * at.direction + turning * (d - lengthened * at.direction));
      out[pair.a] = to_vec3(to_eigen(dx[pair.a]) - half);
      out[pair.b] = to_vec3(to_eigen(dx[pair.b]) + half);
    }
  }

  /// The error of a pair is the violation of its bounds; each of the two points moves by half of it.
  Misfit misfit(std::span<const Vec3> x, std::span<const Vec3>) const override {
    Misfit misfit;
    misfit.count = pairs_.size();
    for (const PointPair& pair : pairs_) {
      const double excess = std::abs(state(pair, x).excess);
      misfit.squares += excess * excess;
      misfit.largest = std::max(misfit.largest, excess);
    }
    return misfit;
  }

  Linearization linearize(std::span<const Vec3> x, const ShapeParameters&) const override {
    Linearization result;
    result.normals.assign(x.size(), Vec3{});
    result.residual.setZero(static_cast<Eigen::Index>(x.size()));
    result.parameters.resize(result.residual.size(), 0);
    result.partners.resize(x.size());
    for (std::size_t i = 0; i < x.size(); ++i) result.partners[i] = static_cast<std::uint32_t>(i);
    result.partner_normals.assign(x.size(), Vec3{});
    // Each of the two is half the excess away, towards the other; so they share it in equal rows.
    for (const PointPair& pair : pairs_) {
      result.partners[pair.a] = static_cast<std::uint32_t>(pair.b);
      result.partners[pair.b] = static_cast<std::uint32_t>(pair.a);
      const State at = state(pair, x);
      if (!at.counts) continue;
      const Vec3 half = to_vec3(0.5 * at.direction), back = to_vec3(-0.5 * at.direction);
      result.normals[pair.a] = result.partner_normals[pair.b] = half;
      result.normals[pair.b] = result.partner_normals[pair.a] = back;
      result.residual[pair.a] = result.residual[pair.b] = 0.5 * at.excess;
    }
    return result;
  }

 private:
  struct State {
    Eigen::Vector3d direction;
    double length = 0, excess = 0;  ///< over the bounds (negative: below them)
    bool counts = false;            ///< out of the bounds, or held to one length
  };

  static State state(const PointPair& pair, std::span<const Vec3> x) {
    State at;
    at.direction = to_eigen(x[pair.a]) - to_eigen(x[pair.b]);
    at.length = at.direction.norm();
    if (at.length > 0) {
      at.direction /= at.length;
    } else {
      at.direction = to_eigen(pair.direction);
    }
    at.excess = at.length - std::clamp(at.length, pair.least, pair.most);
    at.counts = at.excess != 0 || pair.least == pair.most;
    return at;
  }

  std::vector<PointPair> pairs_;
  std::size_t points_;
};

}  // namespace

std::unique_ptr<const Projection> distance_projection(std::vector<PointPair> pairs, std::size_t points) {
  return std::make_unique<DistanceProjection>(std::move(pairs), points);
}

}  // namespace deform
