// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <vector>

#include "core/base/run_context.h"

namespace deform {

/// A symmetric positive definite matrix stored in block columns and factored in place, A = L L^T. Panel p holds rows first(p) ..
/// size of columns first(p) .. first(p) + width(p), column-major, so the storage is a little more than half of the full square.
/// It is not initialized: the caller fills it panel by panel, at and below the diagonal, then calls factor(). Any number of
/// threads may call solve(); the other members are not thread-safe.
class PackedCholesky {
 public:
  explicit PackedCholesky(std::size_t size);

  std::size_t size() const { return size_; }
  std::size_t panels() const { return offsets_.size() - 1; }
  std::size_t first(std::size_t panel) const { return panel * block_; }
  std::size_t width(std::size_t panel) const { return std::min(block_, size_ - first(panel)); }
  std::size_t rows(std::size_t panel) const { return size_ - first(panel); }  ///< also the leading dimension
  double* panel(std::size_t p) { return values_.get() + offsets_[p]; }
  const double* panel(std::size_t p) const { return values_.get() + offsets_[p]; }
  std::size_t bytes() const { return offsets_.back() * sizeof(double); }
  static std::size_t bytes_for(std::size_t size);

  /// The 1-norm of the symmetric matrix. Call before factor().
  double norm1(const RunContext& context) const;

  /// Factors in place. Returns false if a pivot is not positive; the contents are lost then. The result does not depend on the
  /// number of threads. Reports "factor" progress.
  bool factor(const RunContext& context);

  /// Replaces B (size x columns, column-major, leading dimension ldb) by A^-1 B.
  void solve(double* B, std::size_t ldb, std::size_t columns) const;

 private:
  static std::size_t block_for(std::size_t size);

  std::size_t size_;
  std::size_t block_;
  std::vector<std::size_t> offsets_;
  std::unique_ptr<double[]> values_;
};

}  // namespace deform
