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

/// The components of the displacement that are interpolated alike. Without symmetry planes all three. With them the displacement
/// u of the whole model obeys u(R x) = R u(x) for every reflection R, so that in the frame of the planes the component along the
/// normal of plane k is odd in coordinate k, and all else is even. Each parity that occurs is an interpolation problem of its own
/// on the half model: with a kernel that has the images (dense solvers; a centre on plane k is none of the odd problem), or with
/// all images as centres and the data mirrored (the iterative solver, which needs a function of the distance).
struct PartPlan {
  /// One row of a system: a centre, the planes (bits) that it is reflected in, and what its values are multiplied with: 0 for the
  /// odd component of a centre on the plane.
  struct Row {
    std::uint32_t centre = 0;
    unsigned reflected = 0;
    double sign = 1;
  };
  std::vector<std::size_t> components;  ///< 0..2, in the frame of the planes
  Parity parity;                        ///< of the kernel; none for the iterative solver
  std::vector<Row> rows;                ///< empty: every centre once, in order
  std::size_t size = 0;                 ///< rows of the system

  /// size x columns from values at the centres (m x columns).
  Eigen::MatrixXd data(const Eigen::MatrixXd& values) const;
  /// Where its rows are, from the coordinates of the centres in the frame.
  std::vector<Vec3> places(const std::vector<Vec3>& centres) const;
};

/// In order: what is even everywhere, then the components along the normals. Problems without a row (everything lies on the
/// plane) are left out; their components are zero.
std::vector<PartPlan> plan_parts(const Symmetry& symmetry, const RbfCentres& centres, Solver solver);

/// How many points and centres each plane holds.
std::vector<std::string> symmetry_notes(const Symmetry& symmetry, const RbfCentres& centres);

/// Derivatives are solved to this share of their largest value, whatever the tolerance of the setup.
inline constexpr double derivative_tolerance = 1e-11;

/// A prepared part. The parts of the iterative solver share one system.
struct RbfPart {
  PartPlan plan;
  std::shared_ptr<const Interpolator> system;
  std::shared_ptr<const PointErrors> check;  ///< of solvers to a tolerance
};

}  // namespace deform
