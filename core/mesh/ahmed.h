// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "core/mesh/mesh.h"

namespace deform {

/// The Ahmed body (S. R. Ahmed, G. Ramm, G. Faltin, Some salient features of the time-averaged ground vehicle wake, SAE 840300,
/// 1984): 1.044 m long, 0.389 m wide, 0.288 m high, front edges rounded with radius 0.100 m, slant 0.222 m long, 0.050 m above
/// the ground on four stilts of 0.030 m diameter. x points downstream from the nose, y to the side (symmetry plane y = 0), z up
/// from the ground.
struct AhmedOptions {
  double slant_degrees = 25;          ///< 0..40
  std::size_t target_points = 10000;  ///< approximate number of points, 2000..2000000
};

/// A closed, manifold, consistently oriented (outward) triangle mesh without degenerate faces, with the face groups nose, roof,
/// sides, slant, base, underbody, stilts (each face in exactly one). Deterministic. Metres.
Mesh ahmed_body(const AhmedOptions& options);

}  // namespace deform
