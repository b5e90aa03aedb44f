// SPDX-License-Identifier: GPL-3.0-or-later
#include "proto/convert/report.h"

#include <algorithm>

#include "proto/convert/base/fields.h"

namespace deform::convert {

v1::ConstraintsReport constraints_report(const DesignReport& report, const Setup& setup) {
  v1::ConstraintsReport message;
  for (std::size_t i = 0; i < report.constraints.size(); ++i) {
    const ConstraintReport& of = report.constraints[i];
    v1::ConstraintResidual& residual = *message.add_residuals();
    residual.set_name(setup.constraints[i].name);
    residual.set_largest(of.max);
    residual.set_rms(of.rms);
    residual.set_free_largest(of.max_before);
    residual.set_free_rms(of.rms_before);
    residual.set_missed(of.missed);
    if (of.heights) {
      residual.set_least_height(of.heights->least);
      residual.set_largest_height(of.heights->largest);
    }
    if (of.heights_before) {
      residual.set_free_least_height(of.heights_before->least);
      residual.set_free_largest_height(of.heights_before->largest);
    }
    for (const ConstraintReport::Held& held : of.held) {
      v1::ConstraintResidual::Held& message = *residual.add_held();
      if (held.handle != ConstraintReport::Held::fixed) message.set_handle(setup.handles[held.handle].name);
      message.set_points(held.points);
    }
    if (of.held_misfit) {
      residual.set_held_largest(of.held_misfit->max);
      residual.set_held_rms(of.held_misfit->rms);
    }
  }
  message.set_converged(report.converged);
  message.set_at_rounding(report.at_rounding);
  message.set_iterations(static_cast<std::uint32_t>(report.iterations + report.newton_steps));
  message.set_newton_steps(static_cast<std::uint32_t>(report.newton_steps));
  message.set_convergence_error(report.convergence_error);
  message.set_energy(report.energy);
  const auto given_up = [](const ConstraintReport& of) { return of.given_up; };
  message.set_exact_given_up(std::any_of(report.constraints.begin(), report.constraints.end(), given_up));
  return message;
}

std::string given_up_warning(const DesignReport& report, const Setup& setup) {
  std::string names;
  for (std::size_t i = 0; i < report.constraints.size(); ++i) {
    if (report.constraints[i].given_up) names += (names.empty() ? "" : ", ") + ('"' + setup.constraints[i].name + '"');
  }
  if (names.empty()) return {};
  return "The exact constraints " + names +
         " contradict others or points that are held, or their shapes are farther away than points may be moved: putting their "
         "points "
         "on the shapes was given up; they are met as far as their weight carries them.";
}

v1::EvaluationPath path_to_proto(EvaluationPath path) {
  return path == EvaluationPath::basis ? v1::PATH_BASIS : path == EvaluationPath::direct ? v1::PATH_DIRECT : v1::PATH_AUTOMATIC;
}

EvaluationPath path_from_proto(v1::EvaluationPath path) {
  known(path, "path");
  return path == v1::PATH_BASIS    ? EvaluationPath::basis
         : path == v1::PATH_DIRECT ? EvaluationPath::direct
                                   : EvaluationPath::automatic;
}

v1::QualityReport quality_to_proto(const QualityReport& report) {
  v1::QualityReport message;
  for (const auto& [name, count] : report.counts) {
    auto* entry = message.add_counts();
    entry->set_name(name);
    entry->set_count(count);
  }
  for (const QualityRow& row : report.rows) {
    auto* measure = message.add_measures();
    measure->set_name(row.name);
    measure->set_label(row.label);
    measure->set_value(row.value);
    if (row.id) measure->set_id(*row.id);
  }
  for (const auto& [name, ids] : report.lists) {
    auto* list = message.add_lists();
    list->set_name(name);
    for (const std::size_t id : ids) list->add_ids(id);
  }
  for (const QualityHistogram& histogram : report.histograms) {
    auto* entry = message.add_histograms();
    entry->set_name(histogram.name);
    entry->set_title(histogram.title);
    entry->set_low(histogram.low);
    entry->set_high(histogram.high);
    for (const std::size_t count : histogram.counts) entry->add_counts(count);
  }
  for (const std::string& failed : report.failed) message.add_failed(failed);
  message.set_method(report.method);
  return message;
}

}  // namespace deform::convert
