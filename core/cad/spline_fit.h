// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <Geom2d_BSplineCurve.hxx>
#include <Geom_BSplineCurve.hxx>
#include <Geom_BSplineSurface.hxx>
#include <array>
#include <functional>
#include <map>
#include <set>
#include <vector>

#include "core/base/types.h"
#include "core/cad/spline_axis.h"

namespace deform::cad {

/// A cubic spline that interpolates a function of one or two parameters at nodes, with as many of them as a tolerance needs: the
/// function is asked at nodes and at checks between them; where a check is off, intervals are halved. Not thread-safe.
class SplineFit {
 public:
  using Parameters = std::array<double, 2>;  ///< of one parameter (t, 0)

  /// spacing: of checks.
  SplineFit(SplineAxis t, double spacing) : axes_{std::move(t)}, spacing_{spacing, 0} {}
  SplineFit(SplineAxis u, SplineAxis v, const std::array<double, 2>& spacing)
      : axes_{std::move(u), std::move(v)}, spacing_(spacing) {}

  /// Calls `ask` once for each parameter at which the value is not known yet; give() has to follow.
  void want(const std::function<void(const Parameters&)>& ask);
  void give(const Parameters& at, const Vec3& value) { places_[at] = value; }
  /// Halves intervals in which checks are off by more than the tolerance. Returns whether it did: then values are wanted again.
  bool refine(double tolerance);
  /// Halves the intervals around places. Returns false where that is not possible.
  bool refine_around(const std::vector<Parameters>& places);

  /// What was asked so far, and the values.
  const std::map<Parameters, Vec3>& places() const { return places_; }
  const SplineAxis& axis(int k) const { return axes_[k]; }
  int axes() const { return static_cast<int>(axes_.size()); }

  /// The fit to the nodes, whose values have to be known.
  Vec3 value(const Parameters& at) const;
  Handle(Geom_BSplineSurface) surface() const;
  Handle(Geom_BSplineCurve) curve() const;
  Handle(Geom2d_BSplineCurve) plane_curve() const;  ///< of the first two coordinates

 private:
  std::set<int> bad_intervals(int axis, double tolerance) const;
  const std::vector<double>& nodes(int k) const;
  /// Control points, 3 columns for each across the second parameter.
  const Eigen::MatrixXd& poles() const;

  std::vector<SplineAxis> axes_;
  std::array<double, 2> spacing_;
  std::map<Parameters, Vec3> places_;
  mutable Eigen::MatrixXd poles_;  ///< empty: not known
};

}  // namespace deform::cad
