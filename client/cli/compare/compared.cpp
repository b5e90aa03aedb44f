// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/compare/compared.h"

#include <algorithm>
#include <array>
#include <limits>
#include <string_view>
#include <utility>

#include "client/cli/setup/control_lattice.h"
#include "client/cli/setup/region_points.h"
#include "core/mesh/adjacency.h"
#include "core/quality/flipped_faces.h"
#include "core/quality/plane_quality.h"
#include "core/quality/safe_amplitude.h"

namespace deform::cli {

namespace {

/// The measures that are shown where there are such; "inverted" and "flipped" are elsewhere.
constexpr std::array<std::string_view, 5> shown_names{"scaled_jacobian", "non_orthogonality", "skewness", "least_angle",
                                                      "face_quality"};

QualityReport report_at_rest(const io::MeshFile& file) {
  const Mesh& mesh = *file.mesh();
  const auto set = cell_set(mesh);
  const std::vector<char> left_handed = set ? left_handed_cells(mesh.points, *set) : std::vector<char>();
  if (const auto cells = file.cells()) {
    PolyhedralLimits limits;
    limits.left_handed = left_handed;
    return quality_report(polyhedral_quality(mesh.points, *cells, limits), mesh.points, *cells);
  }
  if (const auto elements = file.elements()) {
    return quality_report(element_quality(mesh.points, *elements, left_handed), mesh.points, *elements);
  }
  if (mesh.face_count() == 0) return {};
  QualityReport report = quality_report(surface_quality(mesh), mesh);
  if (set) add_to(report, plane_quality(mesh.points, mesh, left_handed), mesh.points, mesh);
  return report;
}

bool is_flat(const Mesh& mesh) {
  return std::all_of(mesh.points.begin(), mesh.points.end(), [&](const Vec3& p) { return p[2] == mesh.points[0][2]; });
}

}  // namespace

bool ComparedMethod::works() const {
  return std::any_of(designs.begin(), designs.end(), [](const ComparedDesign& design) { return design.error.empty(); });
}

std::vector<char> faces_without_handles(const v1::Setup& setup, const Mesh& mesh) {
  if (mesh.cell_count() == 0) return {};
  const std::vector<std::uint32_t> labels = region_labels(setup, mesh);
  const auto offsets = mesh.face_offsets();
  const auto held = [&](FaceId f) {
    return std::all_of(mesh.face_points.begin() + static_cast<std::ptrdiff_t>(offsets[f]),
                       mesh.face_points.begin() + static_cast<std::ptrdiff_t>(offsets[f + 1]),
                       [&](PointId p) { return labels[p] >= ResolvedRegions::first_handle; });
  };
  std::vector<char> hidden(mesh.face_count(), 1);
  for (const Group& group : mesh.groups) {
    if (!std::any_of(group.faces.begin(), group.faces.end(), held)) continue;
    for (const FaceId f : group.faces) hidden[f] = 0;
  }
  return std::find(hidden.begin(), hidden.end(), 0) == hidden.end() ? std::vector<char>() : hidden;
}

/// What is measured of the surface at rest, once.
struct DesignMeasurer::Surface {
  explicit Surface(const v1::Setup& setup, const Mesh& mesh)
      : adjacency(mesh),
        curvature(mean_curvature(mesh, adjacency)),
        labels(region_labels(setup, mesh)),
        jumps(region_jumps(mesh, labels, curvature)),
        flips(mesh, mesh.points) {}

  Adjacency adjacency;
  MeanCurvature curvature;
  std::vector<std::uint32_t> labels;
  RegionJumps jumps;
  FlipCheck flips;
};

DesignMeasurer::DesignMeasurer(const v1::Setup& setup, const io::MeshFile& rest) : setup_(setup), mesh_(*rest.mesh()) {
  if (!selects_controls(setup) && setup.symmetry().empty()) places_.emplace(setup, mesh_);
  if (mesh_.face_count() > 0 && !is_flat(mesh_)) surface_ = std::make_unique<Surface>(setup, mesh_);
  const QualityReport report = report_at_rest(rest);
  for (const std::string_view name : shown_names) {
    const QualityRow* row = report.find(std::string(name));
    if (row != nullptr) measures_.push_back({row->name, row->label, row->better, row->value});
  }
}

DesignMeasurer::~DesignMeasurer() = default;

ComparedDesign DesignMeasurer::measured(const v1::DesignResult& result, Points&& points, std::span<const double> values,
                                        Keep keep) const {
  ComparedDesign design;
  design.result = result;
  if (places_) design.misfit = places_->misfit(values, points);
  for (const ShownMeasure& shown : measures_) {
    double value = std::numeric_limits<double>::quiet_NaN();
    for (const auto& measure : result.quality().measures()) {
      if (measure.name() == shown.name) value = measure.value();
    }
    design.measures.push_back(value);
  }
  if (surface_) {
    Mesh moved = mesh_;
    moved.points = points;
    const MeanCurvature curvature = mean_curvature(moved, surface_->adjacency);
    CurvatureChange change = curvature_change(mesh_, surface_->curvature, curvature);
    const RegionJumps jumps = region_jumps(moved, surface_->labels, curvature);
    design.smoothness = Smoothness{change.high_pass_energy, jump_growth(jumps, surface_->jumps).normal.value};
    if (keep == Keep::pictures) {
      design.curvature_change = std::move(change.value);
      design.flipped.assign(mesh_.face_count(), 0);
      for (const Extreme& face : surface_->flips.flipped(points)) design.flipped[face.id] = 1;
    }
  }
  if (keep == Keep::pictures) design.points = std::move(points);
  return design;
}

}  // namespace deform::cli
