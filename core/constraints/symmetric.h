// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/constraints/projection.h"

namespace deform {

/// Projects points i and partner[i] onto mirror images in one plane, which is fitted; points that are their own partner lie in
/// it. partner[partner[i]] == i. Closed form: with x_i relative to their mean, the normal is the eigenvector of the least
/// eigenvalue of sum x_i x_partner(i)^T, and a point is projected onto the mean of itself and the image of its partner.
std::unique_ptr<const Projection> symmetric_projection(std::vector<std::uint32_t> partner);

}  // namespace deform
