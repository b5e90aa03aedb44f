// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "core/base/run_context.h"

namespace deform {

/// The QR factorization A = Q R of a tall matrix to which columns are appended on the right: blocked Householder reflectors
/// in compact WY form (Schreiber, Van Loan 1989; LAPACK dgeqrt3, dlarfb). Appending columns leaves the factors of earlier
/// ones unchanged.
///
/// append() must not run concurrently with any other call; the const members may be called by any number of threads. The factors
/// do not depend on the number of threads.
class BlockedQr {
 public:
  explicit BlockedQr(std::size_t rows) : rows_(rows) {}

  std::size_t rows() const { return rows_; }
  std::size_t columns() const { return columns_; }
  std::size_t panels() const { return panels_.size(); }
  std::size_t first(std::size_t panel) const { return panels_[panel].first; }  ///< index of its first column
  std::size_t width(std::size_t panel) const { return panels_[panel].width; }
  std::size_t bytes() const;
  /// Memory in bytes for `columns` columns appended `block` at a time.
  static std::size_t bytes_for(std::size_t rows, std::size_t columns, std::size_t block);

  /// Appends a panel of at most rows() - columns() columns, which `fill` writes in column-major order with leading
  /// dimension rows(). Stops at the first column that depends on the preceding ones to working precision; returns the
  /// number of columns appended.
  std::size_t append(std::size_t columns, const std::function<void(double*)>& fill, const RunContext& context);

  /// Replaces Y (rows x any) by Q_p^T Y, where Q_p is the product of the reflectors of one panel. All panels in order give Q^T Y.
  void apply_transposed(std::size_t panel, Eigen::MatrixXd& Y) const;
  /// Replaces Y (rows x any) by Q Y with the reflectors of the first `panels` panels.
  void apply(std::size_t panels, Eigen::MatrixXd& Y) const;
  /// Replaces Y (columns x any) by R^-1 Y, where R is the leading columns x columns triangle.
  void solve(std::size_t columns, Eigen::MatrixXd& Y) const;
  /// Replaces Y (columns x any) by R^-T Y.
  void solve_transposed(std::size_t columns, Eigen::MatrixXd& Y) const;

 private:
  struct Panel {
    std::size_t first = 0, width = 0;
    std::unique_ptr<double[]> values;  ///< rows x width: R above, reflectors below
    std::vector<double> T;             ///< upper triangle, leading dimension ld_t
    std::size_t ld_t = 0;
  };

  void reflect(const Panel& panel, char transpose, double* Y, std::size_t columns) const;
  std::size_t independent(const Panel& panel) const;

  std::size_t rows_, columns_ = 0;
  std::vector<Panel> panels_;
};

}  // namespace deform
