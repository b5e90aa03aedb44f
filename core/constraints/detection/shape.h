// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "core/constraints/detection/detect.h"

namespace deform::detection {

using Eigen::Vector3d;

/// A plane, cylinder, sphere or cone. A cone is given by a cross-section near its points instead of its apex, which goes to
/// infinity as the half angle goes to zero.
struct Shape {
  PrimitiveKind kind = PrimitiveKind::plane;
  Vector3d point = Vector3d::Zero();  ///< on the plane or axis, or centre of the sphere
  Vector3d axis = Vector3d::UnitZ();  ///< unit length; towards the wider side of a cone
  double radius = 0;                  ///< for a cone, at `point`
  double angle = 0;                   ///< half angle of a cone, radians
  double sine = 0, cosine = 1;        ///< sine and cosine of angle

  /// Signed distance of x and the unit normal there (the gradient).
  struct Foot {
    double distance;
    Vector3d normal;
  };
  Foot foot(const Vector3d& x) const {
    switch (kind) {
      case PrimitiveKind::plane:
        return foot<PrimitiveKind::plane>(x);
      case PrimitiveKind::cylinder:
        return foot<PrimitiveKind::cylinder>(x);
      case PrimitiveKind::sphere:
        return foot<PrimitiveKind::sphere>(x);
      case PrimitiveKind::cone:
        break;
    }
    return foot<PrimitiveKind::cone>(x);
  }
  /// The same for a kind known at compile time.
  template <PrimitiveKind known>
  Foot foot(const Vector3d& x) const {
    const Vector3d q = x - point;
    if constexpr (known == PrimitiveKind::plane) return {q.dot(axis), axis};
    if constexpr (known == PrimitiveKind::sphere) {
      const double length = q.norm();
      return {length - radius, length > 0 ? Vector3d(q / length) : axis};
    }
    const double h = q.dot(axis);
    const Vector3d across = q - h * axis;
    const double rho = across.norm();
    const Vector3d u = rho > 0 ? Vector3d(across / rho) : Vector3d(axis.unitOrthogonal());
    return {(rho - radius) * cosine - h * sine, cosine * u - sine * axis};
  }
  double distance(const Vector3d& x) const { return foot(x).distance; }
  Vector3d apex() const { return point - axis * (radius * cosine / sine); }
};

/// The data for a fit: corners for distances, faces for normals.
struct FitData {
  std::vector<Vector3d> corners;
  std::vector<double> corner_weights;
  std::vector<Vector3d> centres, normals;
  std::vector<double> weights;
};

/// An initial guess from the normals: the axis of a cylinder or cone from their distribution, centre and radius from the
/// regression of face centres on normals. Returns std::nullopt if the data do not determine a shape (a plane does not determine
/// a cylinder).
std::optional<Shape> guess(PrimitiveKind kind, const FitData& data);

/// The accuracy of a fit: while faces are still being collected the last digits do not matter.
enum class Effort { quick, full };

/// Fits a shape to the corners in the least-squares sense by Levenberg-Marquardt iterations from `start`. Returns std::nullopt if
/// it diverges (radius beyond 20, half angle outside 0.5..89.5 degrees). Lengths are divided by the size of the surface.
std::optional<Shape> refine(const Shape& start, const FitData& data, Effort effort);

/// Calls guess(), then refine().
std::optional<Shape> fitted(PrimitiveKind kind, const FitData& data, Effort effort);

/// The weighted root mean square of the distances of the corners, and of the angles (radians) between the normals of faces
/// and shape.
double rms_distance(const Shape& shape, const FitData& data);
double rms_angle(const Shape& shape, const FitData& data);

}  // namespace deform::detection
