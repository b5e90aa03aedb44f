// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/handles/handle_basis.h"
#include "core/numerics/interpolation/interpolator.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

/// The basis of some components from the interpolants of the handles' fields (m x 4H values at the centres). `tolerance` is for
/// the solvers that have one. Progress "basis".
HandleBasis interpolated_basis(const std::vector<std::size_t>& components, const Interpolator& system,
                               const Eigen::MatrixXd& fields, const TiledPoints& deformable, double tolerance,
                               const RunContext& context);

}  // namespace deform
