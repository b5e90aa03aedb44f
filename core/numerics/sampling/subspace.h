// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>

#include "core/base/run_context.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// A matrix with orthonormal columns that spans the columns of a tall matrix (Householder QR). Stops at the first column that
/// depends on the preceding ones to working precision; the result then has only the columns before it.
Eigen::MatrixXd orthonormal_columns(const Eigen::MatrixXd& columns, const RunContext& context = {});

/// The lower triangle of Phi^T E Phi, where E is symmetric with both triangles stored. Runs in parallel over columns if Phi is
/// dense; the result does not depend on the number of threads.
SparseMatrix projected_lower(const SparseMatrix& E, const Eigen::MatrixXd& phi, const RunContext& context = {});
SparseMatrix projected_lower(const SparseMatrix& E, const SparseRows& phi, const RunContext& context = {});

}  // namespace deform
