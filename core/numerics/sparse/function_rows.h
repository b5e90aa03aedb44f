// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "core/numerics/sparse/sparse.h"

namespace deform {

/// A sparse n x k matrix whose rows are computed on demand, because storing them would take more memory than all other data.
/// Immutable; any thread.
class ComputedRows {
 public:
  virtual ~ComputedRows() = default;
  virtual std::int64_t rows() const = 0;
  virtual std::int64_t cols() const = 0;
  /// The number of entries of a row.
  virtual std::size_t count(std::int64_t row) const = 0;
  /// Calls use(column, value) for all entries of a row, columns ascending.
  virtual void for_each(std::int64_t row, const std::function<void(std::int64_t, double)>& use) const = 0;
  /// The memory of this object in bytes.
  virtual std::size_t bytes() const = 0;
};

/// A view of the values of functions (columns) at points (rows), either stored or computed. The underlying object must
/// outlive it.
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
  /// Calls use(column, value) for all entries of a row, columns ascending.
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
