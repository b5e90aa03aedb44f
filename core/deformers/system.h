// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"
#include "core/quality/displacement_fields.h"

namespace deform {

/// How one design is evaluated.
enum class EvaluationPath {
  automatic,  ///< basis if every motion is affine and the system has a basis, else direct
  basis,      ///< n x 4H handle basis times handle coefficients (thesis 4.2)
  direct,     ///< solve for the weights, then kernel sums
};

/// The prescribed motion of one handle: an affine map of its points, or a displacement for each point of the handle (by ascending
/// point id).
struct Motion {
  std::size_t handle = 0;                                           ///< position of the handle in the setup
  std::variant<Affine, std::vector<Vec3>> value = identity_affine;  ///< the map, or the displacements
};

/// One set of motions, one vector of design variables, or both for different handles. Handles without a motion stay at rest.
struct Design {
  std::vector<double> variables;  ///< empty, or one value for each design variable
  std::vector<Motion> motions;    ///< at most one per handle; not for handles with nonzero variables
  /// For systems whose solver has a tolerance: that of this design, as a fraction of D, 1e-10..1e-2; 0 means that of the setup. A
  /// different one needs the direct path. Incremental QR uses fewer of its centres for a larger tolerance and cannot go below the
  /// one for which it was prepared.
  double tolerance = 0;
};

/// Distances of the points of a constraint from its shape, model units; for Distance the violations of the bounds.
struct ConstraintReport {
  double max_before = 0;  ///< largest distance in the deformation without constraints
  double rms_before = 0;  ///< root mean square distance in the deformation without constraints
  double max = 0;         ///< largest distance as delivered
  double rms = 0;         ///< root mean square distance as delivered
  /// Whether the constraint is exact but `max` exceeds 1e-9 D, because it contradicts others or handle and fixed points.
  bool missed = false;
  /// Whether the constraint is exact but was given up, because it contradicts others or handle and fixed points, or is too far
  /// away (see ExactPlacement). Its points then keep the result of the fit.
  bool given_up = false;
  /// With Rigid::layers: the least and the largest height of a layer of a column over that at rest.
  struct Heights {
    double least = 1;    ///< of all layers
    double largest = 1;  ///< of all layers
    /// Counts one more.
    void add(double height) {
      least = std::min(least, height);
      largest = std::max(largest, height);
    }
  };
  std::optional<Heights> heights{};         ///< as delivered
  std::optional<Heights> heights_before{};  ///< in the deformation without constraints

  /// Those of its points that handles or fixed regions hold, so that they keep their prescribed positions; each point of the set
  /// counts, one of two regions twice. Not of columns of cells.
  struct Held {
    static constexpr std::size_t fixed = static_cast<std::size_t>(-1);  ///< by fixed regions
    std::size_t handle = fixed;                                         ///< its position in the setup
    std::size_t points = 0;                                             ///< so many of the set
  };
  std::vector<Held> held{};  ///< by handles in the order of the setup, then by fixed regions
  /// What is left of `max` and `rms` where all points that are not held are where that is least: no weight and no method goes
  /// below this rms. Only with held points and where `max` exceeds 1 % of the largest prescribed displacement.
  struct HeldMisfit {
    double max = 0;  ///< model units
    double rms = 0;  ///< model units
  };
  std::optional<HeldMisfit> held_misfit{};  ///< where it is known
};

/// Report on one evaluated design.
struct DesignReport {
  EvaluationPath path = EvaluationPath::basis;  ///< path of the evaluation
  double interpolation_residual = 0;            ///< max over the centres of |interpolant - prescribed position|, model units
  /// Largest prescribed displacement of a handle point, model units. Other points may move farther: see largest_displacement()
  /// and displacement_warning() of core/quality/displacement.h. Of several methods (Setup::then) that of the chain, from rest to
  /// where the last method that moves a handle point sends it: see ComposedSystem.
  double prescribed_displacement = 0;
  /// Estimated largest error at the points, model units, relative to the exact solution of the equations of the method (for
  /// INCREMENTAL_QR the interpolant of all constraint points). At least half of the true error.
  double error = 0;
  /// For FfdControl::mesh and controls: the largest displacement of a control point, model units. If it is much larger than the
  /// prescribed one with `mesh`, the clamp is too small.
  double control_displacement = 0;
  /// For direct manipulation (FfdControl::mesh and CageControl::mesh): the largest distance of a handle or fixed point from its
  /// prescribed position, model units, on every path; else 0. Not an error of the solution, but what lattice or cage cannot span.
  double misfit = 0;
  /// For FfdControl::controls: the number of edges of the mesh torn at the boundary of the lattice, between moving points and
  /// points at rest.
  std::size_t torn_edges = 0;
  bool converged = true;              ///< whether the solver and the constraint iteration reached their tolerances
  bool at_rounding = false;           ///< not converged, but only as the tolerance of constraints is less than rounding allows
  std::vector<std::string> warnings;  ///< reasons why the method may not suit this design, one sentence each

  // For setups with constraints (thesis 8.5):
  std::vector<ConstraintReport> constraints;  ///< in the order of the setup
  int iterations = 0;                         ///< global steps
  int newton_steps = 0;                       ///< additional Newton steps
  /// Energy above that of the unconstrained deformation, including the weighted constraint errors, unit coordinates.
  double energy = 0;
  double convergence_error = 0;  ///< estimated rms distance of the constrained points from the limit, model units
};

/// Facts about a prepared system. Lengths in model units. If handles select control points (SelectedRegions::of), handle_points,
/// fixed_points and constraint_points count these, and all points of the mesh are deformable.
struct SystemInfo {
  std::size_t points = 0;             ///< points of the mesh
  std::size_t fixed_points = 0;       ///< points in fixed regions
  std::size_t handle_points = 0;      ///< points in handles
  std::size_t deformable_points = 0;  ///< all other points
  std::size_t constraint_points = 0;  ///< handle and fixed points: candidate centres
  std::size_t centres = 0;            ///< centres of an RBF, after reduction and merging; for incremental QR those chosen
  std::size_t held_points = 0;        ///< handle and fixed points that enter the system of a shell with hard handles, else 0
  std::size_t samples = 0;            ///< for the other energy methods: number of centres of their functions, else 0
  std::size_t functions = 0;          ///< unknowns per coordinate of an energy method
  std::size_t cubature_points = 0;    ///< integration points of the energy; 0 if integrated on the faces
  std::size_t merged_duplicates = 0;  ///< centres saved by merging coincident constraint points
  std::size_t polynomial_terms = 0;   ///< polynomial terms of an RBF
  int affine_hull_dimension = 3;      ///< affine hull of the centres: 0 point, 1 line, 2 plane, 3 space
  std::size_t basis_fields = 0;       ///< 4H, or 0 without a basis
  std::size_t bytes = 0;              ///< memory of the system without the mesh
  std::size_t factor_bytes = 0;       ///< memory of the factorization
  std::size_t basis_bytes = 0;        ///< memory of the handle basis
  std::size_t design_bytes = 0;       ///< approximate memory per thread to solve a design with constraints
  double diagonal = 0;                ///< D, bounding-box diagonal of all points
  double condition = 0;               ///< 1-norm estimate of the factored matrix; 0 = none (iterative, incremental QR)
  double tolerance = 0;               ///< for the iterative solver and incremental QR, as a fraction of D; else 0
  Solver solver = Solver::cholesky;   ///< solver in use; for energy methods sparse Cholesky
  bool reduced = false;               ///< whether some constraint points are no centres
  double reduction_tolerance = 0;     ///< tolerance of the choice of centres; 0 if by another rule or all are centres
  /// If some are no centres: the largest misfit of the fields 1, x, y, z of a handle at any constraint point, as a fraction
  /// of the largest value of the field on the handle. It exceeds the tolerance if that would need more centres than are allowed.
  /// With rings, for which there is no tolerance, at up to 50,000 of the constraint points.
  double reduction_misfit = 0;
  /// An estimate of the largest distance of a point from where it would be if all constraint points were centres, as a fraction
  /// of the largest prescribed displacement: see reduction_error() of centres.h. 0 if all are centres.
  double reduction_error = 0;
  std::vector<std::string> notes;                             ///< decisions with their reasons, one sentence each
  std::vector<std::pair<std::string, double>> stage_seconds;  ///< "select", "assemble", "factor", "basis", in order
};

/// Designs bound to a system. All global computations are done; what remains is to evaluate ranges of points. Keeps its system
/// alive. Any number of threads may call evaluate() at once.
class Evaluation {
 public:
  virtual ~Evaluation() = default;
  /// The number of designs.
  virtual std::size_t design_count() const = 0;
  /// The report on a design, in the order of binding.
  virtual const DesignReport& report(std::size_t design) const = 0;

  /// Deformed points [begin, end) of designs [first, first + out.size()): out[k] points to end - begin points. The result for a
  /// point depends only on the point and the design, not on the range, the grouping of designs or the thread, bit for bit.
  virtual void evaluate(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const = 0;

  /// The motion of a design as a combination of System::displacement_fields(); std::nullopt if it is none, as on the direct path.
  virtual std::optional<FieldMotion> field_motion(std::size_t design) const;
};

class System;
class SpaceMap;

/// The state of a sequence of similar designs, from which the next one starts. Small; copies share it. Not thread-safe.
struct WarmStart {
  std::weak_ptr<const System> of;     ///< the system; others ignore the state
  std::shared_ptr<const void> state;  ///< opaque state of the system
};

/// A prepared method (thesis 4.2: prepare once, evaluate often). Immutable; any number of threads may call every method at once.
/// Always owned by a shared_ptr.
class System : public std::enable_shared_from_this<System> {
 public:
  virtual ~System() = default;

  /// Counts, sizes, solver and notes; constant.
  virtual const SystemInfo& info() const = 0;
  /// The memory that the cache charges, in bytes.
  std::size_t bytes() const { return info().bytes; }

  /// Checks the designs and does all global computations. Throws Error(invalid_argument) naming design, handle, point and limit:
  /// wrong length, non-finite value, value out of bounds, coincident constraint points with different prescribed positions, an
  /// unavailable path.
  virtual std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                                 const RunContext& context) const = 0;
  /// The same for similar designs, such as those of a line search. With constraints they are solved in order, each starting from
  /// the solution of the previous one, and the first from `warm` (if not empty), which then receives the state of the last one.
  /// This takes fewer iterations. The results depend on the previous designs within ConstraintOptions::tolerance, or by more if a
  /// design has several solutions: it stays on the branch of the previous one.
  virtual std::unique_ptr<const Evaluation> bind_sequence(std::span<const Design> designs, EvaluationPath path, WarmStart& warm,
                                                          const RunContext& context) const;

  /// A design as a map of space, for points that are not of the mesh (space_map.h). Takes the direct path. Throws what bind()
  /// throws for designs[0], and Error(failed_precondition) with the reason if the deformation is defined at the points of the
  /// mesh only.
  virtual std::unique_ptr<const SpaceMap> bind_in_space(const Design& design, const RunContext& context) const;
  /// Memory of a design as a map of space, in bytes.
  struct SpaceBytes {
    std::size_t map = 0;   ///< of the map besides that of binding
    std::size_t call = 0;  ///< of one call of it
  };
  /// For calls with so many points.
  virtual SpaceBytes space_bytes(std::size_t /*points*/) const { return {}; }

  /// d(points)/d(variables) at `variables` times `direction` (one value per variable): n x 3 (thesis 4.2, eq. 4.2).
  virtual Points jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                                 const RunContext& context) const = 0;
  /// d(points)/d(variables)^T at `variables` times a cotangent field (n x 3): one value per variable.
  virtual std::vector<double> vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                              const RunContext& context) const = 0;

  /// The same for many cotangents, with one solution of the adjoint equations for all of them: one gradient for each. They differ
  /// from those of single calls by rounding only.
  virtual std::vector<std::vector<double>> vector_jacobians(std::span<const double> variables, std::span<const Points> cotangents,
                                                            const RunContext& context) const;

  /// The fields of which the displacements of designs on the basis path are combinations, for checks that are made once and need
  /// no look at the points of a design. Null if there are none. The system must outlive them.
  virtual std::unique_ptr<const DisplacementFields> displacement_fields() const;

  /// Evaluates one design, in parallel.
  Points evaluate(const Design& design, const RunContext& context = {}) const;
  /// Evaluates a population in one pass over the system. The results are in the order of the designs.
  std::vector<Points> evaluate(std::span<const Design> designs, EvaluationPath path = EvaluationPath::automatic,
                               const RunContext& context = {}) const;
};

/// Upper bounds of the cost of a system, known before anything is allocated.
struct Estimate {
  std::size_t constraint_points = 0;  ///< handle and fixed points
  std::size_t centres = 0;            ///< as SystemInfo::centres
  std::size_t held_points = 0;        ///< as SystemInfo::held_points
  std::size_t samples = 0;            ///< as SystemInfo::samples
  std::size_t factor_bytes = 0;       ///< memory of the factorization
  std::size_t basis_bytes = 0;        ///< memory of the handle basis
  std::size_t resident_bytes = 0;     ///< memory of the prepared system
  std::size_t peak_bytes = 0;         ///< peak memory during preparation, including the system
  double seconds = 0;                 ///< rough time, from flop and byte counts at nominal rates
  double design_seconds = 0;          ///< rough time of one design with constraints, elapsed; 0 without any
  std::vector<std::string> notes;     ///< one sentence each
  std::string advice;                 ///< how to use less memory: "use fewer handles"

  /// The one of the three counts that is nonzero.
  std::size_t size() const { return centres + held_points + samples; }
};

/// Estimates the cost of a system by its method. Throws the errors of validate().
Estimate estimate(const Mesh& mesh, const Setup& setup, const RunContext& context = {});

/// The same with the regions that validate() has selected for this mesh and setup. The context may stop it between steps, of
/// which the longest is the symbolic analysis of a matrix.
Estimate estimate(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, const RunContext& context = {});

/// Finds all problems of a setup that can be found without numerical work: those of validate(), constraints that do not fit their
/// points, variables that lead points of handles out of symmetry planes, and if there are none of these, the errors of
/// estimate(). Entries that `problems` contains already are skipped.
void find_problems(const Mesh& mesh, const Setup& setup, Problems& problems, const RunContext& context = {});

/// Prepares a system. The system keeps the mesh alive and does not copy it. Throws the errors of validate(),
/// Error(numerical_failure) with the reason if the system is singular, cancelled, deadline_exceeded. `memory_budget` (bytes, 0 =
/// unlimited) is compared with estimate().peak_bytes before anything large is allocated; throws Error(out_of_budget) that names
/// what is needed, what is available and what to change.
std::shared_ptr<const System> prepare(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context = {},
                                      std::size_t memory_budget = 0);

}  // namespace deform
