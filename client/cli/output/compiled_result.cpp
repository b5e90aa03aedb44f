// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/compiled_result.h"

#include "core/quality/displacement.h"
#include "core/quality/face_intersections.h"
#include "core/quality/flipped_faces.h"
#include "core/quality/safe_amplitude.h"
#include "proto/convert/findings.h"
#include "proto/convert/verdict.h"

namespace deform::cli {

v1::DesignResult compiled_result(const compiled::Deformation& deformation, const v1::Setup& setup,
                                 std::span<const double> variables, const Mesh& mesh, const Points& points, CompiledCheck check) {
  const compiled::Content& content = deformation.content();
  const compiled::Report report = deformation.report(variables);
  const convert::MethodFacts method = convert::method_facts(setup);
  v1::DesignResult result;
  const Extreme largest = largest_displacement(points, mesh.points);
  result.set_path(v1::PATH_BASIS);
  result.set_interpolation_residual(report.interpolation_residual);
  result.set_max_displacement(largest.value);
  result.set_prescribed_displacement(report.prescribed_displacement);
  result.set_estimated_error(report.error);
  result.set_reduction_error(content.reduction_error * report.prescribed_displacement);
  if (largest.value > 0) result.set_relative_error(report.error / largest.value);
  if (const auto warning = displacement_warning(largest, report.prescribed_displacement, content.diagonal, method.overshoot)) {
    result.add_warnings(*warning);
  }
  const PlaneSides::Crossings crossings = deformation.sides().crossings(points, 0);
  result.set_points_across_symmetry(crossings.points);
  if (crossings.points > 0) result.add_warnings(crossings.text(points.size()));
  const bool looked_at = check != CompiledCheck::none;
  if (const auto cells = cell_set(mesh); looked_at && cells) {
    // A 2D mesh has its faces as cells as long as it stays in its plane.
    if (!std::holds_alternative<const Mesh*>(*cells) || in_one_plane(points)) {
      const InversionCheck inversions(mesh.points, *cells);
      *result.mutable_cells() = convert::cell_report(inversions, inversions.amplitude(mesh.points, points));
    }
  }
  if (looked_at && mesh.face_count() > 0) {
    const FlipCheck flips(mesh, mesh.points);
    v1::FaceReport& faces = *result.mutable_faces();
    faces = convert::face_report(flips.face_count(), flips.flipped(points));
    if (faces.flipped() > 0) result.add_warnings(convert::flipped_faces_warning(faces));
    if (check == CompiledCheck::intersections) {
      convert::set_intersecting(faces, IntersectionCheck(mesh, mesh.points).appeared(points));
      if (faces.intersecting() > 0) result.add_warnings(convert::intersecting_faces_warning(faces));
    }
  }
  const double misfit =
      method.manipulates_directly ? deformation.largest_misfit(variables, std::span(points[0].data(), 3 * points.size())) : 0;
  convert::set_verdict({deformation.size().judged_by, content.condition, report.converged, 0, misfit, method, report.doubts},
                       result);
  return result;
}

}  // namespace deform::cli
