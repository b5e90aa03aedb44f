// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/sampling/mls_basis.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

constexpr std::size_t points_per_range = 256;
constexpr double pi = std::numbers::pi;
constexpr double wider = 1.5;  // radii: where samples are looked for in place of those out of reach

using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Vector3d;
using Eigen::Vector4d;

/// Second derivatives in the order of Row::hessians.
constexpr std::array<std::array<int, 2>, 6> pairs{{{0, 0}, {1, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}}};

/// w, w'/r and (w'' - w'/r) / r^2 at distance r, which need no unit vector and so hold at r = 0 too.
struct Weight {
  double value, slope, curve;
  Weight(double square, double radius) {
    const double r = std::sqrt(square), t = pi * r / radius, half = 0.5 * (pi / radius) * (pi / radius);
    value = 0.5 * std::cos(t) + 0.5;
    const bool small = t < 1e-3;  // then the terms left out of the series are below rounding
    const double sinc = small ? 1 - t * t / 6 + t * t * t * t / 120 : std::sin(t) / t;
    slope = -half * sinc;
    // cos t - sin t / t = -t^2/3 + t^4/30
    const double curve_t = small ? -1.0 / 3 + t * t / 30 : (std::cos(t) - sinc) / (t * t);
    curve = -half * (pi / radius) * (pi / radius) * curve_t;
  }
};

Vector3d vector(const Vec3& x) { return {x[0], x[1], x[2]}; }

/// The local coordinates at a point: xi = V^T (y - origin) / unit.
struct Frame {
  Vector3d origin = Vector3d::Zero();
  double unit = 1, weight = 0;  ///< weight: sum of the w_j
  Matrix3d V = Matrix3d::Identity();
  Vector4d inverse = Vector4d::Zero();  ///< diagonal of M^+ over the normalized weights; 0 where an axis is left out
  std::size_t rank = 0;
};

/// The data of one sample, in local coordinates and with weights that add up to 1.
struct Active {
  Vector4d q;
  double weight;
  Vector3d gradient;
  Eigen::Matrix<double, 6, 1> hessian;
};

Frame local_frame(const MlsBasis::Row& row, const std::vector<Vec3>& samples, double flat, std::vector<double>& weights) {
  Frame frame;
  weights.clear();
  for (std::size_t i = 0; i < row.near.size(); ++i) weights.push_back(Weight(row.near[i].square, row.radii[i]).value);
  for (const double w : weights) frame.weight += w;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    weights[i] /= frame.weight;
    frame.origin += weights[i] * vector(samples[row.samples[i]]);
  }
  Matrix3d C = Matrix3d::Zero();
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const Vector3d from = vector(samples[row.samples[i]]) - frame.origin;
    C += weights[i] * from * from.transpose();
  }
  frame.inverse[0] = 1;
  const double spread = C.trace();
  // Only rounding of coordinates of size 1: a single sample.
  if (!(spread > 1e-28 * (1 + frame.origin.squaredNorm()))) return frame;
  frame.unit = std::sqrt(spread);
  const SymmetricEigen<3> eigen = symmetric_eigen(Matrix3d(C / spread));
  for (int a = 0; a < 3; ++a) {  // the largest first
    frame.V.col(a) = eigen.vectors.col(2 - a);
    const double variance = eigen.values[2 - a];
    if (!(variance >= flat)) continue;
    frame.inverse[a + 1] = 1 / variance;
    ++frame.rank;
  }
  return frame;
}

/// The derivatives of alpha = M^+ q(x), from M alpha = q:  M alpha_k = q_k - M_k alpha,
/// M alpha_kl = -(M_kl alpha + M_k alpha_l + M_l alpha_k).
struct Alpha {
  Vector4d value;
  std::array<Vector4d, 3> first{};
  std::array<Vector4d, 6> second{};

  Alpha(const Frame& frame, const Vector4d& q, const std::vector<Active>& active, MlsBasis::Order order)
      : value(frame.inverse.cwiseProduct(q)) {
    if (order == MlsBasis::Order::values) return;
    std::array<Matrix4d, 3> M1;
    std::array<Vector4d, 6> M2_alpha;
    M1.fill(Matrix4d::Zero());
    M2_alpha.fill(Vector4d::Zero());
    for (const Active& a : active) {
      const Matrix4d outer = a.q * a.q.transpose();
      for (std::size_t k = 0; k < 3; ++k) M1[k] += a.gradient[static_cast<int>(k)] * outer;
      if (order != MlsBasis::Order::second) continue;
      const Vector4d along = a.q.dot(value) * a.q;
      for (std::size_t p = 0; p < 6; ++p) M2_alpha[p] += a.hessian[static_cast<int>(p)] * along;
    }
    for (std::size_t k = 0; k < 3; ++k) {
      Vector4d right = -(M1[k] * value);
      right[static_cast<int>(k) + 1] += k < frame.rank ? 1 : 0;
      first[k] = frame.inverse.cwiseProduct(right);
    }
    if (order != MlsBasis::Order::second) return;
    for (std::size_t p = 0; p < 6; ++p) {
      const auto k = static_cast<std::size_t>(pairs[p][0]), l = static_cast<std::size_t>(pairs[p][1]);
      second[p] = -frame.inverse.cwiseProduct(M2_alpha[p] + M1[k] * first[l] + M1[l] * first[k]);
    }
  }
};

std::vector<Active> active_samples(const MlsBasis::Row& row, const std::vector<Vec3>& samples, const Vec3& at, const Frame& frame,
                                   const std::vector<double>& weights, MlsBasis::Order order) {
  std::vector<Active> active(weights.size());
  for (std::size_t i = 0; i < active.size(); ++i) {
    Active& a = active[i];
    const Vector3d xi = frame.V.transpose() * (vector(samples[row.samples[i]]) - frame.origin) / frame.unit;
    a.q = Vector4d::Zero();
    a.q[0] = 1;
    for (std::size_t k = 0; k < frame.rank; ++k) a.q[static_cast<int>(k) + 1] = xi[static_cast<int>(k)];
    a.weight = weights[i];
    if (order == MlsBasis::Order::values) continue;
    const Weight weight(row.near[i].square, row.radii[i]);
    const Vector3d from = frame.V.transpose() * (vector(at) - vector(samples[row.samples[i]])) / frame.unit;
    const double scale = frame.unit * frame.unit / frame.weight;
    a.gradient = weight.slope * scale * from;
    for (std::size_t p = 0; p < 6; ++p) {
      const auto [k, l] = pairs[p];
      a.hessian[static_cast<int>(p)] =
          scale * ((k == l ? weight.slope : 0.0) + weight.curve * frame.unit * frame.unit * from[k] * from[l]);
    }
  }
  return active;
}

/// Derivatives in local coordinates to those along x, y, z; without those along axes left out.
void add_derivatives(const Frame& frame, const Vector3d& gradient, const Eigen::Matrix<double, 6, 1>& hessian,
                     MlsBasis::Order order, MlsBasis::Row& row) {
  const auto kept = static_cast<Eigen::Index>(frame.rank);
  const Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, 3> V = frame.V.leftCols(kept) / frame.unit;
  const Vector3d g = V * gradient.head(kept);
  row.gradients.push_back({g[0], g[1], g[2]});
  if (order != MlsBasis::Order::second) return;
  Matrix3d H;
  for (std::size_t p = 0; p < 6; ++p) {
    const auto [k, l] = pairs[p];
    H(k, l) = H(l, k) = hessian[static_cast<int>(p)];
  }
  const Matrix3d G = V * H.topLeftCorner(kept, kept) * V.transpose();
  row.hessians.push_back({G(0, 0), G(1, 1), G(2, 2), G(1, 2), G(0, 2), G(0, 1)});
}

/// An n x k matrix whose rows have these sizes, not yet filled.
SparseRows with_rows(const std::vector<std::size_t>& sizes, std::size_t columns) {
  SparseRows rows(static_cast<Eigen::Index>(sizes.size()), static_cast<Eigen::Index>(columns));
  std::int64_t* const starts = rows.outerIndexPtr();
  starts[0] = 0;
  for (std::size_t i = 0; i < sizes.size(); ++i) starts[i + 1] = starts[i] + static_cast<std::int64_t>(sizes[i]);
  rows.resizeNonZeros(starts[sizes.size()]);
  return rows;
}

}  // namespace

double covering_radius(const PointTree& samples, std::span<const Vec3> places, const CoverOptions& options,
                       const RunContext& context) {
  const std::size_t cover = std::min(std::max<std::size_t>(options.cover, 1), samples.size());
  if (places.empty() || samples.size() == 0) return 0;
  std::vector<double> needed(places.size());
  parallel_for(context, places.size(), points_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) needed[i] = std::sqrt(samples.kth_square(places[i], cover));
  });
  const double largest = *std::max_element(needed.begin(), needed.end());
  const auto middle = needed.begin() + static_cast<std::ptrdiff_t>(needed.size() / 2);
  std::nth_element(needed.begin(), middle, needed.end());
  return options.factor * std::min(largest, options.limit * *middle);
}

MlsBasis::MlsBasis(std::span<const Vec3> samples, double radius, const Options& options)
    : tree_(samples), radius_(radius), options_(options) {
  if (samples.empty()) throw Error(ErrorCode::invalid_argument, "samples: at least one is needed");
  if (!(radius > 0 && std::isfinite(radius))) {
    throw Error(ErrorCode::invalid_argument, "radius: " + number_digits(radius) + " is out of range, must be over 0");
  }
}

void MlsBasis::gather(const Vec3& x, Row& row) const {
  const auto ascending = [](const auto& a, const auto& b) { return a.point < b.point; };
  double radius = radius_;
  const std::size_t cover = std::min(std::max<std::size_t>(options_.cover.cover, 1), tree_.size());
  tree_.within(x, radius * radius, row.near);
  if (row.near.size() < cover) {
    radius = std::max(radius, options_.cover.factor * std::sqrt(tree_.kth_square(x, cover)));
    tree_.within(x, radius * radius, row.near);
  }
  std::sort(row.near.begin(), row.near.end(), ascending);
  row.radii.assign(row.near.size(), radius);
  if (options_.reach != nullptr && options_.reach->lengthens(x, row.near)) {
    tree_.within(x, wider * wider * radius * radius, row.near);
    std::sort(row.near.begin(), row.near.end(), ascending);
    options_.reach->lengthen(x, row.near, row.distances);
    keep_reached(radius, cover, row);
  }
  row.samples.clear();
  for (const auto& near : row.near) row.samples.push_back(near.point);
}

/// Removes the samples beyond the radius by the distances that count, or beyond the cover-th of them.
void MlsBasis::keep_reached(double radius, std::size_t cover, Row& row) const {
  std::vector<double> sorted;
  for (const double d : row.distances) {
    if (std::isfinite(d)) sorted.push_back(d);
  }
  cover = std::min(cover, sorted.size());
  if (cover > 0) {
    const auto last = sorted.begin() + static_cast<std::ptrdiff_t>(cover - 1);
    std::nth_element(sorted.begin(), last, sorted.end());
    radius = std::max(radius, options_.cover.factor * *last);
  }
  std::size_t kept = 0;
  row.radii.clear();
  for (std::size_t i = 0; i < row.near.size(); ++i) {
    if (!(row.distances[i] < radius)) continue;
    const double straight = std::sqrt(row.near[i].square);
    row.radii.push_back(row.distances[i] > straight && straight > 0 ? radius * straight / row.distances[i] : radius);
    row.near[kept++] = row.near[i];
  }
  row.near.resize(kept);
}

void MlsBasis::evaluate(const Vec3& x, Order order, Row& row) const {
  gather(x, row);
  std::vector<double> weights;
  const Frame frame = local_frame(row, samples(), options_.flat, weights);
  row.rank = frame.rank;
  for (int a = 0; a < 3; ++a) row.axes[static_cast<std::size_t>(a)] = {frame.V(0, a), frame.V(1, a), frame.V(2, a)};
  const std::vector<Active> active = active_samples(row, samples(), x, frame, weights, order);
  Vector4d q = Vector4d::Zero();
  const Vector3d xi = frame.V.transpose() * (vector(x) - frame.origin) / frame.unit;
  q[0] = 1;
  for (std::size_t k = 0; k < frame.rank; ++k) q[static_cast<int>(k) + 1] = xi[static_cast<int>(k)];
  const Alpha alpha(frame, q, active, order);

  row.values.clear();
  row.gradients.clear();
  row.hessians.clear();
  for (const Active& a : active) {
    const double shape = a.q.dot(alpha.value);
    row.values.push_back(a.weight * shape);
    if (order == Order::values) continue;
    Vector3d gradient;
    std::array<double, 3> along;
    for (std::size_t k = 0; k < 3; ++k) {
      along[k] = a.q.dot(alpha.first[k]);
      gradient[static_cast<int>(k)] = a.gradient[static_cast<int>(k)] * shape + a.weight * along[k];
    }
    Eigen::Matrix<double, 6, 1> hessian = Eigen::Matrix<double, 6, 1>::Zero();
    if (order == Order::second) {
      for (std::size_t p = 0; p < 6; ++p) {
        const auto [k, l] = pairs[p];
        hessian[static_cast<int>(p)] = a.hessian[static_cast<int>(p)] * shape +
                                       a.gradient[k] * along[static_cast<std::size_t>(l)] +
                                       a.gradient[l] * along[static_cast<std::size_t>(k)] + a.weight * a.q.dot(alpha.second[p]);
      }
    }
    add_derivatives(frame, gradient, hessian, order, row);
  }
}

std::vector<std::size_t> MlsBasis::row_sizes(std::span<const Vec3> points, const RunContext& context) const {
  std::vector<std::size_t> sizes(points.size());
  parallel_for(context, points.size(), points_per_range, [&](std::size_t begin, std::size_t end) {
    Row row;
    for (std::size_t i = begin; i < end; ++i) {
      gather(points[i], row);
      sizes[i] = row.samples.size();
    }
  });
  return sizes;
}

SparseRows MlsBasis::values(std::span<const Vec3> points, const RunContext& context) const {
  SparseRows rows = with_rows(row_sizes(points, context), size());
  parallel_for(context, points.size(), points_per_range, [&](std::size_t begin, std::size_t end) {
    Row row;
    for (std::size_t i = begin; i < end; ++i) {
      evaluate(points[i], Order::values, row);
      const std::int64_t start = rows.outerIndexPtr()[i];
      std::copy(row.samples.begin(), row.samples.end(), rows.innerIndexPtr() + start);
      std::copy(row.values.begin(), row.values.end(), rows.valuePtr() + start);
    }
  });
  return rows;
}

}  // namespace deform
