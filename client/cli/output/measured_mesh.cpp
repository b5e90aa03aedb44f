// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/measured_mesh.h"

#include <algorithm>
#include <utility>

#include "client/cli/setup/control_lattice.h"
#include "client/cli/setup/reading.h"
#include "client/cli/setup/region_points.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/quality/face_intersections.h"
#include "core/quality/flipped_faces.h"

namespace deform::cli {

namespace {

std::vector<FaceId> faces_of(const MeasuredMesh& measured, const std::vector<std::string>& walls) {
  try {
    return wall_faces(measured.mesh(), walls);
  } catch (const Error& error) {
    throw Error(error.code(), measured.path + ": --wall " + error.what());
  }
}

void add_walls(MeasuredMesh& measured, const std::vector<std::string>& walls) {
  if (walls.empty()) return;
  if (measured.surface) {
    throw Error(ErrorCode::invalid_argument,
                "--wall " + walls.front() + ": " + measured.path + " is a surface; the cells of a volume mesh lie on walls");
  }
  const auto& faces = measured.wall_faces = faces_of(measured, walls);
  if (measured.cells) {
    add_to(measured.report, wall_quality({measured.mesh(), faces, measured.cells->cell_volume}, *measured.file->cells()));
  } else {
    add_to(measured.report, wall_quality({measured.mesh(), faces, measured.elements->volume}, *measured.file->elements()));
  }
}

RegionJumps jumps_of(const MeasuredMesh& measured, const std::vector<std::uint32_t>& labels) {
  const Mesh& mesh = measured.mesh();
  if (measured.surface) return region_jumps(mesh, labels, measured.surface->mean_curvature);
  return region_jumps(mesh, labels, mean_curvature(mesh, Adjacency(mesh)));
}

void add_jumps(Comparison& comparison, const v1::Setup& setup) {
  if (selects_controls(setup)) {
    throw Error(ErrorCode::invalid_argument,
                "--setup: with control CONTROLS handles and fixed regions hold no points of the mesh, so there are no borders to "
                "measure");
  }
  MeasuredMesh& after = comparison.after;
  if (!comparison.before) return add_to(after.report, jumps_of(after, region_labels(setup, after.mesh())));
  MeasuredMesh& before = *comparison.before;
  const auto labels = region_labels(setup, before.mesh());
  const RegionJumps jumps_before = jumps_of(before, labels);
  const RegionJumps jumps = jumps_of(after, comparison.same_points ? labels : region_labels(setup, after.mesh()));
  add_to(before.report, jumps_before);
  add_to(after.report, jumps);
  if (comparison.same_points) add_to(after.report, jump_growth(jumps, jumps_before));
}

bool same_kind(const MeasuredMesh& a, const MeasuredMesh& b) {
  return a.surface.has_value() == b.surface.has_value() && a.elements.has_value() == b.elements.has_value();
}

bool same_connectivity(const Mesh& x, const Mesh& y) {
  if (x.point_count() != y.point_count() || x.face_sizes != y.face_sizes || x.face_points != y.face_points) return false;
  if (static_cast<bool>(x.elements) != static_cast<bool>(y.elements) ||
      static_cast<bool>(x.cells) != static_cast<bool>(y.cells)) {
    return false;
  }
  if (x.elements) return x.elements->types == y.elements->types && x.elements->points == y.elements->points;
  return !x.cells || (x.cells->face_points == y.cells->face_points && x.cells->owner == y.cells->owner &&
                      x.cells->neighbour == y.cells->neighbour);
}

std::size_t cells_in(const MeasuredMesh& measured) {
  return measured.plane ? measured.plane->elements : measured.mesh().cell_count();
}

void add_comparison(Comparison& comparison) {
  MeasuredMesh& after = comparison.after;
  const MeasuredMesh& before = *comparison.before;
  if (!same_kind(after, before)) {
    throw Error(ErrorCode::invalid_argument, "--before " + before.path + ": not the kind of mesh that " + after.path + " is");
  }
  comparison.same_points = same_connectivity(after.mesh(), before.mesh());
  if (!comparison.same_points) {
    comparison.notes.push_back("The meshes differ in their points or faces: there are no displacements and no turned faces.");
    return;
  }
  add_displacement(after.report, after.mesh().points, before.mesh().points);
  if (after.mesh().face_count() == 0) return;
  add_flipped(after.report, after.mesh(), flipped_faces(after.mesh(), before.mesh().points));
  add_newly_intersecting(after.report, IntersectionCheck(before.mesh(), before.mesh().points).appeared(after.mesh().points));
}

}  // namespace

MeasuredMesh::MeasuredMesh(const std::string& file_path, const io::ReadOptions& reading)
    : path(file_path), file(io::read_mesh_file(file_path, reading)), mesh_(file->mesh()) {}

MeasuredMesh measured_mesh(const std::string& path, const std::vector<std::string>& walls, const io::ReadOptions& reading,
                           const Mesh* rest) {
  MeasuredMesh result(path, reading);
  const bool same = rest != nullptr && same_connectivity(result.mesh(), *rest);
  if (result.mesh().face_count() == 0 && result.mesh().cell_count() == 0) {
    throw Error(ErrorCode::invalid_argument, path + ": it has no faces and no cells, only points");
  }
  static_cast<MeshQuality&>(result) =
      mesh_quality(result.mesh(), left_handed_of(result.mesh(), same ? rest->points : result.mesh().points));
  if (result.surface) {
    const IntersectionCheck intersections(result.mesh(), same ? rest->points : result.mesh().points);
    add_intersecting(result.report, result.mesh(), intersections.at(result.mesh().points));
  }
  add_walls(result, walls);
  return result;
}

Comparison compare(const ComparisonInput& input) {
  std::optional<MeasuredMesh> before;
  if (!input.before.empty()) before.emplace(measured_mesh(input.before, input.walls, input.reading));
  io::ReadOptions reading = input.reading;
  reading.faces_of = input.before;
  Comparison result{measured_mesh(input.file, input.walls, reading, before ? &before->mesh() : nullptr), std::nullopt, false, {}};
  result.before = std::move(before);
  if (result.before) add_comparison(result);
  for (const QualityRow& row : result.after.report.rows) {
    if (!row.name.starts_with("left_handed") || row.value == 0) continue;
    result.notes.push_back(
        number_digits(row.value) + " of " + std::to_string(cells_in(result.after)) +
        " cells have their nodes in mirrored order (left-handed): they are measured as in a mirror. Solvers may "
        "refuse them" +
        (result.before ? "." : "; --before tells them from cells that a deformation turned inside out."));
  }
  if (!input.setup.empty()) add_jumps(result, read_setup_file(input.setup, input.reading).setup);
  return result;
}

}  // namespace deform::cli
