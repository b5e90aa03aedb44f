// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/numerics/fast_sums/chebyshev_grid.h"
#include "core/numerics/fast_sums/octree.h"
#include "core/numerics/kernels/kernel.h"

namespace deform {

/// Kernel sums over many points and centres in linear time: a fast multipole method that interpolates the kernel between
/// well-separated boxes (Fong, Darve: The black-box fast multipole method, Journal of Computational Physics 228, 2009). It
/// needs a kernel that is smooth away from 0, that is any but Wendland's. Boxes with few points are summed directly, so small
/// sums are exact.
///
/// Immutable; any number of threads may call sums() at once. Results do not depend on the number of threads.
class FastSums {
 public:
  struct Options {
    int order = 8;                ///< interpolation points per axis, 4..16; two more give 1.5 to 2 digits
    std::size_t leaf_points = 0;  ///< 0 = automatic
  };

  FastSums(const RadialKernel& kernel, std::span<const Vec3> points, std::span<const Vec3> centres, const Options& options);

  std::size_t points() const { return targets_.points().size(); }
  std::size_t centres() const { return sources_.points().size(); }
  /// Row i = sum over centres j of phi(|point i - centre j|) * weights[j]: n x columns from m x columns, both row-major, as
  /// kernel_sums() does. Throws Error(cancelled), deadline_exceeded.
  std::vector<double> sums(std::span<const double> weights, std::size_t columns, const RunContext& context = {}) const;

  std::size_t bytes() const;
  /// Memory in bytes for n points and m centres, including the workspace of one call of sums(). An upper bound for points
  /// on surfaces.
  static std::size_t bytes_for(std::size_t n, std::size_t m, int order);

 private:
  struct Range {
    std::uint32_t begin, end;
  };
  /// Two well-separated boxes of the same level.
  struct Pair {
    std::uint32_t target, source;
    std::uint8_t symmetry;
  };
  /// Pairs whose offsets are equal up to a symmetry of the cube. The pairs of a group have distinct targets.
  struct Class {
    std::size_t level;
    Vec3 offset;  ///< source - target after the symmetry, in units of boxes
    std::vector<Pair> pairs;
    std::vector<std::size_t> groups;
  };
  /// Contributions to a target box that are summed directly or at the nodes of the source only.
  struct Near {
    std::vector<Range> direct;         ///< centres summed directly
    std::vector<std::uint32_t> nodes;  ///< source boxes whose interpolation points are summed
  };
  struct Workspace;

  void pair(std::uint32_t target, std::uint32_t source);
  void far_pair(std::uint32_t target, std::uint32_t source);
  void finish_lists();
  void upward(Workspace& work) const;
  void translate(Workspace& work) const;
  void translate_group(const Class& group, std::size_t first, std::size_t last, const double* matrix, Workspace& work) const;
  void downward(Workspace& work) const;
  void evaluate(Workspace& work) const;
  void evaluate_leaf(std::uint32_t box, Workspace& work) const;

  RadialKernel kernel_;
  ChebyshevGrid grid_;
  Octree sources_, targets_;
  std::size_t direct_limit_;
  std::vector<Class> classes_;
  std::vector<Near> near_;                    ///< for each target box its own; for leaves also those of their ancestors
  std::vector<std::vector<Range>> incoming_;  ///< for each target box, centres summed at its nodes
  std::vector<bool> expanded_;                ///< for each target box, whether its nodes receive anything
  bool expands_ = false;                      ///< whether the nodes of any target box receive anything
  bool collects_ = false;                     ///< whether the nodes of any source box are summed or translated
  std::vector<std::uint32_t> leaves_;         ///< leaves of the targets
};

}  // namespace deform
