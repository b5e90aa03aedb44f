// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/numerics/sparse/function_rows.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// The functions that a deformation is made of and what they cost (thesis 8.2 to 8.4): the displacement of point i is
/// d_i = sum_j values(i, j) w_j with w_j in R^3, its energy the sum of w^T K w over the three coordinates. Everything is in unit
/// coordinates: model coordinates divided by the diagonal D of the mesh, so that weights mean the same for every unit of length.
struct EnergySpace {
  SparseRows values;  ///< n x k at all points of the mesh, columns ascending in each row; empty when they are computed
  std::shared_ptr<const ComputedRows> computed;  ///< the values, or null when they are stored
  SparseMatrix energy;  ///< K, k x k, lower triangle: gamma_s G^T G + gamma_b L^T L, positive semidefinite
  SparseMatrix linear;  ///< k x 4: w that reproduce 1, x, y, z (unit coordinates, no shift) where the space does; else k x 0
  std::vector<std::string> notes;
  std::size_t samples = 0, cubature_points = 0;

  /// The values; a view.
  FunctionRows functions() const { return computed != nullptr ? FunctionRows(*computed) : FunctionRows(values); }
  /// Of what the values take.
  std::size_t value_bytes() const;
};

/// A space, and how the held (handle and fixed) points enter: those of `held` only, the others have no influence.
///  - eliminated: the functions are zero at held points; w minimizes w^T K w + 2 w^T coupling h with the prescribed displacements
///    h (m x 3) of the held points.
///  - otherwise the functions live at held points too, and coupling is empty.
struct EnergyModel {
  EnergySpace space;
  std::vector<PointId> held;  ///< m, ascending
  bool eliminated = false;
  SparseMatrix coupling;   ///< k x m
  bool may_crack = false;  ///< coincident held points may go to different places
  bool of_shell = false;   ///< the energy is that of a shell: parts of it do not turn with the handles
};

/// Copies nothing, unlike a move: Eigen's sparse matrices have none.
void swap(EnergyModel& a, EnergyModel& b);

}  // namespace deform
