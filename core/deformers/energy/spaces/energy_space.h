#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/numerics/sparse/sparse.h"

namespace deform {

/// The functions that a deformation is made of and what they cost (thesis 8.2 to 8.4): the displacement of point i is
/// d_i = sum_j values(i, j) w_j with w_j in R^3, its energy the sum of w^T K w over the three coordinates. Everything is in unit
/// coordinates: model coordinates divided by the diagonal D of the mesh, so that weights mean the same for every unit of length.
struct EnergySpace {
  SparseRows values;    ///< n x k at all points of the mesh, columns ascending in each row
  SparseMatrix energy;  ///< K, k x k, lower triangle: gamma_s G^T G + gamma_b L^T L, positive semidefinite
  SparseMatrix linear;  ///< k x 4: w that reproduce 1, x, y, z (unit coordinates, no shift) where the space does; else k x 0
  std::vector<std::string> notes;
  std::size_t samples = 0, cubature_points = 0;
};

}  // namespace deform
