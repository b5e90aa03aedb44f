// SPDX-License-Identifier: GPL-3.0-or-later
#include "proto/convert/verdict.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <utility>

#include "core/base/number_text.h"
#include "core/quality/displacement.h"
#include "proto/convert/method_traits.h"

namespace deform::convert {

namespace {

constexpr double least_tolerance = 1e-10;                  // of solvers
constexpr double bad_error = 1e-3, doubtful_error = 1e-6;  // of the motion
constexpr double negligible_error = 1e-12;                 // of D
constexpr double least_motion = 1e-4;                      // of D: errors of smaller motions are judged as if they were so large
constexpr double doubtful_condition = 1e12;
constexpr double harmless_error = 1e-8;                     // of the motion: measured, it says that such a condition did no harm
constexpr double unrefined_error = 1e-9;                    // of the motion: estimated without a converged refinement, not bad
constexpr double bad_misfit = 0.5, doubtful_misfit = 0.02;  // of the largest prescribed displacement
constexpr double doubtful_height = 0.01;                    // of the height at rest
constexpr double doubtful_constraint = 0.1;                 // of the largest prescribed displacement
constexpr double no_motion = 1e-6;                          // of the same
constexpr double far_away = 10;                             // of D: prescribed displacements in other units than the mesh

using Finding = std::pair<v1::Verdict, std::string>;

/// The tolerance that would do, where it is of something else than the error. Between them is a factor that hardly grows as the
/// tolerance falls; for that and for other motions there is a margin.
std::string least_squares_advice(const SolutionFacts& facts, double relative_error) {
  constexpr double margin = 4;
  const double tolerance = facts.method.least_squares_tolerance;
  if (!(tolerance > 0) || !std::isfinite(relative_error)) return {};
  const double limit = relative_error > bad_error ? bad_error : doubtful_error;
  const double enough = tolerance * limit / (margin * relative_error);
  const double unit = std::pow(10.0, std::floor(std::log10(enough)));
  const std::string other =
      enough < least_tolerance ? "take " : "take " + three_digits(std::floor(enough / unit) * unit) + " or ";
  return ": the tolerance " + three_digits(tolerance) +
         " of INCREMENTAL_QR is at handle and fixed points, and errors between them are larger; " + other +
         "solver SOLVER_AUTOMATIC";
}

/// What large errors of direct manipulation come from.
std::string clamp_advice(const SolutionFacts& facts) {
  if (!facts.method.manipulates_directly) return {};
  return ": the clamp separates singular values that are close to each other; name another `clamp`, such as 1e-4";
}

constexpr const char* fewer_or_smoother =
    "handle and fixed points nearly coincide; hold fewer of them, or take kernel BIHARMONIC";

/// What keeps a direct solver from its tolerance.
std::string condition_advice(const SolutionFacts& facts) {
  const bool direct = facts.method.condition_effect == MethodFacts::Effect::measured && facts.method.least_squares_tolerance == 0;
  if (!direct || !(facts.condition > doubtful_condition)) return {};
  return "; the condition of the system is " + three_digits(facts.condition) + ": " + fewer_or_smoother;
}

/// Whether the solution of constraints is as near as doubles allow, nearer than which the tolerance is. Its error is judged like
/// that of one that has converged.
bool at_rounding(const SolutionFacts& facts, const v1::DesignResult& result) {
  return !facts.converged && result.constraints().at_rounding();
}

/// Whether a solution that has not converged is one of a direct solver, which has no tolerance of the user's to reach, and is
/// estimated to be so accurate that it is harmless even so. In 36 designs with conditions from 8e18 to 2e21 whose refinement did
/// not converge the true error was up to 1450 times the estimated one, and below 1e-8 of the motion where the estimate was below
/// 1e-9.
bool only_unrefined(const SolutionFacts& facts, const v1::DesignResult& result) {
  return !facts.converged && facts.condition > doubtful_condition && facts.method.least_squares_tolerance == 0 &&
         facts.method.condition_effect == MethodFacts::Effect::measured && result.relative_error() <= unrefined_error;
}

void judge_solution(const SolutionFacts& facts, const v1::DesignResult& result, std::vector<Finding>& found) {
  if (!std::isfinite(result.max_displacement()) || !std::isfinite(result.estimated_error())) {
    found.emplace_back(v1::VERDICT_BAD, "points are not finite");
    return;
  }
  const double motion = std::max(result.max_displacement(), least_motion * facts.diagonal);
  const double relative = motion > 0 ? result.estimated_error() / motion : result.relative_error();
  const bool large = result.estimated_error() > negligible_error * facts.diagonal && relative > doubtful_error;
  const std::string error = "the estimated error is " + three_digits(result.estimated_error()) +
                            (large ? ", " + three_digits(result.relative_error()) + " of the largest displacement" : "");
  if (only_unrefined(facts, result)) {
    found.emplace_back(v1::VERDICT_DOUBTFUL, "the refinement of the solution did not converge: the estimated error is " +
                                                 three_digits(result.estimated_error()) +
                                                 ", and may be a thousand times too small");
  } else if (!facts.converged && !at_rounding(facts, result)) {
    found.emplace_back(v1::VERDICT_BAD, "the solver did not reach its tolerance: " + error + condition_advice(facts) +
                                            least_squares_advice(facts, relative) + clamp_advice(facts));
  } else if (large) {
    found.emplace_back(relative > bad_error ? v1::VERDICT_BAD : v1::VERDICT_DOUBTFUL,
                       error + least_squares_advice(facts, relative) + clamp_advice(facts));
  }
}

/// A large condition is a reason to doubt where its effect on the points is unknown. Adds a note where that is known and
/// nothing. How many digits the factor has left, which is to say what residuals make of the points, shows in how fast refinement
/// converges, whatever the condition; without any it does not.
void judge_condition(const SolutionFacts& facts, v1::DesignResult& result, std::vector<Finding>& found) {
  if (!(facts.condition > doubtful_condition)) return;
  if (!facts.converged && !only_unrefined(facts, result) && !condition_advice(facts).empty()) return;  // said already
  const std::string condition = "the condition of the system is " + three_digits(facts.condition);
  const bool measured = facts.method.condition_effect == MethodFacts::Effect::measured;
  const std::string error = "; the measured error is " + three_digits(result.relative_error()) + " of the largest displacement";
  const bool small = result.relative_error() <= harmless_error || result.estimated_error() <= negligible_error * facts.diagonal;
  if (measured && facts.converged && small) {
    result.add_notes(condition + error);
    return;
  }
  const std::string advice = facts.method.condition_effect == MethodFacts::Effect::unknown
                                 ? ": hold parts that nothing holds, or give stretching and bending both a weight"
                                 : std::string(": ") + fewer_or_smoother;
  found.emplace_back(v1::VERDICT_DOUBTFUL,
                     condition + (measured ? error : "; how far that moves the points is not measured") + advice);
}

/// Whether the points move as prescribed, as far as the method can know.
void judge_motion(const SolutionFacts& facts, const v1::DesignResult& result, std::vector<Finding>& found) {
  const double prescribed = result.prescribed_displacement();
  if (!(prescribed > negligible_error * facts.diagonal)) return;
  if (result.max_displacement() < no_motion * prescribed) {
    found.emplace_back(v1::VERDICT_BAD, "nothing moves: the largest displacement of a point is " +
                                            three_digits(result.max_displacement()) + ", the largest prescribed one " +
                                            three_digits(prescribed) + "; is the lattice or cage around the model?");
    return;
  }
  if (facts.misfit > doubtful_misfit * prescribed) {
    found.emplace_back(facts.misfit > bad_misfit * prescribed ? v1::VERDICT_BAD : v1::VERDICT_DOUBTFUL,
                       "handle and fixed points are missed by up to " + three_digits(facts.misfit) + ", " +
                           three_digits(facts.misfit / prescribed) +
                           " of the largest prescribed displacement: take more control points or a smaller `clamp`");
  }
}

/// ", 2 without positive volume, 3 with a wrong pyramid", of polyhedral cells.
std::string failed_checks(const v1::CellReport& cells) {
  const auto said = [](std::uint64_t count, const char* what) {
    return count > 0 ? ", " + std::to_string(count) + what : std::string();
  };
  return said(cells.without_volume(), " without positive volume") + said(cells.wrong_pyramid(), " with a wrong pyramid");
}

void judge_mesh(const SolutionFacts& facts, const v1::DesignResult& result, std::vector<Finding>& found) {
  if (result.has_split()) {
    const auto& split = result.split();
    if (!split.inversion_free() || split.reached() < 1) {
      found.emplace_back(v1::VERDICT_BAD,
                         "the split did not arrive: " + three_digits(split.reached()) + " of the motion was reached");
    }
  } else if (result.cells().inverted() > 0) {
    found.emplace_back(v1::VERDICT_BAD, std::to_string(result.cells().inverted()) + " of " +
                                            std::to_string(result.cells().cells()) + " cells are inverted; none before " +
                                            three_digits(result.cells().safe_amplitude()) + " of the motion" +
                                            failed_checks(result.cells()));
  }
  if (result.cells().non_orthogonal_faces() > 0) {
    const std::uint64_t count = result.cells().non_orthogonal_faces();
    found.emplace_back(v1::VERDICT_DOUBTFUL, std::to_string(count) +
                                                 (count == 1 ? " face of cells has" : " faces of cells have") +
                                                 " become severely non-orthogonal, beyond 70 degrees; the largest angle is " +
                                                 three_digits(result.cells().largest_non_orthogonality()) + " degrees, at face " +
                                                 std::to_string(result.cells().largest_non_orthogonality_face()));
  }
  if (result.faces().flipped() > 0) {
    found.emplace_back(v1::VERDICT_DOUBTFUL, std::to_string(result.faces().flipped()) + " of " +
                                                 std::to_string(result.faces().faces()) + " faces are flipped");
  }
  if (result.points_across_symmetry() > 0) {
    found.emplace_back(v1::VERDICT_DOUBTFUL, std::to_string(result.points_across_symmetry()) +
                                                 " points crossed a symmetry plane: the whole model runs through itself");
  }
  if (result.faces().intersecting() > 0) {
    found.emplace_back(v1::VERDICT_DOUBTFUL, std::to_string(result.faces().intersecting()) + " of " +
                                                 std::to_string(result.faces().faces()) + " faces ran into others");
  }
  if (facts.torn_edges > 0) {
    found.emplace_back(v1::VERDICT_DOUBTFUL, std::to_string(facts.torn_edges) + " edges are torn at the boundary of the lattice");
  }
  if (std::isfinite(result.max_displacement()) &&
      displacement_warning({result.max_displacement(), 0}, result.prescribed_displacement(), facts.diagonal)) {
    found.emplace_back(v1::VERDICT_DOUBTFUL, "a point moves " +
                                                 three_digits(result.max_displacement() / result.prescribed_displacement()) +
                                                 " times the largest prescribed displacement" +
                                                 (facts.method.overshoot.empty() ? "" : ": " + facts.method.overshoot));
  }
}

/// Whether the motion is one of the size of the model.
void judge_size(const SolutionFacts& facts, const v1::DesignResult& result, std::vector<Finding>& found) {
  const double prescribed = result.prescribed_displacement(), moved = result.max_displacement();
  const auto beyond = std::isfinite(moved) ? beyond_digits(std::max(prescribed, moved), facts.diagonal) : std::nullopt;
  if (beyond) {
    found.emplace_back(v1::VERDICT_BAD, *beyond);
  } else if (facts.diagonal > 0 && prescribed > far_away * facts.diagonal) {
    found.emplace_back(v1::VERDICT_DOUBTFUL, "points are to move by up to " + three_digits(prescribed / facts.diagonal) +
                                                 " times the diagonal of the model; are these its units?");
  }
}

/// The heights of layers that a constraint is to keep. The negation makes NaN count as changed.
void judge_heights(const v1::ConstraintResidual& residual, std::vector<Finding>& found) {
  if (!residual.has_least_height()) return;
  const double least = residual.least_height(), largest = residual.largest_height();
  if (1 - least <= doubtful_height && largest - 1 <= doubtful_height) return;
  found.emplace_back(
      v1::VERDICT_DOUBTFUL,
      "the heights of the layers of \"" + residual.name() + "\" are " + three_digits(least) + " to " + three_digits(largest) +
          " of those at rest, without the constraint " + three_digits(residual.free_least_height()) + " to " +
          three_digits(residual.free_largest_height()) +
          ": points above the wall are held, exact or on two walls, or the wall folds; hold no points above the wall");
}

/// Why no weight meets a constraint: ": 12 of its points are held, 8 by handle "roof" and 4 by fixed regions, and ...". Empty
/// unless what these points miss by themselves is at least half of what all do, a quarter of the squares.
std::string held_reason(const v1::ConstraintResidual& residual) {
  constexpr double most_of_it = 0.5;
  if (!residual.has_held_rms() || !(residual.held_rms() >= most_of_it * residual.rms())) return {};
  std::uint64_t points = 0;
  std::string by;
  bool handles = false;
  for (int h = 0; h < residual.held_size(); ++h) {
    const auto& held = residual.held(h);
    points += held.points();
    handles = handles || !held.handle().empty();
    if (h > 0) by += h + 1 < residual.held_size() ? ", " : " and ";
    if (residual.held_size() > 1) by += std::to_string(held.points()) + " ";
    by += held.handle().empty() ? "by fixed regions" : "by handle \"" + held.handle() + "\"";
  }
  const bool one = points == 1;
  return std::to_string(points) + (one ? " of its points is held" : " of its points are held") +
         (residual.held_size() > 1 ? ", " : " ") + by + ", and " + (one ? "it alone misses" : "these alone miss") +
         " the shape by up to " + three_digits(residual.held_largest()) + " (rms " + three_digits(residual.held_rms()) + " of " +
         three_digits(residual.rms()) + "), which no weight changes: take " + (one ? "it" : "them") + " out of the region" +
         (handles ? ", or let the handle follow the shape" : "");
}

/// A constraint that is met in the least-squares sense, but hardly; those of layers are judged by their heights.
void judge_residual(const SolutionFacts& facts, double prescribed, const v1::ConstraintResidual& residual,
                    std::vector<Finding>& found) {
  if (residual.has_least_height() || residual.missed() || !(prescribed > negligible_error * facts.diagonal)) return;
  if (residual.largest() <= doubtful_constraint * prescribed) return;
  const std::string held = held_reason(residual);
  found.emplace_back(v1::VERDICT_DOUBTFUL,
                     "constraint \"" + residual.name() + "\" is missed by up to " + three_digits(residual.largest()) + ", " +
                         three_digits(residual.largest() / prescribed) +
                         " of the largest prescribed displacement, without it by " + three_digits(residual.free_largest()) +
                         ": " + (held.empty() ? facts.method.more_freedom + "a larger weight, or `exact: true`" : held));
}

void judge_constraints(const SolutionFacts& facts, const v1::DesignResult& result, std::vector<Finding>& found) {
  const v1::ConstraintsReport& constraints = result.constraints();
  for (const auto& residual : constraints.residuals()) {
    judge_heights(residual, found);
    judge_residual(facts, result.prescribed_displacement(), residual, found);
  }
  std::string names;
  for (const auto& residual : constraints.residuals()) {
    if (!residual.missed()) continue;
    const std::string held = held_reason(residual);
    names += (names.empty() ? "\"" : ", \"") + residual.name() + "\"" + (held.empty() ? "" : " (" + held + ")");
  }
  if (!names.empty()) found.emplace_back(v1::VERDICT_BAD, "exact constraints are missed: " + names);
  if (constraints.exact_given_up()) {
    found.emplace_back(v1::VERDICT_BAD, "placing points exactly was given up for some constraints");
  }
}

/// One method of a setup.
struct Stage {
  std::string name;  ///< "the first method", "then[0]"
  const v1::Method& method;
  int fixed = 0;  ///< the number of its fixed regions
};

/// What radial basis functions do beyond the handles. In a chain each method is named, as it is unknown which of them did it.
std::string overshoot(const std::vector<Stage>& stages) {
  std::string unfixed;
  std::vector<std::pair<v1::Kernel, std::string>> kernels;  // with the methods that have them
  for (const Stage& stage : stages) {
    if (!stage.method.has_rbf()) continue;
    if (stage.fixed == 0) {
      unfixed += (unfixed.empty() ? "" : " and ") + stage.name;
      continue;
    }
    const v1::Kernel kernel = stage.method.rbf().kernel();
    const auto of_core = kernel_named_as(v1::Kernel_Name(kernel));
    if (!of_core || !properties(*of_core).overshoots) continue;
    const auto known = std::find_if(kernels.begin(), kernels.end(), [&](const auto& entry) { return entry.first == kernel; });
    if (known == kernels.end()) {
      kernels.emplace_back(kernel, stage.name);
    } else {
      known->second += " and " + stage.name;
    }
  }
  const bool several = stages.size() > 1;
  std::string text;
  if (!unfixed.empty()) {
    text = "nothing is fixed" + (several ? " in " + unfixed : "") +
           ", so that what is beyond the handles goes on moving as they do; fix what is to stay";
  }
  for (const auto& [kernel, fields] : kernels) {
    text += (text.empty() ? "kernel " : "; kernel ") + v1::Kernel_Name(kernel) + (several ? " of " + fields : "") +
            " carries the slopes of handles that turn or bend on beyond them; kernel BIHARMONIC hardly does";
  }
  return text;
}

}  // namespace

MethodFacts method_facts(const v1::Setup& setup) {
  MethodFacts facts;
  std::vector<Stage> stages{{"the first method", setup.method(), setup.fixed_size()}};
  for (int s = 0; s < setup.then_size(); ++s) {
    stages.push_back({"then[" + std::to_string(s) + "]", setup.then(s).method(), setup.then(s).fixed_size()});
  }
  if (std::all_of(stages.begin(), stages.end(),
                  [](const Stage& stage) { return method_features(stage.method).measures_condition; })) {
    facts.condition_effect = MethodFacts::Effect::measured;
  }
  facts.manipulates_directly =
      std::any_of(stages.begin(), stages.end(), [](const Stage& stage) { return manipulates_directly(stage.method); });
  const std::string more_of(method_features(setup.method()).more_of);
  if (!more_of.empty()) facts.more_freedom = "take more " + more_of + ", ";
  if (setup.method().has_rbf() && setup.then_size() == 0 && setup.method().rbf().solver() == v1::INCREMENTAL_QR) {
    facts.least_squares_tolerance = setup.method().rbf().tolerance();
  }
  facts.overshoot = overshoot(stages);
  return facts;
}

std::string rounding_note(double convergence_error) {
  return "the tolerance of the constraints is less than rounding allows: their points are about " +
         three_digits(convergence_error) +
         " from the solution, as near as doubles come; a larger constraint_options.tolerance gives the same";
}

void set_verdict(const SolutionFacts& facts, v1::DesignResult& result) {
  std::vector<Finding> found;
  result.clear_notes();
  judge_solution(facts, result, found);
  if (std::isfinite(result.max_displacement()) && std::isfinite(result.estimated_error())) judge_condition(facts, result, found);
  if (at_rounding(facts, result)) {
    result.add_notes(rounding_note(result.constraints().convergence_error()));
  }
  judge_motion(facts, result, found);
  judge_mesh(facts, result, found);
  judge_size(facts, result, found);
  for (const std::string& shape : facts.shapes) found.emplace_back(v1::VERDICT_DOUBTFUL, shape);
  judge_constraints(facts, result, found);
  std::stable_sort(found.begin(), found.end(), [](const Finding& a, const Finding& b) { return a.first > b.first; });
  result.set_verdict(found.empty() ? v1::VERDICT_GOOD : found.front().first);
  result.clear_reasons();
  result.set_reasons_of_verdict(0);
  for (const Finding& finding : found) {
    result.add_reasons(finding.second);
    if (finding.first == result.verdict()) result.set_reasons_of_verdict(static_cast<std::uint32_t>(result.reasons_size()));
  }
}

}  // namespace deform::convert
