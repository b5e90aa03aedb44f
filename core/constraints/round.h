// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "core/base/types.h"
#include "core/constraints/fitting.h"

namespace deform {

/// The signed distance from a sphere or cylinder through the origin with normal x there and curvature k: its centre (or axis) is
/// at -x / k, and k = 0 is the plane (Lukacs, Marshall, Martin 1998). This form does not degenerate for nearly flat shapes, and a
/// change of sign of k only moves the centre to the other side. With q = |M y|^2, where M projects out the direction of an axis,
/// the distance s satisfies k s^2 + 2 s = k q + 2 x.
struct RoundDistance {
  double value = 0;
  double ratio = 1;  ///< 1 + k s = distance from the centre over the radius, >= 0
  Eigen::Vector3d normal = Eigen::Vector3d::UnitX();
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();  ///< second derivatives of the value with respect to y
  double by_curvature = 0, by_curvature_twice = 0;
  Eigen::Vector3d normal_by_curvature = Eigen::Vector3d::Zero();
};
enum class About { point, z_axis };
RoundDistance round_distance(const Eigen::Vector3d& y, double curvature, About about);
/// The distance as the residual of a point.
void round_residual(const Eigen::Vector3d& y, double curvature, About about, LocalResidual<1, 1>& out);

/// A round shape through `origin` with this normal (x axis of the frame) and curvature (size 0); the z axis of the frame is as
/// close to `z` as possible.
Fit<1> touching(const Eigen::Vector3d& origin, const Eigen::Vector3d& normal, const Eigen::Vector3d& z, double curvature);
/// A round shape with this centre and radius, whose frame lies on the side of `towards`. z is the unit axis (any direction for
/// a sphere).
Fit<1> centred(const Eigen::Vector3d& centre, double radius, const Eigen::Vector3d& z, const Eigen::Vector3d& towards);

/// Turns starts of fits with free curvature into starts with the given curvature, on both sides.
std::vector<Fit<1>> with_curvature(const std::vector<Fit<1>>& starts, double curvature);

/// What the models of round shapes have in common: their size is the curvature, which is free unless it is given. A Model has
///   static std::vector<Fit<1>> starts(x)    starts of fits with free curvature
template <class Model>
class RoundModel {
 public:
  static constexpr int sizes = 1;

  const std::vector<int>& active() const { return active_; }

  Fit<1> fitted(std::span<const Vec3> x, const Fit<1>* last) const {
    const Model& model = static_cast<const Model&>(*this);
    if (last != nullptr) return refitted(model, x, *last);
    const std::vector<Fit<1>> free = Model::starts(x);
    return best_minimum(model, x, kept_ ? with_curvature(free, *kept_) : free);
  }

 protected:
  /// `active`: the free motions of the frame.
  RoundModel(std::vector<int> active, std::optional<double> curvature) : kept_(curvature), active_(std::move(active)) {
    if (!kept_) active_.push_back(motions);
  }

 private:
  std::optional<double> kept_;
  std::vector<int> active_;
};

}  // namespace deform
