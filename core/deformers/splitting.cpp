// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/splitting.h"

#include <algorithm>
#include <utility>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/methods.h"

namespace deform {

namespace {

constexpr std::size_t grain = 8192;
constexpr double least_progress = 1e-3;  // of the motion: smaller steps get ever smaller

/// Without a basis: the handles of a step move point by point.
Setup without_basis(Setup setup) {
  with_method(setup, []<Method M>(typename M::Options& options) { options.basis = BasisMode::never; });
  return setup;
}

/// The regions by their points, so that the mesh may move.
Setup with_explicit_regions(Setup setup, const SelectedRegions& regions, const Mesh& mesh) {
  for (std::size_t h = 0; h < setup.handles.size(); ++h) setup.handles[h].region = {Region::Ids{regions.handles[h]}};
  setup.fixed.clear();
  if (!regions.fixed.empty()) setup.fixed.push_back({Region::Ids{regions.fixed}});
  // Planes that were found are found again: their points keep their distances.
  for (auto& plane : setup.symmetry) {
    if (auto* region = std::get_if<Region>(&plane.kind)) *region = {Region::Ids{select(*region, mesh, "symmetry")}};
  }
  setup.variables.clear();
  return without_basis(std::move(setup));
}

/// The moved mesh, and the points before, after and at the best place so far, beside those of the full step.
std::size_t copies(const Mesh& mesh, const CellSet& cells) {
  return 5 * mesh.points.size() * sizeof(Vec3) + mesh.face_sizes.size() * sizeof(std::uint32_t) +
         mesh.face_points.size() * sizeof(PointId) + InversionCheck::bytes_for(cells);
}

/// Of the budget, for systems.
std::size_t left_of(const SplitProblem& problem) {
  if (problem.memory_budget == 0) return 0;
  const std::size_t needed = copies(*problem.mesh, problem.cells);
  if (needed < problem.memory_budget) return problem.memory_budget - needed;
  throw Error(ErrorCode::out_of_budget, "splitting needs " + std::to_string(needed) +
                                            " bytes for copies of the mesh, available are " +
                                            std::to_string(problem.memory_budget));
}

class Splitting {
 public:
  Splitting(const SplitProblem& problem, const SplitOptions& options, const RunContext& context)
      : problem_(problem),
        options_(options),
        context_(context),
        rest_(problem.mesh->points),
        regions_(validate(problem.setup, *problem.mesh)),
        setup_(with_explicit_regions(problem.setup, regions_, *problem.mesh)),
        budget_(left_of(problem)),
        check_(rest_, problem.cells, context) {}

  SplitResult run(const Design& design) {
    result_.at_rest = check_.at_rest();
    full_ = full_step(design);
    result_.full_step = check_.amplitude(rest_, full_, context_);
    const Inversions& inverted = result_.full_step.inverted;
    ++result_.reused;
    if (inverted.count == 0) {
      result_.attempts.push_back({1, 1, 0, inverted.least_determinant.value, {}});
      arrive({1, std::move(full_), {{1, result_.full_step.amplitude, inverted.least_determinant}}});
    } else {
      result_.attempts.push_back({1, 0, inverted.count, inverted.least_determinant.value, {}});
      best_.points = rest_;
      options_.mode == SplitMode::uniform ? uniform() : adaptive();
    }
    if (!result_.inversion_free) leave(std::move(best_));
    return std::move(result_);
  }

 private:
  /// Where a sequence of steps has led.
  struct Place {
    double fraction = 0;
    Points points;
    std::vector<Substep> substeps;
  };

  void leave(Place place) {
    result_.reached = place.fraction;
    result_.points = std::move(place.points);
    result_.substeps = std::move(place.substeps);
  }

  void arrive(Place place) {
    result_.inversion_free = true;
    result_.steps = place.substeps.size();
    leave(std::move(place));
  }

  Points full_step(const Design& design) {
    std::shared_ptr<const System> system = problem_.system;
    if (!system) {
      system = prepare(problem_.mesh, problem_.setup, context_, budget_);
      ++result_.factorizations;
    }
    return system->evaluate(design, context_);
  }

  Vec3 prescribed(PointId id, double fraction) const { return fraction == 1 ? full_[id] : lerp(rest_[id], full_[id], fraction); }

  /// Handles exactly where they belong, whatever was rounded on the way.
  void put_handles(double fraction, Points& points) const {
    for (const auto& handle : regions_.handles) {
      for (const PointId id : handle) points[id] = prescribed(id, fraction);
    }
  }

  /// A share of a step with a system at hand: its deformation is linear in the displacements.
  Points part_of(const Points& from, const Points& to, double share, double fraction) const {
    Points points(from.size());
    parallel_for(context_, points.size(), grain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) points[i] = lerp(from[i], to[i], share);
    });
    put_handles(fraction, points);
    return points;
  }

  /// A step with a system of its own, from anywhere.
  Points step(const Points& from, double fraction) {
    Mesh moved;
    moved.points = from;
    moved.face_sizes = problem_.mesh->face_sizes;
    moved.face_points = problem_.mesh->face_points;
    Design design;
    for (std::size_t h = 0; h < regions_.handles.size(); ++h) {
      std::vector<Vec3> displacements;
      bool moves = false;
      for (const PointId id : regions_.handles[h]) {
        const Vec3 to = prescribed(id, fraction);
        displacements.push_back({to[0] - from[id][0], to[1] - from[id][1], to[2] - from[id][2]});
        moves = moves || displacements.back() != Vec3{};
      }
      if (moves) design.motions.push_back({h, std::move(displacements)});
    }
    const auto system = prepare(std::make_shared<const Mesh>(std::move(moved)), setup_, context_, budget_);
    ++result_.factorizations;
    Points points = system->evaluate(design, context_);
    put_handles(fraction, points);
    return points;
  }

  /// The same; nothing where the mesh has moved so that it cannot be done: the reason is the attempt's failure.
  std::optional<Points> try_step(const Points& from, double fraction, SplitAttempt& attempt) {
    try {
      return step(from, fraction);
    } catch (const Error& error) {
      // The setup and the design were right at rest. Now places coincide that part again, or all lie in a plane.
      if (error.code() != ErrorCode::numerical_failure && error.code() != ErrorCode::invalid_argument) throw;
      attempt.failure = error.what();
      return std::nullopt;
    }
  }

  void keep_if_farther(Place place) {
    if (place.fraction > best_.fraction) best_ = std::move(place);
  }

  void uniform() {
    for (std::size_t n = 2; n <= options_.most_steps && !result_.inversion_free; ++n) {
      Place place = attempt(n);
      if (place.fraction == 1) {
        arrive(std::move(place));
      } else {
        result_.steps = n;
        keep_if_farther(std::move(place));
      }
    }
  }

  /// n equal steps, as far as nothing is inverted.
  Place attempt(std::size_t n) {
    SplitAttempt attempt{n, 0, 0, 1, {}};
    Place place{0, rest_, {}};
    for (std::size_t k = 1; k <= n; ++k) {
      context_.progress("split", place.fraction);
      const double fraction = k == n ? 1.0 : static_cast<double>(k) / static_cast<double>(n);
      std::optional<Points> next;
      if (k == 1) {
        next = part_of(rest_, full_, fraction, fraction);
        ++result_.reused;
      } else {
        next = try_step(place.points, fraction, attempt);
      }
      if (!next) break;
      const Inversions inverted = check_.inverted(*next, context_);
      attempt.inverted = inverted.count;
      attempt.least_determinant = inverted.least_determinant.value;
      if (inverted.count > 0) break;
      ++attempt.completed;
      // The first step is the beginning of the full one.
      const double amplitude = k == 1 ? std::min(1.0, result_.full_step.amplitude / fraction)
                                      : check_.amplitude(place.points, *next, context_).amplitude;
      place.substeps.push_back({fraction, amplitude, inverted.least_determinant});
      place.points = std::move(*next);
      place.fraction = fraction;
    }
    result_.attempts.push_back(std::move(attempt));
    return place;
  }

  /// Towards the end of the motion as far as the mesh bears it, again and again.
  void adaptive() {
    SplitAttempt& attempt = result_.attempts.front();
    Place place{0, rest_, {}};
    Points ahead = full_;  // at the end of all that remains
    SafeAmplitude safe = result_.full_step;
    while (attempt.steps < options_.most_steps) {
      context_.progress("split", place.fraction);
      const double share = options_.share * safe.amplitude, fraction = place.fraction + share * (1 - place.fraction);
      if (fraction - place.fraction < least_progress) break;
      Points next = part_of(place.points, ahead, share, fraction);
      const Inversions inverted = check_.inverted(next, context_);
      if (inverted.count > 0) break;  // by rounding of coordinates only
      ++attempt.completed;
      place.substeps.push_back({fraction, safe.amplitude, inverted.least_determinant});
      place.points = std::move(next);
      place.fraction = fraction;
      ++attempt.steps;
      std::optional<Points> end = try_step(place.points, 1, attempt);
      if (!end) break;
      ahead = std::move(*end);
      safe = check_.amplitude(place.points, ahead, context_);
      attempt.inverted = safe.inverted.count;
      attempt.least_determinant = safe.inverted.least_determinant.value;
      if (attempt.inverted > 0) continue;
      ++attempt.completed;
      place.substeps.push_back({1, safe.amplitude, safe.inverted.least_determinant});
      arrive({1, std::move(ahead), std::move(place.substeps)});
      return;
    }
    result_.steps = attempt.steps;
    keep_if_farther(std::move(place));
  }

  const SplitProblem& problem_;
  const SplitOptions& options_;
  const RunContext& context_;
  const Points& rest_;
  const SelectedRegions regions_;
  const Setup setup_;
  const std::size_t budget_;  ///< of a system
  const InversionCheck check_;
  Points full_;  ///< the whole motion in one step
  Place best_;   ///< the farthest without inversions
  SplitResult result_;
};

}  // namespace

void validate_split_options(const SplitOptions& options) {
  if (options.most_steps < 1 || options.most_steps > 1000) {
    throw Error(ErrorCode::invalid_argument,
                "splitting.most_steps: " + std::to_string(options.most_steps) + " is out of range 1..1000");
  }
  if (!(options.share > 0 && options.share < 1)) {
    throw Error(ErrorCode::invalid_argument,
                "splitting.share: " + number_digits(options.share) + " is out of range, must be between 0 and 1");
  }
}

SplitResult evaluate_split(const SplitProblem& problem, const Design& design, const SplitOptions& options,
                           const RunContext& context) {
  validate_split_options(options);
  return Splitting(problem, options, context).run(design);
}

Estimate estimate_substep(const Mesh& mesh, const Setup& setup, const CellSet& cells) {
  Estimate result = estimate(mesh, without_basis(setup));
  result.peak_bytes += copies(mesh, cells);
  result.resident_bytes = copies(mesh, cells);  // no system stays
  // Nominal rates of one current core: kernel values of every point and centre, cells looked at twice.
  const double pairs = static_cast<double>(mesh.point_count()) * static_cast<double>(result.size());
  const double bytes = static_cast<double>(InversionCheck::bytes_for(cells));
  result.seconds += (pairs / 8e8 + 1e-7 * bytes) / thread_count({});
  result.notes.push_back("This is for each step of a split motion after the first; how many there are is not known before.");
  return result;
}

}  // namespace deform
