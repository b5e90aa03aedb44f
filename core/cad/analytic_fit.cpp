// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/analytic_fit.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <ElSLib.hxx>
#include <Geom_ConicalSurface.hxx>
#include <Geom_CylindricalSurface.hxx>
#include <Geom_Plane.hxx>
#include <Geom_SphericalSurface.hxx>
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <vector>

#include "core/numerics/dense/decompositions.h"

namespace deform::cad {

namespace {

constexpr int most_steps = 15;

enum class Shape { plane, cylinder, cone, sphere, none };

Shape shape_of(const Handle(Geom_Surface) & surface) {
  if (surface->IsKind(STANDARD_TYPE(Geom_Plane))) return Shape::plane;
  if (surface->IsKind(STANDARD_TYPE(Geom_CylindricalSurface))) return Shape::cylinder;
  if (surface->IsKind(STANDARD_TYPE(Geom_ConicalSurface))) return Shape::cone;
  if (surface->IsKind(STANDARD_TYPE(Geom_SphericalSurface))) return Shape::sphere;
  return Shape::none;
}

Eigen::Vector3d vector_of(const gp_XYZ& p) { return {p.X(), p.Y(), p.Z()}; }
gp_Dir direction_of(const Eigen::Vector3d& d) { return {d[0], d[1], d[2]}; }

/// A surface with the z axis of its frame as axis; the x and y axes are those of the parametrization.
struct Axial {
  Shape shape = Shape::plane;
  Eigen::Vector3d origin;
  Eigen::Matrix3d axes;          ///< columns; may be left-handed
  double radius = 0, slope = 0;  ///< of a cone at the origin, and its angle

  /// Signed distance of a point in local coordinates, and its derivatives by (shift x, y, z, tilt about y, about x, radius,
  /// slope).
  double distance(const Eigen::Vector3d& p, Eigen::Matrix<double, 7, 1>& derivative) const {
    derivative.setZero();
    const double rho = std::hypot(p[0], p[1]), safe = std::max(rho, 1e-300);
    switch (shape) {
      case Shape::plane:
        derivative << 0, 0, -1, p[0], p[1], 0, 0;
        return p[2];
      case Shape::cylinder:
        derivative << -p[0] / safe, -p[1] / safe, 0, -p[0] * p[2] / safe, -p[1] * p[2] / safe, -1, 0;
        return rho - radius;
      case Shape::cone: {
        const double c = std::cos(slope), s = std::sin(slope);
        derivative << -c * p[0] / safe, -c * p[1] / safe, 0, -c * p[0] * p[2] / safe - s * p[0],
            -c * p[1] * p[2] / safe - s * p[1], -c, -(rho - radius) * s - p[2] * c;
        return (rho - radius) * c - p[2] * s;
      }
      default: {
        const double length = p.norm();
        const Eigen::Vector3d n = p / std::max(length, 1e-300);
        derivative << -n[0], -n[1], -n[2], 0, 0, -1, 0;
        return length - radius;
      }
    }
  }
  Eigen::Vector3d local(const Eigen::Vector3d& p) const { return axes.transpose() * (p - origin); }
};

/// What may change of each shape, of the seven derivatives.
std::vector<int> free_of(Shape shape) {
  switch (shape) {
    case Shape::plane:
      return {2, 3, 4};
    case Shape::cylinder:
      return {0, 1, 3, 4, 5};
    case Shape::cone:
      return {0, 1, 3, 4, 5, 6};
    default:
      return {0, 1, 2, 5};
  }
}

double largest_distance(const Axial& axial, const Eigen::Matrix3Xd& places) {
  Eigen::Matrix<double, 7, 1> ignored;
  double largest = 0;
  for (Eigen::Index i = 0; i < places.cols(); ++i) {
    largest = std::max(largest, std::abs(axial.distance(axial.local(places.col(i)), ignored)));
  }
  return largest;
}

/// One step of Gauss-Newton, of least length where the places do not determine it. Returns its size, relative to `size`.
double step(Axial& axial, const Eigen::Matrix3Xd& places, double size) {
  const std::vector<int> free = free_of(axial.shape);
  const auto columns = static_cast<Eigen::Index>(free.size());
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 7, 7> normal = Eigen::MatrixXd::Zero(columns, columns);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(columns);
  Eigen::Matrix<double, 7, 1> derivative;
  for (Eigen::Index i = 0; i < places.cols(); ++i) {
    const double off = axial.distance(axial.local(places.col(i)), derivative);
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 7, 1> row(columns);
    // Angles count by the way that they move points.
    for (Eigen::Index k = 0; k < columns; ++k)
      row[k] = derivative[free[k]] / (free[k] == 3 || free[k] == 4 || free[k] == 6 ? size : 1);
    normal += row * row.transpose();
    right -= off * row;
  }
  const auto [values, vectors] = symmetric_eigen(Eigen::MatrixXd(normal));
  Eigen::VectorXd change = Eigen::VectorXd::Zero(columns);
  for (Eigen::Index k = 0; k < columns; ++k) {
    if (values[k] > 1e-12 * values[columns - 1]) change += vectors.col(k) * (vectors.col(k).dot(right) / values[k]);
  }
  Eigen::Matrix<double, 7, 1> full = Eigen::Matrix<double, 7, 1>::Zero();
  for (Eigen::Index k = 0; k < columns; ++k) {
    full[free[k]] = change[k] / (free[k] == 3 || free[k] == 4 || free[k] == 6 ? size : 1);
  }
  axial.origin += axial.axes * full.head<3>();
  // The axis tilts to z + a x + b y, and the others with it.
  const Eigen::Vector3d tilted = (axial.axes * Eigen::Vector3d(full[3], full[4], 1)).normalized();
  const double hand = axial.axes.determinant();
  Eigen::Vector3d x = axial.axes.col(0) - tilted * tilted.dot(axial.axes.col(0));
  x.normalize();
  axial.axes.col(0) = x;
  axial.axes.col(2) = tilted;
  axial.axes.col(1) = (hand < 0 ? -1 : 1) * tilted.cross(x);
  axial.radius += full[5];
  axial.slope += full[6];
  return change.norm() / size;
}

Handle(Geom_ElementarySurface) made(const Axial& axial) {
  gp_Ax3 frame(gp_Pnt(axial.origin[0], axial.origin[1], axial.origin[2]), direction_of(axial.axes.col(2)),
               direction_of(axial.axes.col(0)));
  if (axial.axes.determinant() < 0) frame.YReverse();
  switch (axial.shape) {
    case Shape::plane:
      return new Geom_Plane(frame);
    case Shape::cylinder:
      return new Geom_CylindricalSurface(frame, axial.radius);
    case Shape::cone:
      return new Geom_ConicalSurface(frame, axial.slope, axial.radius);
    default:
      return new Geom_SphericalSurface(frame, axial.radius);
  }
}

bool sound(const Axial& axial, double size) {
  if (!axial.origin.allFinite() || !axial.axes.allFinite()) return false;
  switch (axial.shape) {
    case Shape::plane:
      return true;
    case Shape::cone:  // OpenCASCADE's limits, and a reference circle that is one
      return axial.radius > 0 && axial.radius < 1e4 * size && std::abs(axial.slope) > 1e-6 &&
             std::abs(axial.slope) < std::numbers::pi / 2 - 1e-6;
    default:
      return axial.radius > 0 && axial.radius < 1e4 * size;
  }
}

/// Turns x and y about the axis until u of the places is on average what it was.
void turn(Axial& axial, const Geom_ElementarySurface& rest, const Eigen::Matrix3Xd& rest_places, const Eigen::Matrix3Xd& places) {
  if (axial.shape == Shape::sphere) return;
  const gp_Ax3& frame = rest.Position();
  Eigen::Matrix3d axes;
  axes << vector_of(frame.XDirection().XYZ()), vector_of(frame.YDirection().XYZ()), vector_of(frame.Direction().XYZ());
  std::complex<double> sum = 0;
  const Eigen::Vector3d middle =
      axial.shape == Shape::plane ? Eigen::Vector3d(rest_places.rowwise().mean()) : vector_of(frame.Location().XYZ());
  const Eigen::Vector3d now = axial.shape == Shape::plane ? Eigen::Vector3d(places.rowwise().mean()) : axial.origin;
  for (Eigen::Index i = 0; i < places.cols(); ++i) {
    const Eigen::Vector3d a = axes.transpose() * (rest_places.col(i) - middle),
                          b = axial.axes.transpose() * (places.col(i) - now);
    sum += std::complex<double>(b[0], b[1]) * std::conj(std::complex<double>(a[0], a[1]));
  }
  if (std::abs(sum) == 0) return;
  const std::complex<double> unit = sum / std::abs(sum);
  const Eigen::Vector3d x = unit.real() * axial.axes.col(0) + unit.imag() * axial.axes.col(1);
  const Eigen::Vector3d y = -unit.imag() * axial.axes.col(0) + unit.real() * axial.axes.col(1);
  axial.axes.col(0) = x;
  axial.axes.col(1) = y;
}

}  // namespace

RigidMotion best_motion(const Eigen::Matrix3Xd& before, const Eigen::Matrix3Xd& after) {
  RigidMotion motion;
  motion.from = before.rowwise().mean();
  motion.to = after.rowwise().mean();
  const Eigen::Matrix3d moments = (after.colwise() - motion.to) * (before.colwise() - motion.from).transpose();
  const auto [values, U, V] = svd(moments);
  const Eigen::Vector3d signs(1, 1, (U * V.transpose()).determinant() < 0 ? -1 : 1);
  motion.rotation = U * signs.asDiagonal() * V.transpose();
  return motion;
}

RigidMotion best_similarity(const Eigen::Matrix3Xd& before, const Eigen::Matrix3Xd& after) {
  RigidMotion motion = best_motion(before, after);
  const Eigen::Matrix3Xd turned = motion.rotation * (before.colwise() - motion.from);
  const double squares = turned.squaredNorm();
  if (squares > 0) motion.scale = turned.cwiseProduct(after.colwise() - motion.to).sum() / squares;
  return motion;
}

gp_Trsf transformation_of(const RigidMotion& motion) {
  const Eigen::Matrix3d r = motion.scale * motion.rotation;
  const Eigen::Vector3d shift = motion.to - r * motion.from;
  gp_Trsf trsf;
  trsf.SetValues(r(0, 0), r(0, 1), r(0, 2), shift[0], r(1, 0), r(1, 1), r(1, 2), shift[1], r(2, 0), r(2, 1), r(2, 2), shift[2]);
  return trsf;
}

bool is_analytic(const Handle(Geom_Surface) & surface) { return shape_of(surface) != Shape::none; }

AnalyticFit analytic_fit(const Handle(Geom_Surface) & rest, const Eigen::Matrix3Xd& rest_places, const Eigen::Matrix3Xd& places) {
  AnalyticFit fit{nullptr, std::numeric_limits<double>::infinity()};
  Axial axial;
  axial.shape = shape_of(rest);
  if (axial.shape == Shape::none || places.cols() < 3) return fit;
  const auto elementary = Handle(Geom_ElementarySurface)::DownCast(rest);
  const RigidMotion motion = best_motion(rest_places, places);
  const gp_Ax3& frame = elementary->Position();
  Eigen::Matrix3d axes;
  axes << vector_of(frame.XDirection().XYZ()), vector_of(frame.YDirection().XYZ()), vector_of(frame.Direction().XYZ());
  axial.axes = motion.rotation * axes;
  Eigen::Vector3d origin = vector_of(frame.Location().XYZ());
  if (axial.shape == Shape::cylinder) {
    axial.radius = Handle(Geom_CylindricalSurface)::DownCast(rest)->Radius();
  } else if (axial.shape == Shape::sphere) {
    axial.radius = Handle(Geom_SphericalSurface)::DownCast(rest)->Radius();
  } else if (axial.shape == Shape::cone) {
    const auto cone = Handle(Geom_ConicalSurface)::DownCast(rest);
    axial.radius = cone->RefRadius();
    axial.slope = cone->SemiAngle();
  }
  // The origin at the height of the middle of the places, where tilting it is conditioned best.
  double up = 0;
  if (axial.shape == Shape::cylinder || axial.shape == Shape::cone) up = axes.col(2).dot(motion.from - origin);
  axial.origin = motion(origin + up * axes.col(2));
  if (axial.shape == Shape::cone) axial.radius += up * std::tan(axial.slope);
  if (axial.shape == Shape::plane) axial.origin = motion.to + motion.rotation * (origin - motion.from);
  const double size = std::max((places.colwise() - motion.to).colwise().norm().maxCoeff(), 1e-300);
  for (int k = 0; k < most_steps; ++k) {
    const double change = step(axial, places, size);
    if (!sound(axial, size) || !(change < 1e3)) return fit;
    if (change < 1e-13) break;
  }
  turn(axial, *elementary, rest_places, places);
  fit.largest = largest_distance(axial, places);
  fit.surface = made(axial);
  return fit;
}

std::array<double, 2> analytic_parameters(const Geom_ElementarySurface& surface, const Vec3& p, double u0) {
  const gp_Pnt point(p[0], p[1], p[2]);
  std::array<double, 2> uv{};
  if (const auto* plane = dynamic_cast<const Geom_Plane*>(&surface)) {
    ElSLib::Parameters(plane->Pln(), point, uv[0], uv[1]);
    return uv;
  }
  if (const auto* cylinder = dynamic_cast<const Geom_CylindricalSurface*>(&surface)) {
    ElSLib::Parameters(cylinder->Cylinder(), point, uv[0], uv[1]);
  } else if (const auto* cone = dynamic_cast<const Geom_ConicalSurface*>(&surface)) {
    ElSLib::Parameters(cone->Cone(), point, uv[0], uv[1]);
  } else if (const auto* sphere = dynamic_cast<const Geom_SphericalSurface*>(&surface)) {
    ElSLib::Parameters(sphere->Sphere(), point, uv[0], uv[1]);
  }
  constexpr double turn = 2 * std::numbers::pi;
  uv[0] += turn * std::round((u0 - uv[0]) / turn);
  return uv;
}

double analytic_distance(const Geom_ElementarySurface& surface, const Vec3& p) {
  const std::array<double, 2> uv = analytic_parameters(surface, p, 0);
  const gp_Pnt q = surface.Value(uv[0], uv[1]);
  return std::sqrt(std::pow(q.X() - p[0], 2) + std::pow(q.Y() - p[1], 2) + std::pow(q.Z() - p[2], 2));
}

}  // namespace deform::cad
