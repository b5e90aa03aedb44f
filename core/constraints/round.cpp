// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/round.h"

#include <cmath>

#include "core/constraints/fit_starts.h"

namespace deform {

RoundDistance round_distance(const Eigen::Vector3d& y, double curvature, About about) {
  const double k = curvature;
  Eigen::Vector3d my = y;
  Eigen::Matrix3d M = Eigen::Matrix3d::Identity();
  if (about == About::z_axis) my[2] = M(2, 2) = 0;
  const double q = my.squaredNorm();
  RoundDistance d;
  Eigen::Vector3d u = k * my;
  u[0] += 1;
  const double length = u.norm();
  d.value = (k * q + 2 * y[0]) / (1 + length);
  d.ratio = length;
  // At the centre every direction is the nearest: one is taken, and the derivatives stay finite.
  const double s = std::max(length, 1e-9);
  if (length > 1e-9) d.normal = u / length;
  d.hessian = (k / s) * (M - d.normal * d.normal.transpose());
  d.by_curvature = (q - d.value * d.value) / (2 * s);
  const double ratio_by_curvature = d.value + k * d.by_curvature;
  d.normal_by_curvature = (my - ratio_by_curvature * d.normal) / s;
  d.by_curvature_twice = -(d.value + ratio_by_curvature) * d.by_curvature / s;
  return d;
}

void round_residual(const Eigen::Vector3d& y, double curvature, About about, LocalResidual<1, 1>& out) {
  const RoundDistance d = round_distance(y, curvature, about);
  out.value[0] = d.value;
  out.gradient << d.normal.transpose(), d.by_curvature;
  out.curvature << d.value * d.hessian, d.value * d.normal_by_curvature, d.value * d.normal_by_curvature.transpose(),
      d.value * d.by_curvature_twice;
}

Fit<1> touching(const Eigen::Vector3d& origin, const Eigen::Vector3d& normal, const Eigen::Vector3d& z, double curvature) {
  Fit<1> fit;
  fit.frame.origin = origin;
  fit.frame.axes = axes_from(z, normal);
  fit.size[0] = curvature;
  return fit;
}

Fit<1> centred(const Eigen::Vector3d& centre, double radius, const Eigen::Vector3d& z, const Eigen::Vector3d& towards) {
  Fit<1> fit;
  fit.frame.axes = axes_from(z, towards - centre);
  fit.frame.origin = centre + radius * fit.frame.axes.col(0);
  fit.size[0] = 1 / radius;
  return fit;
}

std::vector<Fit<1>> with_curvature(const std::vector<Fit<1>>& starts, double curvature) {
  std::vector<Fit<1>> all;
  for (const Fit<1>& start : starts) {
    for (const double sign : {1.0, -1.0}) {
      all.push_back(start);
      all.back().size[0] = sign * curvature;
    }
    // With the same centre instead of the same tangent.
    if (std::abs(start.size[0]) < 1e-3 * curvature) continue;
    Fit<1> same_centre = start;
    same_centre.size[0] = std::copysign(curvature, start.size[0]);
    same_centre.frame.origin += (1 / same_centre.size[0] - 1 / start.size[0]) * start.frame.axes.col(0);
    all.push_back(same_centre);
  }
  return all;
}

}  // namespace deform
