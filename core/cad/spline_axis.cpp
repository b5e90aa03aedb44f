// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/spline_axis.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

namespace deform::cad {

namespace {

constexpr int first_intervals = 3;
constexpr std::size_t most_nodes = 250;
constexpr double shortest = 1.0 / 4000;  ///< of a stretch
constexpr double steepest = 2.001;       ///< ratio of neighbours

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

int SplineAxis::interval_of(double t) const {
  const auto after = std::upper_bound(nodes_.begin(), nodes_.end(), t) - nodes_.begin();
  return std::clamp(static_cast<int>(after) - 1, 0, static_cast<int>(nodes_.size()) - 2);
}

int SplineAxis::stretch_of(int interval) const {
  return static_cast<int>(std::upper_bound(first_.begin(), first_.end() - 1, interval) - first_.begin()) - 1;
}

/// Of the spline through the nodes of a stretch; the second one and the last but one are no knots.
std::vector<double> SplineAxis::stretch_knots(int stretch) const {
  const int a = first_[stretch], b = first_[stretch + 1];
  std::vector<double> knots(4, nodes_[a]);
  knots.insert(knots.end(), nodes_.begin() + a + 2, nodes_.begin() + b - 1);
  knots.insert(knots.end(), 4, nodes_[b]);
  return knots;
}

bool SplineAxis::halve(const std::set<int>& intervals) {
  if (nodes_.size() + intervals.size() > most_nodes) return false;
  for (const int k : intervals) {
    const int s = stretch_of(k);
    if (nodes_[k + 1] - nodes_[k] < shortest * (nodes_[first_[s + 1]] - nodes_[first_[s]])) return false;
  }
  std::set<int> next = intervals;
  while (!next.empty()) {
    for (auto k = next.rbegin(); k != next.rend(); ++k) {
      for (int s = stretch_of(*k) + 1; s <= stretches(); ++s) ++first_[s];
      nodes_.insert(nodes_.begin() + *k + 1, 0.5 * (nodes_[*k] + nodes_[*k + 1]));
    }
    next.clear();
    for (int s = 0; s < stretches(); ++s) {
      for (int k = first_[s]; k < first_[s + 1]; ++k) {
        const double own = nodes_[k + 1] - nodes_[k];
        if ((k > first_[s] && own > steepest * (nodes_[k] - nodes_[k - 1])) ||
            (k + 1 < first_[s + 1] && own > steepest * (nodes_[k + 2] - nodes_[k + 1]))) {
          next.insert(k);
        }
      }
    }
  }
  return true;
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
    const int m = first_[s + 1] - first_[s];
    const std::vector<double> knots = stretch_knots(s);
    Eigen::MatrixXd functions = Eigen::MatrixXd::Zero(m + 1, m + 1);
    for (int k = 0; k <= m; ++k) {
      std::array<double, 4> row;
      const int first = cubic_functions(knots, nodes_[first_[s] + k], row);
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
    const int s = stretch_of(interval_of(at[i]));
    if (s != stretch) knots = stretch_knots(s);
    stretch = s;
    std::array<double, 4> row;
    const int first = cubic_functions(knots, at[i], row);
    for (int j = 0; j < 4; ++j) values.row(static_cast<int>(i)) += row[j] * poles.row(first_[s] + first + j);
  }
  return values;
}

std::vector<double> SplineAxis::knots() const {
  std::vector<double> knots;
  for (int s = 0; s < stretches(); ++s) {
    knots.push_back(nodes_[first_[s]]);
    knots.insert(knots.end(), nodes_.begin() + first_[s] + 2, nodes_.begin() + first_[s + 1] - 1);
  }
  knots.push_back(nodes_.back());
  return knots;
}

std::vector<int> SplineAxis::multiplicities() const {
  std::vector<int> multiplicities;
  for (int s = 0; s < stretches(); ++s) {
    multiplicities.push_back(s == 0 ? 4 : 3);
    multiplicities.insert(multiplicities.end(), static_cast<std::size_t>(first_[s + 1] - first_[s] - 3), 1);
  }
  multiplicities.push_back(4);
  return multiplicities;
}

}  // namespace deform::cad
