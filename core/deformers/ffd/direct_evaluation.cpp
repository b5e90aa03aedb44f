// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/ffd/direct_evaluation.h"

#include <algorithm>
#include <atomic>
#include <string>

#include "core/base/number_text.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr std::size_t direct_places_per_task = 1024;
constexpr double far = 20;  // control points against handles: a clamp that is too small

}  // namespace

DirectEvaluation::DirectEvaluation(std::shared_ptr<const DirectSystem> system, std::span<const Design> designs,
                                   EvaluationPath path, const RunContext& context)
    : HandleEvaluation(system, designs, path, context), system_(*system), controls_(designs.size()) {
  solve(context);
  report_controls();
}

DirectEvaluation::DirectEvaluation(std::shared_ptr<const DirectSystem> system, const std::vector<Affine>& derivatives,
                                   const RunContext& context)
    : HandleEvaluation(system, derivatives), system_(*system), controls_(1) {
  solve(context);
}

void DirectEvaluation::solve(const RunContext& context) {
  for_each_direct(context, [&](std::size_t i) {
    const Eigen::MatrixXd h = system_.prescribed(designs_[i], kind_);
    const auto [controls, parts] = system_.inverse_->solution(h);
    const Eigen::MatrixXd missed = system_.misfit(h, controls);
    reports_[i].interpolation_residual = reports_[i].misfit = missed.rowwise().norm().maxCoeff();
    set_error(i, system_.error_of({controls, missed, parts, largest_terms(i)}));
    controls_[i] = controls;
  });
}

void DirectEvaluation::report_controls() {
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    DesignReport& report = reports_[i];
    Eigen::MatrixXd controls;
    if (is_direct(i)) {
      controls = controls_[i];
    } else {
      // Those of the fields of each handle by themselves may be far larger: of a handle and its image that meet in a plane, say.
      const Eigen::MatrixXd coefficients = system_.affine_coefficients(designs_[i], kind_);
      controls = system_.controls_ * coefficients;
      const Eigen::MatrixXd missed = system_.missed_ * coefficients, parts = system_.parts_ * coefficients;
      report.interpolation_residual = report.misfit = missed.rowwise().norm().maxCoeff();
      // Coefficients are rounded alike for all points of a handle, which solutions do not multiply.
      set_error(i, system_.error_of({controls, missed, parts, 0}) + compression_error(i));
    }
    report.control_displacement = controls.rowwise().norm().maxCoeff();
    if (report.control_displacement <= far * report.prescribed_displacement) continue;
    report.warnings.push_back(
        "control points move by up to " + scientific(report.control_displacement) + ", over " + number_digits(far) +
        " times as far as handles do, so that what is between these swings: " + system_.model_.remedy + " keep them back");
  }
}

void DirectEvaluation::direct_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const {
  for (std::size_t k = 0; k < count; ++k) system_.displace_tile(controls_[first + k], tile, values + 3 * k * tile_size);
}

SpaceMap::Found DirectEvaluation::displacements_at(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                                                   const RunContext& context) const {
  std::atomic<std::size_t> still = 0;
  const auto* const controls = reinterpret_cast<const Vec3*>(controls_[0].data());
  parallel_for(context, points.size(), direct_places_per_task, [&](std::size_t begin, std::size_t end) {
    still +=
        system_.model_.in_space->sums(points.subspan(begin, end - begin), first + begin, controls, out.data() + begin).size();
  });
  return {still, 0};
}

}  // namespace deform
