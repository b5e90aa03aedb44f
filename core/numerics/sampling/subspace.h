// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>

#include "core/base/run_context.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// Q with orthonormal columns that spans the columns of a tall matrix (Householder). Columns that depend on those before them to
/// working precision end it: Q then has fewer, those of the columns up to there.
Eigen::MatrixXd orthonormal_columns(const Eigen::MatrixXd& columns, const RunContext& context = {});

/// The lower triangle of Phi^T E Phi, E symmetric with both triangles stored. In parallel over columns where Phi is full; the
/// same for any number of threads.
SparseMatrix projected_lower(const SparseMatrix& E, const Eigen::MatrixXd& phi, const RunContext& context = {});
SparseMatrix projected_lower(const SparseMatrix& E, const SparseRows& phi, const RunContext& context = {});

}  // namespace deform
