// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/interpolation/schwarz.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "core/base/parallel.h"
#include "core/numerics/dense/decompositions.h"
#include "core/numerics/interpolation/dense_interpolator.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// A subset's own centres, and how many of its neighbours' go with them.
constexpr std::size_t most_own = 400;
constexpr std::size_t overlap_percent = 200;
// Coarse centres: a number in all that a dense factorization takes in a second, but a few per subset.
constexpr std::size_t coarse_in_all = 3600;
constexpr std::size_t least_per_domain = 4, most_per_domain = 400;
// Order of the sums between the two stages: a preconditioner needs few digits.
constexpr int coarse_order = 8;

std::size_t per_domain(std::size_t domains) {
  return std::clamp(coarse_in_all / std::max<std::size_t>(domains, 1), least_per_domain, most_per_domain);
}

double squared(double x) { return x * x; }

double squared_distance(const Vec3& a, const Vec3& b) {
  return squared(a[0] - b[0]) + squared(a[1] - b[1]) + squared(a[2] - b[2]);
}

/// To a box, 0 inside.
double squared_distance(const Vec3& p, const Box& box) {
  double sum = 0;
  for (std::size_t k = 0; k < 3; ++k) sum += squared(std::max({box.min[k] - p[k], 0.0, p[k] - box.max[k]}));
  return sum;
}

}  // namespace

SchwarzPreconditioner::SchwarzPreconditioner(const RadialKernel& kernel, std::span<const Vec3> centres, int polynomial_degree,
                                             const RunContext& context)
    : kernel_(kernel), degree_(polynomial_degree) {
  const PolynomialSpace space(centres, degree_);
  if (space.terms() > 0) {
    Q_ = HouseholderQr(space.matrix(centres)).leading_q(static_cast<Index>(space.terms()));
  } else {
    Q_.resize(static_cast<Index>(centres.size()), 0);
  }
  partition(centres);
  choose_coarse(centres);
  std::vector<Vec3> coarse;
  for (const std::uint32_t id : coarse_ids_) coarse.push_back(centres[id]);
  coarse_ = factor(coarse, coarse_terms_, context);
  if (properties(kernel_.kernel).smooth) {
    to_coarse_ = std::make_unique<FastSums>(kernel_, coarse, centres, FastSums::Options{coarse_order, 0});
  } else {
    all_places_.assign(centres.begin(), centres.end());
    coarse_places_ = std::move(coarse);
  }
  std::atomic<std::size_t> done{0};
  parallel_for(context, domains_.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t d = begin; d < end; ++d) {
      overlap(domains_[d], centres);
      std::vector<Vec3> places;
      for (const std::uint32_t id : domains_[d].ids) places.push_back(centres[id]);
      domains_[d].factor = factor(places, domains_[d].terms, RunContext());
    }
    context.progress("factor", static_cast<double>(done += end - begin) / static_cast<double>(domains_.size()));
  });
}

/// Halves at the median of the longest axis until the parts are small.
void SchwarzPreconditioner::partition(std::span<const Vec3> centres) {
  std::vector<std::vector<std::uint32_t>> parts(1, std::vector<std::uint32_t>(centres.size()));
  std::iota(parts[0].begin(), parts[0].end(), 0u);
  while (!parts.empty()) {
    std::vector<std::uint32_t> part = std::move(parts.back());
    parts.pop_back();
    if (part.size() <= most_own) {
      std::sort(part.begin(), part.end());
      Domain domain;
      domain.own = part.size();
      domain.ids = std::move(part);
      domains_.push_back(std::move(domain));
      continue;
    }
    Box box;
    for (const std::uint32_t id : part) box.add(centres[id]);
    std::size_t axis = 0;
    for (std::size_t k = 1; k < 3; ++k) {
      if (box.max[k] - box.min[k] > box.max[axis] - box.min[axis]) axis = k;
    }
    const auto middle = part.begin() + static_cast<std::ptrdiff_t>(part.size() / 2);
    std::nth_element(part.begin(), middle, part.end(), [&](std::uint32_t a, std::uint32_t b) {
      return centres[a][axis] != centres[b][axis] ? centres[a][axis] < centres[b][axis] : a < b;
    });
    parts.emplace_back(middle, part.end());
    part.erase(middle, part.end());
    parts.push_back(std::move(part));
  }
}

/// Adds the centres nearest to the domain's box.
void SchwarzPreconditioner::overlap(Domain& domain, std::span<const Vec3> centres) const {
  Box box;
  for (const std::uint32_t id : domain.ids) box.add(centres[id]);
  std::vector<std::pair<double, std::uint32_t>> others;
  const std::size_t wanted = std::min(centres.size() - domain.own, domain.own * overlap_percent / 100);
  auto own = domain.ids.begin();
  for (std::uint32_t id = 0; id < centres.size(); ++id) {
    if (own != domain.ids.end() && *own == id) {
      ++own;
    } else {
      others.emplace_back(squared_distance(centres[id], box), id);
    }
  }
  std::nth_element(others.begin(), others.begin() + static_cast<std::ptrdiff_t>(wanted), others.end());
  others.resize(wanted);
  std::sort(others.begin(), others.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  for (const auto& other : others) domain.ids.push_back(other.second);
}

std::unique_ptr<SaddleFactor> SchwarzPreconditioner::factor(std::span<const Vec3> centres, std::size_t& terms,
                                                            const RunContext& context) const {
  const PolynomialSpace polynomials(centres, degree_);
  terms = polynomials.terms();
  const SaddleProblem problem{kernel_, centres, polynomials};
  if (auto cholesky = factor_cholesky(problem, context)) return cholesky;
  return factor_ldlt(problem, context);
}

/// A few centres of every domain, each the farthest from those before it.
void SchwarzPreconditioner::choose_coarse(std::span<const Vec3> centres) {
  const std::size_t count = per_domain(domains_.size());
  for (const Domain& domain : domains_) {
    std::vector<double> distance(domain.own, std::numeric_limits<double>::infinity());
    std::size_t next = 0;
    for (std::size_t k = 0; k < std::min(count, domain.own); ++k) {
      const Vec3& chosen = centres[domain.ids[next]];
      coarse_ids_.push_back(domain.ids[next]);
      for (std::size_t i = 0; i < domain.own; ++i) {
        distance[i] = std::min(distance[i], squared_distance(centres[domain.ids[i]], chosen));
      }
      next = static_cast<std::size_t>(std::max_element(distance.begin(), distance.end()) - distance.begin());
    }
  }
}

void SchwarzPreconditioner::project(MatrixXd& weights) const {
  if (Q_.cols() > 0) weights -= Q_ * (Q_.transpose() * weights);
}

MatrixXd SchwarzPreconditioner::apply(const MatrixXd& values, const RunContext& context) const {
  MatrixXd weights = MatrixXd::Zero(values.rows(), values.cols());
  parallel_for(context, domains_.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t d = begin; d < end; ++d) {
      const Domain& domain = domains_[d];
      MatrixXd B = MatrixXd::Zero(static_cast<Index>(domain.ids.size() + domain.terms), values.cols());
      for (std::size_t i = 0; i < domain.ids.size(); ++i) B.row(static_cast<Index>(i)) = values.row(domain.ids[i]);
      domain.factor->solve(B);
      for (std::size_t i = 0; i < domain.own; ++i) weights.row(domain.ids[i]) = B.row(static_cast<Index>(i));
    }
  });
  project(weights);

  const RowMajor rows = weights;
  const std::span<const double> all(rows.data(), static_cast<std::size_t>(rows.size()));
  const auto columns = static_cast<std::size_t>(rows.cols());
  const std::vector<double> sums = to_coarse_ ? to_coarse_->sums(all, columns, context)
                                              : kernel_sums(kernel_, coarse_places_, all_places_, all, columns, context);
  MatrixXd B = MatrixXd::Zero(static_cast<Index>(coarse_ids_.size() + coarse_terms_), values.cols());
  for (std::size_t i = 0; i < coarse_ids_.size(); ++i) {
    for (Index c = 0; c < values.cols(); ++c) {
      B(static_cast<Index>(i), c) =
          values(coarse_ids_[i], c) - sums[i * static_cast<std::size_t>(values.cols()) + static_cast<std::size_t>(c)];
    }
  }
  coarse_->solve(B);
  for (std::size_t i = 0; i < coarse_ids_.size(); ++i) weights.row(coarse_ids_[i]) += B.row(static_cast<Index>(i));
  return weights;
}

std::size_t SchwarzPreconditioner::bytes() const {
  std::size_t bytes = static_cast<std::size_t>(Q_.size()) * sizeof(double) + coarse_->bytes() +
                      (to_coarse_ ? to_coarse_->bytes() : 0) + (all_places_.size() + coarse_places_.size()) * sizeof(Vec3);
  for (const Domain& domain : domains_) bytes += domain.factor->bytes() + domain.ids.size() * sizeof(std::uint32_t);
  return bytes;
}

std::size_t SchwarzPreconditioner::bytes_for(std::size_t m) {
  // Halving leaves between most_own / 2 and most_own centres in a domain.
  const std::size_t domains = 2 * m / most_own + 1;
  const std::size_t size = std::min(m, most_own + most_own * overlap_percent / 100);
  const std::size_t coarse = std::min(m, std::max(coarse_in_all, domains * least_per_domain));
  // Domains are half full where there are twice as many: the sum of squares is largest where they are full.
  return (m / most_own + 1) * DenseInterpolator::bytes_for(size, Solver::cholesky) +
         DenseInterpolator::bytes_for(coarse, Solver::cholesky) + m * 10 * sizeof(double) +
         FastSums::bytes_for(coarse, m, coarse_order);
}

}  // namespace deform
