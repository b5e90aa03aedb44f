// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <Geom_ElementarySurface.hxx>
#include <Geom_Surface.hxx>
#include <array>
#include <gp_Trsf.hxx>

#include "core/base/types.h"

namespace deform::cad {

/// The rotation and translation that take columns nearest to others, in the sense of least squares (Kabsch 1976).
struct RigidMotion {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d from, to;  ///< centroids
  double scale = 1;
  Eigen::Vector3d operator()(const Eigen::Vector3d& p) const { return to + scale * (rotation * (p - from)); }
};
gp_Trsf transformation_of(const RigidMotion& motion);
RigidMotion best_motion(const Eigen::Matrix3Xd& before, const Eigen::Matrix3Xd& after);
/// The same with a uniform scale (Umeyama 1991).
RigidMotion best_similarity(const Eigen::Matrix3Xd& before, const Eigen::Matrix3Xd& after);

/// Whether analytic_fit() knows the type: plane, cylinder, cone, sphere.
bool is_analytic(const Handle(Geom_Surface) & surface);

/// The surface of the type of `rest` nearest to places, in the sense of least squares, by Gauss-Newton from where the best rigid
/// motion takes it. rest_places: where the places are on it, columns; at least three. Its axes lie so that u, and v of a plane or
/// sphere, are near those of the same points before; v of a cylinder or cone counts from the middle of the places. largest: the
/// largest distance of a place from it. Deterministic.
struct AnalyticFit {
  Handle(Geom_ElementarySurface) surface;
  double largest = 0;
};
AnalyticFit analytic_fit(const Handle(Geom_Surface) & rest, const Eigen::Matrix3Xd& rest_places, const Eigen::Matrix3Xd& places);

/// (u, v) of the point of the surface nearest to p; u of a periodic surface nearest to u0.
std::array<double, 2> analytic_parameters(const Geom_ElementarySurface& surface, const Vec3& p, double u0);

/// Distance of a place from the whole surface.
double analytic_distance(const Geom_ElementarySurface& surface, const Vec3& p);

}  // namespace deform::cad
