// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/unit_points.h"

#include "core/base/error.h"

namespace deform {

UnitBox unit_box(const Mesh& mesh) {
  const Box bounds = bounding_box(mesh.points);
  const double diagonal = bounds.diagonal();
  if (!(diagonal > 0)) throw Error(ErrorCode::invalid_argument, "mesh: all points coincide, so it has no extent to deform");
  return {bounds.min, diagonal};
}

std::vector<Vec3> unit_points(const Mesh& mesh) {
  const UnitBox box = unit_box(mesh);
  std::vector<Vec3> points(mesh.points);
  for (Vec3& x : points) x = box.to_unit(x);
  return points;
}

SparseMatrix linear_coefficients(const std::vector<Vec3>& samples) {
  Eigen::MatrixXd linear(static_cast<Eigen::Index>(samples.size()), 4);
  for (std::size_t j = 0; j < samples.size(); ++j) {
    linear.row(static_cast<Eigen::Index>(j)) << 1, samples[j][0], samples[j][1], samples[j][2];
  }
  return linear.sparseView(0, 0);
}

}  // namespace deform
