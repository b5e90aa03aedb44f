// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/lattice/spline_axis.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include "core/base/error.h"

namespace deform {

namespace {

constexpr std::size_t cubic = 3;

void check_points(LatticeBasis basis, std::size_t points) {
  const bool bernstein = basis == LatticeBasis::bernstein;
  if (bernstein ? points >= 2 && points <= SplineAxis::most_bernstein_points : points >= SplineAxis::least_points) return;
  throw Error(ErrorCode::invalid_argument,
              "a lattice with " + std::to_string(points) + " points along an axis: " +
                  (bernstein ? "a Bernstein basis takes 2 to " + std::to_string(SplineAxis::most_bernstein_points)
                             : "cubic splines take at least " + std::to_string(SplineAxis::least_points)));
}

}  // namespace

SplineAxis::SplineAxis(LatticeBasis basis, std::size_t points)
    : points_(points), degree_(basis == LatticeBasis::bernstein ? points - 1 : cubic) {
  check_points(basis, points);
  const auto spans = static_cast<double>(points_ - degree_);
  for (std::size_t k = 0; k < points_ + degree_ + 1; ++k) {
    const double knot = (static_cast<double>(k) - static_cast<double>(degree_)) / spans;
    knots_.push_back(basis == LatticeBasis::uniform_cubic ? knot : std::clamp(knot, 0.0, 1.0));
  }
}

double SplineAxis::greville(std::size_t i) const {
  double sum = 0;
  for (std::size_t k = 1; k <= degree_; ++k) sum += knots_[i + k];
  return sum / static_cast<double>(degree_);
}

std::size_t SplineAxis::span(double u) const {
  const double at = std::floor(u * static_cast<double>(spans()));
  return at <= 0 ? 0 : std::min(spans() - 1, static_cast<std::size_t>(at));
}

/// Values of the splines of a lower degree, raised by the recurrence of the derivatives.
void SplineAxis::evaluate(std::size_t span, double u, std::size_t derivative, double* out) const {
  const double* const t = knots_.data() + span + degree_;  // t[0] <= u <= t[1]
  std::fill_n(out, order(), 0.0);
  if (derivative > degree_) return;
  const std::size_t low = degree_ - derivative;
  out[0] = 1;
  std::array<double, most_order> left{}, right{};
  for (std::size_t q = 1; q <= low; ++q) {
    left[q] = u - t[1 - static_cast<std::ptrdiff_t>(q)];
    right[q] = t[q] - u;
    double saved = 0;
    for (std::size_t r = 0; r < q; ++r) {
      const double part = out[r] / (right[r + 1] + left[q - r]);
      out[r] = saved + right[r + 1] * part;
      saved = left[q - r] * part;
    }
    out[q] = saved;
  }
  // The functions that begin at t[-q] .. t[0] have degree q.
  for (std::size_t q = low + 1; q <= degree_; ++q) {
    double before = 0;  // of the function of degree q - 1 that begins at the same knot, over its width
    for (std::size_t r = 0; r <= q; ++r) {
      const auto begin = static_cast<std::ptrdiff_t>(r) - static_cast<std::ptrdiff_t>(q);
      double next = 0;
      if (r < q) next = out[r] / (t[begin + 1 + static_cast<std::ptrdiff_t>(q)] - t[begin + 1]);
      out[r] = static_cast<double>(q) * (before - next);
      before = next;
    }
  }
}

GaussRule gauss_rule(std::size_t count) {
  GaussRule rule;
  const auto n = static_cast<long double>(count);
  for (std::size_t i = 0; i < count; ++i) {
    // Newton's method on the Legendre polynomial from the usual approximation of its roots.
    long double x = -std::cos(std::numbers::pi_v<long double> * (static_cast<long double>(i) + 0.75L) / (n + 0.5L));
    long double slope = 1;
    for (int step = 0; step < 100; ++step) {
      long double before = 1, value = x;
      for (std::size_t k = 2; k <= count; ++k) {
        const auto order = static_cast<long double>(k);
        const long double next = ((2 * order - 1) * x * value - (order - 1) * before) / order;
        before = value;
        value = next;
      }
      slope = n * (x * value - before) / (x * x - 1);
      const long double change = value / slope;
      x -= change;
      if (std::abs(change) < 1e-18L) break;
    }
    rule.nodes.push_back(static_cast<double>((1 + x) / 2));
    rule.weights.push_back(static_cast<double>(1 / ((1 - x * x) * slope * slope)));
  }
  return rule;
}

Eigen::MatrixXd SplineAxis::gram(std::size_t p, std::size_t q) const {
  const auto n = static_cast<Eigen::Index>(points_);
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(n, n);
  const GaussRule rule = gauss_rule(order());
  const double width = 1 / static_cast<double>(spans());
  std::array<double, most_order> a{}, b{};
  for (std::size_t s = 0; s < spans(); ++s) {
    for (std::size_t g = 0; g < rule.nodes.size(); ++g) {
      const double u = (static_cast<double>(s) + rule.nodes[g]) * width;
      evaluate(s, u, p, a.data());
      evaluate(s, u, q, b.data());
      for (std::size_t i = 0; i < order(); ++i) {
        for (std::size_t j = 0; j < order(); ++j) {
          G(static_cast<Eigen::Index>(s + i), static_cast<Eigen::Index>(s + j)) += width * rule.weights[g] * a[i] * b[j];
        }
      }
    }
  }
  return G;
}

}  // namespace deform
