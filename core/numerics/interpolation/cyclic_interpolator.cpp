// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/cyclic_interpolator.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/numerics/dense/decompositions.h"
#include "core/numerics/dense/lapack.h"
#include "core/numerics/interpolation/value_errors.h"
#include "core/numerics/kernels/residual.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

namespace {

using Eigen::MatrixXcd;
using Eigen::MatrixXd;

/// An orthonormal basis of the range of a projection, as columns.
MatrixXcd range_of(MatrixXcd A) {
  constexpr double nothing = 1e-6;
  MatrixXcd Q(A.rows(), 0);
  for (Eigen::Index step = 0; step < A.cols(); ++step) {
    Eigen::Index pivot = 0;
    const double largest = A.colwise().norm().maxCoeff(&pivot);
    if (!(largest > nothing)) break;
    const Eigen::VectorXcd q = A.col(pivot) / largest;
    Q.conservativeResize(Eigen::NoChange, Q.cols() + 1);
    Q.col(Q.cols() - 1) = q;
    for (int twice = 0; twice < 2; ++twice) A -= q * (q.adjoint() * A);
  }
  return Q;
}

/// The lower triangle, column after column, moved to the front in place.
template <typename Number>
void pack_lower(std::size_t n, std::vector<Number>& values) {
  std::size_t to = 0;
  for (std::size_t j = 0; j < n; ++j) {
    for (std::size_t i = j; i < n; ++i) values[to++] = values[j * n + i];
  }
  values.resize(to);
  values.shrink_to_fit();
}

std::size_t system_bytes(std::size_t unknowns, bool real) {
  const std::size_t n = unknowns + PolynomialSpace::most_terms;
  return n * n * (real ? sizeof(double) : sizeof(std::complex<double>));
}

}  // namespace

CyclicInterpolator::CyclicInterpolator(std::vector<Vec3> centres, CyclicRows rows, const InterpolationOptions& options,
                                       const RunContext& context)
    : Interpolator(std::move(centres), options.kernel, options.polynomial_degree), rows_(std::move(rows)) {
  for (std::uint32_t b = 0; b < rows_.orbits(); ++b) {
    representatives_.push_back(rows_.first[b]);
    if (rows_.harmonic != 0 && rows_.size(b) == 1) continue;
    used_.push_back(b);
    places_.push_back(centres_[rows_.first[b]]);
  }
  find_polynomials();
  factor(context);
}

std::size_t CyclicInterpolator::bytes() const {
  return real_.size() * sizeof(double) + complex_.size() * sizeof(Complex) + centres_.size() * sizeof(Vec3) +
         places_.size() * (sizeof(Vec3) + sizeof(int) + 2 * sizeof(std::uint32_t)) +
         static_cast<std::size_t>(F_.size()) * sizeof(Complex) + rows_.first.size() * sizeof(std::uint32_t);
}

std::size_t CyclicInterpolator::bytes_for(std::size_t orbits, std::size_t rows, const CyclicRows& of) {
  const bool real = of.harmonic == 0 || of.images == 2;
  return system_bytes(orbits, real) / 2 + system_bytes(0, false) + rows * sizeof(Vec3) + orbits * 256 + 4096;
}

std::size_t CyclicInterpolator::peak_bytes(std::size_t orbits, std::size_t rows, const CyclicRows& of) {
  const bool real = of.harmonic == 0 || of.images == 2;
  // The matrix and what it is copied from, and the polynomials of all rows with their decomposition.
  return system_bytes(orbits, real) + system_bytes(orbits, false) +
         64 * (orbits + PolynomialSpace::most_terms) * sizeof(Complex) + 4 * rows * PolynomialSpace::most_terms * sizeof(double) +
         (std::size_t{1} << 12);
}

CyclicInterpolator::Complex CyclicInterpolator::phase(std::size_t image) const {
  if (rows_.harmonic == 0) return 1;
  if (rows_.images == 2) return image % 2 == 0 ? 1 : -1;
  const double angle = 2 * std::numbers::pi * static_cast<double>(image % rows_.images) / static_cast<double>(rows_.images);
  return {std::cos(angle), std::sin(angle)};
}

double CyclicInterpolator::repeated(std::size_t orbit) const {
  return static_cast<double>(rows_.images) / static_cast<double>(rows_.size(orbit));
}

/// T with p(R x) = p(x) T for the row of polynomials p, whose eigenvectors are the polynomials of each harmonic.
void CyclicInterpolator::find_polynomials() {
  const auto q = static_cast<Eigen::Index>(polynomials_.terms());
  polynomials_of_.resize(q, 0);
  if (q > 0) {
    const MatrixXd P = polynomials_.matrix(centres_);
    const double angle = 2 * std::numbers::pi / static_cast<double>(rows_.images);
    std::vector<Vec3> turned;
    for (const Vec3& x : centres_) {
      turned.push_back({x[0], std::cos(angle) * x[1] - std::sin(angle) * x[2], std::sin(angle) * x[1] + std::cos(angle) * x[2]});
    }
    const MatrixXd image = polynomials_.matrix(turned);
    const MatrixXd T = HouseholderQr(P).solve(image);
    // Off the centres they must repeat as well: quadratics of which some were left out may not.
    std::vector<Vec3> off, off_turned;
    for (std::size_t j = 0; j < std::min<std::size_t>(centres_.size(), 16); ++j) {
      off.push_back({1.3 * centres_[j][0], 1.3 * centres_[j][1], 1.3 * centres_[j][2]});
      off_turned.push_back({1.3 * turned[j][0], 1.3 * turned[j][1], 1.3 * turned[j][2]});
    }
    const MatrixXd there = polynomials_.matrix(off_turned);
    if (!((there - polynomials_.matrix(off) * T).cwiseAbs().maxCoeff() <= 1e-8 * there.cwiseAbs().maxCoeff())) {
      throw Error(ErrorCode::numerical_failure,
                  "the polynomials of the centres do not repeat under the rotation of the sectors; use a smaller "
                  "polynomial_degree, or another kernel");
    }
    MatrixXcd sum = MatrixXcd::Zero(q, q);
    MatrixXd power = MatrixXd::Identity(q, q);
    for (std::size_t k = 0; k < rows_.images; ++k) {
      sum += std::conj(phase(k)) * power.cast<Complex>();
      power = power * T;
    }
    polynomials_of_ = range_of(sum / static_cast<double>(rows_.images));
  }
  F_ = polynomials_.matrix(places_).cast<Complex>() * polynomials_of_;
}

void CyclicInterpolator::assemble(const RunContext& context, MatrixXcd& H) const {
  const std::size_t m = used_.size();
  const auto q = F_.cols();
  H.setZero(static_cast<Eigen::Index>(m) + q, static_cast<Eigen::Index>(m) + q);
  const TiledPoints tiled(places_);
  std::vector<Complex> phases;
  for (std::size_t k = 0; k < rows_.images; ++k) phases.push_back(phase(k));
  parallel_for(context, m, 8, [&](std::size_t begin, std::size_t end) {
    std::vector<double> block(rows_.images * tile_size);
    for (std::size_t b = begin; b < end; ++b) {
      if (b % 8 == 0) context.check();
      const std::size_t rows = rows_.size(used_[b]);
      const std::span<const Vec3> images(centres_.data() + rows_.first[used_[b]], rows);
      for (std::size_t t = b / tile_size; t < tiled.tiles(); ++t) {  // the lower triangle
        tile_kernel(kernel_, tiled.tile(t), images, block.data());
        for (std::size_t a = t * tile_size; a < std::min((t + 1) * tile_size, m); ++a) {
          Complex sum = 0;
          for (std::size_t k = 0; k < rows; ++k) sum += phases[k] * block[k * tile_size + a % tile_size];
          H(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b)) = repeated(used_[b]) * sum;
        }
      }
      H.block(static_cast<Eigen::Index>(m), static_cast<Eigen::Index>(b), q, 1) = F_.row(static_cast<Eigen::Index>(b)).adjoint();
    }
    context.progress("assemble", static_cast<double>(end) / static_cast<double>(m));
  });
}

void CyclicInterpolator::factor(const RunContext& context) {
  lapack::use_one_thread();
  const auto size = static_cast<Eigen::Index>(used_.size()) + F_.cols();
  const int n = static_cast<int>(size);
  const auto entries = static_cast<std::size_t>(size * size);
  double largest = 0;
  {
    MatrixXcd H;
    assemble(context, H);
    largest = projected_norm([&](const Eigen::VectorXcd& x) -> Eigen::VectorXcd {
      const auto m = static_cast<Eigen::Index>(used_.size());
      return H.topLeftCorner(m, m).selfadjointView<Eigen::Lower>() * x;
    });
    if (is_real()) {
      real_.resize(entries);
      Eigen::Map<MatrixXd>(real_.data(), size, size) = H.real();
    } else {
      complex_.assign(H.data(), H.data() + entries);
    }
  }
  pivots_.resize(static_cast<std::size_t>(n));
  const int lwork = 64 * n;
  int info = 0;
  context.progress("factor", 0);
  if (n > 0 && is_real()) {
    std::vector<double> work(static_cast<std::size_t>(lwork));
    dsytrf_("L", &n, real_.data(), &n, pivots_.data(), work.data(), &lwork, &info);
    pack_lower(static_cast<std::size_t>(n), real_);
  } else if (n > 0) {
    std::vector<Complex> work(static_cast<std::size_t>(lwork));
    zhetrf_("L", &n, complex_.data(), &n, pivots_.data(), work.data(), &lwork, &info);
    pack_lower(static_cast<std::size_t>(n), complex_);
  }
  if (info > 0) {
    throw Error(ErrorCode::numerical_failure, "the RBF system of the sector is singular: pivot " + std::to_string(info) +
                                                  " is zero; centres coincide or the shape parameter is too large");
  }
  context.check();
  // What the inverse does to weights of no polynomial is the inverse on the complement of the polynomials.
  condition_ = largest * projected_norm([&](const Eigen::VectorXcd& x) -> Eigen::VectorXcd {
                 context.check();
                 MatrixXcd B = MatrixXcd::Zero(size, 1);
                 B.col(0).head(x.size()) = x;
                 solve(B);
                 return B.col(0).head(x.size());
               });
  context.progress("factor", 1);
}

/// The 2-norm of a Hermitian map on the complement of the polynomials, by power iteration: a lower bound.
double CyclicInterpolator::projected_norm(const std::function<Eigen::VectorXcd(const Eigen::VectorXcd&)>& map) const {
  constexpr int steps = 12;
  const MatrixXcd Q = range_of(F_ / std::max(1.0, F_.size() > 0 ? F_.cwiseAbs().maxCoeff() : 1.0));
  Eigen::VectorXcd x(static_cast<Eigen::Index>(used_.size()));
  std::minstd_rand random;
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    x[i] = static_cast<double>(random()) / static_cast<double>(std::minstd_rand::max()) - 0.5;
  }
  double largest = 0;
  for (int step = 0; step < steps; ++step) {
    x -= Q * (Q.adjoint() * x);
    const double size = x.norm();
    if (!(size > 0)) break;
    x = map(x / size);
    x -= Q * (Q.adjoint() * x);
    largest = x.norm();
  }
  return largest;
}

void CyclicInterpolator::solve(MatrixXcd& B) const {
  const int n = static_cast<int>(B.rows()), columns = static_cast<int>(B.cols());
  if (n == 0 || columns == 0) return;
  int info = 0;
  if (is_real()) {
    MatrixXd parts = B.real();
    dsptrs_("L", &n, &columns, real_.data(), pivots_.data(), parts.data(), &n, &info);
    B = parts.cast<Complex>();
  } else {
    zhptrs_("L", &n, &columns, complex_.data(), pivots_.data(), B.data(), &n, &info);
  }
}

Eigen::MatrixXd CyclicInterpolator::expanded(const MatrixXcd& X, Complex factor) const {
  const auto rows = static_cast<Eigen::Index>(centres_.size()), m = static_cast<Eigen::Index>(used_.size());
  MatrixXd result = MatrixXd::Zero(rows + static_cast<Eigen::Index>(polynomials_.terms()), X.cols());
  for (std::size_t b = 0; b < used_.size(); ++b) {
    const std::size_t orbit = used_[b];
    for (std::size_t k = 0; k < rows_.size(orbit); ++k) {
      const Complex turn = factor * phase(k) * repeated(orbit);
      const auto row = static_cast<Eigen::Index>(rows_.first[orbit] + k);
      for (Eigen::Index c = 0; c < X.cols(); ++c) result(row, c) = (turn * X(static_cast<Eigen::Index>(b), c)).real();
    }
  }
  result.bottomRows(result.rows() - rows) = (factor * (polynomials_of_ * X.bottomRows(X.rows() - m))).real();
  return result;
}

/// As DenseInterpolator::solve_saddle().
CyclicInterpolator::Solution CyclicInterpolator::refined(const MatrixXcd& B, const RunContext& context) const {
  constexpr double enough = 1e-15, contracting = 0.5;
  using LongComplex = std::complex<long double>;
  const auto m = static_cast<Eigen::Index>(used_.size());
  const MatrixXd P = polynomials_.matrix(places_);
  const Complex i(0, 1);
  Solution solution;
  MatrixXcd& X = solution.values;
  X = B;
  solve(X);
  solution.uncertainty = MatrixXcd::Zero(X.rows(), X.cols());
  // Real and imaginary parts side by side, so that the kernel is evaluated once.
  const auto left = [&]() -> MatrixXcd {
    const Eigen::Index columns = X.cols(), parts = is_real() ? 1 : 2;
    MatrixXd all(static_cast<Eigen::Index>(centres_.size() + polynomials_.terms()), parts * columns), data(m, parts * columns);
    for (Eigen::Index part = 0; part < parts; ++part) {
      const Complex factor = part == 0 ? 1 : -i;
      all.middleCols(part * columns, columns) = expanded(X, factor);
      data.middleCols(part * columns, columns) = (factor * B.topRows(m)).real();
    }
    const MatrixXd residual = deform::accurate_residual(kernel_, places_, centres_, P, all, data, context);
    MatrixXcd result = residual.leftCols(columns).cast<Complex>();
    if (parts == 2) result += i * residual.rightCols(columns).cast<Complex>();
    return result;
  };
  double last = X.norm(), rate = 0;
  for (int step = 0; step < most_refinements && last > 0; ++step) {
    context.check();
    MatrixXcd correction(X.rows(), X.cols());
    correction.topRows(m) = left();
    const auto sides = F_.cast<LongComplex>().adjoint() * X.topRows(m).cast<LongComplex>();
    correction.bottomRows(F_.cols()) = (B.bottomRows(F_.cols()).cast<LongComplex>() - sides).cast<Complex>();
    solve(correction);
    const double size = correction.norm();
    rate = size / last;
    solution.uncertainty = std::move(correction);
    if (!(rate < contracting)) {
      solution.converged = refined_as_far_as_possible(step, size, X.norm());
      rate = contracting;
      break;
    }
    X += solution.uncertainty;
    // Accurate residuals of all images take longer than the factorization: none for a correction that is below rounding.
    if (rate * size <= enough * X.norm()) break;
    last = size;
  }
  solution.uncertainty *= rate / (1 - rate);
  if (solution.converged && properties(kernel_.kernel).has_shape) {
    MatrixXcd rounded = rounding_of_values(B, static_cast<Eigen::Index>(used_.size()));
    solve(rounded);
    solution.uncertainty += rounded;
  }
  return solution;
}

Interpolants CyclicInterpolator::interpolate(const MatrixXd& F, double /*tolerance*/, const RunContext& context) const {
  const auto m = static_cast<Eigen::Index>(used_.size());
  MatrixXcd B = MatrixXcd::Zero(m + F_.cols(), F.cols());
  for (Eigen::Index b = 0; b < m; ++b) {
    const std::size_t orbit = used_[static_cast<std::size_t>(b)], rows = rows_.size(orbit);
    const double share = (is_real() ? 1.0 : 2.0) / static_cast<double>(rows);
    for (std::size_t k = 0; k < rows; ++k) {
      B.row(b) += share * std::conj(phase(k)) * F.row(static_cast<Eigen::Index>(rows_.first[orbit] + k)).cast<Complex>();
    }
  }
  const Solution solution = refined(B, context);
  Interpolants result;
  result.coefficients = expanded(solution.values, 1);
  result.uncertainty = expanded(solution.uncertainty, 1);
  result.converged = solution.converged;
  return result;
}

/// The inverse of the system is Hermitian, so the derivatives of what interpolate() does are those of the conjugate problem.
Eigen::MatrixXd CyclicInterpolator::adjoint(MatrixXd B, const RunContext& context) const {
  const auto m = static_cast<Eigen::Index>(used_.size());
  const auto q = static_cast<Eigen::Index>(polynomials_.terms());
  MatrixXcd Z = MatrixXcd::Zero(m + F_.cols(), B.cols());
  for (Eigen::Index b = 0; b < m; ++b) {
    const std::size_t orbit = used_[static_cast<std::size_t>(b)];
    for (std::size_t k = 0; k < rows_.size(orbit); ++k) {
      Z.row(b) += repeated(orbit) * phase(k) * B.row(static_cast<Eigen::Index>(rows_.first[orbit] + k)).cast<Complex>();
    }
  }
  Z.bottomRows(F_.cols()) = polynomials_of_.transpose() * B.bottomRows(q).cast<Complex>();
  const MatrixXcd G = refined(Z.conjugate(), context).values.conjugate();
  MatrixXd result = MatrixXd::Zero(static_cast<Eigen::Index>(centres_.size()), B.cols());
  for (Eigen::Index b = 0; b < m; ++b) {
    const std::size_t orbit = used_[static_cast<std::size_t>(b)], rows = rows_.size(orbit);
    const double share = (is_real() ? 1.0 : 2.0) / static_cast<double>(rows);
    for (std::size_t k = 0; k < rows; ++k) {
      result.row(static_cast<Eigen::Index>(rows_.first[orbit] + k)) = share * (std::conj(phase(k)) * G.row(b)).real();
    }
  }
  return result;
}

}  // namespace deform
