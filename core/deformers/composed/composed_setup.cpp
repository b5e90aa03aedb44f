// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/composed/composed_setup.h"

#include <algorithm>
#include <optional>
#include <set>
#include <utility>

#include "core/base/error.h"
#include "core/deformers/option_checks.h"

namespace deform {

namespace {

/// How a variable moves the handles of `names`: the first as its handle, the others in `also`. None if it moves none of them.
std::optional<DesignVariable> on_handles(const DesignVariable& variable, const std::set<std::string>& names) {
  std::vector<DrivenHandle> driven;
  if (names.contains(variable.handle)) driven.push_back({variable.handle, variable.kind});
  for (const DrivenHandle& other : variable.also) {
    if (names.contains(other.handle)) driven.push_back(other);
  }
  if (driven.empty()) return std::nullopt;
  DesignVariable result{variable.name, driven.front().handle, driven.front().kind, variable.lower, variable.upper};
  result.also.assign(driven.begin() + 1, driven.end());
  return result;
}

/// The samples of a method for its own variables. Those that do not move its handles say nothing about it.
void reduce_samples(StageSetup& stage, std::size_t all) {
  auto* const samples = samples_of(stage.setup.method);
  if (samples == nullptr) return;
  std::vector<std::vector<double>> reduced;
  for (const std::vector<double>& sample : *samples) {
    if (sample.size() != all) return;  // which is refused
    std::vector<double> own = stage.own(sample);
    if (std::any_of(own.begin(), own.end(), [](double value) { return value != 0; })) reduced.push_back(std::move(own));
  }
  *samples = std::move(reduced);
}

/// A message about a stage that names a field of its setup, or its prefix before one that does not.
std::string about_stage(std::size_t stage, const std::string& message) {
  if (stage == 0) return message;
  for (const char* field : {"method.", "fixed[", "handles"}) {
    if (message.starts_with(field)) return stage_field(stage) + "." + message;
  }
  return stage_field(stage) + ": " + message;
}

/// The problems of a stage that are known, under the names that they have in its own setup.
Problems known_problems(const Problems& problems, std::size_t stage) {
  Problems own(Problems::Mode::collect);
  const std::string prefix = stage == 0 ? "" : stage_field(stage) + ".";
  for (const Problem& problem : problems.list()) {
    const bool of_whole = problem.field.starts_with("variables") || problem.field.starts_with("symmetry");
    if (!of_whole && !problem.field.starts_with(prefix)) continue;
    own.check(of_whole ? problem.field : problem.field.substr(prefix.size()), [&] { refuse_argument(problem.message); });
  }
  return own;
}

SelectedRegions validate_stage(const StageSetup& of, std::size_t stage, const Mesh& mesh, Problems& problems,
                               const RunContext& context) {
  if (!problems.collects()) {
    try {
      return validate(of.setup, mesh, problems, context);
    } catch (const Error& error) {
      throw Error(error.code(), about_stage(stage, error.what()), error.retry_after_ms());
    }
  }
  Problems own = known_problems(problems, stage);
  const std::size_t known = own.list().size();
  SelectedRegions regions = validate(of.setup, mesh, own, context);
  for (std::size_t i = known; i < own.list().size(); ++i) {
    const Problem& problem = own.list()[i];
    // What concerns all methods is named by the first.
    if (problem.field.starts_with("variables") || (stage > 0 && problem.field.starts_with("symmetry"))) continue;
    const std::string field = stage == 0 ? problem.field : stage_field(stage) + "." + problem.field;
    problems.check(field, [&] { refuse_argument(about_stage(stage, problem.message)); });
  }
  return regions;
}

}  // namespace

std::vector<double> StageSetup::own(std::span<const double> values) const {
  std::vector<double> result;
  if (values.empty()) return result;
  for (const std::size_t k : variables) result.push_back(values[k]);
  return result;
}

std::string stage_field(std::size_t stage) { return stage == 0 ? "" : "then[" + std::to_string(stage - 1) + "]"; }

StageSetup stage_setup(const Setup& setup, std::size_t stage) {
  StageSetup result;
  result.setup.method = stage == 0 ? setup.method : setup.then[stage - 1].method;
  result.setup.fixed = stage == 0 ? setup.fixed : setup.then[stage - 1].fixed;
  result.setup.seed = setup.seed;
  result.setup.symmetry = setup.symmetry;
  std::set<std::string> names;
  for (std::size_t h = 0; h < setup.handles.size(); ++h) {
    if (setup.handles[h].stage < stage) result.first_handle = h + 1;
    if (setup.handles[h].stage != stage) continue;
    result.setup.handles.push_back({setup.handles[h].name, setup.handles[h].region});
    names.insert(setup.handles[h].name);
  }
  for (std::size_t k = 0; k < setup.variables.size(); ++k) {
    auto own = on_handles(setup.variables[k], names);
    if (!own) continue;
    result.setup.variables.push_back(std::move(*own));
    result.variables.push_back(k);
  }
  reduce_samples(result, setup.variables.size());
  return result;
}

SelectedRegions validate_stages(const Setup& setup, const Mesh& mesh, Problems& problems, const RunContext& context) {
  problems.check("then", [&] {
    if (setup.then.size() > most_further_methods) {
      refuse_argument("then: " + std::to_string(setup.then.size()) + " methods are more than the limit of " +
                      std::to_string(most_further_methods));
    }
  });
  problems.check("constraints", [&] {
    if (!setup.constraints.empty()) {
      refuse_argument(
          "constraints: a setup with `then` takes none, because a method that follows would move the points off the shapes that "
          "the one before it fits; use one method, or deform the result with a setup of its own");
    }
  });
  SelectedRegions result;
  for (std::size_t s = 0; s <= setup.then.size(); ++s) {
    SelectedRegions own = validate_stage(stage_setup(setup, s), s, mesh, problems, context);
    result.handles.insert(result.handles.end(), own.handles.begin(), own.handles.end());
    if (s == 0) {
      result.fixed = own.fixed;
      result.symmetry = own.symmetry;
      result.of = own.of;
    }
    result.stages.push_back(std::move(own));
  }
  return result;
}

Estimate estimate_composed(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, const RunContext& context) {
  Estimate sum;
  for (std::size_t s = 0; s <= setup.then.size(); ++s) {
    const Estimate own = estimate(mesh, stage_setup(setup, s).setup, regions.stages[s], context);
    sum.peak_bytes = std::max(sum.peak_bytes, sum.resident_bytes + own.peak_bytes);
    sum.constraint_points += own.constraint_points;
    sum.centres += own.centres;
    sum.held_points += own.held_points;
    sum.samples += own.samples;
    sum.factor_bytes += own.factor_bytes;
    sum.basis_bytes += own.basis_bytes;
    sum.resident_bytes += own.resident_bytes;
    sum.seconds += own.seconds;
    sum.design_seconds += own.design_seconds;
    for (const std::string& note : own.notes) sum.notes.push_back(s == 0 ? note : stage_field(s) + ": " + note);
    if (sum.advice.empty()) sum.advice = own.advice;
  }
  return sum;
}

}  // namespace deform
