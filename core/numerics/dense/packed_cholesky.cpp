// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/dense/packed_cholesky.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/numerics/dense/lapack.h"

namespace deform {

std::size_t PackedCholesky::block_for(std::size_t size) {
  // The upper halves of the diagonal blocks are what packing wastes: at most block / (2 size) of the square.
  return std::clamp<std::size_t>(size / 16 / 32 * 32, 32, 256);
}

PackedCholesky::PackedCholesky(std::size_t size) : size_(size), block_(block_for(size)), offsets_{0} {
  for (std::size_t begin = 0; begin < size; begin += block_) {
    offsets_.push_back(offsets_.back() + (size - begin) * std::min(block_, size - begin));
  }
  // Not initialized: the threads that fill the panels touch the pages first.
  values_ = std::make_unique_for_overwrite<double[]>(offsets_.back());
}

std::size_t PackedCholesky::bytes_for(std::size_t size) {
  const std::size_t block = block_for(size);
  std::size_t count = 0;
  for (std::size_t begin = 0; begin < size; begin += block) count += (size - begin) * std::min(block, size - begin);
  return count * sizeof(double);
}

double PackedCholesky::norm1(const RunContext& context) const {
  // A panel's entries count for their columns and, below the diagonal, for their rows.
  std::vector<std::vector<double>> parts(panels());
  parallel_for(context, panels(), 1, [&](std::size_t p, std::size_t) {
    std::vector<double>& sums = parts[p];
    sums.assign(rows(p), 0.0);
    for (std::size_t c = 0; c < width(p); ++c) {
      const double* column = panel(p) + c * rows(p);
      double lanes[4] = {std::abs(column[c]), 0, 0, 0};
      for (std::size_t r = c + 1; r < rows(p); ++r) {
        const double size = std::abs(column[r]);
        sums[r] += size;
        lanes[r % 4] += size;
      }
      sums[c] += (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]);
    }
  });
  std::vector<double> sums(size_, 0.0);
  for (std::size_t p = 0; p < panels(); ++p) {
    for (std::size_t r = 0; r < rows(p); ++r) sums[first(p) + r] += parts[p][r];
  }
  return size_ == 0 ? 0 : *std::max_element(sums.begin(), sums.end());
}

bool PackedCholesky::factor(const RunContext& context) {
  lapack::use_one_thread();
  constexpr std::size_t row_chunk = 512;
  context.progress("factor", 0);
  for (std::size_t k = 0; k < panels(); ++k) {
    context.check();
    double* L = panel(k);
    const int n = static_cast<int>(width(k));
    const int ld = static_cast<int>(rows(k));
    int info = 0;
    dpotrf_("L", &n, L, &ld, &info);
    if (info != 0) return false;
    // OpenBLAS lets NaN pass.
    for (std::size_t c = 0; c < width(k); ++c) {
      if (!std::isfinite(L[c * rows(k) + c])) return false;
    }
    const std::size_t below = rows(k) - width(k);
    parallel_for(context, below, row_chunk, [&](std::size_t begin, std::size_t end) {
      cblas_dtrsm(CblasColMajor, CblasRight, CblasLower, CblasTrans, CblasNonUnit, static_cast<int>(end - begin), n, 1.0, L, ld,
                  L + width(k) + begin, ld);
    });
    // Every later panel is updated whole by one thread, in the order of k: the sums do not depend on the number of threads.
    parallel_for(context, panels() - k - 1, 1, [&](std::size_t begin, std::size_t) {
      const std::size_t p = k + 1 + begin;
      const double* lower = L + (first(p) - first(k));
      // The upper half of the diagonal block is never read.
      const int w = static_cast<int>(width(p));
      const int rest = static_cast<int>(rows(p)) - w;
      const int ld_p = static_cast<int>(rows(p));
      cblas_dsyrk(CblasColMajor, CblasLower, CblasNoTrans, w, n, -1.0, lower, ld, 1.0, panel(p), ld_p);
      if (rest > 0) {
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, rest, w, n, -1.0, lower + w, ld, lower, ld, 1.0, panel(p) + w, ld_p);
      }
    });
    const double left = static_cast<double>(below) / static_cast<double>(size_);
    context.progress("factor", 1 - left * left * left);
  }
  return true;
}

void PackedCholesky::solve(double* B, std::size_t ldb, std::size_t columns) const {
  if (columns == 0 || size_ == 0) return;
  lapack::use_one_thread();
  const int c = static_cast<int>(columns);
  const int ld_b = static_cast<int>(ldb);
  for (std::size_t p = 0; p < panels(); ++p) {
    const int n = static_cast<int>(width(p));
    const int ld = static_cast<int>(rows(p));
    const int below = ld - n;
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, n, c, 1.0, panel(p), ld, B + first(p), ld_b);
    if (below > 0) {
      cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, below, c, n, -1.0, panel(p) + n, ld, B + first(p), ld_b, 1.0,
                  B + first(p) + n, ld_b);
    }
  }
  for (std::size_t q = panels(); q > 0; --q) {
    const std::size_t p = q - 1;
    const int n = static_cast<int>(width(p));
    const int ld = static_cast<int>(rows(p));
    const int below = ld - n;
    if (below > 0) {
      cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, n, c, below, -1.0, panel(p) + n, ld, B + first(p) + n, ld_b, 1.0,
                  B + first(p), ld_b);
    }
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasTrans, CblasNonUnit, n, c, 1.0, panel(p), ld, B + first(p), ld_b);
  }
}

}  // namespace deform
