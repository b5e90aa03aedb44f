// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "core/numerics/sparse/sparse.h"

namespace deform {

/// Rows of a sparse n x k matrix that are computed whenever they are asked for, because storing them would take more memory than
/// everything else. Immutable; any thread.
class ComputedRows {
 public:
  virtual ~ComputedRows() = default;
  virtual std::int64_t rows() const = 0;
  virtual std::int64_t cols() const = 0;
  /// Entries of a row.
  virtual std::size_t count(std::int64_t row) const = 0;
  /// use(column, value) for all entries of a row, columns ascending.
  virtual void for_each(std::int64_t row, const std::function<void(std::int64_t, double)>& use) const = 0;
  /// What this holds.
  virtual std::size_t bytes() const = 0;
};

/// The values of functions (columns) at points (rows), stored or computed. A view: what it was made from must outlive it.
class FunctionRows {
 public:
  FunctionRows(const SparseRows& stored) : stored_(&stored) {}          // NOLINT(google-explicit-constructor)
  FunctionRows(const ComputedRows& computed) : computed_(&computed) {}  // NOLINT(google-explicit-constructor)

  std::int64_t rows() const { return stored_ != nullptr ? stored_->rows() : computed_->rows(); }
  std::int64_t cols() const { return stored_ != nullptr ? stored_->cols() : computed_->cols(); }
  std::size_t count(std::int64_t row) const {
    if (stored_ == nullptr) return computed_->count(row);
    return static_cast<std::size_t>(stored_->outerIndexPtr()[row + 1] - stored_->outerIndexPtr()[row]);
  }
  /// use(column, value) for all entries of a row, columns ascending.
  template <typename Use>
  void for_each(std::int64_t row, const Use& use) const {
    if (stored_ == nullptr) return computed_->for_each(row, std::cref(use));
    for (SparseRows::InnerIterator it(*stored_, row); it; ++it) use(it.col(), it.value());
  }

 private:
  const SparseRows* stored_ = nullptr;
  const ComputedRows* computed_ = nullptr;
};

}  // namespace deform
