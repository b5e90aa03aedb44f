// SPDX-License-Identifier: Apache-2.0
#include "core/quality/report.h"

#include <algorithm>
#include <map>
#include <utility>

#include "core/base/error.h"
#include "core/quality/displacement.h"
#include "core/quality/polygon.h"
#include "core/quality/summary.h"

namespace deform {

namespace {

using namespace quality;

QualityRow row(const char* name, const char* label, const Extreme& extreme, Better better = Better::neither) {
  return {name, label, extreme.value, extreme.id, better};
}
QualityRow row(const char* name, const char* label, double value, Better better = Better::neither) {
  return {name, label, value, std::nullopt, better};
}
QualityRow row(const char* name, const char* label, std::size_t count, Better better = Better::neither) {
  QualityRow made = row(name, label, static_cast<double>(count), better);
  made.counts = true;
  return made;
}

template <typename Counts>
QualityHistogram histogram(const char* name, const char* title, double low, double high, const Counts& counts) {
  return {name, title, low, high, {counts.begin(), counts.end()}};
}

/// Positions of cells: the mean of the corners of their faces.
std::map<std::size_t, Vec3> cell_positions(std::span<const Vec3> points, const PolyhedralCells& cells,
                                           const std::vector<std::size_t>& ids) {
  std::map<std::size_t, Vec3> sums;
  std::map<std::size_t, std::size_t> corners;
  for (const std::size_t id : ids) sums[id] = {};
  if (ids.empty()) return sums;
  for (std::size_t f = 0; f < cells.face_count(); ++f) {
    const auto add = [&](std::size_t cell) {
      const auto found = sums.find(cell);
      if (found == sums.end()) return;
      for (const PointId p : cells.face(f)) found->second = found->second + points[p];
      corners[cell] += cells.face(f).size();
    };
    add(cells.owner[f]);
    if (f < cells.internal_faces()) add(cells.neighbour[f]);
  }
  for (auto& [id, sum] : sums) sum = (1 / static_cast<double>(std::max<std::size_t>(corners[id], 1))) * sum;
  return sums;
}

/// In the table only where there are any.
void add_left_handed(QualityReport& report, std::size_t count, const char* name) {
  QualityRow& added = report.rows.emplace_back(row(name, "left-handed: nodes in mirrored order", count));
  added.in_table = count > 0;
}

/// Adds the measures of all elements, or with a prefix those of one type.
std::vector<QualityRow> rows_of(const ElementMeasures& q, const std::string& name, const std::string& label) {
  std::vector<QualityRow> rows = {
      row("scaled_jacobian", "scaled Jacobian, least", q.least_scaled_jacobian, Better::higher),
      row("average_scaled_jacobian", "scaled Jacobian, average", q.average_scaled_jacobian, Better::higher),
      row("aspect_ratio", "longest edge to least height, largest", q.largest_aspect_ratio, Better::lower),
      row("edge_ratio", "longest to shortest edge, largest", q.largest_edge_ratio, Better::lower),
      row("least_edge_ratio", "longest to shortest edge, least", q.least_edge_ratio),
      row("volume", "volume of an element, least", q.least_volume),
      row("largest_volume", "volume of an element, largest", q.largest_volume),
      row("total_volume", "volume, total", q.total_volume),
      row("inverted_elements", "inverted elements", q.inverted_elements, Better::lower)};
  for (QualityRow& r : rows) {
    r.name = name + r.name;
    r.label = label + r.label;
  }
  return rows;
}

std::vector<std::size_t> ids_of(std::span<const IntersectingFace> faces) {
  std::vector<std::size_t> ids;
  for (const IntersectingFace& face : faces) ids.push_back(face.face);
  return ids;
}

}  // namespace

const QualityRow* QualityReport::find(const std::string& name) const {
  const auto of = [&](const std::string& wanted) {
    const auto found = std::find_if(rows.begin(), rows.end(), [&](const QualityRow& r) { return r.name == wanted; });
    return found == rows.end() ? nullptr : &*found;
  };
  const QualityRow* found = of(name);
  return found == nullptr && name == "inverted_cells" ? of("inverted_elements") : found;
}

std::string QualityReport::unknown(const std::string& name) const {
  std::vector<std::string> names;
  std::string all;
  for (const QualityRow& r : rows) {
    names.push_back(r.name);
    all += (all.empty() ? "" : ", ") + r.name;
  }
  const std::string near = nearest_names(name, names);
  return "there is no measure \"" + name + "\"; " + (near.empty() ? "there are " + all : "did you mean " + near + "?");
}

std::vector<QualityName> quality_names() {
  ElementQuality elements;
  for (ElementMeasures& type : elements.of_type) type.elements = 1;
  QualityReport all;  // the reports of nothing have the names of those of something
  for (const QualityReport& report :
       {quality_report(SurfaceQuality{}, {}), quality_report(elements, {}, {}), quality_report(PolyhedralQuality{}, {}, {})}) {
    all.rows.insert(all.rows.end(), report.rows.begin(), report.rows.end());
  }
  add_to(all, PlaneQuality{}, {}, {});
  add_to(all, WallQuality{});
  add_to(all, RegionJumps{});
  add_to(all, JumpGrowth{});
  add_displacement(all, {}, {});
  add_flipped(all, {}, {});
  add_intersecting(all, {}, {});
  add_newly_intersecting(all, {});
  std::vector<QualityName> names;
  for (const QualityRow& r : all.rows) {
    const bool known = std::any_of(names.begin(), names.end(), [&](const QualityName& name) { return name.name == r.name; });
    if (!known) names.push_back({r.name, r.counts});
  }
  return names;
}

QualityReport quality_report(const PolyhedralQuality& q, std::span<const Vec3> points, const PolyhedralCells& cells) {
  constexpr Better lower = Better::lower, higher = Better::higher;
  QualityReport result;
  result.method = "Measured by the formulas of OpenFOAM's checkMesh.";
  result.counts = {{"cells", q.cells}, {"faces", q.faces}, {"points", q.points}};
  result.rows = {row("non_orthogonality", "non-orthogonality, largest (degrees)", q.largest_non_orthogonality, lower),
                 row("average_non_orthogonality", "non-orthogonality, average", q.average_non_orthogonality, lower),
                 row("skewness", "skewness of a face, largest", q.largest_skewness, lower),
                 row("aspect_ratio", "aspect ratio of a cell, largest", q.largest_aspect_ratio, lower),
                 row("openness", "openness of a cell, largest", q.largest_openness),
                 row("flatness", "flatness of a face, least", q.least_flatness, higher),
                 row("volume", "volume of a cell, least", q.least_volume),
                 row("largest_volume", "volume of a cell, largest", q.largest_volume),
                 row("total_volume", "volume, total", q.total_volume),
                 row("area", "area of a face, least", q.least_area),
                 row("inverted_cells", "inverted cells: volume or a pyramid not positive", q.inverted_cells, lower),
                 row("negative_volumes", "cells without positive volume", q.negative_volumes, lower),
                 row("wrong_pyramids", "wrong pyramids, on each side of a face", q.wrong_pyramids, lower),
                 row("non_orthogonal_faces", "faces from 70 to 90 degrees", q.non_orthogonal_faces, lower),
                 row("non_orthogonality_errors", "faces from 90 degrees", q.non_orthogonality_errors, lower),
                 row("skew_faces", "faces of skewness beyond 4", q.skew_faces, lower),
                 row("failed_checks", "failed checks", q.failed_checks(), lower)};
  add_left_handed(result, q.left_handed, "left_handed_cells");
  for (const auto& failure : q.failures()) result.failed.push_back(failure.check + ": " + std::to_string(failure.count));
  result.lists = {{"inverted", q.inverted}, {"wrong_faces", q.wrong_faces}};
  result.histograms = {
      histogram("non_orthogonality_histogram", "Non-orthogonality of internal faces (degrees)", 0, 90, q.histogram),
      histogram("skewness_histogram", "Skewness of faces (the last bar also holds what is beyond)", 0, 4, q.skewness_histogram)};
  WorstList inverted{"Inverted cells (volume)", "cell", {}}, wrong{"Faces that look the wrong way", "face", {}};
  WorstList worst{"Internal faces of largest non-orthogonality (degrees)", "face", {}};
  const auto positions = cell_positions(points, cells, q.inverted);
  for (const std::size_t c : q.inverted) inverted.entries.push_back({c, q.cell_volume[c], positions.at(c)});
  for (const std::size_t f : q.wrong_faces) wrong.entries.push_back({f, std::nullopt, mean_of(points, cells.face(f))});
  for (const std::size_t f : q.worst) {
    worst.entries.push_back({f, q.face_non_orthogonality[f], mean_of(points, cells.face(f))});
  }
  result.worst = {inverted, wrong, worst};
  return result;
}

QualityReport quality_report(const ElementQuality& q, std::span<const Vec3> points, const Elements& elements) {
  QualityReport result;
  result.method =
      "Scaled Jacobian of Knupp (2000): 1 for cubes, 0.707 for the regular tetrahedron, not positive where an element is "
      "inverted.";
  result.counts = {{"elements", q.elements}, {"points", q.points}};
  result.rows = rows_of(q, "", "");
  add_left_handed(result, q.left_handed, "left_handed_elements");
  for (std::size_t i = 0; i < q.of_type.size(); ++i) {
    const std::string type = shape(static_cast<ElementType>(i)).name;
    result.counts.emplace_back(type, q.of_type[i].elements);
    if (q.of_type[i].elements == 0) continue;
    auto rows = rows_of(q.of_type[i], type + ".", type + ": ");
    for (QualityRow& r : rows) r.in_table = q.of_type[i].elements < q.elements;  // the only type has the numbers of all
    result.rows.insert(result.rows.end(), rows.begin(), rows.end());
  }
  result.lists = {{"worst", q.worst}};
  result.histograms = {histogram("histogram", "Scaled Jacobian of elements", -1, 1, q.histogram)};
  WorstList worst{"Elements of least scaled Jacobian", "element", {}};
  for (const std::size_t e : q.worst) {
    worst.entries.push_back({e, q.scaled_jacobian[e], mean_of(points, elements.nodes(e))});
  }
  result.worst = {worst};
  return result;
}

QualityReport quality_report(const SurfaceQuality& q, const Mesh& mesh) {
  constexpr Better lower = Better::lower, higher = Better::higher;
  QualityReport result;
  result.method =
      "Quality of a face: twice the radius of the inscribed over that of the circumscribed circle, 1 for regular polygons. Mean "
      "curvature by cotangent weights and mixed areas (Meyer et al. 2003), at points inside the surface.";
  result.counts = {{"faces", q.faces}, {"points", q.points}};
  result.rows = {row("face_quality", "quality of a face 2r/R, least", q.least_face_quality, higher),
                 row("average_face_quality", "quality of a face 2r/R, average", q.average_face_quality, higher),
                 row("least_angle", "angle at a corner, least (degrees)", q.least_angle, higher),
                 row("largest_angle", "angle at a corner, largest (degrees)", q.largest_angle, lower),
                 row("area", "area of a face, least", q.least_area),
                 row("largest_area", "area of a face, largest", q.largest_area),
                 row("total_area", "area, total", q.total_area),
                 row("degenerate_faces", "degenerate faces", q.degenerate_faces, lower),
                 row("mean_curvature", "mean curvature, largest (1/length)", q.largest_mean_curvature),
                 row("average_mean_curvature", "mean curvature, average", q.average_mean_curvature)};
  result.lists = {{"worst", q.worst}, {"degenerate", q.degenerate}};
  result.histograms = {histogram("histogram", "Quality of faces 2r/R", 0, 1, q.histogram),
                       histogram("angle_histogram", "Angles at corners (degrees)", 0, 180, q.angle_histogram)};
  WorstList worst{"Faces of least quality", "face", {}}, curved{"Points of largest mean curvature", "point", {}};
  const auto offsets = mesh.face_offsets();
  for (const std::size_t f : q.worst) {
    const auto corners = std::span(mesh.face_points).subspan(offsets[f], mesh.face_sizes[f]);
    worst.entries.push_back({f, q.face_quality[f], mean_of(mesh.points, corners)});
  }
  const auto& curvature = q.mean_curvature;
  const auto bent = worst_of(q.points, [&](std::size_t i) { return curvature.defined(i) ? -curvature.value[i] : 0; });
  for (const std::size_t i : bent) {
    if (curvature.defined(i)) curved.entries.push_back({i, curvature.value[i], mesh.points[i]});
  }
  result.worst = {worst, curved};
  return result;
}

void add_to(QualityReport& report, const PlaneQuality& q, std::span<const Vec3> points, const Mesh& mesh) {
  constexpr Better lower = Better::lower, higher = Better::higher;
  const std::vector<QualityRow> rows = {
      row("scaled_jacobian", "plane elements: scaled Jacobian, least", q.least_scaled_jacobian, higher),
      row("average_scaled_jacobian", "plane elements: scaled Jacobian, average", q.average_scaled_jacobian, higher),
      row("skewness", "plane elements: equiangle skewness, largest", q.largest_skewness, lower),
      row("average_skewness", "plane elements: equiangle skewness, average", q.average_skewness, lower),
      row("inverted_elements", "inverted elements", q.inverted_elements, lower)};
  report.rows.insert(report.rows.begin(), rows.begin(), rows.end());
  add_left_handed(report, q.left_handed, "left_handed_elements");
  WorstList worst{"Elements of least scaled Jacobian", "face", {}};
  const auto offsets = mesh.face_offsets();
  for (const std::size_t f : q.worst) {
    const auto corners = std::span(mesh.face_points).subspan(offsets[f], mesh.face_sizes[f]);
    worst.entries.push_back({f, q.scaled_jacobian[f], mean_of(points, corners)});
  }
  report.worst.insert(report.worst.begin(), std::move(worst));
  report.method +=
      " The mesh is plane: its faces are measured as elements, too (scaled Jacobian: least sine of a corner, 1 for "
      "rectangles; equiangle skewness, 0 for regular faces).";
}

void add_to(QualityReport& report, const WallQuality& wall) {
  for (const QualityRow& r :
       {row("wall_height", "height of the first layer on the wall, least", wall.least_height),
        row("average_wall_height", "height of the first layer, average", wall.average_height),
        row("largest_wall_height", "height of the first layer, largest", wall.largest_height),
        row("wall_angle", "edges off the wall to its normal, largest (degrees)", wall.largest_angle, Better::lower),
        row("average_wall_angle", "edges off the wall to its normal, average", wall.average_angle, Better::lower),
        row("least_wall_angle", "edges off the wall to its normal, least", wall.least_angle)}) {
    report.rows.push_back(r);
  }
  report.counts.emplace_back("wall_faces", wall.faces);
}

void add_to(QualityReport& report, const RegionJumps& jumps) {
  constexpr Better lower = Better::lower;
  for (const QualityRow& r :
       {row("normal_jump", "jump of normals across borders, largest (degrees)", jumps.largest_normal_jump, lower),
        row("rms_normal_jump", "jump of normals across borders, rms", jumps.rms_normal_jump, lower),
        row("curvature_jump", "jump of mean curvature across borders, largest", jumps.largest_curvature_jump, lower),
        row("rms_curvature_jump", "jump of mean curvature across borders, rms", jumps.rms_curvature_jump, lower)}) {
    report.rows.push_back(r);
  }
  report.counts.emplace_back("border_edges", jumps.edges);
}

void add_to(QualityReport& report, const JumpGrowth& growth) {
  report.rows.push_back(row("normal_jump_growth", "jump of normals, largest growth (degrees)", growth.normal, Better::lower));
  report.rows.push_back(row("curvature_jump_growth", "jump of mean curvature, largest growth", growth.curvature, Better::lower));
}

void add_displacement(QualityReport& report, std::span<const Vec3> points, std::span<const Vec3> original) {
  report.rows.push_back(row("displacement", "displacement of a point, largest", largest_displacement(points, original)));
}

void add_flipped(QualityReport& report, const Mesh& mesh, std::span<const Extreme> flipped) {
  report.rows.push_back(row("flipped_faces", "faces flipped against their surroundings", flipped.size(), Better::lower));
  const auto listed = flipped.first(std::min(flipped.size(), most_listed));
  WorstList list{"Faces turned by more than 90 degrees against their surroundings (cosine)",
                 mesh.cell_count() > 0 ? "boundary face" : "face",
                 {}};
  std::vector<std::size_t> ids;
  const auto offsets = mesh.face_offsets();
  for (const Extreme& face : listed) {
    const auto corners = std::span(mesh.face_points).subspan(offsets[face.id], mesh.face_sizes[face.id]);
    list.entries.push_back({face.id, face.value, mean_of(mesh.points, corners)});
    ids.push_back(face.id);
  }
  report.lists.emplace_back("flipped", std::move(ids));
  report.worst.insert(report.worst.begin(), std::move(list));
}

void add_intersecting(QualityReport& report, const Mesh& mesh, std::span<const IntersectingFace> faces) {
  report.rows.push_back(row("intersecting_faces", "faces that intersect or touch others", faces.size(), Better::lower));
  WorstList list{"Faces that intersect others, the first", "face", {}};
  const auto offsets = mesh.face_offsets();
  const auto listed = faces.first(std::min(faces.size(), most_listed));
  for (const IntersectingFace& face : listed) {
    const auto corners = std::span(mesh.face_points).subspan(offsets[face.face], mesh.face_sizes[face.face]);
    list.entries.push_back({face.face, std::nullopt, mean_of(mesh.points, corners)});
  }
  report.lists.emplace_back("intersecting", ids_of(listed));
  if (!listed.empty()) report.worst.push_back(std::move(list));
}

void add_newly_intersecting(QualityReport& report, std::span<const IntersectingFace> faces) {
  report.rows.push_back(row("newly_intersecting_faces", "faces that ran into others", faces.size(), Better::lower));
  report.lists.emplace_back("newly_intersecting", ids_of(faces.first(std::min(faces.size(), most_listed))));
}

}  // namespace deform
