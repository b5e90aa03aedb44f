// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/design_checks.h"

#include <algorithm>
#include <utility>

#include "core/base/error.h"
#include "core/mesh/cells.h"
#include "core/quality/plane_quality.h"
#include "core/quality/report.h"
#include "proto/convert/base/fields.h"
#include "proto/convert/report.h"
#include "server/engine/system_cache.h"

namespace deform::server {

namespace {

/// The bytes of the measures of one design: some numbers per point, face and cell.
std::size_t quality_bytes(const Mesh& mesh) {
  std::size_t items = mesh.point_count() + mesh.face_count() + mesh.cell_count();
  if (mesh.cells) items += mesh.cells->face_count();
  return 128 * items + 4 * mesh.face_points.size();
}

/// Left-handed is what is so at rest.
PolyhedralLimits polyhedral_limits(const Mesh& mesh) {
  PolyhedralLimits limits;
  limits.left_handed = left_handed_cells(mesh.points, *cell_set(mesh));
  return limits;
}

}  // namespace

std::size_t SevereFaces::bytes_for(const Mesh& mesh) { return quality_bytes(mesh); }

SevereFaces::SevereFaces(const Mesh& mesh, const Points& rest, const RunContext& context) {
  const PolyhedralLimits limits = polyhedral_limits(mesh);
  for (const double angle : polyhedral_quality(rest, *mesh.cells, limits, context).face_non_orthogonality) {
    severe_.push_back(angle > limits.non_orthogonality ? 1 : 0);
  }
}

std::uint64_t SevereFaces::appeared(std::span<const double> non_orthogonality) const {
  std::uint64_t count = 0;
  for (std::size_t f = 0; f < severe_.size(); ++f) {
    count += severe_[f] == 0 && non_orthogonality[f] > PolyhedralLimits{}.non_orthogonality ? 1 : 0;
  }
  return count;
}

std::shared_ptr<const InversionCheck> CellCheckCache::get(const Mesh& mesh, const CellSet& cells,
                                                          const DisplacementFields* fields, MemoryBudget& budget,
                                                          const RunContext& context) const {
  const std::lock_guard lock(mutex_);
  if (check_) return check_;
  const auto charge = [&](std::size_t count) {
    return budget.charge(InversionCheck::bytes_to_make(cells, mesh.points.size(), count),
                         {"checking the cells", "set check: CELL_CHECK_OFF, or raise the server's memory budget", 0});
  };
  const std::size_t points = mesh.points.size(), count = fields == nullptr ? 0 : fields->count();
  if (count > 0) {
    try {
      Charge charged = charge(count);
      check_ = std::make_shared<const InversionCheck>(mesh.points, cells, *fields, context);
      charge_ = std::move(charged);
      charge_.shrink(InversionCheck::bytes_for(cells, points, count));
      return check_;
    } catch (const Error& error) {
      if (error.code() != ErrorCode::out_of_budget) throw;  // the fields only save time
    }
  }
  Charge charged = charge(0);
  check_ = std::make_shared<const InversionCheck>(mesh.points, cells, context);
  charge_ = std::move(charged);
  charge_.shrink(InversionCheck::bytes_for(cells, points));
  return check_;
}

DesignChecks DesignChecks::from_proto(const v1::DeformRequest& request) {
  DesignChecks checks;
  if (convert::known(request.check(), "check") != v1::CELL_CHECK_DEFAULT) checks.check = request.check();
  checks.intersections = request.intersections() && checks.check != v1::CELL_CHECK_OFF;
  const v1::Splitting& splitting = request.splitting();
  if (convert::known(splitting.mode(), "splitting.mode") == v1::SPLIT_OFF) return checks;
  SplitOptions options;
  options.mode = splitting.mode() == v1::SPLIT_ADAPTIVE ? SplitMode::adaptive : SplitMode::uniform;
  if (splitting.most_steps() > 0) options.most_steps = splitting.most_steps();
  if (splitting.share() != 0) options.share = splitting.share();
  options.margin = splitting.margin();
  validate_split_options(options);
  checks.splitting = options;
  return checks;
}

void DesignChecker::Findings::move_to(v1::DesignResult& result) {
  if (cells) *result.mutable_cells() = std::move(*cells);
  if (quality) *result.mutable_quality() = std::move(*quality);
  if (split) *result.mutable_split() = std::move(*split);
  if (!faces) return;
  if (faces->flipped() > 0) result.add_warnings(convert::flipped_faces_warning(*faces));
  if (faces->intersecting() > 0) result.add_warnings(convert::intersecting_faces_warning(*faces));
  *result.mutable_faces() = std::move(*faces);
}

std::unique_ptr<const DesignChecker> DesignChecker::make(std::shared_ptr<const ResidentSystem> system, const DesignChecks& checks,
                                                         const std::function<std::vector<Design>()>& designs,
                                                         MemoryBudget& budget, const RunContext& context) {
  const Mesh& mesh = *system->mesh;
  const std::optional<CellSet> cells = checks.none() ? std::nullopt : cell_set(mesh);
  if (checks.splitting && !cells) {
    throw Error(ErrorCode::failed_precondition,
                "splitting: the geometry has no cells that could be inverted; register a volume mesh or a 2D mesh");
  }
  const bool quality = checks.check == v1::CELL_QUALITY && (cells || mesh.face_count() > 0);
  const bool faces = checks.check != v1::CELL_CHECK_OFF && mesh.face_count() > 0;
  if (!cells && !quality && !faces) return nullptr;
  std::unique_ptr<DesignChecker> checker(new DesignChecker);
  checker->checks_ = checks;
  checker->cells_ = cells;
  if (faces) checker->flips_ = system->flip_check.get(mesh, budget, context);
  if (faces && checks.intersections) checker->intersections_ = system->intersection_check.get(mesh, budget, context);
  std::size_t bytes = 0;
  if (cells || quality) bytes += checker->check_faces_bytes();
  // A 2D mesh has to be seen to stay in its plane, for which its points are read anyway.
  const bool plane = cells && std::holds_alternative<const Mesh*>(*cells);
  const auto fields = cells && !plane ? system->system->displacement_fields() : nullptr;
  if (cells) bytes += InversionCheck::bytes_for(*cells, mesh.points.size());
  if (quality) bytes += quality_bytes(mesh);
  if (checks.splitting) bytes += estimate_substep(mesh, system->setup, *cells).peak_bytes;
  checker->charge_ = budget.charge(bytes, {checks.splitting ? "splitting designs" : "checking the cells of designs",
                                           "set check: CELL_CHECK_OFF and no splitting, or raise the server's memory budget", 0});
  if (cells) checker->inversions_ = system->cell_check.get(mesh, *cells, fields.get(), budget, context);
  if (quality && mesh.cells) checker->severe_ = system->severe_check.get(mesh, budget, context);
  if (checks.splitting) checker->designs_ = designs();
  checker->system_ = std::move(system);
  return checker;
}

bool DesignChecker::in_plane(const Points& points) const {
  return !std::holds_alternative<const Mesh*>(*cells_) || in_one_plane(points);
}

SafeAmplitude DesignChecker::amplitude(const std::optional<FieldMotion>& motion, const Points& points,
                                       const RunContext& context) const {
  return motion && inversions_->fields() > 0 ? inversions_->amplitude(points, *motion, context)
                                             : inversions_->amplitude(system_->mesh->points, points, context);
}

DesignChecker::Findings DesignChecker::check(std::size_t design, const std::optional<FieldMotion>& motion, Points& points,
                                             const RunContext& context) const {
  Findings findings;
  if (inversions_ && in_plane(points)) {
    const SafeAmplitude safety = amplitude(motion, points, context);
    if (checks_.check != v1::CELL_CHECK_OFF) findings.cells = convert::cell_report(*inversions_, safety);
    if (checks_.splitting) split(design, points, safety, findings, context);
  }
  if (checks_.check == v1::CELL_QUALITY) findings.quality = quality(points, findings.cells ? &*findings.cells : nullptr);
  findings.faces = check_faces(points, context);
  return findings;
}

std::optional<v1::FaceReport> DesignChecker::check_faces(std::span<const Vec3> points, const RunContext& context) const {
  if (!flips_) return std::nullopt;
  v1::FaceReport report = convert::face_report(flips_->face_count(), flips_->flipped(points, context));
  if (intersections_) convert::set_intersecting(report, intersections_->appeared(points, context));
  return report;
}

void DesignChecker::split(std::size_t design, Points& points, const SafeAmplitude& safety, Findings& findings,
                          const RunContext& context) const {
  v1::SplitReport& report = findings.split.emplace();
  report.set_inversion_free(true);
  report.set_steps(1);
  report.set_reached(1);
  report.set_least_determinant(safety.inverted.least_determinant.value);
  if (safety.inverted.count == 0 && !(safety.inverted.least_determinant.value < checks_.splitting->margin)) return;
  SplitProblem problem;
  problem.mesh = system_->mesh;
  problem.setup = system_->setup;
  problem.cells = *cells_;
  problem.system = system_->system;
  SplitResult result = evaluate_split(problem, designs_[design], *checks_.splitting, context);
  report.set_inversion_free(result.inversion_free);
  report.set_steps(static_cast<std::uint32_t>(result.steps));
  report.set_reached(result.reached);
  report.set_straight(result.straight);
  report.set_least_determinant(result.least_determinant.value);
  report.set_factorizations(static_cast<std::uint32_t>(result.factorizations));
  if (!result.attempts.empty()) report.set_failure(result.attempts.back().failure);
  points = std::move(result.points);
}

v1::QualityReport DesignChecker::quality(const Points& points, v1::CellReport* cells) const {
  const Mesh& mesh = *system_->mesh;
  const auto left_handed = [&] { return left_handed_cells(mesh.points, *cells_); };
  if (mesh.cells) {
    const PolyhedralQuality measured = polyhedral_quality(points, *mesh.cells, polyhedral_limits(mesh));
    if (cells != nullptr) {
      cells->set_non_orthogonal_faces(severe_->appeared(measured.face_non_orthogonality));
      cells->set_largest_non_orthogonality(measured.largest_non_orthogonality.value);
      cells->set_largest_non_orthogonality_face(static_cast<std::uint32_t>(measured.largest_non_orthogonality.id));
    }
    return convert::quality_to_proto(quality_report(measured, points, *mesh.cells));
  }
  if (mesh.elements) {
    const ElementQuality measured = element_quality(points, *mesh.elements, left_handed());
    return convert::quality_to_proto(quality_report(measured, points, *mesh.elements));
  }
  Mesh surface;
  surface.points = points;
  surface.face_sizes = mesh.face_sizes;
  surface.face_points = mesh.face_points;
  QualityReport report = quality_report(surface_quality(surface), surface);
  if (intersections_) add_intersecting(report, surface, intersections_->at(points));
  if (cells_ && in_plane(points)) add_to(report, plane_quality(points, mesh, left_handed()), points, mesh);
  return convert::quality_to_proto(report);
}

}  // namespace deform::server
