// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/composed/composed_system.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <variant>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/option_checks.h"
#include "core/deformers/space_map.h"
#include "core/numerics/interpolation/solver.h"
#include "core/numerics/sampling/point_tree.h"

namespace deform {

namespace {

constexpr std::size_t composed_points_per_task = 512;
/// By how much an error of the points of a handle that is turned may grow between these, where their displacements are
/// interpolated or extrapolated.
constexpr double carried_growth = 4;
constexpr std::size_t most_near_points = 65536;  // among which those near control points are looked for

/// The linear part of M - 1, row by row; of a rate M itself.
std::array<double, 9> linear_part(const Affine& map, double unit) {
  std::array<double, 9> part{};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) part[3 * i + j] = map[4 * i + j] - (i == j ? unit : 0);
  }
  return part;
}

bool is_translation(const Affine& map) { return linear_part(map, 1) == std::array<double, 9>{}; }

double size_of(const std::array<double, 9>& part) {
  double sum = 0;
  for (const double value : part) sum += value * value;
  return std::sqrt(sum);
}

Vec3 times(const std::array<double, 9>& a, const Vec3& v) {
  return {a[0] * v[0] + a[1] * v[1] + a[2] * v[2], a[3] * v[0] + a[4] * v[1] + a[5] * v[2],
          a[6] * v[0] + a[7] * v[1] + a[8] * v[2]};
}

/// Runs of consecutive ids, each for one task: first and one behind the last position.
std::vector<std::pair<std::size_t, std::size_t>> runs(std::span<const PointId> ids) {
  std::vector<std::pair<std::size_t, std::size_t>> result;
  for (std::size_t i = 0; i < ids.size();) {
    std::size_t end = i + 1;
    while (end < ids.size() && end - i < composed_points_per_task && ids[end] == ids[end - 1] + 1) ++end;
    result.emplace_back(i, end);
    i = end;
  }
  return result;
}

/// Adds to `out` the displacements of points [begin, end) by an evaluation.
void add_displacements(const Evaluation& evaluation, const Mesh& mesh, std::size_t begin, std::size_t end, std::size_t first,
                       std::span<Vec3* const> out) {
  std::vector<Vec3> places((end - begin) * out.size());
  std::vector<Vec3*> to(out.size());
  for (std::size_t d = 0; d < out.size(); ++d) to[d] = places.data() + d * (end - begin);
  evaluation.evaluate(begin, end, first, to);
  for (std::size_t d = 0; d < out.size(); ++d) {
    for (std::size_t i = 0; i < end - begin; ++i) out[d][i] = out[d][i] + (to[d][i] - mesh.points[begin + i]);
  }
}

/// The fields of all methods, one after the other.
class ComposedFields : public DisplacementFields {
 public:
  explicit ComposedFields(std::vector<std::unique_ptr<const DisplacementFields>> parts) : parts_(std::move(parts)) {}

  std::size_t count() const override {
    std::size_t sum = 0;
    for (const auto& part : parts_) sum += part->count();
    return sum;
  }
  void values(std::size_t first, std::size_t count, std::span<double> values, const RunContext& context) const override {
    const std::size_t points = count == 0 ? 0 : values.size() / count;
    std::size_t start = 0;
    for (const auto& part : parts_) {
      const std::size_t low = std::max(first, start), high = std::min(first + count, start + part->count());
      if (low < high) {
        std::vector<double> own(points * (high - low));
        part->values(low - start, high - low, own, context);
        for (std::size_t i = 0; i < points; ++i) {
          std::copy_n(own.data() + i * (high - low), high - low, values.data() + i * count + (low - first));
        }
      }
      start += part->count();
    }
  }
  double error(std::size_t field) const override {
    std::size_t part = 0;
    while (field >= parts_[part]->count()) field -= parts_[part++]->count();
    return parts_[part]->error(field);
  }

 private:
  const std::vector<std::unique_ptr<const DisplacementFields>> parts_;
};

}  // namespace

/// Designs bound to a ComposedSystem.
class ComposedEvaluation : public Evaluation {
 public:
  ComposedEvaluation(std::shared_ptr<const ComposedSystem> system, ComposedSystem::Bound bound)
      : system_(std::move(system)), bound_(std::move(bound)) {}

  std::size_t design_count() const override { return bound_.reports.size(); }
  const DesignReport& report(std::size_t design) const override { return bound_.reports[design]; }
  void evaluate(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const override {
    bound_.evaluations[0]->evaluate(begin, end, first, out);
    for (std::size_t s = 1; s < bound_.evaluations.size(); ++s) {
      add_displacements(*bound_.evaluations[s], *system_->mesh_, begin, end, first, out);
    }
  }
  /// The roundings of the points of a method are those of its displacements and of the sums with them.
  std::optional<FieldMotion> field_motion(std::size_t design) const override {
    FieldMotion sum;
    for (const auto& evaluation : bound_.evaluations) {
      const auto own = evaluation->field_motion(design);
      if (!own) return std::nullopt;
      sum.coefficients.insert(sum.coefficients.end(), own->coefficients.begin(), own->coefficients.end());
      sum.uncertainties.insert(sum.uncertainties.end(), own->uncertainties.begin(), own->uncertainties.end());
      sum.rounding += 2 * own->rounding;
    }
    return sum;
  }

 private:
  const std::shared_ptr<const ComposedSystem> system_;
  const ComposedSystem::Bound bound_;
};

/// A design of a ComposedSystem as a map of space: the displacements of all methods at a place are added.
class ComposedMap : public SpaceMap {
 public:
  ComposedMap(std::shared_ptr<const ComposedSystem> system, std::vector<std::unique_ptr<const SpaceMap>> maps,
              DesignReport report)
      : system_(std::move(system)), maps_(std::move(maps)), report_(std::move(report)) {}

  const DesignReport& report() const override { return report_; }
  Found evaluate(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                 const RunContext& context) const override {
    Found found = maps_[0]->evaluate(points, first, out, context);
    std::vector<Vec3> to(points.size());
    for (std::size_t s = 1; s < maps_.size(); ++s) {
      const Found own = maps_[s]->evaluate(points, first, to, context);
      found.still = std::max(found.still, own.still);
      found.sums_error += own.sums_error;
      for (std::size_t i = 0; i < points.size(); ++i) out[i] = out[i] + (to[i] - points[i]);
    }
    return found;
  }

 private:
  const std::shared_ptr<const ComposedSystem> system_;
  const std::vector<std::unique_ptr<const SpaceMap>> maps_;
  const DesignReport report_;
};

ComposedSystem::ComposedSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context,
                               std::size_t memory_budget, const ControlPlaces& control_places)
    : mesh_(std::move(mesh)), setup_(setup), regions_(validate(setup_, *mesh_)) {
  std::size_t resident = 0;
  for (std::size_t s = 0; s <= setup_.then.size(); ++s) {
    Prepared& stage = stages_.emplace_back();
    stage.of = stage_setup(setup_, s);
    RunContext own = context;
    if (context.on_progress && s > 0) {
      own.on_progress = [&context, s](const std::string& name, double fraction) {
        context.on_progress(stage_field(s) + " " + name, fraction);
      };
    }
    // What the methods before have taken; the whole has been compared with the budget.
    const std::size_t left = memory_budget == 0 ? 0 : std::max<std::size_t>(1, memory_budget - std::min(memory_budget, resident));
    try {
      stage.system = prepare(mesh_, stage.of.setup, own, left);
    } catch (const Error& error) {
      if (s == 0) throw;
      throw Error(error.code(), stage_field(s) + ": " + error.what(), error.retry_after_ms());
    }
    resident += stage.system->bytes();
    if (s > 0 && regions_.stages[s].of == SelectedRegions::Of::control_points) find_near_points(s, control_places);
  }
  fill_info();
}

void ComposedSystem::fill_info() {
  info_ = stages_.front().system->info();
  const bool all_bases =
      std::all_of(stages_.begin(), stages_.end(), [](const Prepared& stage) { return stage.system->info().basis_fields > 0; });
  for (std::size_t s = 1; s < stages_.size(); ++s) add_stage_info(s);
  if (!all_bases) info_.basis_fields = 0;
  // Points of the mesh that a method holds.
  std::vector<char> handled(mesh_->point_count()), fixed(mesh_->point_count(), 1);
  for (const SelectedRegions& regions : regions_.stages) {
    if (regions.of != SelectedRegions::Of::mesh_points) return;  // then counts are those of the methods
    std::vector<char> fixed_here(mesh_->point_count());
    for (const PointId id : regions.fixed) fixed_here[id] = 1;
    for (const auto& handle : regions.handles) {
      for (const PointId id : handle) handled[id] = 1;
    }
    for (std::size_t i = 0; i < fixed.size(); ++i) fixed[i] = fixed[i] != 0 && fixed_here[i] != 0 ? 1 : 0;
  }
  info_.handle_points = static_cast<std::size_t>(std::count(handled.begin(), handled.end(), 1));
  info_.fixed_points = static_cast<std::size_t>(std::count(fixed.begin(), fixed.end(), 1));
  info_.deformable_points = info_.points - info_.handle_points - info_.fixed_points;
}

void ComposedSystem::add_stage_info(std::size_t stage) {
  const SystemInfo& own = stages_[stage].system->info();
  info_.handle_points += own.handle_points;
  info_.fixed_points += own.fixed_points;
  info_.constraint_points += own.constraint_points;
  info_.centres += own.centres;
  info_.held_points += own.held_points;
  info_.samples += own.samples;
  info_.functions += own.functions;
  info_.cubature_points += own.cubature_points;
  info_.merged_duplicates += own.merged_duplicates;
  info_.polynomial_terms = std::max(info_.polynomial_terms, own.polynomial_terms);
  info_.basis_fields += own.basis_fields;
  info_.bytes += own.bytes;
  info_.factor_bytes += own.factor_bytes;
  info_.basis_bytes += own.basis_bytes;
  info_.design_bytes += own.design_bytes;
  info_.condition = std::max(info_.condition, own.condition);
  info_.tolerance = std::max(info_.tolerance, own.tolerance);
  info_.reduced = info_.reduced || own.reduced;
  info_.reduction_tolerance = std::max(info_.reduction_tolerance, own.reduction_tolerance);
  info_.reduction_misfit = std::max(info_.reduction_misfit, own.reduction_misfit);
  info_.reduction_error += own.reduction_error;
  const std::string field = stage_field(stage);
  for (const std::string& note : own.notes) info_.notes.push_back(field + ": " + note);
  for (const auto& [name, seconds] : own.stage_seconds) info_.stage_seconds.emplace_back(field + " " + name, seconds);
}

void ComposedSystem::find_near_points(std::size_t stage, const ControlPlaces& control_places) {
  Prepared& prepared = stages_[stage];
  const SelectedRegions& regions = regions_.stages[stage];
  const std::size_t stride = 1 + (mesh_->point_count() - 1) / most_near_points;
  std::vector<Vec3> some;
  for (std::size_t i = 0; i < mesh_->point_count(); i += stride) some.push_back(mesh_->points[i]);
  const PointTree tree(some);
  const std::vector<Vec3> all = control_places(prepared.of.setup, *mesh_, regions.symmetry);
  for (const auto& handle : regions.handles) {
    std::vector<Vec3>& places = prepared.controls.emplace_back();
    for (const PointId id : handle) places.push_back(all[id]);
    std::vector<PointId>& near = prepared.near.emplace_back();
    for (const Vec3& place : places) near.push_back(static_cast<PointId>(stride * tree.nearest(place).point));
  }
}

std::vector<Affine> ComposedSystem::checked_maps(const Design& design, std::size_t index) const {
  const std::string field = "designs[" + std::to_string(index) + "].";
  std::vector<Affine> maps(setup_.handles.size(), identity_affine);
  if (!design.variables.empty()) {
    try {
      maps = handle_motions(setup_, design.variables);
    } catch (const Error& error) {
      throw Error(error.code(), field + error.what());
    }
  }
  std::vector<char> moved(setup_.handles.size());
  for (std::size_t k = 0; k < design.motions.size(); ++k) {
    const Motion& motion = design.motions[k];
    const std::string what = field + "motions[" + std::to_string(k) + "]";
    if (motion.handle >= setup_.handles.size()) {
      refuse_argument(what + ".handle: " + std::to_string(motion.handle) + " is out of range, the setup has " +
                      std::to_string(setup_.handles.size()) + " handles");
    }
    const std::string name = what + " (handle \"" + setup_.handles[motion.handle].name + "\")";
    if (moved[motion.handle]++ != 0) refuse_argument(name + ": the handle has two motions");
    if (maps[motion.handle] != identity_affine) {
      refuse_argument(name + ": the handle is moved by design variables as well; set those to 0");
    }
    if (const auto* map = std::get_if<Affine>(&motion.value)) maps[motion.handle] = *map;
  }
  return maps;
}

std::vector<Vec3> ComposedSystem::places(const Bound& bound, std::size_t stages, std::size_t design, std::span<const PointId> ids,
                                         const RunContext& context) const {
  std::vector<Vec3> result(ids.size());
  if (stages == 0) {
    for (std::size_t i = 0; i < ids.size(); ++i) result[i] = mesh_->points[ids[i]];
    return result;
  }
  const auto parts = runs(ids);
  parallel_for(context, parts.size(), 64, [&](std::size_t begin, std::size_t end) {
    for (std::size_t r = begin; r < end; ++r) {
      Vec3* out = result.data() + parts[r].first;
      const std::size_t from = ids[parts[r].first], to = from + (parts[r].second - parts[r].first);
      const std::span<Vec3* const> one(&out, 1);
      bound.evaluations[0]->evaluate(from, to, design, one);
      for (std::size_t s = 1; s < stages; ++s) {
        add_displacements(*bound.evaluations[s], *mesh_, from, to, design, one);
      }
    }
  });
  return result;
}

Design ComposedSystem::stage_design(const Design& design, std::size_t index, std::size_t stage, const Bound& before,
                                    EvaluationPath path, const RunContext& context) const {
  const StageSetup& of = stages_[stage].of;
  const SelectedRegions& regions = regions_.stages[stage];
  const std::size_t count = of.setup.handles.size();
  const std::vector<Affine> maps = checked_maps(design, index);
  Design own;
  own.variables = of.own(design.variables);
  for (const Motion& motion : design.motions) {
    if (motion.handle < of.first_handle || motion.handle >= of.first_handle + count) continue;
    own.motions.push_back({motion.handle - of.first_handle, motion.value});
  }
  // Methods without a tolerance would refuse it; if there is no other, the first does.
  const auto takes = [](const Prepared& prepared) { return to_tolerance(prepared.system->info().solver); };
  if (takes(stages_[stage]) || (stage == 0 && std::none_of(stages_.begin(), stages_.end(), takes))) {
    own.tolerance = design.tolerance;
  }
  if (stage == 0 || regions.of != SelectedRegions::Of::mesh_points) return own;

  std::vector<std::vector<Vec3>> turned(count);
  bool any = false;
  for (std::size_t h = 0; h < count; ++h) {
    const Affine& map = maps[of.first_handle + h];
    if (is_translation(map)) continue;  // or displacements
    const std::vector<PointId>& ids = regions.handles[h];
    const std::vector<Vec3> at = places(before, stage, index, ids, context);
    bool moved = false;
    for (std::size_t i = 0; i < ids.size(); ++i) moved = moved || at[i] != mesh_->points[ids[i]];
    if (!moved) continue;
    if (path == EvaluationPath::basis) {
      refuse_argument("designs[" + std::to_string(index) + "]: path BASIS, but handle \"" + of.setup.handles[h].name + "\" of " +
                      stage_field(stage) +
                      " is turned or scaled where the methods before have moved it, which is no affine motion of its points at "
                      "rest; use the path DIRECT");
    }
    for (const Vec3& y : at) turned[h].push_back(transformed(map, y) - y);
    any = true;
  }
  if (!any) return own;
  std::vector<Motion> motions;
  for (std::size_t h = 0; h < count; ++h) {
    const auto given =
        std::find_if(own.motions.begin(), own.motions.end(), [&](const Motion& motion) { return motion.handle == h; });
    if (!turned[h].empty()) {
      motions.push_back({h, std::move(turned[h])});
    } else if (given != own.motions.end()) {
      motions.push_back(*given);
    } else if (maps[of.first_handle + h] != identity_affine) {
      motions.push_back({h, maps[of.first_handle + h]});
    }
  }
  own.variables.clear();
  own.motions = std::move(motions);
  return own;
}

void ComposedSystem::add_report(const Bound& bound, std::size_t stage, std::size_t index, DesignReport& report) const {
  const DesignReport& own = bound.evaluations[stage]->report(index);
  if (stage == 0) {
    report = own;
    return;
  }
  const Design& design = bound.designs[stage][index];
  double turning = 0;  // largest |A - 1| of the handles that start from points with errors
  for (const Motion& motion : design.motions) {
    if (!std::holds_alternative<std::vector<Vec3>>(motion.value)) continue;
    turning = std::max(turning, size_of(linear_part(bound.maps[index][stages_[stage].of.first_handle + motion.handle], 1)));
  }
  if (own.path == EvaluationPath::direct) report.path = EvaluationPath::direct;
  report.error = report.error * (1 + carried_growth * turning) + own.error;
  report.interpolation_residual = std::max(report.interpolation_residual, own.interpolation_residual);
  report.control_displacement = std::max(report.control_displacement, own.control_displacement);
  report.misfit = std::max(report.misfit, own.misfit);
  report.torn_edges += own.torn_edges;
  const bool both = (report.converged || report.at_rounding) && (own.converged || own.at_rounding);
  report.converged = report.converged && own.converged;
  report.at_rounding = both && !report.converged;
  for (const std::string& warning : own.warnings) report.warnings.push_back(stage_field(stage) + ": " + warning);
}

double ComposedSystem::prescribed_displacement(const Bound& bound, const Design& design, std::size_t index,
                                               const RunContext& context) const {
  std::vector<Motion> motions;
  for (std::size_t h = 0; h < setup_.handles.size(); ++h) motions.push_back({h, bound.maps[index][h]});
  for (const Motion& motion : design.motions) motions[motion.handle] = motion;
  const auto moves = [](const Motion& motion) {
    const auto* given = std::get_if<std::vector<Vec3>>(&motion.value);
    if (given == nullptr) return std::get<Affine>(motion.value) != identity_affine;
    return std::any_of(given->begin(), given->end(), [](const Vec3& u) { return u != Vec3{}; });
  };
  std::vector<char> counted(mesh_->point_count());
  double largest = 0;
  for (std::size_t s = stages_.size(); s-- > 0;) {
    const std::size_t first = stages_[s].of.first_handle;
    for (std::size_t h = first; h < first + stages_[s].of.setup.handles.size(); ++h) {
      if (!moves(motions[h])) continue;
      if (regions_.stages[s].of == SelectedRegions::Of::control_points) {
        largest = std::max(largest, control_displacement(bound, index, s, h, motions[h], context));
        continue;
      }
      const std::vector<PointId>& all = regions_.handles[h];
      std::vector<PointId> ids;
      std::vector<std::size_t> ranks;
      for (std::size_t i = 0; i < all.size(); ++i) {
        if (counted[all[i]]++ != 0) continue;
        ids.push_back(all[i]);
        ranks.push_back(i);
      }
      const std::vector<Vec3> at = places(bound, s, index, ids, context);
      const auto* given = std::get_if<std::vector<Vec3>>(&motions[h].value);
      for (std::size_t i = 0; i < ids.size(); ++i) {
        const Vec3& rest = mesh_->points[ids[i]];
        const Vec3 to = given != nullptr ? at[i] + (*given)[ranks[i]] : transformed(std::get<Affine>(motions[h].value), at[i]);
        largest = std::max(largest, distance(to, rest));
      }
    }
  }
  return largest;
}

double ComposedSystem::control_displacement(const Bound& bound, std::size_t index, std::size_t stage, std::size_t handle,
                                            const Motion& motion, const RunContext& context) const {
  if (stage == 0) return bound.evaluations[0]->report(index).prescribed_displacement;
  const std::size_t own = handle - stages_[stage].of.first_handle;
  const std::vector<Vec3>& controls = stages_[stage].controls[own];
  const std::vector<PointId>& near = stages_[stage].near[own];
  const auto* given = std::get_if<std::vector<Vec3>>(&motion.value);
  double largest = 0;
  for (std::size_t i = 0; i < controls.size(); ++i) {
    const Vec3 u = given != nullptr ? (*given)[i] : transformed(std::get<Affine>(motion.value), controls[i]) - controls[i];
    const Vec3 before = places(bound, stage, index, {&near[i], 1}, context)[0] - mesh_->points[near[i]];
    largest = std::max(largest, norm(before + u));
  }
  return largest;
}

ComposedSystem::Bound ComposedSystem::bind_stages(std::span<const Design> designs, std::size_t stages, EvaluationPath path,
                                                  const RunContext& context) const {
  Bound bound;
  bound.reports.resize(designs.size());
  for (std::size_t i = 0; i < designs.size(); ++i) bound.maps.push_back(checked_maps(designs[i], i));
  for (std::size_t s = 0; s < stages; ++s) {
    std::vector<Design> own;
    for (std::size_t i = 0; i < designs.size(); ++i) {
      context.check();
      own.push_back(stage_design(designs[i], i, s, bound, path, context));
    }
    bound.evaluations.push_back(stages_[s].system->bind(own, path, context));
    bound.designs.push_back(std::move(own));
    for (std::size_t i = 0; i < designs.size(); ++i) add_report(bound, s, i, bound.reports[i]);
  }
  if (stages < stages_.size()) return bound;  // to go on from
  for (std::size_t i = 0; i < designs.size(); ++i) {
    context.check();
    bound.reports[i].prescribed_displacement = prescribed_displacement(bound, designs[i], i, context);
  }
  return bound;
}

std::unique_ptr<const Evaluation> ComposedSystem::bind(std::span<const Design> designs, EvaluationPath path,
                                                       const RunContext& context) const {
  Bound bound = bind_stages(designs, stages_.size(), path, context);
  bound.designs.clear();  // of which the evaluations have copies
  return std::make_unique<ComposedEvaluation>(std::static_pointer_cast<const ComposedSystem>(shared_from_this()),
                                              std::move(bound));
}

std::unique_ptr<const SpaceMap> ComposedSystem::bind_in_space(const Design& design, const RunContext& context) const {
  const Bound bound = bind_stages({&design, 1}, stages_.size(), EvaluationPath::direct, context);
  std::vector<std::unique_ptr<const SpaceMap>> maps;
  for (std::size_t s = 0; s < stages_.size(); ++s) {
    try {
      maps.push_back(stages_[s].system->bind_in_space(bound.designs[s][0], context));
    } catch (const Error& error) {
      if (s == 0) throw;
      throw Error(error.code(), stage_field(s) + ": " + error.what(), error.retry_after_ms());
    }
  }
  return std::make_unique<ComposedMap>(std::static_pointer_cast<const ComposedSystem>(shared_from_this()), std::move(maps),
                                       bound.reports[0]);
}

System::SpaceBytes ComposedSystem::space_bytes(std::size_t points) const {
  SpaceBytes sum;
  for (const Prepared& stage : stages_) {
    const SpaceBytes own = stage.system->space_bytes(points);
    sum.map += own.map;
    sum.call += own.call;
  }
  sum.call += points * sizeof(Vec3);
  return sum;
}

std::unique_ptr<const DisplacementFields> ComposedSystem::displacement_fields() const {
  std::vector<std::unique_ptr<const DisplacementFields>> parts;
  for (const Prepared& stage : stages_) {
    parts.push_back(stage.system->displacement_fields());
    if (parts.back() == nullptr) return nullptr;
  }
  return std::make_unique<ComposedFields>(std::move(parts));
}

std::vector<std::vector<ComposedSystem::Turned>> ComposedSystem::turned_at(std::span<const double> variables,
                                                                           const RunContext& context) const {
  const std::vector<Affine> maps = handle_motions(setup_, variables);
  std::vector<char> turns(setup_.handles.size());
  for (std::size_t h = 0; h < maps.size(); ++h) turns[h] = is_translation(maps[h]) ? 0 : 1;
  for (std::size_t k = 0; k < setup_.variables.size(); ++k) {
    const std::vector<Affine> rates = handle_motion_derivative(setup_, variables, k);
    for (std::size_t h = 0; h < rates.size(); ++h) {
      if (linear_part(rates[h], 0) != std::array<double, 9>{}) turns[h] = 1;
    }
  }
  std::vector<std::vector<Turned>> result(stages_.size());
  std::size_t last = 0;  // method with such handles
  for (std::size_t s = 1; s < stages_.size(); ++s) {
    if (regions_.stages[s].of != SelectedRegions::Of::mesh_points) continue;
    const std::size_t first = stages_[s].of.first_handle;
    for (std::size_t h = first; h < first + stages_[s].of.setup.handles.size(); ++h) {
      if (turns[h] == 0) continue;
      result[s].push_back({h, maps[h], {}});
      last = s;
    }
  }
  if (last == 0) return result;
  const Design design{{variables.begin(), variables.end()}, {}};
  const Bound bound = bind_stages({&design, 1}, last, EvaluationPath::automatic, context);
  for (std::size_t s = last; s > 0; --s) {
    for (Turned& turned : result[s]) turned.at = places(bound, s, 0, regions_.handles[turned.handle], context);
  }
  return result;
}

/// The data are a linear function of displacements of the handle points, so that the method gives the derivative for theirs. Of
/// the size of the model, these do not drown in the roundings of the points.
Points ComposedSystem::turned_product(std::size_t stage, const std::vector<Affine>& rates, const std::vector<Turned>& turned,
                                      const Points& before, const RunContext& context) const {
  const StageSetup& of = stages_[stage].of;
  std::vector<std::vector<Vec3>> by_point(of.setup.handles.size());
  double largest = 0;
  const auto include = [&](const Vec3& u) { largest = std::max(largest, norm(u)); };
  for (const Turned& handle : turned) {
    const std::vector<PointId>& ids = regions_.handles[handle.handle];
    const std::array<double, 9> linear = linear_part(handle.map, 1);
    for (std::size_t i = 0; i < ids.size(); ++i) {
      by_point[handle.handle - of.first_handle].push_back(transformed(rates[handle.handle], handle.at[i]) +
                                                          times(linear, before[ids[i]]));
      include(by_point[handle.handle - of.first_handle].back());
    }
  }
  for (std::size_t h = 0; h < by_point.size(); ++h) {
    if (by_point[h].empty())
      include({rates[of.first_handle + h][3], rates[of.first_handle + h][7], rates[of.first_handle + h][11]});
  }
  Points field(mesh_->point_count());
  if (largest == 0) return field;
  const double scale = info_.diagonal / largest;
  Design design;
  if (stages_[stage].system->info().solver == Solver::iterative) design.tolerance = least_tolerance;
  for (std::size_t h = 0; h < by_point.size(); ++h) {
    if (by_point[h].empty()) {
      const Affine& rate = rates[of.first_handle + h];
      if (rate == Affine{}) continue;
      Affine map = identity_affine;
      for (const std::size_t k : {3, 7, 11}) map[k] = scale * rate[k];
      design.motions.push_back({h, map});
      continue;
    }
    for (Vec3& u : by_point[h]) u = scale * u;
    design.motions.push_back({h, std::move(by_point[h])});
  }
  const Points moved = stages_[stage].system->evaluate(design, context);
  for (std::size_t i = 0; i < field.size(); ++i) field[i] = (moved[i] - mesh_->points[i]) / scale;
  return field;
}

Points ComposedSystem::product(std::span<const double> variables, std::span<const double> direction,
                               const std::vector<std::vector<Turned>>& turned, const RunContext& context) const {
  const std::vector<Affine> rates = motion_derivative(setup_, variables, direction);
  Points sum(mesh_->point_count());
  for (std::size_t s = 0; s < stages_.size(); ++s) {
    const StageSetup& of = stages_[s].of;
    if (of.variables.empty() && turned[s].empty()) continue;
    const Points own = turned[s].empty() ? stages_[s].system->jacobian_vector(of.own(variables), of.own(direction), context)
                                         : turned_product(s, rates, turned[s], sum, context);
    for (std::size_t i = 0; i < sum.size(); ++i) sum[i] = sum[i] + own[i];
  }
  return sum;
}

Points ComposedSystem::jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                                       const RunContext& context) const {
  return product(variables, direction, turned_at(variables, context), context);
}

std::vector<double> ComposedSystem::vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                                    const RunContext& context) const {
  return vector_jacobians(variables, {&cotangent, 1}, context).front();
}

std::vector<std::vector<double>> ComposedSystem::vector_jacobians(std::span<const double> variables,
                                                                  std::span<const Points> cotangents,
                                                                  const RunContext& context) const {
  for (const Points& cotangent : cotangents) check_cotangent(cotangent, mesh_->point_count());
  const std::vector<std::vector<Turned>> turned = turned_at(variables, context);
  std::vector<std::vector<double>> gradients(cotangents.size(), std::vector<double>(setup_.variables.size()));
  const bool independent = std::all_of(turned.begin(), turned.end(), [](const auto& handles) { return handles.empty(); });
  if (independent) {
    for (const Prepared& stage : stages_) {
      if (stage.of.variables.empty()) continue;
      const auto own = stage.system->vector_jacobians(stage.of.own(variables), cotangents, context);
      for (std::size_t j = 0; j < own.size(); ++j) {
        for (std::size_t k = 0; k < own[j].size(); ++k) gradients[j][stage.of.variables[k]] += own[j][k];
      }
    }
    return gradients;
  }
  for (std::size_t k = 0; k < setup_.variables.size(); ++k) {
    context.check();
    std::vector<double> direction(setup_.variables.size());
    direction[k] = 1;
    const Points column = product(variables, direction, turned, context);
    for (std::size_t j = 0; j < cotangents.size(); ++j) {
      for (std::size_t i = 0; i < column.size(); ++i) gradients[j][k] += dot(column[i], cotangents[j][i]);
    }
  }
  return gradients;
}

}  // namespace deform
