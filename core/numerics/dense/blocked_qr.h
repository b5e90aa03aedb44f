// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "core/base/run_context.h"

namespace deform {

/// A = Q R of a tall matrix that grows by columns on its right: Householder reflectors in blocks, compact WY form (Schreiber, Van
/// Loan 1989; LAPACK dgeqrt3, dlarfb). What is appended leaves the factors of earlier columns as they are.
///
/// append() is for one thread; everything else only reads: any number of threads at once. The factors do not depend on the number
/// of threads.
class BlockedQr {
 public:
  explicit BlockedQr(std::size_t rows) : rows_(rows) {}

  std::size_t rows() const { return rows_; }
  std::size_t columns() const { return columns_; }
  std::size_t panels() const { return panels_.size(); }
  std::size_t first(std::size_t panel) const { return panels_[panel].first; }  ///< column
  std::size_t width(std::size_t panel) const { return panels_[panel].width; }
  std::size_t bytes() const;
  /// Of `columns` columns appended `block` at a time.
  static std::size_t bytes_for(std::size_t rows, std::size_t columns, std::size_t block);

  /// Appends a panel of columns, at most rows() - columns() of them, which `fill` writes: column-major, leading dimension rows().
  /// Columns that depend on those before them to working precision end it: returns how many were taken.
  std::size_t append(std::size_t columns, const std::function<void(double*)>& fill, const RunContext& context);

  /// Y (rows x any) becomes that of Q_p^T Y, Q_p the reflectors of one panel; all panels in order give Q^T Y.
  void apply_transposed(std::size_t panel, Eigen::MatrixXd& Y) const;
  /// Y becomes Q Y with the reflectors of the first `panels` panels.
  void apply(std::size_t panels, Eigen::MatrixXd& Y) const;
  /// The leading columns x columns triangle of R: Y (columns x any) becomes R^-1 Y.
  void solve(std::size_t columns, Eigen::MatrixXd& Y) const;
  /// Y becomes R^-T Y.
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
