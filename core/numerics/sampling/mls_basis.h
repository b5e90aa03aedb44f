// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/sampling/point_tree.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// The radius at which every place has at least `cover` samples (all of them, if there are fewer) strictly within it, times
/// `factor`; but at most `limit` times the middle one of all those that the places need. Places beyond are few and apart (ends of
/// wires, stray points); MlsBasis gives each a radius of its own.
struct CoverOptions {
  std::size_t cover = 8;
  double factor = 1.1;
  double limit = 2.2;  ///< the corner of a box needs twice what its middle needs
};
double covering_radius(const PointTree& samples, std::span<const Vec3> places, const CoverOptions& options,
                       const RunContext& context = {});

/// Moving least squares with linear monomials and the weight w(r) = (cos(pi r / radius) + 1) / 2 (thesis 8.3.3; Fries, Matthies
/// 2004): phi_j(x) = w_j q(x)^T M^+ q(c_j), M = sum w_j q(c_j) q(c_j)^T, one function per sample c_j.
///
/// At each point x the monomials q are 1 and coordinates along the principal axes of the samples that reach it, about their
/// weighted mean, over their weighted rms distance from it; so M is diagonal, its first entry is sum w_j and the others are the
/// principal variances, which add up to that. Axes whose variance is below `flat` of that are left out (the pseudo-inverse): the
/// functions count as constant along them, their derivatives along them are 0. So the functions always add up to 1 and reproduce
/// linear functions within the affine hull of the samples. Derivatives are those of the functions with the axes at x kept as they
/// are: exact where the rank is that of the samples, and but for the rims of the supports (w is C1).
///
/// Where fewer than `cover` samples are within the radius of x, x has a radius of its own: factor times the distance to the
/// cover-th nearest (continuous, but not smooth there; derivatives count it as fixed). Immutable; any number of threads.
class MlsBasis {
 public:
  struct Options {
    CoverOptions cover;
    double flat = 1e-6;
  };

  /// Samples must not coincide. Throws Error(invalid_argument): no sample, a radius that is not positive.
  MlsBasis(std::span<const Vec3> samples, double radius, const Options& options);

  std::size_t size() const { return tree_.size(); }
  double radius() const { return radius_; }
  const std::vector<Vec3>& samples() const { return tree_.points(); }

  enum class Order { values, first, second };

  /// The functions that are not 0 at a point, by ascending number of their samples.
  struct Row {
    std::vector<std::uint32_t> samples;
    std::vector<double> values;
    std::vector<Vec3> gradients;
    std::vector<std::array<double, 6>> hessians;  ///< xx yy zz yz xz xy
    std::size_t rank = 0;                         ///< axes kept, 0 to 3
    std::array<Vec3, 3> axes{};                   ///< orthonormal, the kept ones first
    std::vector<PointTree::Near> near;            ///< scratch

    double laplacian(std::size_t i) const { return hessians[i][0] + hessians[i][1] + hessians[i][2]; }
  };

  /// Fills what `order` asks for; the rest of the row is left as it is.
  void evaluate(const Vec3& x, Order order, Row& row) const;

  /// n x k, row i the functions at point i, in parallel.
  SparseRows values(std::span<const Vec3> points, const RunContext& context = {}) const;

  /// How many functions are not 0 at each point: row sizes, before anything is allocated.
  std::vector<std::size_t> row_sizes(std::span<const Vec3> points, const RunContext& context = {}) const;

 private:
  /// The samples around x into row.near and row.samples; returns the radius.
  double gather(const Vec3& x, Row& row) const;

  PointTree tree_;
  double radius_;
  Options options_;
};

}  // namespace deform
