// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/sampling/point_tree.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// The support radius of MlsBasis: `factor` times the radius within which every place has at least `cover` samples (or all, if
/// there are fewer), but at most `limit` times the median of the radii of the single places. The places beyond that are few and
/// isolated (ends of wires, stray points); MlsBasis gives each a radius of its own.
struct CoverOptions {
  std::size_t cover = 8;
  double factor = 1.1;
  double limit = 2.2;  ///< the corner of a box needs twice the radius of its middle
};
double covering_radius(const PointTree& samples, std::span<const Vec3> places, const CoverOptions& options,
                       const RunContext& context = {});

/// Distances that count instead of straight ones, for the supports of MlsBasis: those of ways around something. Any thread.
class SampleReach {
 public:
  SampleReach() = default;
  SampleReach(const SampleReach&) = delete;
  SampleReach& operator=(const SampleReach&) = delete;
  virtual ~SampleReach() = default;

  /// Whether lengthen() changes any distance from x to these samples.
  virtual bool lengthens(const Vec3& x, std::span<const PointTree::Near> near) const = 0;
  /// Stores the distances from x to samples, in the order of `near`: not less than the straight ones, infinity where there is no
  /// way. Distances are continuous in x up to a part of the distance between samples.
  virtual void lengthen(const Vec3& x, std::span<const PointTree::Near> near, std::vector<double>& distances) const = 0;
};

/// Moving least squares with linear monomials and the weight w(r) = (cos(pi r / radius) + 1) / 2 (thesis 8.3.3; Fries, Matthies
/// 2004): phi_j(x) = w_j q(x)^T M^+ q(c_j), M = sum w_j q(c_j) q(c_j)^T, one function per sample c_j.
///
/// At each point x the monomials q are 1 and the coordinates along the principal axes of the samples in its support, relative to
/// their weighted mean and divided by their weighted rms distance from it. So M is diagonal: its first entry is sum w_j, the
/// others are the principal variances, which add up to the first. Axes whose variance is below `flat` times that are left out
/// (pseudo-inverse); the functions are treated as constant along them, with zero derivatives. So the functions always add up to 1
/// and reproduce linear functions within the affine hull of the samples. Derivatives are taken with the axes at x kept fixed,
/// which is exact where the rank is that of the samples, except at the boundaries of the supports (w is C1).
///
/// A point x with fewer than `cover` samples within the radius has a radius of its own: `factor` times the distance to the
/// cover-th nearest sample. The functions are continuous there but not smooth; derivatives treat the radius as fixed.
///
/// With `reach`, a sample at distance r has the weight of its distance in it, d: w(d / r times r), of which derivatives treat d /
/// r as fixed. So linear functions are reproduced with all derivatives. Immutable; any number of threads.
class MlsBasis {
 public:
  struct Options {
    CoverOptions cover;
    double flat = 1e-6;
    std::shared_ptr<const SampleReach> reach{};  ///< if empty, straight distances count
  };

  /// Samples must be distinct. Throws Error(invalid_argument) if there is no sample or the radius is not positive.
  MlsBasis(std::span<const Vec3> samples, double radius, const Options& options);

  std::size_t size() const { return tree_.size(); }
  double radius() const { return radius_; }
  const std::vector<Vec3>& samples() const { return tree_.points(); }

  enum class Order { values, first, second };

  /// The functions that are nonzero at a point, by ascending index of their samples.
  struct Row {
    std::vector<std::uint32_t> samples;
    std::vector<double> values;
    std::vector<Vec3> gradients;
    std::vector<std::array<double, 6>> hessians;  ///< xx yy zz yz xz xy
    std::size_t rank = 0;                         ///< number of axes kept, 0 to 3
    std::array<Vec3, 3> axes{};                   ///< orthonormal, the kept ones first
    std::vector<PointTree::Near> near;            ///< scratch
    std::vector<double> radii;                    ///< scratch: of the supports of these samples
    std::vector<double> distances;                ///< scratch

    double laplacian(std::size_t i) const { return hessians[i][0] + hessians[i][1] + hessians[i][2]; }
  };

  /// Computes derivatives up to `order`; higher ones in `row` are left unchanged.
  void evaluate(const Vec3& x, Order order, Row& row) const;

  /// The n x k matrix with the functions at point i in row i; computed in parallel.
  SparseRows values(std::span<const Vec3> points, const RunContext& context = {}) const;

  /// The number of nonzero functions at each point, to allocate rows.
  std::vector<std::size_t> row_sizes(std::span<const Vec3> points, const RunContext& context = {}) const;

 private:
  /// Stores the samples whose supports contain x in row.near and row.samples, and the radii of the supports.
  void gather(const Vec3& x, Row& row) const;
  void keep_reached(double radius, std::size_t cover, Row& row) const;

  PointTree tree_;
  double radius_;
  Options options_;
};

}  // namespace deform
