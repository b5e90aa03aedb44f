// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/core/deformers/dense_interpolant.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "core/numerics/kernels/kernel.h"
#include "tests/core/deformers/wide.h"

extern "C" {
void dgetrf_(const int* m, const int* n, double* a, const int* lda, int* pivots, int* info);
void dgetrs_(const char* trans, const int* n, const int* columns, const double* a, const int* lda, const int* pivots, double* b,
             const int* ldb, int* info);
}

namespace deform::test {

DenseInterpolant::DenseInterpolant(Problem problem) : problem_(std::move(problem)) {
  const auto& centres = problem_.centres;
  Box box;
  for (const WideVec& c : centres) box.add({c[0].hi, c[1].hi, c[2].hi});
  for (std::size_t k = 0; k < 3; ++k) origin_[k] = 0.5 * (box.min[k] + box.max[k]);
  // A power of two: dividing by it is exact.
  unit_ = std::exp2(std::round(std::log2(std::max(box.diagonal(), 1e-300))));
  for (const WideVec& c : centres) places_.push_back(place(c));
  size_ = centres.size() + monomials({}).size();
  matrix_.resize(size_ * size_);
  for (std::size_t i = 0; i < places_.size(); ++i) {
    for (std::size_t j = 0; j <= i; ++j) at(i, j) = at(j, i) = phi(places_[i] - places_[j]);
    const std::vector<Wide> terms = monomials(places_[i]);
    for (std::size_t t = 0; t < terms.size(); ++t) at(i, places_.size() + t) = at(places_.size() + t, i) = terms[t];
  }
}

bool DenseInterpolant::solve(const std::vector<WideVec>& data) {
  right_.assign(size_, {});
  std::copy(data.begin(), data.end(), right_.begin());
  for (int stage = stage_; stage < 3; ++stage) {
    if (stage == 1 && size_ > 2500) continue;
    if (stage == 2 && size_ > 800) continue;
    if (stage != factored_) factor(stage);
    if (refine(stage)) {
      stage_ = stage;  // of further data, too
      return true;
    }
  }
  return false;
}

WideVec DenseInterpolant::value(const WideVec& x) const {
  const WideVec y = place(x);
  WideVec sum{};
  for (std::size_t j = 0; j < places_.size(); ++j) {
    const Wide value = phi(y - places_[j]);
    for (std::size_t k = 0; k < 3; ++k) sum[k] += value * solution_[j][k];
  }
  const std::vector<Wide> terms = monomials(y);
  for (std::size_t t = 0; t < terms.size(); ++t) {
    for (std::size_t k = 0; k < 3; ++k) sum[k] += terms[t] * solution_[places_.size() + t][k];
  }
  return sum;
}

WideVec DenseInterpolant::place(const WideVec& x) const {
  WideVec y = x - wide(origin_);
  for (Wide& value : y) value = {value.hi / unit_, value.lo / unit_};
  return y;
}

Wide DenseInterpolant::phi(const WideVec& between) const {
  const Wide square = dot(between, between);
  const Wide e{problem_.shape.hi / unit_, problem_.shape.lo / unit_};
  switch (problem_.kernel) {
    case Kernel::triharmonic:
      return square * sqrt(square);
    case Kernel::biharmonic:
      return sqrt(square);
    case Kernel::quintic:
      return square * square * sqrt(square);
    case Kernel::gaussian:
      return exp(-(square / (e * e)));
    case Kernel::multiquadric:
      return sqrt(Wide(1) + square / (e * e));
    case Kernel::inverse_multiquadric:
      return Wide(1) / sqrt(Wide(1) + square / (e * e));
    case Kernel::wendland_c2: {
      const Wide x = sqrt(square) / e, left = Wide(1) - x;
      if (left.hi <= 0) return {};
      return left * left * left * left * (Wide(4) * x + Wide(1));
    }
    case Kernel::thin_plate:
      return square.hi > 0 ? square * log(square) * Wide(0.5) : Wide();
  }
  return {};
}

std::vector<Wide> DenseInterpolant::monomials(const WideVec& x) const {
  std::vector<Wide> all{1};
  const std::size_t width = problem_.flat ? 2 : 3;
  for (std::size_t k = 0; k < width && problem_.degree >= 1; ++k) all.push_back(x[k]);
  for (std::size_t k = 0; k < width && problem_.degree >= 2; ++k) {
    for (std::size_t l = k; l < width; ++l) all.push_back(x[k] * x[l]);
  }
  return all;
}

void DenseInterpolant::factor(int stage) {
  factored_ = stage;
  const auto n = static_cast<Eigen::Index>(size_);
  if (stage == 0) {
    doubles_.resize(size_ * size_);
    for (std::size_t i = 0; i < matrix_.size(); ++i) doubles_[i] = matrix_[i].hi;
    pivots_.resize(size_);
    const int size = static_cast<int>(size_);
    int info = 0;
    dgetrf_(&size, &size, doubles_.data(), &size, pivots_.data(), &info);
  } else if (stage == 1) {
    doubles_ = {};
    Extended A(n, n);
    for (Eigen::Index i = 0; i < n; ++i) {
      for (Eigen::Index j = 0; j < n; ++j) A(i, j) = at(static_cast<std::size_t>(i), static_cast<std::size_t>(j)).extended();
    }
    extended_.compute(A);
  } else {
    wides_ = matrix_;
    rows_.resize(size_);
    for (std::size_t i = 0; i < size_; ++i) rows_[i] = i;
    for (std::size_t k = 0; k < size_; ++k) {
      std::size_t best = k;
      for (std::size_t i = k + 1; i < size_; ++i) {
        if (std::abs(wides_[i * size_ + k].hi) > std::abs(wides_[best * size_ + k].hi)) best = i;
      }
      std::swap(rows_[k], rows_[best]);
      std::swap_ranges(&wides_[k * size_], &wides_[k * size_] + size_, &wides_[best * size_]);
      for (std::size_t i = k + 1; i < size_; ++i) {
        Wide& factor = wides_[i * size_ + k];
        factor = factor / wides_[k * size_ + k];
        for (std::size_t j = k + 1; j < size_; ++j) wides_[i * size_ + j] -= factor * wides_[k * size_ + j];
      }
    }
  }
}

std::vector<WideVec> DenseInterpolant::solved(int stage, const std::vector<WideVec>& r) const {
  std::vector<WideVec> x(size_);
  const auto n = static_cast<Eigen::Index>(size_);
  if (stage == 0) {
    Eigen::MatrixXd b(n, 3);
    for (Eigen::Index i = 0; i < n; ++i) {
      for (Eigen::Index k = 0; k < 3; ++k) b(i, k) = r[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)].hi;
    }
    const int size = static_cast<int>(size_), columns = 3;
    int info = 0;
    // The matrix is symmetric: its rows are its columns.
    dgetrs_("N", &size, &columns, doubles_.data(), &size, pivots_.data(), b.data(), &size, &info);
    for (std::size_t i = 0; i < size_; ++i) {
      for (std::size_t k = 0; k < 3; ++k) x[i][k] = b(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k));
    }
  } else if (stage == 1) {
    Extended b(n, 3);
    for (Eigen::Index i = 0; i < n; ++i) {
      for (Eigen::Index k = 0; k < 3; ++k) b(i, k) = r[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)].extended();
    }
    b = extended_.solve(b);
    for (std::size_t i = 0; i < size_; ++i) {
      for (std::size_t k = 0; k < 3; ++k) x[i][k] = Wide::of(b(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)));
    }
  } else {
    for (std::size_t i = 0; i < size_; ++i) {
      x[i] = r[rows_[i]];
      for (std::size_t j = 0; j < i; ++j) {
        for (std::size_t k = 0; k < 3; ++k) x[i][k] -= wides_[i * size_ + j] * x[j][k];
      }
    }
    for (std::size_t i = size_; i-- > 0;) {
      for (std::size_t j = i + 1; j < size_; ++j) {
        for (std::size_t k = 0; k < 3; ++k) x[i][k] -= wides_[i * size_ + j] * x[j][k];
      }
      for (std::size_t k = 0; k < 3; ++k) x[i][k] = x[i][k] / wides_[i * size_ + i];
    }
  }
  return x;
}

double DenseInterpolant::largest(const std::vector<WideVec>& x) {
  double result = 0;
  for (const WideVec& row : x) {
    for (const Wide& value : row) result = std::isfinite(value.hi) ? std::max(result, std::abs(value.hi)) : HUGE_VAL;
  }
  return result;
}

bool DenseInterpolant::refine(int stage) {
  constexpr double small_enough = 1e-26, slowest = 0.25;
  solution_.assign(size_, {});
  std::vector<WideVec> r = right_;
  double before = largest(r);
  for (int step = 0; step < 40 && before > 0; ++step) {
    const std::vector<WideVec> change = solved(stage, r);
    if (!std::isfinite(largest(change))) return false;
    for (std::size_t i = 0; i < size_; ++i) {
      for (std::size_t k = 0; k < 3; ++k) solution_[i][k] += change[i][k];
    }
    r = right_;
    double terms = 0;
    for (std::size_t i = 0; i < size_; ++i) {
      const Wide* row = &matrix_[i * size_];
      double sum = 0;
      for (std::size_t j = 0; j < size_; ++j) {
        for (std::size_t k = 0; k < 3; ++k) {
          const Wide term = row[j] * solution_[j][k];
          sum += std::abs(term.hi);
          r[i][k] -= term;
        }
      }
      terms = std::max(terms, sum);
    }
    const double left = largest(r);
    if (left <= small_enough * terms) return true;
    if (!(left <= slowest * before)) return false;
    before = left;
  }
  return before == 0;
}

}  // namespace deform::test
