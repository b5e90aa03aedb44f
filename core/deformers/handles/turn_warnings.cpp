// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/turn_warnings.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

constexpr double largest_turn = 15;  // degrees: beyond, a shell that keeps its energy linear loses more than its details

/// By how many degrees an affine map turns: of the orthogonal part of its polar decomposition, but for a reflection.
double turn_of(const Affine& map) {
  Eigen::Matrix3d A;
  A << map[0], map[1], map[2], map[4], map[5], map[6], map[8], map[9], map[10];
  auto [values, U, V] = svd(A);
  if ((U * V.transpose()).determinant() < 0) U.col(2) *= -1;
  const double cosine = 0.5 * ((U * V.transpose()).trace() - 1);
  return std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / std::numbers::pi;
}

}  // namespace

void add_turn_warnings(const Setup& setup, const BoundDesign& design, DesignReport& report) {
  for (std::size_t h = 0; h < setup.handles.size(); ++h) {
    if (!design.displacement[h].empty()) continue;
    const double turn = turn_of(design.affine[h]);
    if (turn <= largest_turn) continue;
    char degrees[32];
    std::snprintf(degrees, sizeof degrees, "%.0f", turn);
    report.warnings.push_back("handle \"" + setup.handles[h].name + "\" turns by " + degrees +
                              " degrees: the energy of the shell is linear, so that what is between the handles does "
                              "not turn with them but shears and swells; mls and rbf follow turns of all handles");
  }
}

}  // namespace deform
