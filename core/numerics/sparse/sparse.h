// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/SparseCore>
#include <cstdint>

namespace deform {

/// 64-bit indices: what CHOLMOD's long interface takes without a copy.
using SparseMatrix = Eigen::SparseMatrix<double, Eigen::ColMajor, std::int64_t>;
/// One row per point: evaluated row by row.
using SparseRows = Eigen::SparseMatrix<double, Eigen::RowMajor, std::int64_t>;

}  // namespace deform
