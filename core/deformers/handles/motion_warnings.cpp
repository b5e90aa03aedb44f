// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/motion_warnings.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "core/base/vectors.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

constexpr double largest_turn = 15;   // degrees: beyond, a method that does not follow turns loses more than details
constexpr double rounding = 1e-12;    // of a covariance, over a size and a coordinate
constexpr double least_width = 1e-8;  // second singular value of a covariance over the first: less is a line

double degrees(double cosine) { return std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / std::numbers::pi; }

/// By how many degrees the rotation turns that is nearest to a matrix, without its reflection. No singular value beyond `noise`:
/// by none.
double turn_of(const Eigen::Matrix3d& A, double noise) {
  auto [values, U, V] = svd(A);
  if (values[0] <= noise) return 0;
  if (values[1] <= least_width * values[0]) return degrees(U.col(0).dot(V.col(0)));
  if ((U * V.transpose()).determinant() < 0) U.col(2) *= -1;
  return degrees(0.5 * ((U * V.transpose()).trace() - 1));
}

double turn_of(const Affine& map) {
  Eigen::Matrix3d A;
  A << map[0], map[1], map[2], map[4], map[5], map[6], map[8], map[9], map[10];
  return turn_of(A, 0);
}

/// The same of the rotation that fits displacements best.
double turn_of(const Mesh& mesh, std::span<const PointId> ids, std::span<const Vec3> displacements) {
  Vec3 middle{}, moved{};
  const double share = 1 / static_cast<double>(ids.size());
  for (std::size_t i = 0; i < ids.size(); ++i) {
    middle = middle + share * mesh.points[ids[i]];
    moved = moved + share * displacements[i];
  }
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  double size = 0, coordinate = norm(middle) + norm(moved);
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const Vec3 x = mesh.points[ids[i]] - middle, y = x + displacements[i] - moved;
    for (Eigen::Index k = 0; k < 3; ++k) {
      for (Eigen::Index l = 0; l < 3; ++l) {
        covariance(k, l) += share * y[static_cast<std::size_t>(k)] * x[static_cast<std::size_t>(l)];
      }
    }
    size = std::max(size, norm(x));
    coordinate = std::max(coordinate, norm(y));
  }
  return turn_of(covariance, rounding * size * (size + coordinate));
}

std::string consequence(Turns turns) {
  if (turns == Turns::of_shell) {
    return "the energy of the shell is linear, so that what is between the handles does not turn with them but shears and "
           "swells; "
           "mls and rbf follow turns of all handles";
  }
  return "stretching measures turns like strains, so that what is between the handles does not turn with them but shears and "
         "swells; with a `stretching` far below `bending`, or 0, turns of all handles are followed";
}

constexpr const char* missed_motions =
    "the functions of the subspace do not contain 1, x, y and z (LINEAR_LEFT_OUT): where all handles move alike, points between "
    "them do not, and may be several tenths of the diagonal off; take LINEAR_ADDED, kernel SUBSPACE_MLS or more centres";

}  // namespace

void add_motion_warnings(const HeldPoints& held, const SharedMotions& motions, const BoundDesign& design, DesignReport& report) {
  const std::size_t handles = held.setup.handles.size();
  bool moves = false;
  for (std::size_t h = 0; h < handles; ++h) moves = moves || design.moves(h);
  if (motions.missed && moves) report.warnings.push_back(missed_motions);
  for (std::size_t h = 0; h < handles && motions.turns != Turns::followed; ++h) {
    const std::vector<Vec3>& displacements = design.displacement[h];
    const double turn =
        displacements.empty() ? turn_of(design.affine[h]) : turn_of(held.mesh, held.regions.handles[h], displacements);
    if (turn <= largest_turn) continue;
    char text[32];
    std::snprintf(text, sizeof text, "%.0f", turn);
    report.warnings.push_back("handle \"" + held.setup.handles[h].name + "\" turns by " + text + " degrees" +
                              (displacements.empty() ? "" : ", as its displacements tell") + ": " + consequence(motions.turns));
  }
}

}  // namespace deform
