// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/system.h"

#include <algorithm>
#include <limits>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/deformers/composed/composed_system.h"
#include "core/deformers/constrained/constraint_sets.h"
#include "core/deformers/handles/sliding_checks.h"
#include "core/deformers/methods.h"
#include "core/deformers/mirrored_system.h"
#include "core/deformers/space_map.h"

namespace deform {

namespace {

constexpr std::size_t most_overhead = std::size_t{8} << 20;  // stacks of threads, scratch memory of libraries and allocators
constexpr std::size_t points_per_task = 8192;
constexpr std::size_t designs_per_pass = 16;  // as many as keep a tile's results in the first-level cache

std::string gibibytes(std::size_t bytes) {
  const std::size_t tenths = (bytes * 10 + (std::size_t{1} << 30) - 1) >> 30;
  return std::to_string(tenths / 10) + "." + std::to_string(tenths % 10) + " GiB";
}

}  // namespace

std::unique_ptr<const Evaluation> System::bind_sequence(std::span<const Design> designs, EvaluationPath path, WarmStart&,
                                                        const RunContext& context) const {
  return bind(designs, path, context);
}

std::optional<FieldMotion> Evaluation::field_motion(std::size_t) const { return std::nullopt; }

std::unique_ptr<const DisplacementFields> System::displacement_fields() const { return nullptr; }

std::vector<std::vector<double>> System::vector_jacobians(std::span<const double> variables, std::span<const Points> cotangents,
                                                          const RunContext& context) const {
  std::vector<std::vector<double>> gradients;
  for (const Points& cotangent : cotangents) gradients.push_back(vector_jacobian(variables, cotangent, context));
  return gradients;
}

std::unique_ptr<const SpaceMap> System::bind_in_space(const Design&, const RunContext&) const {
  throw Error(ErrorCode::failed_precondition,
              "the system cannot be evaluated at other points: its method is defined at the points of its geometry only");
}

Points System::evaluate(const Design& design, const RunContext& context) const {
  return std::move(evaluate(std::span<const Design>(&design, 1), EvaluationPath::automatic, context).front());
}

std::vector<Points> System::evaluate(std::span<const Design> designs, EvaluationPath path, const RunContext& context) const {
  const std::unique_ptr<const Evaluation> evaluation = bind(designs, path, context);
  std::vector<Points> result(designs.size(), Points(info().points));
  for (std::size_t first = 0; first < designs.size(); first += designs_per_pass) {
    const std::size_t count = std::min(designs_per_pass, designs.size() - first);
    parallel_for(context, info().points, points_per_task, [&](std::size_t begin, std::size_t end) {
      std::vector<Vec3*> out(count);
      for (std::size_t k = 0; k < count; ++k) out[k] = result[first + k].data() + begin;
      evaluation->evaluate(begin, end, first, out);
    });
  }
  return result;
}

Estimate estimate(const Mesh& mesh, const Setup& setup, const RunContext& context) {
  return estimate(mesh, setup, validate(setup, mesh, context), context);
}

Estimate estimate(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, const RunContext& context) {
  if (is_composed(setup)) return estimate_composed(mesh, setup, regions, context);
  if (is_mirrored(setup)) return estimate_mirrored(mesh, setup, regions, context);
  Estimate expected = with_method(
      setup, [&]<Method M>(const typename M::Options& options) { return M::estimate(options, mesh, setup, regions, context); });
  expected.peak_bytes += std::min(expected.peak_bytes / 8, most_overhead);
  return expected;
}

namespace {

/// In setups of several methods that of points of the mesh.
void check_sliding(const Mesh& mesh, const Setup& setup, const SelectedRegions& regions, Problems& problems) {
  const bool any = std::any_of(regions.stages.begin(), regions.stages.end(),
                               [](const SelectedRegions& stage) { return stage.of == SelectedRegions::Of::control_points; });
  const FlatCase flat(mesh);
  if (any || (regions.symmetry.planes() == 0 && !flat.exists())) return;
  problems.check("handles", [&] { check_one_sided(flat, setup, regions); });
  const bool controls = regions.of == SelectedRegions::Of::control_points;
  const std::vector<Vec3> places = controls ? control_places(setup, mesh, regions.symmetry) : std::vector<Vec3>();
  const SlidingPlaces at{regions.symmetry, controls ? places : mesh.points, regions.handles, bounding_box(mesh.points).diagonal(),
                         controls ? "control point" : "point"};
  check_variables_slide(setup, at, problems);
  if (problems.empty()) check_variables_flat(flat, setup, at, problems);
}

}  // namespace

void find_problems(const Mesh& mesh, const Setup& setup, Problems& problems, const RunContext& context) {
  const SelectedRegions regions = validate(setup, mesh, problems, context);
  if (problems.empty()) check_sliding(mesh, setup, regions, problems);
  const Box box = bounding_box(mesh.points);
  if (!is_composed(setup)) {  // which takes none, so that none of their points are selected
    check_constraint_sets(mesh, setup, regions, {box.min, std::max(box.diagonal(), std::numeric_limits<double>::min())},
                          problems);
  }
  if (problems.empty()) problems.check("", [&] { estimate(mesh, setup, regions, context); });
}

std::shared_ptr<const System> prepare(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context,
                                      std::size_t memory_budget) {
  if (memory_budget != 0) {
    const Estimate expected = estimate(*mesh, setup);
    if (expected.peak_bytes > memory_budget) {
      const char* size = expected.centres > 0 ? " centres" : expected.samples > 0 ? " samples" : " held points";
      throw Error(ErrorCode::out_of_budget, "preparing needs up to " + gibibytes(expected.peak_bytes) + " (" +
                                                std::to_string(expected.size()) + size + ": factor " +
                                                gibibytes(expected.factor_bytes) + ", basis " + gibibytes(expected.basis_bytes) +
                                                "), available are " + gibibytes(memory_budget) + "; " + expected.advice);
    }
  }
  if (is_composed(setup)) {
    return std::make_shared<const ComposedSystem>(std::move(mesh), setup, context, memory_budget, control_places);
  }
  if (is_mirrored(setup)) {
    return std::make_shared<const MirroredSystem>(std::move(mesh), setup, context, memory_budget);
  }
  return with_method(setup, [&]<Method M>(const typename M::Options& options) {
    return M::prepare(options, mesh, setup, context, memory_budget);
  });
}

}  // namespace deform
