// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/mesh.h"
#include "deform/v1/service.pb.h"

namespace deform::bench {

struct CaseSize {
  std::size_t points = 50000;  ///< about, of the Ahmed body
  std::size_t centres = 2000;  ///< half on the handles, half fixed
  std::size_t handles = 20;
};

/// An Ahmed body whose upper side moves in slices (one handle each, x' = A x + b) above a fixed underbody. The constrained points
/// are spread evenly and given by id, so that the interpolation system has exactly the wanted size.
struct Case {
  Mesh mesh;
  double diagonal = 0;
  std::vector<std::pair<std::string, std::vector<PointId>>> handles;  ///< ascending ids
  std::vector<PointId> fixed;                                         ///< ascending ids
};

/// Throws std::runtime_error when the mesh has too few points for it. Deterministic.
Case make_case(const CaseSize& size);

/// Triharmonic, without centre reduction.
v1::Setup make_setup(const Case& bench_case, const std::string& geometry_id);

/// One small affine map per handle.
std::vector<Affine> random_maps(const Case& bench_case, std::mt19937_64& random);
v1::Design make_design(const Case& bench_case, const std::vector<Affine>& maps);

}  // namespace deform::bench
