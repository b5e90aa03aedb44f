// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/handles/space_functions.h"
#include "core/numerics/kernels/kernel.h"
#include "core/numerics/sampling/mls_basis.h"
#include "core/numerics/sampling/point_tree.h"

namespace deform {

/// The memory of functions with this number of centres, in bytes.
std::size_t local_function_bytes(std::size_t centres);

/// Moving least squares at any place; see MlsBasis. Defined everywhere: far from all samples a place takes the nearest ones.
class MlsFunctions : public SpaceFunctions {
 public:
  /// `samples` and `radius` are in unit coordinates, which are those of `box`.
  MlsFunctions(std::span<const Vec3> samples, double radius, const MlsBasis::Options& options, const UnitBox& box);

  Outside rows(std::span<const Vec3> places, std::uint64_t first, const Use& use) const override;
  std::size_t bytes() const override { return local_function_bytes(basis_.size()); }

 private:
  const MlsBasis basis_;
  const UnitBox box_;
};

/// Radial functions that are cut off at `reach`, and on demand 1, x, y, z about a mean as the last four; what kernel_rows() and
/// shell_subspace() compute for the points of a mesh. Zero beyond the reach of all centres.
class LocalKernelFunctions : public SpaceFunctions {
 public:
  /// Centres, reach and mean are in unit coordinates, which are those of `box`.
  LocalKernelFunctions(const RadialKernel& kernel, double reach, std::span<const Vec3> centres, const UnitBox& box,
                       std::optional<Vec3> mean);

  Outside rows(std::span<const Vec3> places, std::uint64_t first, const Use& use) const override;
  std::size_t bytes() const override { return local_function_bytes(tree_.size()); }

 private:
  const RadialKernel kernel_;
  const double reach_;
  const UnitBox box_;
  const PointTree tree_;
  const std::optional<Vec3> mean_;
};

}  // namespace deform
