// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/deformers/energy/spaces/energy_space.h"
#include "core/mesh/mesh.h"
#include "core/mesh/operators/shell_operators.h"
#include "tests/core/deformers/space_cases.h"

namespace deform::test {

using Eigen::VectorXd;

/// The shell on the mesh (thesis eq. 8.10) as a space whose functions are those of the points.
inline EnergySpace mesh_space(const Mesh& mesh, double stretching, double bending) {
  const ShellOperators shell = shell_operators(mesh, bounding_box(mesh.points).diagonal());
  const Eigen::Index n = shell.areas.size();
  SparseMatrix inverse_areas(n, n), identity(n, n);
  identity.setIdentity();
  inverse_areas.setIdentity();
  for (Eigen::Index i = 0; i < n; ++i) inverse_areas.coeffRef(i, i) = 1 / shell.areas[i];
  EnergySpace space;
  space.values = identity;
  const SparseMatrix whole =
      -stretching * shell.laplacian + bending * SparseMatrix(shell.laplacian * inverse_areas * shell.laplacian);
  space.energy = whole.triangularView<Eigen::Lower>();
  return space;
}

/// What is held, and where to.
struct Held {
  std::vector<PointId> points;
  VectorXd prescribed;
};

/// The plane is fixed at both ends and lifted by 0.2 in the middle: a strip across it, or a disc while the whole rim is fixed.
enum class Lifted { strip, disc };
inline Held lift(const Mesh& mesh, Lifted lifted) {
  const Box box = bounding_box(mesh.points);
  std::vector<double> values;
  Held held;
  for (PointId i = 0; i < mesh.points.size(); ++i) {
    const double x = mesh.points[i][0], y = mesh.points[i][1] - box.max[1] / 2;
    const bool handle = lifted == Lifted::strip ? std::abs(x - 0.5) < 0.1 : std::hypot(x - 0.5, y) < 0.1;
    const double to_rim = std::min({x, 1 - x, lifted == Lifted::strip ? 1.0 : box.max[1] / 2 - std::abs(y)});
    if (!handle && to_rim > (lifted == Lifted::strip ? 0.1 : 0.06)) continue;
    held.points.push_back(i);
    values.push_back(handle ? 0.2 / box.diagonal() : 0);
  }
  held.prescribed = Eigen::Map<VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
  return held;
}

/// Over the lift.
inline VectorXd solution(const EnergySpace& space, const Held& held) {
  return least_energy(space, held.points, held.prescribed) / held.prescribed.maxCoeff();
}

}  // namespace deform::test
