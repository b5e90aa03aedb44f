// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/constraints/projection.h"

namespace deform {

/// Point i and point partner[i] are mirror images in one plane, wherever it is; points that are their own partner lie in it.
/// partner[partner[i]] == i. Closed form: with x_i about their mean, the normal is the eigenvector of the least eigenvalue of
/// sum x_i x_partner(i)^T, and what is nearest is the mean of a point and the image of its partner.
std::unique_ptr<const Projection> symmetric_projection(std::vector<std::uint32_t> partner);

}  // namespace deform
