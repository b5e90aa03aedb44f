// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/spline_axis.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace deform::cad {

namespace {

constexpr int first_intervals = 3;
constexpr std::size_t most_nodes = 250;
constexpr double shortest = 1.0 / 4000;  ///< of a stretch
constexpr double steepest = 2.001;       ///< ratio of neighbours

/// The four cubic functions that are not 0 between the middle two of eight knots (Piegl and Tiller, The NURBS Book, algorithm
/// A2.2).
void cubic_functions(const std::array<double, 8>& knots, double t, std::array<double, 4>& functions) {
  std::array<double, 4> left{}, right{};
  functions[0] = 1;
  for (int j = 1; j <= 3; ++j) {
    left[j] = t - knots[4 - j];
    right[j] = knots[3 + j] - t;
    double saved = 0;
    for (int r = 0; r < j; ++r) {
      const double part = functions[r] / (right[r + 1] + left[j - r]);
      functions[r] = saved + right[r + 1] * part;
      saved = left[j - r] * part;
    }
    functions[j] = saved;
  }
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
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> poles = values;  // whole rows are added
  for (int s = 0; s < stretches(); ++s) {
    const int size = first_[s + 1] - first_[s] + 1;
    // Row k has the functions that are not 0 at node k, from the function k - 3 on. Gaussian elimination without exchanging rows:
    // the matrix is totally positive (de Boor and Pinkus 1977).
    std::vector<std::array<double, 7>> band(static_cast<std::size_t>(size), std::array<double, 7>{});
    for (int k = 0; k < size; ++k) {
      std::array<double, 4> row;
      // The last node of a stretch is the first one of the next.
      const int first = k + 1 < size ? functions(nodes_[first_[s] + k], row) - first_[s] : size - 4;
      if (k + 1 == size) row = {0, 0, 0, 1};
      for (int j = 0; j < 4; ++j) {
        const int place = first + j - k + 3;
        if (place >= 0 && place < 7) band[k][place] = row[j];  // the others are 0
      }
    }
    auto rows = poles.middleRows(first_[s], size);
    for (int k = 0; k < size; ++k) {
      for (int i = k + 1; i < std::min(k + 4, size); ++i) {
        const double factor = band[i][k - i + 3] / band[k][3];
        if (factor == 0) continue;
        for (int j = k; j < std::min(k + 4, size); ++j) band[i][j - i + 3] -= factor * band[k][j - k + 3];
        rows.row(i) -= factor * rows.row(k);
      }
    }
    for (int k = size - 1; k >= 0; --k) {
      for (int j = k + 1; j < std::min(k + 4, size); ++j) rows.row(k) -= band[k][j - k + 3] * rows.row(j);
      rows.row(k) /= band[k][3];
    }
    // The value at a break belongs to the next stretch, too.
    if (s + 1 < stretches()) poles.row(first_[s + 1]) = values.row(first_[s + 1]);
  }
  // What several stretches share, and the ends, are values themselves.
  for (const int k : first_) poles.row(k) = values.row(k);
  return poles;
}

int SplineAxis::functions(double t, std::array<double, 4>& values) const {
  const int s = stretch_of(interval_of(t));
  // The knots around t: those of stretch_knots(s) from span - 3 to span + 4.
  const int a = first_[s], b = first_[s + 1];
  const auto knot = [&](int k) { return k < 4 ? nodes_[a] : k > b - a ? nodes_[b] : nodes_[a + k - 2]; };
  // The span begins at a knot that is a node, and neither the second node nor the last but one is a knot.
  int span = interval_of(t) - a + 2;
  span = std::clamp(span, 3, b - a);
  std::array<double, 8> around;
  for (int k = 0; k < 8; ++k) around[k] = knot(span - 3 + k);
  cubic_functions(around, t, values);
  return a + span - 3;
}

Eigen::MatrixXd SplineAxis::values(const Eigen::MatrixXd& poles, const std::vector<double>& at) const {
  Eigen::MatrixXd values = Eigen::MatrixXd::Zero(static_cast<int>(at.size()), poles.cols());
  for (std::size_t i = 0; i < at.size(); ++i) {
    std::array<double, 4> row;
    const int first = functions(at[i], row);
    for (int j = 0; j < 4; ++j) values.row(static_cast<int>(i)) += row[j] * poles.row(first + j);
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
