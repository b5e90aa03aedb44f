// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/deformers/handles/symmetry.h"
#include "core/deformers/rbf/centres.h"
#include "core/deformers/setup.h"
#include "core/numerics/interpolation/interpolator.h"
#include "core/numerics/interpolation/point_errors.h"

namespace deform {

/// The components of the displacement that share an interpolation problem; without symmetry planes all three. With planes the
/// displacement u of the whole model satisfies u(R x) = R u(x) for every reflection R, so that in the frame of the planes the
/// normal component of plane k is odd in coordinate k, and all other parities are even. Each parity that occurs is an
/// interpolation problem on the half model: with a kernel summed over the images (dense solvers; a centre on plane k is left out
/// of the odd problem), or with all images as centres and mirrored data (the iterative solver, which needs a radial function).
struct PartPlan {
  /// One row of a system: a centre, the planes (bits) in which it is reflected, and the factor of its values: 0 for the odd
  /// component of a centre on the plane.
  struct Row {
    std::uint32_t centre = 0;
    unsigned reflected = 0;
    double sign = 1;
  };
  std::vector<std::size_t> components;  ///< 0..2, in the frame of the planes
  Parity parity;                        ///< parity of the kernel; none for the iterative solver
  std::vector<Row> rows;                ///< empty if every centre occurs once, in order
  std::size_t size = 0;                 ///< number of rows of the system

  /// The right-hand side, size x columns, from values at the centres (m x columns).
  Eigen::MatrixXd data(const Eigen::MatrixXd& values) const;
  /// The positions of the rows, from the coordinates of the centres in the frame of the planes.
  std::vector<Vec3> places(const std::vector<Vec3>& centres) const;
};

/// The parts in order: the one that is even in all coordinates, then the normal components. Problems without rows (all centres
/// lie on the plane) are left out; their components are zero.
std::vector<PartPlan> plan_parts(const Symmetry& symmetry, const RbfCentres& centres, Solver solver);

/// Notes on the numbers of points and centres on each plane.
std::vector<std::string> symmetry_notes(const Symmetry& symmetry, const RbfCentres& centres);

/// The tolerance of derivatives, as a fraction of their largest value, independent of the setup.
inline constexpr double derivative_tolerance = 1e-11;

/// A prepared part. With the iterative solver all parts share one system.
struct RbfPart {
  PartPlan plan;
  std::shared_ptr<const Interpolator> system;
  std::shared_ptr<const PointErrors> check;  ///< for solvers that work to a tolerance
};

}  // namespace deform
