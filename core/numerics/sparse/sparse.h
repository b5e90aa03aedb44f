// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/SparseCore>
#include <cstdint>

namespace deform {

/// Has 64-bit indices, so that CHOLMOD's long interface uses it without a copy.
using SparseMatrix = Eigen::SparseMatrix<double, Eigen::ColMajor, std::int64_t>;
/// A matrix with one row for each point, evaluated row by row.
using SparseRows = Eigen::SparseMatrix<double, Eigen::RowMajor, std::int64_t>;

}  // namespace deform
