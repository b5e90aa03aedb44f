#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/constraint.h"
#include "core/deformers/handles/symmetry.h"
#include "core/mesh/region.h"
#include "core/numerics/interpolation/solver.h"
#include "core/numerics/kernels/kernel.h"

namespace deform {

/// Of RbfOptions::tolerance and Design::tolerance.
inline constexpr double least_tolerance = 1e-10, largest_tolerance = 1e-2;

enum class CentreReduction {
  automatic,  ///< the constraint points within `reduction_rings` of the deformable region, where the mesh is manifold there
  off,        ///< all constraint points
};

enum class BasisMode {
  automatic,  ///< store the handle basis when there are handles and it is not larger than max(4 x the factor, 1 GiB)
  always,
  never,  ///< every design goes through the factorization and kernel sums
};

/// RBF deformation (thesis 3.5, 4.2). Lengths in model units.
struct RbfOptions {
  Kernel kernel = Kernel::triharmonic;
  /// s of the kernels that have one, as a fraction of the bounding-box diagonal of the centres; larger is smoother and worse
  /// conditioned. Ignored by r, r^3, r^5. 0 = automatic_shape() of kernel.h, else 0 < shape <= 100.
  double shape = 0;
  /// Total degree of the polynomial part; -1 = max(1, order - 1). At least order - 1, at most 2.
  int polynomial_degree = -1;
  Solver solver = Solver::automatic;
  /// Of the iterative solver: largest error at the centres. Of incremental QR: RMS error at the constraint points, for the
  /// samples; in wide gaps between the constraint points the field is off by some ten times that. As a fraction of D;
  /// 1e-10..1e-2.
  double tolerance = 1e-6;
  CentreOrder centre_order = CentreOrder::farthest_point;  ///< of incremental QR
  /// Of incremental QR: vectors of design variables whose displacements its centres are chosen for; empty: affine motions of the
  /// handles, of the size of the model.
  std::vector<std::vector<double>> samples;
  CentreReduction reduction = CentreReduction::automatic;
  int reduction_rings = 3;  ///< 1..100 (thesis 3.5: three rings fix positions and first and second derivatives)
  BasisMode basis = BasisMode::automatic;
};

/// How handles and fixed points hold the energy methods below.
enum class HandleMode {
  hard,  ///< exactly: by elimination (shell), by multipliers and an interpolated correction (the others)
  soft,  ///< least squares with the weight `fixing` (thesis eq. 8.8)
};

/// Thin shell on the faces of the mesh (thesis 3.1, 8.2): least gamma_s |grad d|^2 + gamma_b |laplace d|^2 integrated over the
/// surface in coordinates divided by D, so that weights do not depend on units. Every point must be a corner of a face.
struct ShellOptions {
  double stretching = 0;  ///< gamma_s, 0..1e12
  double bending = 1;     ///< gamma_b, 0..1e12; not both 0
  HandleMode handles = HandleMode::hard;
  /// gamma_f of soft handles, over 0 up to 1e12: weight of the mean square misfit of each handle, and of the fixed points.
  double fixing = 1000;
  BasisMode basis = BasisMode::automatic;
};

/// The functions of a subspace (thesis 8.3).
enum class SubspaceKernel { triharmonic, biharmonic, wendland_c2, gaussian, mls };

/// The energy of the shell over few functions in space around centres on the surface (thesis 8.3, eq. 8.11).
struct SubspaceOptions {
  SubspaceKernel kernel = SubspaceKernel::mls;
  std::size_t centres = 1000;  ///< 4..100000
  double cover = 8;            ///< s: centres whose function reaches a point, 4..1000; of the kernels with a support
  double stretching = 0, bending = 1;
  HandleMode handles = HandleMode::hard;
  double fixing = 1000;
  BasisMode basis = BasisMode::automatic;
};

/// Moving least squares in space with energies integrated over the volume (thesis 8.4). Works for every kind of mesh.
struct MlsOptions {
  std::size_t surface_samples = 0, volume_samples = 0;  ///< 0 = automatic; at most 1,000,000 each
  double cubature = 4;                                  ///< integration points per sample, 1..64
  double cover = 12;                                    ///< s: samples that reach a point, 5..1000
  double stretching = 0, bending = 1;                   ///< as for the shell
  HandleMode handles = HandleMode::hard;
  double fixing = 1000;
  BasisMode basis = BasisMode::automatic;
  /// Other weights where a region is: at the integration points whose nearest point of the mesh belongs to it; of several the
  /// last counts.
  struct Weights {
    Region region;
    double stretching = 0, bending = 1;
  };
  std::vector<Weights> weights;
};

/// A region with a name, moved by the user.
struct Handle {
  std::string name;
  Region region;
};

/// A named scalar that moves a handle; 0 is the rest position.
struct DesignVariable {
  struct Translate {  ///< x' = x + v direction
    Vec3 direction{};
  };
  struct Rotate {  ///< by v radians about the axis through the centre, right-handed; the axis need not be of unit length
    Vec3 axis{}, centre{};
  };
  struct Scale {  ///< x' = centre + (1 + v)(x - centre); with an axis (not zero) only along it
    Vec3 centre{}, axis{};
  };
  std::string name;
  std::string handle;
  std::variant<Translate, Rotate, Scale> kind;
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
};

/// A geometric property that a deformation keeps or takes on (thesis 8.5). For the energy methods, not for RBF.
struct Constraint {
  std::string name;  ///< of its own, like those of handles
  std::vector<Region> regions;
  ConstraintKind kind;
  /// gamma_c, the weight of the mean square distance of its points (in units of D) from the shape; up to 1e10. 0 =
  /// automatic_weight.
  double weight = 0;
  static constexpr double automatic_weight = 1e7;
  /// In the end its points are put on the shape exactly, together with all other exact ones, and what is around them follows
  /// smoothly. Points of handles and fixed regions stay where they are told to be: a shape that cannot take them in is reported
  /// by the distances that are left.
  bool exact = false;
};

/// Of ConstraintOptions::iterations.
inline constexpr int most_constraint_iterations = 1000000;

/// How constraints are solved for.
struct ConstraintOptions {
  double tolerance = 1e-7;  ///< rms distance of the constrained points from the solution, as a fraction of D; 1e-12..1e-2
  int iterations = 3000;    ///< at most, of a design; 1..1,000,000. A design that needs more is reported as not converged.
};

/// What a system is prepared from, besides the mesh. Several variables of one handle compose in their order here (the first acts
/// first).
struct Setup {
  std::variant<RbfOptions, ShellOptions, SubspaceOptions, MlsOptions> method;
  std::vector<Handle> handles;
  std::vector<Region> fixed;
  std::vector<DesignVariable> variables;
  std::uint64_t seed = 0;
  std::vector<SymmetryPlane> symmetry;  ///< at most 3, orthogonal to each other; their points slide in them
  std::vector<Constraint> constraints;
  ConstraintOptions constraint_options;
};

/// The regions of a setup on one mesh.
struct SelectedRegions {
  std::vector<std::vector<PointId>> handles;  ///< per handle, sorted, not empty, disjoint
  std::vector<PointId> fixed;                 ///< sorted, disjoint from all handles; may be empty
  Symmetry symmetry;
  std::vector<std::vector<std::vector<PointId>>> constraints;  ///< per constraint and region, sorted, not empty
};

/// Checks everything that can be checked without numerics and selects the regions. Throws Error(invalid_argument) naming the
/// field: no handle, repeated or empty names, empty region, a point in two handles or in a handle and a fixed region (with the
/// count and the first id), unknown handle of a variable (with the nearest names), lower > upper or 0 outside of them, zero axis
/// or direction, non-finite numbers, options out of range, constraints without a name, with the wrong number of regions, a weight
/// or layers out of range, layers of a mesh without cells, and what Symmetry throws.
SelectedRegions validate(const Setup& setup, const Mesh& mesh);

/// The affine motion of every handle for a vector of variable values (size = setup.variables.size()). Values beside
/// a bound count as the bound, see core/base/bounds.h. Throws Error(invalid_argument): wrong length, non-finite value, value
/// outside its bounds (both named).
std::vector<Affine> handle_motions(const Setup& setup, std::span<const double> variables);

/// d(motion of every handle) / d(variable k), as 3 x 4 matrices per handle: exact derivative at `variables`, so a rotation is
/// linearised at the current design. Handles that variable k does not move get zeros.
std::vector<Affine> handle_motion_derivative(const Setup& setup, std::span<const double> variables, std::size_t k);

/// Whether or not there are constraints. Throws Error(invalid_argument) naming the field ("constraint_options.tolerance"), its
/// value and the limits.
void validate_constraint_options(const ConstraintOptions& options);

}  // namespace deform
