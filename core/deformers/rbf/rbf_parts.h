// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/deformers/handles/symmetry.h"
#include "core/deformers/rbf/centres.h"
#include "core/deformers/setup.h"
#include "core/numerics/interpolation/cyclic_interpolator.h"
#include "core/numerics/interpolation/point_errors.h"

namespace deform {

/// The components of the displacement that share an interpolation problem; without symmetry planes all three. With planes the
/// displacement u of the whole model satisfies u(R x) = R u(x) for every reflection R, so that in the frame of the planes the
/// normal component of plane k is odd in coordinate k, and all other parities are even. Each parity that occurs is an
/// interpolation problem on the half model: with a kernel summed over the images (dense solvers; a centre on plane k is left out
/// of the odd problem), or with all images as centres and mirrored data (the iterative solver, which needs a radial function).
///
/// With a sector u(R x) = R u(x) for the turn R by one sector. All images of all centres are rows: k turns send the axial
/// component of a centre to itself, and a vector v across the axis to cos(k theta) v + sin(k theta) J v, where J turns by a right
/// angle. So there are three parts: the axial component; both others, with data times the cosine; and those of J v, with data
/// times the sine, which is added (`turned`). Dense solvers factor one harmonic each, see CyclicInterpolator.
struct PartPlan {
  /// One row of a system: a centre, the planes (bits) in which it is reflected or the number of turns, and the factor of its
  /// values: 0 for the odd component of a centre on the plane, and across the axis for one on it.
  struct Row {
    std::uint32_t centre = 0;
    unsigned image = 0;
    double sign = 1;
  };
  std::vector<std::size_t> components;  ///< 0..2, in the frame of the planes or of the axis
  Parity parity;                        ///< parity of the kernel; none for the iterative solver
  std::vector<Row> rows;                ///< empty if every centre occurs once, in order
  std::size_t size = 0;                 ///< number of rows of the system
  std::optional<CyclicRows> cyclic{};   ///< with a sector and a dense solver: the system is a CyclicInterpolator
  bool turned = false;                  ///< with a sector: whether the values are those of vectors turned by a right angle

  /// Whether it has the same system as another part, which stands before it.
  bool shares(const PartPlan& other, Solver solver) const;
  /// A displacement, in the frame, as this part takes it: unchanged or turned.
  Vec3 taken(const Vec3& u) const { return turned ? Vec3{0, -u[2], u[1]} : u; }
  /// The transpose.
  Vec3 given_back(const Vec3& u) const { return turned ? Vec3{0, u[2], -u[1]} : u; }

  /// The right-hand side, size x columns, from values at the centres (m x columns).
  Eigen::MatrixXd data(const Eigen::MatrixXd& values) const;
  /// The positions of the rows, from the coordinates of the centres in the frame of the planes or of the axis.
  std::vector<Vec3> places(const std::vector<Vec3>& centres, const Symmetry& symmetry) const;
  /// Upper bounds of the memory of its system and of the peak while it is prepared or used.
  std::size_t system_bytes(Solver solver) const;
  std::size_t system_peak_bytes(Solver solver) const;
};

/// The solver for so many centres, one of a sector's system being complex.
Solver solver_for(const RbfOptions& options, const Symmetry& symmetry, std::size_t centres);

/// Replaces centres on the second of two periodic boundaries by their partners on the first.
void merge_partners(const Symmetry& symmetry, const ConstraintPoints& points, RbfCentres& centres);

/// The parts in order: the one that is even in all coordinates, then the normal components. Problems without rows (all centres
/// lie on the plane) are left out; their components are zero.
std::vector<PartPlan> plan_parts(const Symmetry& symmetry, const RbfCentres& centres, Solver solver);

/// Notes on the numbers of points and centres on each plane, or of partners and points on the axis of a sector.
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
