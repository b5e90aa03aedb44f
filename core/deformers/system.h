// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform {

/// How one design is evaluated.
enum class EvaluationPath {
  automatic,  ///< basis when every motion is affine and the system has a basis, else direct
  basis,      ///< n x 4H handle basis times handle coefficients (thesis 4.2)
  direct,     ///< solve for the weights, then kernel sums
};

/// What one design prescribes for one handle: an affine map of its points, or a displacement per point of the handle (in the
/// order of the sorted point ids).
struct Motion {
  std::size_t handle = 0;                                           ///< its position in the setup
  std::variant<Affine, std::vector<Vec3>> value = identity_affine;  ///< the map, or the displacements
};

/// One set of motions, or one vector of design variables, or both for different handles. Handles that nothing mentions stay at
/// rest.
struct Design {
  std::vector<double> variables;  ///< empty, or one value per design variable of the setup
  std::vector<Motion> motions;    ///< at most one per handle; not for a handle whose variables are not all 0
  /// Of a system whose solver has a tolerance: the one of this design, as a fraction of D, 1e-10..1e-2; 0: that of the setup. Any
  /// other takes the direct path. Incremental QR takes fewer of its centres then; it has none for less than what it was prepared
  /// for.
  double tolerance = 0;
};

/// How far the points of a constraint are from its shape, model units; of Distance how far distances are out of their bounds.
struct ConstraintReport {
  double max_before = 0;  ///< largest distance in the deformation without constraints
  double rms_before = 0;  ///< root mean square distance in the deformation without constraints
  double max = 0;         ///< largest distance as delivered
  double rms = 0;         ///< root mean square distance as delivered
  /// An exact one whose max is over 1e-9 D: it contradicts others, or points that are held.
  bool missed = false;
  /// An exact one that contradicts others or points that are held, or is too far (see ExactPlacement): it keeps the fit that it
  /// has without that.
  bool given_up = false;
};

/// Report on one evaluated design.
struct DesignReport {
  EvaluationPath path = EvaluationPath::basis;  ///< the one taken
  double interpolation_residual = 0;            ///< max over the centres of |interpolant - prescribed position|, model units
  /// Largest prescribed displacement of a handle point, model units. Others may move farther: largest_displacement()
  /// of core/quality/displacement.h says how far any does, displacement_warning() what to think of it.
  double prescribed_displacement = 0;
  /// Estimated largest error at the points, model units: how far they may be from where the exact solution of the method's own
  /// equations puts them (of INCREMENTAL_QR the interpolant of all constraint points). At least half of what it is.
  double error = 0;
  /// Of FfdControl::mesh and controls: largest displacement of a control point, model units. With mesh far more than prescribed:
  /// the clamp is too small.
  double control_displacement = 0;
  /// Of FfdControl::controls: edges of the mesh that are torn where the lattice ends, between points that move and points that
  /// stay.
  std::size_t torn_edges = 0;
  bool converged = true;              ///< whether the solver, and the solution with constraints, reached their tolerances
  std::vector<std::string> warnings;  ///< why the method may not suit this design, one sentence each

  // With constraints (thesis 8.5); the defaults without.
  std::vector<ConstraintReport> constraints;  ///< in the order of the setup
  int iterations = 0;                         ///< global steps
  int newton_steps = 0;                       ///< besides them
  double energy = 0;  ///< of the deformation above that without constraints, and of what they are missed by; unit coordinates
  double convergence_error = 0;  ///< estimated rms distance of the constrained points from the limit, model units
};

/// Facts about a prepared system. Lengths in model units. Where handles select control points (SelectedRegions::of),
/// handle_points, fixed_points and constraint_points count these, and all points of the mesh are deformable.
struct SystemInfo {
  std::size_t points = 0;             ///< of the mesh
  std::size_t fixed_points = 0;       ///< in fixed regions
  std::size_t handle_points = 0;      ///< in handles
  std::size_t deformable_points = 0;  ///< all others
  std::size_t constraint_points = 0;  ///< handle and fixed points: candidate centres
  std::size_t centres = 0;      ///< of an RBF, after reduction and merging of coincident ones; of incremental QR those it chose
  std::size_t held_points = 0;  ///< handle and fixed points that enter the system of a shell with hard handles, else 0
  std::size_t samples = 0;      ///< of the other energy methods: the places of their functions, else 0
  std::size_t functions = 0;    ///< unknowns per coordinate of an energy method
  std::size_t cubature_points = 0;    ///< at which its energies are integrated; 0 on the faces of the mesh
  std::size_t merged_duplicates = 0;  ///< centres saved where constraint points coincide
  std::size_t polynomial_terms = 0;   ///< of an RBF
  int affine_hull_dimension = 3;      ///< of the centres: 0 point, 1 line, 2 plane, 3 space
  std::size_t basis_fields = 0;       ///< 4H, or 0 without a basis
  std::size_t bytes = 0;              ///< of all that the system holds but the mesh
  std::size_t factor_bytes = 0;       ///< of the factorization
  std::size_t basis_bytes = 0;        ///< of the handle basis
  std::size_t design_bytes = 0;       ///< about what a thread takes to solve a design with constraints
  double diagonal = 0;                ///< D, of all points
  double condition = 0;               ///< 1-norm estimate of the factored matrix; 0 = none (iterative, incremental QR)
  double tolerance = 0;               ///< of the iterative solver or incremental QR, as a fraction of D; else 0
  Solver solver = Solver::cholesky;   ///< the one that was used; of energy methods sparse Cholesky
  bool reduced = false;               ///< not all constraint points are centres
  double reduction_tolerance = 0;     ///< what the centres were chosen to; 0: by another rule, or all are centres
  /// With a reduction tolerance the largest misfit of the fields 1, x, y, z of a handle at any constraint point, as a fraction of
  /// the largest value of the field on the handle. Over the tolerance: it takes more centres than there may be.
  double reduction_misfit = 0;
  std::vector<std::string> notes;                             ///< what was decided and why, one sentence each
  std::vector<std::pair<std::string, double>> stage_seconds;  ///< "select", "assemble", "factor", "basis", in order
};

/// Designs bound to a system: everything that is small or global has been computed, what remains is to evaluate ranges of points.
/// Keeps its system alive. Any number of threads may call evaluate() at once.
class Evaluation {
 public:
  virtual ~Evaluation() = default;
  /// How many designs were bound.
  virtual std::size_t design_count() const = 0;
  /// What is known of a design, in the order in which they were bound.
  virtual const DesignReport& report(std::size_t design) const = 0;

  /// Deformed points [begin, end) of designs [first, first + out.size()): out[k] points to end - begin points. The result for a
  /// point depends on nothing but the point and the design (not on the range, the grouping of designs or the thread), bit for
  /// bit.
  virtual void evaluate(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const = 0;
};

class System;

/// Where a sequence of similar designs stands: what the next one starts from. Small; copies share it. Not for two threads at
/// once.
struct WarmStart {
  std::weak_ptr<const System> of;     ///< another system takes no notice of it
  std::shared_ptr<const void> state;  ///< only the system knows what it is
};

/// A prepared method (thesis 4.2: prepare once, evaluate often). Immutable; any number of threads may call every method at once.
/// Made and held by shared_ptr.
class System : public std::enable_shared_from_this<System> {
 public:
  virtual ~System() = default;

  /// Counts, sizes, solver and notes; constant.
  virtual const SystemInfo& info() const = 0;
  /// What the cache charges.
  std::size_t bytes() const { return info().bytes; }

  /// Checks the designs (Error(invalid_argument) naming design, handle, point and limit: wrong length, non-finite, out of bounds,
  /// coincident constraint points that are sent to different places, a path that cannot be taken) and solves what is
  /// global.
  virtual std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                                 const RunContext& context) const = 0;
  /// The same for designs that resemble each other, such as those of a line search: those with constraints are solved one after
  /// the other, each from the solution of the one before, the first from `warm` (empty: by itself), which then tells where the
  /// last one ended. Fewer iterations; the results depend on the designs before within ConstraintOptions::tolerance, and by more
  /// where a design has several solutions: it stays on the branch of the one before.
  virtual std::unique_ptr<const Evaluation> bind_sequence(std::span<const Design> designs, EvaluationPath path, WarmStart& warm,
                                                          const RunContext& context) const;

  /// d(points)/d(variables) at `variables` times `direction` (one value per variable): n x 3 (thesis 4.2, eq. 4.2).
  virtual Points jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                                 const RunContext& context) const = 0;
  /// d(points)/d(variables)^T at `variables` times a cotangent field (n x 3): one value per variable.
  virtual std::vector<double> vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                              const RunContext& context) const = 0;

  /// One design to arrays, in parallel.
  Points evaluate(const Design& design, const RunContext& context = {}) const;
  /// A population: the designs share one pass over the system. In order of the designs.
  std::vector<Points> evaluate(std::span<const Design> designs, EvaluationPath path = EvaluationPath::automatic,
                               const RunContext& context = {}) const;
};

/// Cheap upper bounds, before anything is allocated.
struct Estimate {
  std::size_t constraint_points = 0;  ///< handle and fixed points
  std::size_t centres = 0;            ///< as SystemInfo::centres
  std::size_t held_points = 0;        ///< as SystemInfo::held_points
  std::size_t samples = 0;            ///< as SystemInfo::samples
  std::size_t factor_bytes = 0;       ///< of the factorization
  std::size_t basis_bytes = 0;        ///< of the handle basis
  std::size_t resident_bytes = 0;     ///< of the prepared system
  std::size_t peak_bytes = 0;         ///< while preparing, including the system
  double seconds = 0;                 ///< rough: from flop and byte counts at nominal rates
  std::vector<std::string> notes;     ///< one sentence each
  std::string advice;                 ///< what takes less memory: "use fewer handles"

  /// The one of the three counts that is not 0.
  std::size_t size() const { return centres + held_points + samples; }
};

/// By the method of the setup. Throws what validate() throws.
Estimate estimate(const Mesh& mesh, const Setup& setup);

/// All that is wrong with a setup, as far as it can be told without numerics: what validate() finds (see there), constraints that
/// their points cannot make, and when there is nothing of that, what estimate() throws. `problems` may have some already; entries
/// that these are about are left out.
void find_problems(const Mesh& mesh, const Setup& setup, Problems& problems);

/// Prepares a system. The mesh is kept alive by the system and not copied. Throws what validate() throws,
/// Error(numerical_failure) when the system is singular (with the reason), cancelled, deadline_exceeded. `memory_budget` (bytes,
/// 0 = unlimited) is compared with estimate().peak_bytes before anything large is allocated: Error(out_of_budget) with needed,
/// available and what to change.
std::shared_ptr<const System> prepare(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context = {},
                                      std::size_t memory_budget = 0);

}  // namespace deform
