// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/dense/blocked_qr.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/numerics/dense/lapack.h"

namespace deform {

namespace {

// A column counts as dependent when less of it than this is left beside the others.
constexpr double least_share = 1e-14;

int to_int(std::size_t value) { return static_cast<int>(value); }

}  // namespace

std::size_t BlockedQr::bytes() const {
  std::size_t count = 0;
  for (const Panel& panel : panels_) count += rows_ * panel.ld_t + panel.T.size();
  return count * sizeof(double);
}

std::size_t BlockedQr::bytes_for(std::size_t rows, std::size_t columns, std::size_t block) {
  return (rows + std::min(block, columns)) * columns * sizeof(double);
}

void BlockedQr::reflect(const Panel& panel, char transpose, double* Y, std::size_t columns) const {
  const int m = to_int(rows_ - panel.first), n = to_int(columns), k = to_int(panel.width), ld = to_int(rows_),
            ld_t = to_int(panel.ld_t);
  std::vector<double> work(columns * panel.width);
  dlarfb_("L", &transpose, "F", "C", &m, &n, &k, panel.values.get() + panel.first, &ld, panel.T.data(), &ld_t, Y + panel.first,
          &ld, work.data(), &n);
}

std::size_t BlockedQr::independent(const Panel& panel) const {
  for (std::size_t j = 0; j < panel.width; ++j) {
    // Reflections keep the length of a column.
    const double* column = panel.values.get() + j * rows_;
    const std::size_t diagonal = panel.first + j;
    double square = 0;
    for (std::size_t i = 0; i <= diagonal; ++i) square += column[i] * column[i];
    if (!(std::abs(column[diagonal]) > least_share * std::sqrt(square))) return j;
  }
  return panel.width;
}

std::size_t BlockedQr::append(std::size_t columns, const std::function<void(double*)>& fill, const RunContext& context) {
  if (columns == 0) return 0;
  lapack::use_one_thread();
  Panel panel{columns_, columns, std::make_unique_for_overwrite<double[]>(rows_ * columns),
              std::vector<double>(columns * columns), columns};
  fill(panel.values.get());
  // Left-looking: a few columns through all earlier reflectors at a time, the same few on any number of threads.
  const std::size_t chunk = std::max<std::size_t>(8, (columns + 3) / 4);
  parallel_for(context, columns, chunk, [&](std::size_t begin, std::size_t end) {
    for (const Panel& earlier : panels_) {
      context.check();
      reflect(earlier, 'T', panel.values.get() + begin * rows_, end - begin);
    }
  });
  const int m = to_int(rows_ - columns_), n = to_int(columns), ld = to_int(rows_);
  int info = 0;
  dgeqrt3_(&m, &n, panel.values.get() + columns_, &ld, panel.T.data(), &n, &info);
  const std::size_t taken = independent(panel);
  panel.width = taken;
  columns_ += taken;
  if (taken > 0) panels_.push_back(std::move(panel));
  return taken;
}

void BlockedQr::apply_transposed(std::size_t panel, Eigen::MatrixXd& Y) const {
  lapack::use_one_thread();
  reflect(panels_[panel], 'T', Y.data(), static_cast<std::size_t>(Y.cols()));
}

void BlockedQr::apply(std::size_t panels, Eigen::MatrixXd& Y) const {
  lapack::use_one_thread();
  for (std::size_t p = panels; p > 0; --p) reflect(panels_[p - 1], 'N', Y.data(), static_cast<std::size_t>(Y.cols()));
}

void BlockedQr::solve(std::size_t columns, Eigen::MatrixXd& Y) const {
  lapack::use_one_thread();
  const int n = to_int(static_cast<std::size_t>(Y.cols())), ld = to_int(rows_), ld_y = to_int(static_cast<std::size_t>(Y.rows()));
  for (std::size_t p = panels_.size(); p > 0; --p) {
    const Panel& panel = panels_[p - 1];
    if (panel.first >= columns) continue;
    const int w = to_int(std::min(panel.width, columns - panel.first)), above = to_int(panel.first);
    double* part = Y.data() + panel.first;
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, w, n, 1.0, panel.values.get() + panel.first, ld,
                part, ld_y);
    if (above > 0) {
      cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, above, n, w, -1.0, panel.values.get(), ld, part, ld_y, 1.0, Y.data(),
                  ld_y);
    }
  }
}

void BlockedQr::solve_transposed(std::size_t columns, Eigen::MatrixXd& Y) const {
  lapack::use_one_thread();
  const int n = to_int(static_cast<std::size_t>(Y.cols())), ld = to_int(rows_), ld_y = to_int(static_cast<std::size_t>(Y.rows()));
  for (const Panel& panel : panels_) {
    if (panel.first >= columns) break;
    const int w = to_int(std::min(panel.width, columns - panel.first)), above = to_int(panel.first);
    double* part = Y.data() + panel.first;
    if (above > 0) {
      cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, w, n, above, -1.0, panel.values.get(), ld, Y.data(), ld_y, 1.0, part,
                  ld_y);
    }
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasTrans, CblasNonUnit, w, n, 1.0, panel.values.get() + panel.first, ld,
                part, ld_y);
  }
}

}  // namespace deform
