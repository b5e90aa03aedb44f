// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/mesh/mesh.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli {

/// The ascending point ids of a handle of a setup that the server accepted; with control CONTROLS numbers of control points of
/// its method.
std::vector<PointId> handle_points(const v1::Setup& setup, const std::string& handle, const Mesh& mesh);

/// The regions of a setup that no server has accepted yet, and all that is wrong with them.
struct ResolvedRegions {
  static constexpr std::uint32_t free = 0, fixed = 1, first_handle = 2;
  struct Constraint {
    std::string name, kind;
    std::vector<std::vector<PointId>> regions;
  };
  std::vector<std::uint32_t> labels;  ///< of every point, as region_labels()
  std::vector<std::string> handles;   ///< their names
  std::vector<Constraint> constraints;
  std::vector<PointId> contested;  ///< ascending: points of two handles, or of a handle and a fixed region
  /// One sentence each, the words of `deform prepare`: regions that cannot be selected, hold no point or overlap.
  std::vector<std::string> problems;
};
/// Throws Error(invalid_argument) where control points are selected.
ResolvedRegions resolve_regions(const v1::Setup& setup, const Mesh& mesh);

/// A label per point: 0 for what may deform, 1 for what is fixed (by all methods), 2 + i for handle i of all methods. Of regions
/// that overlap the first handle has the point. All 0 where control points are selected.
std::vector<std::uint32_t> region_labels(const v1::Setup& setup, const Mesh& mesh);

}  // namespace deform::cli
