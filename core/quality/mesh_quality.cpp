// SPDX-License-Identifier: Apache-2.0
#include "core/quality/mesh_quality.h"

#include <algorithm>
#include <utility>

#include "core/base/error.h"
#include "core/quality/safe_amplitude.h"

namespace deform {

namespace {

[[noreturn]] void refuse_quality(const std::string& message) { throw Error(ErrorCode::invalid_argument, message); }

/// The mesh at other points, without its groups.
Mesh moved_mesh(const Mesh& rest, std::span<const Vec3> points) {
  Mesh moved;
  moved.points.assign(points.begin(), points.end());
  moved.face_sizes = rest.face_sizes;
  moved.face_points = rest.face_points;
  moved.elements = rest.elements;
  moved.cells = rest.cells;
  return moved;
}

void add_walls(MeshQuality& measured, const Mesh& mesh, std::span<const FaceId> walls, const RunContext& context) {
  add_to(measured.report, measured.cells ? wall_quality({mesh, walls, measured.cells->cell_volume}, *mesh.cells, context)
                                         : wall_quality({mesh, walls, measured.elements->volume}, *mesh.elements, context));
}

bool known_somewhere(const std::string& name) {
  const std::vector<QualityName> names = quality_names();
  return std::any_of(names.begin(), names.end(), [&](const QualityName& each) { return each.name == name; });
}

/// What compares a design with the rest takes time of its own.
bool of_flips(const std::string& name) { return name == "flipped_faces"; }
bool of_intersections(const std::string& name) { return name == "intersecting_faces" || name == "newly_intersecting_faces"; }
bool compares(const std::string& name) { return of_flips(name) || of_intersections(name) || name == "displacement"; }

}  // namespace

MeshQuality mesh_quality(const Mesh& mesh, const std::vector<char>& left_handed, const RunContext& context) {
  MeshQuality result;
  if (mesh.cells) {
    PolyhedralLimits limits;
    limits.left_handed = left_handed;
    result.cells = polyhedral_quality(mesh.points, *mesh.cells, limits, context);
    result.report = quality_report(*result.cells, mesh.points, *mesh.cells);
  } else if (mesh.elements) {
    result.elements = element_quality(mesh.points, *mesh.elements, left_handed, context);
    result.report = quality_report(*result.elements, mesh.points, *mesh.elements);
  } else {
    if (mesh.face_count() == 0) refuse_quality("it has no faces and no cells, only points");
    result.surface = surface_quality(mesh, context);
    result.report = quality_report(*result.surface, mesh);
    if (cell_set(mesh)) {
      result.plane = plane_quality(mesh.points, mesh, left_handed, context);
      add_to(result.report, *result.plane, mesh.points, mesh);
    }
  }
  return result;
}

std::vector<char> left_handed_of(const Mesh& mesh, std::span<const Vec3> points, const RunContext& context) {
  const std::optional<CellSet> cells = cell_set(mesh);
  return cells ? left_handed_cells(points, *cells, context) : std::vector<char>{};
}

std::vector<FaceId> wall_faces(const Mesh& mesh, const std::vector<std::string>& groups) {
  std::vector<FaceId> faces;
  for (const std::string& name : groups) {
    const Group* group = mesh.find_group(name);
    if (group == nullptr) {
      std::vector<std::string> known;
      std::string all;
      for (const Group& each : mesh.groups) {
        if (each.faces.empty()) continue;
        known.push_back(each.name);
        all += (all.empty() ? "" : ", ") + each.name;
      }
      const std::string near = nearest_names(name, known);
      refuse_quality(name + ": there is no such group; " +
                     (!near.empty()   ? "did you mean " + near + "?"
                      : known.empty() ? "it has no groups of faces"
                                      : "it has " + all));
    }
    if (group->faces.empty()) refuse_quality(name + ": this group has no boundary faces");
    faces.insert(faces.end(), group->faces.begin(), group->faces.end());
  }
  std::sort(faces.begin(), faces.end());
  faces.erase(std::unique(faces.begin(), faces.end()), faces.end());
  return faces;
}

QualityCheck::QualityCheck(std::shared_ptr<const Mesh> rest, const std::vector<std::string>& walls, const RunContext& context)
    : rest_(std::move(rest)), left_handed_(left_handed_of(*rest_, rest_->points, context)), walls_(wall_faces(*rest_, walls)) {
  if (!walls_.empty() && rest_->cell_count() == 0) {
    refuse_quality("walls: the mesh is a surface; the cells of a volume mesh lie on walls");
  }
  if (rest_->face_count() > 0) {
    flips_ = std::make_unique<const FlipCheck>(*rest_, rest_->points, context);
    intersections_ = std::make_unique<const IntersectionCheck>(*rest_, rest_->points, context);
  }
  for (const QualityRow& row : measured(rest_->points, Part::all, context).rows) {
    names_.push_back({row.name, row.label, row.counts, row.better});
  }
}

QualityCheck::~QualityCheck() = default;

void QualityCheck::check(const std::string& name) const {
  QualityReport report;  // whose rows are found by this name
  for (const Name& each : names_) report.rows.push_back({each.name, each.label, 0, std::nullopt, each.better});
  if (report.find(name) != nullptr) return;
  const bool needs_walls = walls_.empty() && name.find("wall_") != std::string::npos && known_somewhere(name);
  if (needs_walls && rest_->cell_count() > 0) refuse_quality(name + " is measured with walls, the groups of its faces");
  if (name.find("_jump") != std::string::npos && known_somewhere(name)) {
    refuse_quality(name + " is measured between the regions of a setup, by `deform quality --setup` only");
  }
  refuse_quality((known_somewhere(name) ? name + " is measured of other kinds of meshes: " : "") + report.unknown(name));
}

std::vector<double> QualityCheck::values(std::span<const Vec3> points, const std::vector<std::string>& wanted,
                                         const RunContext& context) const {
  check_points(points);
  for (const std::string& name : wanted) check(name);
  QualityReport report;
  if (!std::all_of(wanted.begin(), wanted.end(), compares)) report = measured(points, Part::without_comparison, context);
  if (std::any_of(wanted.begin(), wanted.end(), compares)) {
    add_displacement(report, points, rest_->points);
    if (std::any_of(wanted.begin(), wanted.end(), of_flips)) {
      add_flipped(report, moved_mesh(*rest_, points), flips_->flipped(points, context));
    }
    if (std::any_of(wanted.begin(), wanted.end(), of_intersections)) {
      add_intersections(report, moved_mesh(*rest_, points), context);
    }
  }
  std::vector<double> values;
  for (const std::string& name : wanted) {
    const QualityRow* row = report.find(name);
    if (row == nullptr) refuse_quality(name + ": it is measured of meshes in a plane z = constant, which these points left");
    values.push_back(row->value);
  }
  return values;
}

QualityReport QualityCheck::report(std::span<const Vec3> points, const RunContext& context) const {
  check_points(points);
  return measured(points, Part::all, context);
}

QualityReport QualityCheck::measured(std::span<const Vec3> points, Part part, const RunContext& context) const {
  const Mesh moved = moved_mesh(*rest_, points);
  MeshQuality quality = mesh_quality(moved, left_handed_, context);
  if (!walls_.empty()) add_walls(quality, moved, walls_, context);
  if (part == Part::all) {
    add_displacement(quality.report, points, rest_->points);
    if (flips_) add_flipped(quality.report, moved, flips_->flipped(points, context));
    if (intersections_) add_intersections(quality.report, moved, context);
  }
  return std::move(quality.report);
}

void QualityCheck::add_intersections(QualityReport& report, const Mesh& moved, const RunContext& context) const {
  if (rest_->cell_count() == 0) add_intersecting(report, moved, intersections_->at(moved.points, context));
  add_newly_intersecting(report, intersections_->appeared(moved.points, context));
}

void QualityCheck::check_points(std::span<const Vec3> points) const {
  if (points.size() != point_count()) {
    refuse_quality("points: " + std::to_string(points.size()) + ", the mesh has " + std::to_string(point_count()));
  }
}

}  // namespace deform
