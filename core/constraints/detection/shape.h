// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Dense>
#include <optional>
#include <vector>

#include "core/constraints/detection/detect.h"

namespace deform::detection {

using Eigen::Vector3d;

/// A plane, cylinder, sphere or cone. A cone is given where it is cut across beside its points rather than by its apex, which
/// runs off to infinity for half angles near zero.
struct Shape {
  PrimitiveKind kind = PrimitiveKind::plane;
  Vector3d point = Vector3d::Zero();  ///< on the plane or axis, or the centre
  Vector3d axis = Vector3d::UnitZ();  ///< unit; of a cone towards the wider side
  double radius = 0;                  ///< of a cone at `point`
  double angle = 0;                   ///< half angle of a cone
  double sine = 0, cosine = 1;        ///< of angle

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
  /// The same of what is known to be of that kind.
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

/// What a shape is fitted to: corners for distances, faces for directions.
struct FitData {
  std::vector<Vector3d> corners;
  std::vector<double> corner_weights;
  std::vector<Vector3d> centres, normals;
  std::vector<double> weights;
};

/// A first guess from the normals: axis of a cylinder or cone from their spread, centre and radius from the regression of centres
/// over normals. No shape for data that has none (the normals of a plane make no cylinder).
std::optional<Shape> guess(PrimitiveKind kind, const FitData& data);

/// How far to go: while faces are still being collected the last digits do not matter.
enum class Effort { quick, full };

/// The shape of least squared distance to the corners, by Levenberg-Marquardt from `start`; none when it runs off (radius beyond
/// 20, half angle out of 0.5..89.5 degrees). Lengths over the size of the surface.
std::optional<Shape> refine(const Shape& start, const FitData& data, Effort effort);

/// Both.
std::optional<Shape> fitted(PrimitiveKind kind, const FitData& data, Effort effort);

/// Weighted root mean square of the distances of the corners, and of the angles (radians) between normals of face and shape.
double rms_distance(const Shape& shape, const FitData& data);
double rms_angle(const Shape& shape, const FitData& data);

}  // namespace deform::detection
