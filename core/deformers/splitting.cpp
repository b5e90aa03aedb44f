// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/splitting.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <variant>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/composed/composed_setup.h"
#include "core/deformers/handles/handle_ways.h"
#include "core/deformers/methods.h"

namespace deform {

namespace {

constexpr std::size_t grain = 8192;
constexpr double least_progress = 1e-3;  // of the motion: smaller steps get ever smaller
constexpr int halvings = 10;             // of the way beyond the last sound place

/// Steps are prepared anew with the handles' points where they have come to: they must be points of the mesh.
void refuse_controls(const Setup& setup) {
  if (is_composed(setup)) {
    throw Error(ErrorCode::invalid_argument,
                "splitting: a setup with `then` is not cut into steps, because each method starts where those before it end; ask "
                "for smaller motions, or use a setup with one method");
  }
  if (!selects_controls(setup)) return;
  throw Error(
      ErrorCode::invalid_argument,
      "splitting: with control CONTROLS handles are control points, whose motions are not cut into steps; ask for smaller "
      "motions, or use a method whose handles are regions of the mesh");
}

SelectedRegions regions_of(const SplitProblem& problem) {
  refuse_controls(problem.setup);
  return validate(problem.setup, *problem.mesh);
}

/// Without a basis: the handles of a step move point by point.
Setup without_basis(Setup setup) {
  with_method(setup, []<Method M>(typename M::Options& options) { options.basis = BasisMode::never; });
  return setup;
}

/// All regions by their points at rest, so that the mesh may move.
Setup with_explicit_regions(Setup setup, const SelectedRegions& regions, const Mesh& mesh) {
  for (std::size_t h = 0; h < setup.handles.size(); ++h) setup.handles[h].region = {Region::Ids{regions.handles[h]}};
  setup.fixed.clear();
  if (!regions.fixed.empty()) setup.fixed.push_back({Region::Ids{regions.fixed}});
  for (std::size_t c = 0; c < setup.constraints.size(); ++c) {
    auto& own = setup.constraints[c].regions;
    for (std::size_t r = 0; r < own.size(); ++r) own[r] = {Region::Ids{regions.constraints[c][r]}};
  }
  for (const OptionRegion& option : option_regions(setup)) {
    *option.region = {Region::Ids{select(*option.region, mesh, option.field)}};
  }
  // Planes that were found are found again: their points keep their distances.
  for (auto& plane : setup.symmetry) {
    if (auto* region = std::get_if<Region>(&plane.kind)) *region = {Region::Ids{select(*region, mesh, "symmetry")}};
    if (auto* sector = std::get_if<SectorOptions>(&plane.kind)) sector->periodic.clear();  // partners stay partners
  }
  setup.variables.clear();
  // They are values of those variables.
  if (auto* samples = samples_of(setup.method)) samples->clear();
  return without_basis(std::move(setup));
}

/// The moved mesh, and the points before, after and at the best place so far, beside those of the full step.
std::size_t copies(const Mesh& mesh, const CellSet& cells) {
  return 6 * mesh.points.size() * sizeof(Vec3) + mesh.face_sizes.size() * sizeof(std::uint32_t) +
         mesh.face_points.size() * sizeof(PointId) + InversionCheck::bytes_to_make(cells, mesh.points.size());
}

/// The part of the memory budget that is left for systems.
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
        regions_(regions_of(problem)),
        setup_(with_explicit_regions(problem.setup, regions_, *problem.mesh)),
        budget_(left_of(problem)),
        check_(rest_, problem.cells, context) {}

  SplitResult run(const Design& design) {
    result_.at_rest = check_.at_rest();
    best_.points = rest_;
    take_full_step(design);
    result_.full_step = check_.amplitude(rest_, full_, context_);
    ++result_.reused;
    const Judged whole = judged(full_, result_.full_step.inverted);
    result_.attempts.push_back({1, whole.wrong == 0 ? 1u : 0u, whole.wrong, whole.inverted.least_determinant.value, {}});
    if (whole.wrong == 0) {
      arrive({1, std::move(full_), {{1, result_.full_step.amplitude, whole.inverted.least_determinant}}});
    } else {
      options_.mode == SplitMode::uniform ? uniform() : adaptive();
    }
    if (!result_.inversion_free) {
      go_farther();
      go_straight();
      leave(std::move(best_));
    }
    result_.least_determinant = check_.inverted(result_.points, context_).least_determinant;
    return std::move(result_);
  }

 private:
  /// Where a sequence of steps has led.
  struct Place {
    double fraction = 0;
    Points points;
    std::vector<Substep> substeps;
  };

  /// The result of the check at a state.
  struct Judged {
    Inversions inverted;
    std::size_t wrong = 0;  ///< cells that are inverted, or have less than the margin
  };

  Judged judged(const Points& points, Inversions inverted) const {
    const std::size_t below = inverted.count == 0 && inverted.least_determinant.value < options_.margin
                                  ? check_.below(options_.margin, rest_, points, context_)
                                  : 0;
    return {inverted, inverted.count + below};
  }
  Judged judged(const Points& points) const { return judged(points, check_.inverted(points, context_)); }

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

  void take_full_step(const Design& design) {
    from_rest_ = problem_.system;
    if (!from_rest_) {
      from_rest_ = prepare(problem_.mesh, problem_.setup, context_, budget_);
      ++result_.factorizations;
    }
    full_ = from_rest_->evaluate(design, context_);
    ways_.emplace(problem_.setup, regions_, *problem_.mesh, design, HandleWays::Kind::natural);
    if (leaves_the_plane()) ways_.emplace(problem_.setup, regions_, *problem_.mesh, design, HandleWays::Kind::straight);
  }

  /// Faces that are cells can be judged in their plane only.
  bool leaves_the_plane() const {
    if (ways_->straight() || !std::holds_alternative<const Mesh*>(problem_.cells)) return false;
    for (const double t : {0.25, 0.5, 0.75}) {
      Points moved = rest_;
      put_handles(t, moved);
      for (const auto& handle : regions_.handles) {
        for (const PointId id : handle) {
          if (std::abs(moved[id][2] - lerp(rest_[id], full_[id], t)[2]) > 1e-9 * bounding_box(rest_).diagonal()) return true;
        }
      }
    }
    return false;
  }

  Vec3 prescribed(PointId id, const std::optional<Affine>& motion, double fraction) const {
    if (fraction == 1) return full_[id];
    if (!motion || ways_->straight()) return lerp(rest_[id], full_[id], fraction);
    if (*motion == identity_affine) return rest_[id];
    const Vec3 to = transformed(*motion, rest_[id]);
    const unsigned on = regions_.symmetry.on(id);
    return on == 0 ? to : regions_.symmetry.slid(rest_[id], to, on);
  }

  /// Sets the handle points to their exact positions, without accumulated rounding.
  void put_handles(double fraction, Points& points) const {
    const auto motions = ways_->motions(fraction);
    for (std::size_t h = 0; h < regions_.handles.size(); ++h) {
      for (const PointId id : regions_.handles[h]) points[id] = prescribed(id, motions[h], fraction);
    }
  }

  /// The points between two places.
  Points between(const Points& from, const Points& to, double share) const {
    Points points(from.size());
    parallel_for(context_, points.size(), grain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) points[i] = lerp(from[i], to[i], share);
    });
    return points;
  }

  /// A place and the system that was prepared there: it can step to any fraction of the motion.
  class Start {
   public:
    Start(const Splitting& of, const Points& from, std::shared_ptr<const System> system, bool at_rest)
        : splitting_(&of), from_(&from), system_(std::move(system)), at_rest_(at_rest) {}

    Points step(double fraction) const {
      if (at_rest_ && splitting_->ways_->straight()) return splitting_->between(*from_, splitting_->full_, fraction);
      Points points =
          system_->evaluate(at_rest_ ? splitting_->ways_->design(fraction) : displacements(fraction), splitting_->context_);
      splitting_->put_handles(fraction, points);
      return points;
    }

   private:
    Design displacements(double fraction) const {
      Design design;
      const auto motions = splitting_->ways_->motions(fraction);
      for (std::size_t h = 0; h < splitting_->regions_.handles.size(); ++h) {
        std::vector<Vec3> displacements;
        bool moves = false;
        for (const PointId id : splitting_->regions_.handles[h]) {
          displacements.push_back(splitting_->prescribed(id, motions[h], fraction) - (*from_)[id]);
          moves = moves || displacements.back() != Vec3{};
        }
        if (moves) design.motions.push_back({h, std::move(displacements)});
      }
      return design;
    }

    const Splitting* splitting_;
    const Points* from_;
    std::shared_ptr<const System> system_;
    bool at_rest_;
  };

  Start start_at_rest() {
    ++result_.reused;
    return {*this, rest_, from_rest_, true};
  }

  /// std::nullopt if the mesh has moved such that no system can be prepared; the reason is stored in the attempt. `from` must
  /// outlive the result.
  std::optional<Start> start_at(const Points& from, SplitAttempt& attempt) {
    Mesh moved;
    moved.points = from;
    moved.face_sizes = problem_.mesh->face_sizes;
    moved.face_points = problem_.mesh->face_points;
    try {
      auto system = prepare(std::make_shared<const Mesh>(std::move(moved)), setup_, context_, budget_);
      ++result_.factorizations;
      return Start(*this, from, std::move(system), false);
    } catch (const Error& error) {
      note_failure(error, attempt);
      return std::nullopt;
    }
  }

  /// The setup and the design were right at rest. Now places coincide that part again, or all lie in a plane.
  static void note_failure(const Error& error, SplitAttempt& attempt) {
    if (error.code() != ErrorCode::numerical_failure && error.code() != ErrorCode::invalid_argument) throw error;
    attempt.failure = error.what();
  }

  static std::optional<Points> try_step(const Start& start, double fraction, SplitAttempt& attempt) {
    try {
      return start.step(fraction);
    } catch (const Error& error) {
      note_failure(error, attempt);
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
      const std::optional<Start> start = k == 1 ? start_at_rest() : start_at(place.points, attempt);
      std::optional<Points> next = start ? try_step(*start, fraction, attempt) : std::nullopt;
      if (!next) break;
      const Judged found = judged(*next);
      attempt.inverted = found.wrong;
      attempt.least_determinant = found.inverted.least_determinant.value;
      if (found.wrong > 0) break;
      ++attempt.completed;
      const double amplitude = k == 1 && ways_->straight() ? std::min(1.0, result_.full_step.amplitude / fraction)
                                                           : check_.amplitude(place.points, *next, context_).amplitude;
      place.substeps.push_back({fraction, amplitude, found.inverted.least_determinant});
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
    std::optional<Start> start = start_at_rest();
    --result_.reused;                        // that of the full step
    SafeAmplitude safe = result_.full_step;  // of the straight way to the end of all that remains
    while (start && attempt.steps < options_.most_steps) {
      context_.progress("split", place.fraction);
      // The straight way is safe so far; on arcs, and with a margin, it may have to be less.
      double step = options_.share * safe.amplitude * (1 - place.fraction), fraction = 0;
      std::optional<Points> next;
      Judged found;
      for (; step >= least_progress; step *= 0.5) {
        fraction = place.fraction + step;
        next = try_step(*start, fraction, attempt);
        if (!next) break;
        found = judged(*next);
        if (found.wrong == 0) break;
      }
      if (!next || step < least_progress) break;
      ++attempt.completed;
      place.substeps.push_back({fraction, safe.amplitude, found.inverted.least_determinant});
      place.points = std::move(*next);
      place.fraction = fraction;
      ++attempt.steps;
      start = start_at(place.points, attempt);
      std::optional<Points> end = start ? try_step(*start, 1, attempt) : std::nullopt;
      if (!end) break;
      safe = check_.amplitude(place.points, *end, context_);
      const Judged ahead = judged(*end, safe.inverted);
      attempt.inverted = ahead.wrong;
      attempt.least_determinant = safe.inverted.least_determinant.value;
      if (attempt.inverted > 0) continue;
      ++attempt.completed;
      place.substeps.push_back({1, safe.amplitude, safe.inverted.least_determinant});
      arrive({1, std::move(*end), std::move(place.substeps)});
      return;
    }
    result_.steps = attempt.steps;
    keep_if_farther(std::move(place));
  }

  /// Goes as far beyond the last valid state as one more step can, by bisection.
  void go_farther() {
    SplitAttempt ignored;
    const Points from = best_.points;
    const std::optional<Start> start = best_.fraction == 0 ? std::optional<Start>(start_at_rest()) : start_at(from, ignored);
    if (best_.fraction == 0) --result_.reused;
    const std::size_t steps = best_.substeps.size();
    double sound = best_.fraction, wrong = 1;
    for (int k = 0; start && k < halvings; ++k) {
      const double fraction = 0.5 * (sound + wrong);
      std::optional<Points> points = try_step(*start, fraction, ignored);
      const Judged found = points ? judged(*points) : Judged{{}, 1};
      (found.wrong == 0 ? sound : wrong) = fraction;
      if (found.wrong > 0) continue;
      if (best_.substeps.size() == steps) best_.substeps.emplace_back();
      best_.substeps.back() = {fraction, check_.amplitude(from, *points, context_).amplitude, found.inverted.least_determinant};
      best_.points = std::move(*points);
      best_.fraction = fraction;
    }
  }

  /// The straight path to the full step may be valid for longer: up to t*, less an allowance for rounding or a margin.
  void go_straight() {
    const auto sound = [&](double t) { return judged(between(rest_, full_, t)).wrong == 0; };
    double t = result_.full_step.amplitude;
    for (double less = 1e-15; t > best_.fraction && less < 1e-3 && !sound(t); less *= 4)
      t = result_.full_step.amplitude * (1 - less);
    if (t > best_.fraction && !sound(t)) {
      double low = best_.fraction, high = t;
      for (int k = 0; k < halvings; ++k) (sound(0.5 * (low + high)) ? low : high) = 0.5 * (low + high);
      t = low;
    }
    if (!(t > best_.fraction)) return;
    Points points = between(rest_, full_, t);
    const Judged found = judged(points);
    best_ = {t, std::move(points), {{t, std::min(1.0, result_.full_step.amplitude / t), found.inverted.least_determinant}}};
    result_.straight = true;
  }

  const SplitProblem& problem_;
  const SplitOptions& options_;
  const RunContext& context_;
  const Points& rest_;
  const SelectedRegions regions_;
  const Setup setup_;
  const std::size_t budget_;  ///< of a system
  const InversionCheck check_;
  std::shared_ptr<const System> from_rest_;
  std::optional<HandleWays> ways_;
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
  if (!(options.margin >= 0 && options.margin < 1)) {
    throw Error(ErrorCode::invalid_argument,
                "splitting.margin: " + number_digits(options.margin) + " is out of range, must be from 0 to below 1");
  }
}

SplitResult evaluate_split(const SplitProblem& problem, const Design& design, const SplitOptions& options,
                           const RunContext& context) {
  validate_split_options(options);
  return Splitting(problem, options, context).run(design);
}

Estimate estimate_substep(const Mesh& mesh, const Setup& setup, const CellSet& cells) {
  refuse_controls(setup);
  Estimate result = estimate(mesh, without_basis(setup));
  result.peak_bytes += copies(mesh, cells);
  result.resident_bytes = copies(mesh, cells);  // no system stays
  // Nominal rates of one current core: kernel values of every point and centre, cells looked at twice.
  const double pairs = static_cast<double>(mesh.point_count()) * static_cast<double>(result.size());
  const double bytes = static_cast<double>(InversionCheck::bytes_for(cells, mesh.points.size()));
  result.seconds += (pairs / 8e8 + 3e-8 * bytes) / thread_count({});
  result.notes.push_back("This is for each step of a split motion after the first; how many there are is not known before.");
  return result;
}

}  // namespace deform
