// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "core/base/problems.h"
#include "core/base/types.h"
#include "core/constraints/constraint.h"
#include "core/deformers/handles/symmetry.h"
#include "core/mesh/region.h"
#include "core/numerics/interpolation/solver.h"
#include "core/numerics/kernels/kernel.h"
#include "core/numerics/lattice/lattice_options.h"
#include "core/numerics/motion/variable_motion.h"

namespace deform {

/// Limits of RbfOptions::tolerance and Design::tolerance.
inline constexpr double least_tolerance = 1e-10, largest_tolerance = 1e-2;

/// Which constraint points become centres of an RBF.
enum class CentreReduction {
  /// All up to 5,000 constraint points. Of more as many, dense at the deformable region and the sparser the farther away, as it
  /// takes to meet the affine motions of the handles at all of them, see RbfOptions::reduction_tolerance.
  tolerance,
  rings,  ///< the constraint points within `reduction_rings` of the deformable region, where the mesh is manifold there
  off,    ///< all constraint points
};

/// Whether the handle basis is stored.
enum class BasisMode {
  automatic,  ///< store the handle basis when there are handles and it is not larger than max(4 x the factor, 1 GiB)
  always,     ///< store it whatever it takes
  never,      ///< every design goes through the factorization and kernel sums
};

/// Of RbfOptions::reduction_tolerance: where it was seen to change the deformable region by less than 1e-2 of the largest
/// displacement. What constraint points are missed by is multiplied there by up to sixty with r^3, and divided by three with r.
constexpr double default_reduction_tolerance(Kernel kernel) { return kernel == Kernel::biharmonic ? 1e-3 : 1e-4; }

/// Of RbfOptions::tolerance.
constexpr double default_tolerance(Solver solver) { return solver == Solver::incremental_qr ? 1e-4 : 1e-6; }

/// RBF deformation (thesis 3.5, 4.2). Lengths in model units.
struct RbfOptions {
  std::optional<Kernel> kernel = std::nullopt;  ///< radial kernel; none: default_kernel() of the mesh
  /// s of the kernels that have one, as a fraction of the bounding-box diagonal of the centres; larger is smoother and worse
  /// conditioned. Ignored by r, r^3, r^5. 0 = automatic_shape() of kernel.h, else 0 < shape <= 100.
  double shape = 0;
  /// Total degree of the polynomial part; -1 = max(1, order - 1). At least order - 1, at most 2.
  int polynomial_degree = -1;
  Solver solver = Solver::automatic;  ///< of the interpolation system
  /// Of the iterative solver: largest error at the points that follow. Of incremental QR: RMS error at the constraint points, for
  /// the samples; in wide gaps between the constraint points the field is off by some ten times that. As a fraction of D;
  /// 1e-10..1e-2, 0 = default_tolerance().
  double tolerance = 0;
  CentreOrder centre_order = CentreOrder::farthest_point;  ///< of incremental QR
  /// Of incremental QR: vectors of design variables whose displacements its centres are chosen for; empty: affine motions of the
  /// handles, of the size of the model.
  std::vector<std::vector<double>> samples{};
  CentreReduction reduction = CentreReduction::tolerance;  ///< which constraint points become centres
  int reduction_rings = 3;  ///< 1..100 (thesis 3.5: three rings fix positions and first and second derivatives)
  /// Largest misfit of an affine motion of a handle at a constraint point, as a fraction of the largest displacement that the
  /// motion prescribes; 1e-8..0.1, 0 = default_reduction_tolerance().
  double reduction_tolerance = 0;
  BasisMode basis = BasisMode::automatic;  ///< of the affine motions of the handles
  /// Of the stored basis: the largest error that it may add to a design whose handles move by D and turn by one radian, as a
  /// fraction of D; 1e-12..1e-3. 0: it is stored in doubles.
  double basis_tolerance = 0;
};

/// How handles and fixed points hold the energy methods below.
enum class HandleMode {
  hard,  ///< exactly: by elimination (shell), by multipliers and an interpolated correction (the others)
  soft,  ///< least squares with the weight `fixing` (thesis eq. 8.8)
};

/// What the energy methods have in common: least gamma_s |grad d|^2 + gamma_b |laplace d|^2, integrated in coordinates divided by
/// D, so that weights do not depend on units.
struct EnergyOptions {
  double stretching = 0;                  ///< gamma_s, 0..1e12
  double bending = 1;                     ///< gamma_b, 0..1e12; not both 0
  HandleMode handles = HandleMode::hard;  ///< whether prescribed positions are met exactly
  /// gamma_f of soft handles, over 0 up to 1e12: weight of the mean square misfit of each handle, and of the fixed points.
  double fixing = 1000;
  BasisMode basis = BasisMode::automatic;  ///< of the affine motions of the handles
  double basis_tolerance = 0;              ///< of the stored basis, as RbfOptions::basis_tolerance
};

/// Thin shell on the faces of the mesh (thesis 3.1, 8.2). Every point must be a corner of a face.
struct ShellOptions : EnergyOptions {};

/// Of SubspaceOptions::cover. Kernels that decay need more than moving least squares (thesis 8.3.2).
double default_cover(const std::optional<Kernel>& kernel);

/// Whether 1, x, y and z, which have no energy then, are functions of a subspace besides those of a kernel that decays.
enum class SubspaceLinear {
  left_out,  ///< thesis 8.3.2: where all handles move affinely, the other points are off by up to several tenths of D
  added,
};

/// The energy of the shell over few functions in space around centres on the surface (thesis 8.3, eq. 8.11).
struct SubspaceOptions : EnergyOptions {
  SubspaceLinear linear = SubspaceLinear::added;  ///< of kernels that decay; the others have them or cannot
  /// The functions: none are those of moving least squares (thesis 8.3.3); else a kernel without a shape (8.3.1) or one that
  /// decays (8.3.2), see KernelProperties::local_shape.
  std::optional<Kernel> kernel = std::nullopt;
  std::size_t centres = 1000;  ///< 4..100000
  /// s: centres whose function reaches a point, 4..1000, 0 = default_cover(kernel); of the kernels with a support.
  double cover = 0;
};

/// The body that moving least squares integrate energies over. A mesh with cells is what they fill, in any case.
enum class MlsDomain {
  surface,   ///< the faces alone; with volume_samples the box around them
  enclosed,  ///< what the faces enclose; where they do not, as with `surface`
};

/// Of MlsOptions::cover: as many as it takes for samples to be enough, see docs/methods/mls.md.
constexpr double default_cover(MlsDomain domain) { return domain == MlsDomain::enclosed ? 20 : 12; }

/// Moving least squares in space with energies integrated over the volume (thesis 8.4). Works for every kind of mesh.
struct MlsOptions : EnergyOptions {
  MlsDomain domain = MlsDomain::enclosed;  ///< what energies are integrated over
  std::size_t surface_samples = 0;         ///< 0 = automatic; at most 1,000,000
  std::size_t volume_samples = 0;          ///< 0 = automatic; at most 1,000,000
  double cubature = 4;                     ///< integration points per sample, 1..64
  double cover = 0;                        ///< s: samples that reach a point, 5..1000, 0 = default_cover(domain)
  /// Other weights where a region is: at the integration points whose nearest point of the mesh belongs to it; of several the
  /// last counts.
  struct Weights {
    Region region;          ///< where
    double stretching = 0;  ///< gamma_s there
    double bending = 1;     ///< gamma_b there
  };
  std::vector<Weights> weights;  ///< in the order in which they count
};

/// What decides about the control points of free-form deformation.
enum class FfdControl {
  energy,  ///< the least energy, integrated over the whole lattice, of the fields that meet handles and constraints
  /// Direct manipulation (thesis 3.3): least squares at the handle and fixed points, and of what these leave open the least
  /// motion of the control points, by a singular value decomposition whose small values are left out.
  mesh,
  /// Handles and fixed regions select control points, which go where the handles send them; all other control points stay. Points
  /// outside of the lattice stay, too.
  controls,
};

/// Free-form deformation (thesis 3.2, 3.3): a displacement field that control points around the model span.
struct FfdOptions : EnergyOptions {
  /// Must hold every point that is not fixed, unless control is FfdControl::controls. Moved control points: not with
  /// FfdControl::energy.
  LatticeOptions lattice;
  FfdControl control = FfdControl::energy;  ///< what decides about the control points
  /// Of FfdControl::mesh: singular values up to this fraction of the largest one are left out, 1e-15..0.5; 0 = at the corner of
  /// the L-curve, see ClampedInverse.
  double clamp = 0;
};

/// What decides about the vertices of a cage.
enum class CageControl {
  controls,  ///< handles and fixed regions select vertices, which go where the handles send them; all others stay
  mesh,      ///< direct manipulation, as FfdControl::mesh
};

/// Cage-based deformation (thesis 3.4): a point goes by the mean of the displacements of the vertices of a cage, with its mean
/// value coordinates in the cage.
struct CageOptions {
  std::vector<Vec3> vertices;                           ///< of the cage, model units; see Cage
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< of the cage
  CageControl control = CageControl::controls;          ///< what decides about the vertices
  double clamp = 0;                                     ///< of CageControl::mesh, as FfdOptions::clamp
  BasisMode basis = BasisMode::automatic;               ///< of the affine motions of the handles
  double basis_tolerance = 0;                           ///< of the stored basis, as RbfOptions::basis_tolerance
};

/// A region with a name, moved by the user.
struct Handle {
  std::string name;  ///< not empty, unlike those of other handles
  Region region;     ///< its points, or control points
};

/// Another handle that a design variable moves.
struct DrivenHandle {
  std::string handle;   ///< its name
  VariableMotion kind;  ///< how
};

/// A named scalar that moves handles; 0 is the rest position.
struct DesignVariable {
  using Translate = Translation;                            ///< along a direction
  using Rotate = Rotation;                                  ///< about an axis
  using Scale = Scaling;                                    ///< from a centre
  std::string name;                                         ///< not empty, unlike those of other variables
  std::string handle;                                       ///< name of the handle that it moves
  VariableMotion kind;                                      ///< how
  double lower = -std::numeric_limits<double>::infinity();  ///< least value, at most 0
  double upper = std::numeric_limits<double>::infinity();   ///< greatest value, at least 0
  std::vector<DrivenHandle> also{};                         ///< other handles that it moves at the same time, each once
};

/// A geometric property that a deformation keeps or takes on (thesis 8.5). For the energy methods, not for RBF.
struct Constraint {
  std::string name;             ///< of its own, like those of handles
  std::vector<Region> regions;  ///< as many as the kind takes
  ConstraintKind kind;          ///< what is kept
  /// gamma_c, the weight of the mean square distance of its points (in units of D) from the shape; up to 1e10. 0 =
  /// automatic_weight.
  double weight = 0;
  static constexpr double automatic_weight = 1e7;  ///< what a weight of 0 means
  /// In the end its points are put on the shape exactly, together with all other exact ones, and what is around them follows
  /// smoothly. Points of handles and fixed regions stay where the design puts them: a shape that cannot take them in is reported
  /// by the distances that are left.
  bool exact = false;
};

/// Limit of ConstraintOptions::iterations.
inline constexpr int most_constraint_iterations = 1000000;

/// How constraints are solved for.
struct ConstraintOptions {
  double tolerance = 1e-7;  ///< rms distance of the constrained points from the solution, as a fraction of D; 1e-12..1e-2
  int iterations = 3000;    ///< at most, of a design; 1..1,000,000. A design that needs more is reported as not converged.
};

/// What a system is prepared from, besides the mesh. Several variables that move one handle compose in their order here (the
/// first acts first).
struct Setup {
  std::variant<RbfOptions, ShellOptions, SubspaceOptions, MlsOptions, FfdOptions, CageOptions>
      method;                             ///< of one method (methods.h)
  std::vector<Handle> handles;            ///< at least one; disjoint
  std::vector<Region> fixed;              ///< whose points stay; disjoint from the handles
  std::vector<DesignVariable> variables;  ///< what designs are made of
  std::uint64_t seed = 0;                 ///< of every random choice
  std::vector<SymmetryPlane> symmetry;    ///< at most 3, orthogonal to each other; their points slide in them
  std::vector<Constraint> constraints;    ///< not with RBF
  ConstraintOptions constraint_options;   ///< how constraints are solved for
};

/// The regions of a setup on one mesh.
struct SelectedRegions {
  std::vector<std::vector<PointId>> handles;                   ///< per handle, sorted, not empty, disjoint
  std::vector<PointId> fixed;                                  ///< sorted, disjoint from all handles; may be empty
  Symmetry symmetry;                                           ///< the planes, as they were found
  std::vector<std::vector<std::vector<PointId>>> constraints;  ///< per constraint and region, sorted, not empty
  /// What handles and fixed regions select: control points where the method says so, see FfdControl::controls.
  enum class Of { mesh_points, control_points };
  Of of = Of::mesh_points;  ///< one for all handles and fixed regions
};

/// Checks everything that can be checked without numerics and selects the regions. Throws Error(invalid_argument) naming the
/// field: no handle, repeated or empty names, empty region, a point in two handles or in a handle and a fixed region (with the
/// count and the first id), unknown handle of a variable (with the nearest names) or one that it moves twice, lower > upper or 0
/// outside of them, zero axis or direction, non-finite numbers, options out of range, constraints without a name, with the wrong
/// number of regions, a weight or layers out of range, layers of a mesh without cells, and what Symmetry throws.
SelectedRegions validate(const Setup& setup, const Mesh& mesh);

/// The same, with what is found going to `problems`. Collecting, it goes on with the next entry, whose regions are empty where
/// they cannot be selected; entries that `problems` knows already are not looked at. Of the options of a method only the first
/// problem is found.
SelectedRegions validate(const Setup& setup, const Mesh& mesh, Problems& problems);

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
