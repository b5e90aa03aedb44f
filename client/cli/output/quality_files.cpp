// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/quality_files.h"

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/base/error.h"
#include "core/base/small_file.h"
#include "core/base/vectors.h"
#include "core/base/version.h"
#include "core/io/vtk_output.h"
#include "core/quality/boundary_owners.h"

namespace deform::cli {

namespace {

/// Per face of the boundary the number of the cell behind it.
std::vector<double> behind(const std::vector<BoundaryOwner>& owners, const std::vector<double>& cells) {
  std::vector<double> values;
  values.reserve(owners.size());
  for (const BoundaryOwner& owner : owners) values.push_back(cells[owner.cell]);
  return values;
}

std::vector<PictureField> fields_of(const Comparison& comparison) {
  using Of = PictureField::Of;
  const MeasuredMesh& after = comparison.after;
  std::vector<PictureField> fields;
  if (after.surface) {
    if (after.plane) fields.push_back({"scaled Jacobian", Of::faces, after.plane->scaled_jacobian, Better::higher});
    fields.push_back({"quality of faces 2r/R", Of::faces, after.surface->face_quality, Better::higher});
    fields.push_back({"mean curvature", Of::points, after.surface->mean_curvature.value, Better::neither});
  } else if (after.elements) {
    const auto owners = boundary_owners(after.mesh(), *after.file->elements());
    fields.push_back(
        {"scaled Jacobian of the element behind", Of::faces, behind(owners, after.elements->scaled_jacobian), Better::higher});
  } else {
    const auto owners = boundary_owners(after.mesh(), *after.file->cells());
    fields.push_back({"non-orthogonality of the cell behind (degrees)", Of::faces,
                      behind(owners, after.cells->cell_non_orthogonality), Better::lower});
  }
  if (comparison.same_points) {
    PictureField moved{"displacement", Of::points, {}, Better::neither};
    const auto &now = after.mesh().points, &then = comparison.before->mesh().points;
    for (std::size_t i = 0; i < now.size(); ++i) moved.values.push_back(distance(now[i], then[i]));
    fields.push_back(std::move(moved));
  }
  return fields;
}

}  // namespace

std::vector<QualityPage::Constraint> constraints_of(const std::string& path) {
  const auto refuse = [&](const std::string& why) { throw Error(ErrorCode::invalid_argument, "--result " + path + ": " + why); };
  std::ifstream file(path);
  if (!file) throw Error(ErrorCode::not_found, "--result " + path + ": cannot be read: " + why_unreadable(path));
  const auto json = nlohmann::json::parse(file, nullptr, false);
  const nlohmann::json::json_pointer place("/report/constraints/residuals");
  if (json.is_discarded()) refuse("is not JSON");
  if (!json.is_object() || !json.contains("report")) refuse("is not what `deform apply --json` prints");
  if (!json.contains(place)) refuse("its design had no constraints");
  std::vector<QualityPage::Constraint> constraints;
  try {
    for (const auto& residual : json.at(place)) {
      constraints.push_back({residual.at("name"), residual.at("largest"), residual.at("rms"), residual.at("free_largest"),
                             residual.at("free_rms"), residual.at("missed")});
    }
  } catch (const nlohmann::json::exception& error) {
    refuse(error.what());
  }
  return constraints;
}

void write_quality_page(const Comparison& comparison, const PageExtras& extras, const std::filesystem::path& path) {
  PictureSource source{comparison.after.mesh(), {}, fields_of(comparison)};
  if (comparison.same_points) source.before = comparison.before->mesh().points;
  source.shown = comparison.after.wall_faces;
  const Picture picture = make_picture(source);
  QualityPage page{comparison.after.path, "", comparison.after.report};
  if (comparison.before) {
    page.before_file = comparison.before->path;
    page.before = &comparison.before->report;
  }
  page.gates = extras.gates;
  page.constraints = extras.constraints;
  page.notes = comparison.notes;
  page.picture = &picture;
  page.program = std::string("deform ") + version();
  io::write_file(path, html_page(page));
}

void write_quality_arrays(const Comparison& comparison, const std::filesystem::path& path) {
  const MeasuredMesh& after = comparison.after;
  const Mesh& mesh = after.mesh();
  io::VtkArrays arrays;
  if (comparison.same_points) {
    io::VtkArray displacement{"displacement", 3, {}};
    for (std::size_t i = 0; i < mesh.point_count(); ++i) {
      for (int k = 0; k < 3; ++k) displacement.values.push_back(mesh.points[i][k] - comparison.before->mesh().points[i][k]);
    }
    arrays.points.push_back(std::move(displacement));
  }
  if (after.surface) {
    arrays.points.push_back({"mean_curvature", 1, after.surface->mean_curvature.value});
    arrays.cells.push_back({"face_quality", 1, after.surface->face_quality});
    if (after.plane) arrays.cells.push_back({"scaled_jacobian", 1, after.plane->scaled_jacobian});
    return io::write_vtp(mesh, arrays, path);
  }
  if (after.elements) {
    arrays.cells.push_back({"scaled_jacobian", 1, after.elements->scaled_jacobian});
    arrays.cells.push_back({"volume", 1, after.elements->volume});
    return io::write_vtu(mesh.points, *after.file->elements(), arrays, path);
  }
  arrays.cells.push_back({"non_orthogonality", 1, after.cells->cell_non_orthogonality});
  arrays.cells.push_back({"volume", 1, after.cells->cell_volume});
  io::write_vtu(mesh.points, *after.file->cells(), arrays, path);
}

}  // namespace deform::cli
