// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
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

class MirroredMesh;

/// Limits of RbfOptions::tolerance and Design::tolerance.
inline constexpr double least_tolerance = 1e-10, largest_tolerance = 1e-2;

/// The rule by which constraint points (handle and fixed points) become centres of an RBF.
enum class CentreReduction {
  /// All, if there are at most 5,000 constraint points. Otherwise as many as are needed to meet the affine motions of the handles
  /// at all constraint points (see RbfOptions::reduction_tolerance), dense near the deformable region and sparser farther away.
  tolerance,
  rings,  ///< constraint points within `reduction_rings` of the deformable region, if the mesh is manifold there
  off,    ///< all constraint points
};

/// Whether the handle basis is stored.
enum class BasisMode {
  automatic,  ///< store the handle basis if it is not larger than max(4 x the factor, 1 GiB)
  always,     ///< store it regardless of its size
  never,      ///< solve every design by the factorization and kernel sums
};

/// The default of RbfOptions::reduction_tolerance, see KernelProperties.
double default_reduction_tolerance(Kernel kernel);

/// The default of RbfOptions::tolerance.
constexpr double default_tolerance(Solver solver) { return solver == Solver::incremental_qr ? 1e-4 : 1e-6; }

/// The distance between neighbouring centres that sets automatic shapes: that of the densest ones, as they set the condition, or
/// the median, as up to version 0.2.
enum class ShapeRule { densest, median };

/// RBF deformation (thesis 3.5, 4.2). Lengths in model units.
struct RbfOptions {
  std::optional<Kernel> kernel = std::nullopt;  ///< radial kernel; if not set, default_kernel() of the mesh
  /// The shape parameter s of kernels that have one, as a fraction of the bounding-box diagonal of the centres. Larger values are
  /// smoother and worse conditioned. 0 means automatic_shape() of kernel.h; otherwise 0 < shape <= 100.
  double shape = 0;
  ShapeRule shape_rule = ShapeRule::densest;  ///< for shape = 0
  /// The total degree of the polynomial part, at least order - 1 and at most 2; -1 means max(1, order - 1).
  int polynomial_degree = -1;
  Solver solver = Solver::automatic;  ///< solver of the interpolation system
  /// For the iterative solver: the largest error at the following points. For incremental QR: the RMS error at the constraint
  /// points, for the samples; in wide gaps between the constraint points the error is about ten times larger. As a fraction of D,
  /// 1e-10..1e-2; 0 means default_tolerance().
  double tolerance = 0;
  CentreOrder centre_order = CentreOrder::farthest_point;  ///< order of the centres of incremental QR
  /// For incremental QR: the vectors of design variables for whose displacements the centres are chosen. If empty, they are
  /// chosen for affine motions of the handles of the size of the model.
  std::vector<std::vector<double>> samples{};
  CentreReduction reduction = CentreReduction::tolerance;  ///< rule for the choice of centres
  int reduction_rings = 3;  ///< 1..100 (thesis 3.5: three rings fix positions and first and second derivatives)
  /// The largest misfit of an affine motion of a handle at a constraint point, as a fraction of the largest displacement that the
  /// motion prescribes, 1e-8..0.1; 0 means default_reduction_tolerance().
  double reduction_tolerance = 0;
  BasisMode basis = BasisMode::automatic;  ///< basis of the affine motions of the handles
  /// The largest error that compression of the basis may add to a design whose handles move by D and rotate by one radian, as a
  /// fraction of D, 1e-12..1e-3. 0 means that it is stored in doubles.
  double basis_tolerance = 0;
};

/// How the energy methods below enforce handles and fixed points.
enum class HandleMode {
  hard,  ///< exactly: by elimination (shell), or by multipliers and an interpolated correction (others)
  soft,  ///< in the least-squares sense with the weight `fixing` (thesis eq. 8.8)
};

/// Where energy methods other than the shell meet hard handles and fixed points: the misfit of their functions is interpolated
/// there, so that what follows the field beside them joins them. Prescribed points themselves are always exact.
enum class MisfitRule {
  joins,    ///< all that share a face or a cell with a deformable point
  centres,  ///< a well-distributed subset, ResidualCorrection::centres_for(); the default up to version 0.2
};

/// The options common to the energy methods, which minimize the integral of gamma_s |grad d|^2 + gamma_b |laplace d|^2 in
/// coordinates divided by D, so that weights do not depend on units.
struct EnergyOptions {
  double stretching = 0;                  ///< gamma_s, 0..1e12
  double bending = 1;                     ///< gamma_b, 0..1e12; not both 0
  HandleMode handles = HandleMode::hard;  ///< whether prescribed positions are met exactly
  /// gamma_f of soft handles, the weight of the mean square misfit of each handle and of the fixed points; greater than 0, up
  /// to 1e12.
  double fixing = 1000;
  MisfitRule misfit = MisfitRule::joins;   ///< of hard handles
  BasisMode basis = BasisMode::automatic;  ///< basis of the affine motions of the handles
  double basis_tolerance = 0;              ///< as RbfOptions::basis_tolerance
};

/// Thin shell on the faces of the mesh (thesis 3.1, 8.2). Every point must be a corner of a face.
struct ShellOptions : EnergyOptions {};

/// The default of SubspaceOptions::cover. Kernels that decay need more than moving least squares (thesis 8.3.2).
double default_cover(const std::optional<Kernel>& kernel);

/// Whether a subspace contains the functions 1, x, y and z, without energy, in addition to those of a kernel that decays.
enum class SubspaceLinear {
  left_out,  ///< as in thesis 8.3.2; if all handles move by one affine map, other points have errors of up to several tenths of D
  added,
};

/// The energy of the shell in a subspace of few functions around centres on the surface (thesis 8.3, eq. 8.11).
struct SubspaceOptions : EnergyOptions {
  SubspaceLinear linear = SubspaceLinear::added;  ///< for kernels that decay; the other spaces contain them or cannot
  /// The functions: moving least squares if not set (thesis 8.3.3), otherwise a kernel without a shape (8.3.1) or one that decays
  /// (8.3.2), see KernelProperties::local_shape.
  std::optional<Kernel> kernel = std::nullopt;
  std::size_t centres = 1000;  ///< 4..100000
  /// The average number of functions that are nonzero at a point, 4..1000; 0 means default_cover(kernel). For functions with
  /// compact support.
  double cover = 0;
};

/// The body over which moving least squares integrate energies. For a mesh with cells it is always their union.
enum class MlsDomain {
  surface,   ///< the faces; with volume_samples the box around them
  enclosed,  ///< the volume enclosed by the faces, or else as `surface`
  /// As `enclosed`, with more samples, and supports that go around slots of the body, so that these do not join their sides.
  connected,
  body,  ///< as `connected`, with more samples in an enclosed volume, however few points the mesh has
};

/// The default of MlsOptions::cover, see docs/methods/mls.md.
constexpr double default_cover(MlsDomain domain) { return domain == MlsDomain::surface ? 12 : 20; }

/// Moving least squares in space with energies integrated over the volume (thesis 8.4). Works for every kind of mesh.
struct MlsOptions : EnergyOptions {
  MlsDomain domain = MlsDomain::body;  ///< domain of integration of the energies
  std::size_t surface_samples = 0;     ///< 0 = automatic; at most 1,000,000
  std::size_t volume_samples = 0;      ///< 0 = automatic; at most 1,000,000
  double cubature = 4;                 ///< integration points per sample, 1..64
  double cover = 0;                    ///< samples whose support contains a point, 5..1000; 0 = default_cover(domain)
  /// Different weights in a region: they apply at the integration points whose nearest point of the mesh belongs to it. If
  /// several regions apply, the last one counts.
  struct Weights {
    Region region;          ///< where the weights apply
    double stretching = 0;  ///< gamma_s there
    double bending = 1;     ///< gamma_b there
  };
  std::vector<Weights> weights;  ///< later entries override earlier ones
};

/// What determines the control points of free-form deformation.
enum class FfdControl {
  energy,  ///< minimal energy, integrated over the whole lattice, subject to handles and constraints
  /// Direct manipulation (thesis 3.3): the least-squares fit at the handle and fixed points with the smallest motion of the
  /// control points, by a truncated singular value decomposition.
  mesh,
  /// Handles and fixed regions select control points. Those of handles move as prescribed, all other control points stay. Points
  /// outside the lattice stay as well.
  controls,
};

/// Free-form deformation (thesis 3.2, 3.3): a displacement field spanned by control points around the model.
struct FfdOptions : EnergyOptions {
  /// The lattice. It must contain every point that is not fixed, unless control is FfdControl::controls. Moved control points are
  /// not allowed for FfdControl::energy.
  LatticeOptions lattice;
  FfdControl control = FfdControl::energy;  ///< what determines the control points
  /// For FfdControl::mesh: singular values up to this fraction of the largest one are truncated, 1e-15..0.5; 0 means the corner
  /// of the L-curve, see ClampedInverse.
  double clamp = 0;
};

/// What determines the vertices of a cage.
enum class CageControl {
  controls,  ///< handles and fixed regions select vertices; those of handles move as prescribed, all others stay
  mesh,      ///< direct manipulation, as FfdControl::mesh
};

/// The coordinates of points in a cage.
enum class CageCoordinates {
  mean_value,  ///< see MeanValue: inside and outside of the cage
  /// See Green: inside of the cage only. They also follow the normals of its triangles, so details are turned instead of sheared,
  /// and points are no linear function of its vertices. Not with CageControl::mesh or basis_tolerance.
  green,
};

/// Cage-based deformation (thesis 3.4): the displacement of a point is the sum of the displacements of the vertices of a cage,
/// weighted with its coordinates in the cage.
struct CageOptions {
  std::vector<Vec3> vertices;                                 ///< vertices of the cage, model units; see Cage
  std::vector<std::array<std::uint32_t, 3>> triangles;        ///< triangles of the cage
  CageControl control = CageControl::controls;                ///< what determines the vertices
  double clamp = 0;                                           ///< for CageControl::mesh, as FfdOptions::clamp
  CageCoordinates coordinates = CageCoordinates::mean_value;  ///< coordinates of points in the cage
  /// The basis of the affine motions of the handles. For CageCoordinates::green, which have none, whether the coordinates of the
  /// points are stored.
  BasisMode basis = BasisMode::automatic;
  double basis_tolerance = 0;  ///< as RbfOptions::basis_tolerance
};

/// The options of a method; see methods.h.
using MethodOptions = std::variant<RbfOptions, ShellOptions, SubspaceOptions, MlsOptions, FfdOptions, CageOptions>;

/// The designs of a setup for which a method chooses its functions, as values of its design variables: RbfOptions::samples. Null
/// if the options have none.
std::vector<std::vector<double>>* samples_of(MethodOptions& method);

/// A named region that is moved.
struct Handle {
  std::string name;       ///< not empty, unique among the handles
  Region region;          ///< its points, or control points
  std::size_t stage = 0;  ///< whose it is: 0 is Setup::method, s is Setup::then[s - 1]; ascending
};

/// A further method of a setup, which starts where those before it end; see ComposedSystem.
struct Stage {
  MethodOptions method;       ///< the method and its options
  std::vector<Region> fixed;  ///< regions of points that it leaves where those before it put them; disjoint from its handles
};

/// The largest number of methods of Setup::then.
inline constexpr std::size_t most_further_methods = 7;

/// Another handle that a design variable moves.
struct DrivenHandle {
  std::string handle;   ///< name of the handle moved
  VariableMotion kind;  ///< kind of motion
};

/// A named scalar that moves handles; 0 is the rest position.
struct DesignVariable {
  using Translate = Translation;                            ///< along a direction
  using Rotate = Rotation;                                  ///< about an axis
  using Scale = Scaling;                                    ///< from a centre
  std::string name;                                         ///< not empty, unique among the variables
  std::string handle;                                       ///< name of the handle moved
  VariableMotion kind;                                      ///< kind of motion
  double lower = -std::numeric_limits<double>::infinity();  ///< lower bound, at most 0
  double upper = std::numeric_limits<double>::infinity();   ///< upper bound, at least 0
  std::vector<DrivenHandle> also{};                         ///< other handles that it moves at the same time, each once
};

/// A geometric property that a deformation is to have (thesis 8.5). For the energy methods only.
struct Constraint {
  std::string name;             ///< not empty, unique among the constraints
  std::vector<Region> regions;  ///< number as required by the kind
  ConstraintKind kind;          ///< the property
  /// gamma_c, the weight of the mean square distance (in units of D) of its points from the shape, up to 1e10; 0
  /// means automatic_weight.
  double weight = 0;
  static constexpr double automatic_weight = 1e7;  ///< weight used for 0
  /// Whether its points are finally placed on the shape exactly, together with those of all other exact constraints; the points
  /// around them follow smoothly. Points of handles and fixed regions keep their prescribed positions; if the shape cannot
  /// contain them, the report shows the remaining distances.
  bool exact = false;
};

/// Limit of ConstraintOptions::iterations.
inline constexpr int most_constraint_iterations = 1000000;

/// Where the step of exact points onto their shapes is carried to the points around them: it is interpolated there, and is zero
/// at handle and fixed points. Exact points themselves are always on their shapes.
enum class ExactSteps {
  joins,    ///< all exact, handle and fixed points that share a face or a cell with one that is none of these
  centres,  ///< a well-distributed subset, ResidualCorrection::centres_for(); the default up to version 0.2
};

/// Options of the solver for constraints.
struct ConstraintOptions {
  double tolerance = 1e-7;  ///< rms distance of the constrained points from the solution, fraction of D, 1e-12..1e-2
  /// Largest number of iterations of a design, 1..1,000,000. A design that needs more is reported as not converged.
  int iterations = 3000;
  ExactSteps exact_steps = ExactSteps::joins;  ///< of exact constraints
};

/// The input of a system besides the mesh. Several variables that move one handle are composed in their order here (the first one
/// is applied first).
struct Setup {
  // Defined in setup.cpp: their code is large, and each file that copies a setup would compile it.
  Setup();
  Setup(const Setup& other);                 ///< copies all of it but `images`, which both share
  Setup(Setup&& other) noexcept;             ///< leaves `other` valid, with unspecified members
  Setup& operator=(const Setup& other);      ///< as the copy
  Setup& operator=(Setup&& other) noexcept;  ///< as the move
  ~Setup();

  MethodOptions method;                   ///< the method and its options
  std::vector<Handle> handles;            ///< at least one of each method, whose regions are disjoint; in the order of methods
  std::vector<Region> fixed;              ///< regions of points that `method` lets stay; disjoint from its handles
  std::vector<DesignVariable> variables;  ///< the design variables
  std::uint64_t seed = 0;                 ///< seed of all random choices
  std::vector<SymmetryPlane> symmetry;    ///< at most 3, mutually orthogonal; points on them slide in them
  std::vector<Constraint> constraints;    ///< for the energy methods only
  ConstraintOptions constraint_options;   ///< options of the solver for constraints
  std::vector<Stage> then{};              ///< methods that follow `method`, at most most_further_methods; not with constraints
  /// For the whole of a model with symmetry, what it consists of: the mean over these images is delivered. MirroredSystem sets
  /// it; it changes no result, only estimates of errors, and is not part of the canonical form.
  std::shared_ptr<const MirroredMesh> images{};
};

/// The regions of a setup on one mesh.
struct SelectedRegions {
  /// Points of each handle, sorted, not empty; disjoint among the handles of one method.
  std::vector<std::vector<PointId>> handles;
  std::vector<PointId> fixed;  ///< of Setup::method; sorted, disjoint from its handles; may be empty
  Symmetry symmetry;           ///< the symmetry planes
  std::vector<std::vector<std::vector<PointId>>> constraints;  ///< points of each region of each constraint, sorted, not empty
  /// What handles and fixed regions select: points of the mesh, or control points for FfdControl::controls
  /// and CageControl::controls.
  enum class Of { mesh_points, control_points };
  Of of = Of::mesh_points;  ///< the same for all handles and fixed regions of a method; here that of Setup::method
  /// With Setup::then the regions of each method, those of Setup::method first; else empty.
  std::vector<SelectedRegions> stages{};
};

/// Makes all checks that need no numerical work and selects the regions. Throws Error(invalid_argument) naming the field: no
/// handle, repeated or empty names, empty region, a point in two handles or in a handle and a fixed region (with the count and
/// the first id), unknown handle of a variable (with the nearest names) or one that it moves twice, lower > upper or 0 outside of
/// them, zero axis or direction, non-finite numbers, options out of range, constraints without a name, with a wrong number of
/// regions, or with a weight or layers out of range, layers in a mesh without cells, and the errors of Symmetry. Between two
/// parts of a region the context may stop it. What the regions select is claimed from the context, with what estimate() needs for
/// the points of constraints.
SelectedRegions validate(const Setup& setup, const Mesh& mesh, const RunContext& context = {});

/// The same, adding errors to `problems`. In collecting mode, checking continues with the next entry, and regions that cannot be
/// selected are empty. Entries that `problems` contains already are skipped.
SelectedRegions validate(const Setup& setup, const Mesh& mesh, Problems& problems, const RunContext& context = {});

/// The affine motion of every handle for a vector of variable values (size = setup.variables.size()). Values close to a bound are
/// clamped to it, see within_bounds(). Throws Error(invalid_argument): wrong length, non-finite value, value outside its bounds
/// (both named).
std::vector<Affine> handle_motions(const Setup& setup, std::span<const double> variables);

/// d(motion of every handle) / d(variable k) as one 3 x 4 matrix per handle: the exact derivative at `variables`, so rotations
/// are linearized at the current design. Zero for handles that variable k does not move.
std::vector<Affine> handle_motion_derivative(const Setup& setup, std::span<const double> variables, std::size_t k);

/// Checks the options, even if there are no constraints. Throws Error(invalid_argument) naming the field
/// ("constraint_options.tolerance"), its value and the limits.
void validate_constraint_options(const ConstraintOptions& options);

}  // namespace deform
