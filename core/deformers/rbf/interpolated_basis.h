// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/base/run_context.h"
#include "core/deformers/handles/handle_basis.h"
#include "core/deformers/rbf/rbf_parts.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

/// The basis of the components of a part from the interpolants of the handles' fields (m x 4H values at the centres). Of the
/// solvers to a tolerance it is one of the sum over the fields, which is what a design gets. Errors are estimated at the points
/// of the numbers `checked`. Progress "basis".
HandleBasis interpolated_basis(const RbfPart& part, const Eigen::MatrixXd& fields, const TiledPoints& deformable,
                               std::span<const std::uint32_t> checked, double tolerance, const RunContext& context);

}  // namespace deform
