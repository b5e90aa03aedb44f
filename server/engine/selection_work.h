// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>

#include "deform/v1/setup.pb.h"

namespace deform::server {

/// What selecting the points of a setup costs, known before anything is selected: every region, also within others, is a pass
/// over all points.
struct SelectionWork {
  /// Regions that need neighbours of points or the surface of the mesh (open_boundary, boundary, patch, grow) count as so many.
  static constexpr std::uint64_t surface_weight = 30;

  std::uint64_t regions = 0;  ///< of handles, fixed regions, constraints, symmetry and methods, at any depth
  std::uint64_t points = 0;   ///< of the mesh

  double product() const { return static_cast<double>(regions) * static_cast<double>(points); }
  /// About how long it takes on one core.
  double seconds() const;
  /// Throws Error(invalid_argument) with all numbers when the product is above the limit.
  void check(std::size_t limit) const;
};

SelectionWork selection_work(const v1::Setup& setup, std::uint64_t points);

}  // namespace deform::server
