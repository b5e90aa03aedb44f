// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/numerics/sparse/row_gram.h"

namespace deform {

/// What joins parts of a set of samples that have no energy in common (components of a model further apart than the supports
/// reach). Starting with the largest part, the part nearest to those joined is joined next: its samples are asked to follow the
/// moving least squares continuation from the nearest samples of those. Affine motions of the whole agree with that exactly.
struct Ties {
  RowBlocks rows;         ///< of height 1, one per sample of every part but the first; each counts 1 / (samples of its part)
  std::size_t parts = 0;  ///< 1: nothing to join
};

/// part[j] numbers the part of sample j from 0; the continuation is from about `cover` samples.
Ties component_ties(std::span<const Vec3> samples, const std::vector<std::uint32_t>& part, std::size_t cover);

}  // namespace deform
