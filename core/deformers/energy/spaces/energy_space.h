// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/deformers/handles/motion_warnings.h"
#include "core/deformers/handles/space_functions.h"
#include "core/numerics/sparse/function_rows.h"
#include "core/numerics/sparse/sparse.h"

namespace deform {

/// The functions that span the deformations, and their energy (thesis 8.2 to 8.4): the displacement of point i is d_i = sum_j
/// values(i, j) w_j with w_j in R^3, and the energy is the sum of w^T K w over the three coordinates. All quantities are in
/// unit coordinates, that is model coordinates divided by the diagonal D of the mesh, so that weights do not depend on the unit
/// of length.
struct EnergySpace {
  SparseRows values;  ///< n x k at all points of the mesh, columns ascending in each row; empty if computed
  std::shared_ptr<const ComputedRows> computed;  ///< the values if they are computed, else null
  /// The functions at any place; null if they are defined at the points of the mesh only, for the reason `only_on_mesh`.
  std::shared_ptr<const SpaceFunctions> in_space;
  std::string only_on_mesh;
  SparseMatrix energy;  ///< K, k x k, lower triangle: gamma_s G^T G + gamma_b L^T L, positive semidefinite
  SparseMatrix linear;  ///< k x 4: the w that reproduce 1, x, y, z (coordinates of unit_box()), or k x 0 if the space does not
  std::vector<std::string> notes;
  std::size_t samples = 0, cubature_points = 0;

  /// A view of the values.
  FunctionRows functions() const { return computed != nullptr ? FunctionRows(*computed) : FunctionRows(values); }
  /// The memory of the values in bytes.
  std::size_t value_bytes() const;
};

/// A space with its held points, that is the handle and fixed points that enter the system; the others have no influence.
///  - eliminated: the functions are zero at held points, and w minimizes w^T K w + 2 w^T coupling h with the prescribed
///    displacements h (m x 3) of the held points.
///  - otherwise: the functions are nonzero at held points too, and `coupling` is empty.
struct EnergyModel {
  EnergySpace space;
  std::vector<PointId> held;  ///< m, ascending
  bool eliminated = false;
  SparseMatrix coupling;   ///< k x m
  bool may_crack = false;  ///< whether coincident held points may separate
  SharedMotions motions{};
};

/// Swaps without copying; moving would copy, because Eigen's sparse matrices cannot be moved.
void swap(EnergyModel& a, EnergyModel& b);

}  // namespace deform
