// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/numerics/sparse/row_gram.h"

namespace deform {

/// Rows that couple parts of a set of samples without common energy (components of a model further apart than the
/// supports). Starting with the largest part, the part nearest to the coupled ones is coupled next: its samples are to
/// follow the moving-least-squares extrapolation from the nearest coupled samples. Affine motions of the whole model
/// satisfy these rows exactly.
struct Ties {
  RowBlocks rows;         ///< height 1; one row per sample of all parts but the first, with weight 1 / (samples of its part)
  std::size_t parts = 0;  ///< 1 if there is nothing to couple
};

/// Couples the parts. part[j] is the part of sample j, from 0; the extrapolation uses about `cover` samples.
Ties component_ties(std::span<const Vec3> samples, const std::vector<std::uint32_t>& part, std::size_t cover);

}  // namespace deform
