// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/spline_axis.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

namespace deform::cad {

namespace {

constexpr int first_intervals = 3;

/// Knots of the spline through 0, 1, ..., m: not a knot are 1 and m - 1.
std::vector<double> stretch_knots(int m) {
  std::vector<double> knots(4, 0.0);
  for (int k = 2; k <= m - 2; ++k) knots.push_back(k);
  knots.insert(knots.end(), 4, m);
  return knots;
}

/// The four cubic functions that are not 0 at t, and the number of the first (Piegl and Tiller, The NURBS Book, algorithm A2.2).
int cubic_functions(const std::vector<double>& knots, double t, std::array<double, 4>& functions) {
  const int last = static_cast<int>(knots.size()) - 5;
  int span = static_cast<int>(std::upper_bound(knots.begin(), knots.end(), t) - knots.begin()) - 1;
  span = std::clamp(span, 3, last);
  std::array<double, 4> left{}, right{};
  functions[0] = 1;
  for (int j = 1; j <= 3; ++j) {
    left[j] = t - knots[span + 1 - j];
    right[j] = knots[span + j] - t;
    double saved = 0;
    for (int r = 0; r < j; ++r) {
      const double part = functions[r] / (right[r + 1] + left[j - r]);
      functions[r] = saved + right[r + 1] * part;
      saved = left[j - r] * part;
    }
    functions[j] = saved;
  }
  return span - 3;
}

}  // namespace

SplineAxis::SplineAxis(const std::vector<double>& breaks) {
  for (std::size_t s = 0; s + 1 < breaks.size(); ++s) {
    first_.push_back(static_cast<int>(nodes_.size()));
    for (int k = 0; k < first_intervals; ++k) {
      nodes_.push_back(breaks[s] + (breaks[s + 1] - breaks[s]) * k / first_intervals);
    }
  }
  first_.push_back(static_cast<int>(nodes_.size()));
  nodes_.push_back(breaks.back());
}

int SplineAxis::stretch_of(double t) const {
  int s = 0;
  while (s + 1 < stretches() && t > nodes_[first_[s + 1]]) ++s;
  return s;
}

void SplineAxis::halve(int stretch) {
  std::vector<double> refined;
  for (int k = first_[stretch]; k < first_[stretch + 1]; ++k) {
    refined.push_back(nodes_[k]);
    refined.push_back(0.5 * (nodes_[k] + nodes_[k + 1]));
  }
  const int added = intervals(stretch);
  nodes_.erase(nodes_.begin() + first_[stretch], nodes_.begin() + first_[stretch + 1]);
  nodes_.insert(nodes_.begin() + first_[stretch], refined.begin(), refined.end());
  for (std::size_t s = static_cast<std::size_t>(stretch) + 1; s < first_.size(); ++s) first_[s] += added;
}

std::vector<double> SplineAxis::checks(double spacing) const {
  std::vector<double> at;
  const auto between = [&](const auto& self, double a, double b, int depth) -> void {
    const double middle = 0.5 * (a + b);
    const bool deeper = depth < 6 && b - a > 2 * spacing;
    if (deeper) self(self, a, middle, depth + 1);
    at.push_back(middle);
    if (deeper) self(self, middle, b, depth + 1);
  };
  for (std::size_t k = 0; k + 1 < nodes_.size(); ++k) between(between, nodes_[k], nodes_[k + 1], 0);
  return at;
}

Eigen::MatrixXd SplineAxis::poles(const Eigen::MatrixXd& values) const {
  Eigen::MatrixXd poles(values.rows(), values.cols());
  for (int s = 0; s < stretches(); ++s) {
    const int m = intervals(s);
    const std::vector<double> knots = stretch_knots(m);
    Eigen::MatrixXd functions = Eigen::MatrixXd::Zero(m + 1, m + 1);
    for (int k = 0; k <= m; ++k) {
      std::array<double, 4> row;
      const int first = cubic_functions(knots, k, row);
      for (int j = 0; j < 4; ++j) functions(k, first + j) = row[j];
    }
    poles.middleRows(first_[s], m + 1) = functions.partialPivLu().solve(values.middleRows(first_[s], m + 1));
  }
  // What several stretches share, and the ends, are values themselves.
  for (const int k : first_) poles.row(k) = values.row(k);
  return poles;
}

Eigen::MatrixXd SplineAxis::values(const Eigen::MatrixXd& poles, const std::vector<double>& at) const {
  Eigen::MatrixXd values = Eigen::MatrixXd::Zero(static_cast<int>(at.size()), poles.cols());
  int stretch = -1;
  std::vector<double> knots;
  for (std::size_t i = 0; i < at.size(); ++i) {
    const int s = stretch_of(at[i]);
    if (s != stretch) knots = stretch_knots(intervals(s));
    stretch = s;
    const double a = nodes_[first_[s]], b = nodes_[first_[s + 1]];
    std::array<double, 4> row;
    const int first = cubic_functions(knots, (at[i] - a) / (b - a) * intervals(s), row);
    for (int j = 0; j < 4; ++j) values.row(static_cast<int>(i)) += row[j] * poles.row(first_[s] + first + j);
  }
  return values;
}

std::vector<double> SplineAxis::knots() const {
  std::vector<double> knots;
  for (int s = 0; s < stretches(); ++s) {
    knots.push_back(nodes_[first_[s]]);
    for (int k = 2; k <= intervals(s) - 2; ++k) knots.push_back(nodes_[first_[s] + k]);
  }
  knots.push_back(nodes_.back());
  return knots;
}

std::vector<int> SplineAxis::multiplicities() const {
  std::vector<int> multiplicities;
  for (int s = 0; s < stretches(); ++s) {
    multiplicities.push_back(s == 0 ? 4 : 3);
    for (int k = 2; k <= intervals(s) - 2; ++k) multiplicities.push_back(1);
  }
  multiplicities.push_back(4);
  return multiplicities;
}

}  // namespace deform::cad
