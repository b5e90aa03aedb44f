// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/design_result.h"

#include <algorithm>
#include <utility>

#include "core/base/reduction_error.h"
#include "core/deformers/handle_shapes.h"
#include "core/quality/displacement.h"
#include "proto/convert/report.h"
#include "proto/convert/verdict.h"
#include "server/engine/system_cache.h"

namespace deform::server {

void DeliveredDesign::add(const codec::Block& block, const Extreme& largest_displacement, const PlaneSides::Crossings& crossed) {
  checksums.push_back(block.checksum);
  max_error = std::max(max_error, block.max_error);
  if (largest_displacement.value > displacement.value) displacement = largest_displacement;
  crossings.add(crossed);
  fell_back += block.fell_back ? 1 : 0;
}

v1::DesignResult design_result(const DeliveredDesign& delivered, const DesignReport& report, const Setup& setup,
                               const v1::SystemInfo& info) {
  v1::DesignResult result;
  result.set_checksum(codec::fold_checksums(delivered.checksums));
  result.set_max_error(delivered.max_error);
  result.set_blocks_fell_back(delivered.fell_back);
  result.set_path(convert::path_to_proto(report.path));
  result.set_interpolation_residual(report.interpolation_residual);
  result.set_max_displacement(delivered.displacement.value);
  result.set_prescribed_displacement(report.prescribed_displacement);
  result.set_control_displacement(report.control_displacement);
  result.set_estimated_error(report.error);
  result.set_reduction_error(info.reduction_error() * report.prescribed_displacement);
  if (result.max_displacement() > 0) result.set_relative_error(report.error / result.max_displacement());
  if (const auto warning = displacement_warning(delivered.displacement, report.prescribed_displacement, info.diagonal(),
                                                convert::method_facts(info.setup()).overshoot)) {
    result.add_warnings(*warning);
  }
  for (const std::string& warning : report.warnings) result.add_warnings(warning);
  if (delivered.crossings.points > 0) result.add_warnings(delivered.crossings.text(info.points()));
  if (setup.constraints.empty()) return result;
  *result.mutable_constraints() = convert::constraints_report(report, setup);
  if (const std::string warning = convert::given_up_warning(report, setup); !warning.empty()) result.add_warnings(warning);
  return result;
}

std::vector<std::string> design_doubts(const ResidentSystem& system, const Design& design) {
  std::vector<std::string> doubts = handle_shape_doubts(system.setup, design);
  if (const std::string& stray = system.size().stray; !stray.empty()) doubts.push_back(stray);
  if (std::string reduced = reduction_doubt(system.info.reduction_error()); !reduced.empty())
    doubts.push_back(std::move(reduced));
  return doubts;
}

}  // namespace deform::server
