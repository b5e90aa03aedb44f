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

/// Computes the basis for the components of a part from the interpolants of the handle fields (m x 4H values at the centres). For
/// solvers that work to a tolerance, `tolerance` applies to the sum over the fields, that is to a design. Errors are estimated at
/// the points with the indices `checked`. Reports "basis" progress.
HandleBasis interpolated_basis(const RbfPart& part, const Eigen::MatrixXd& fields, const TiledPoints& deformable,
                               std::span<const std::uint32_t> checked, double tolerance, const RunContext& context);

}  // namespace deform
