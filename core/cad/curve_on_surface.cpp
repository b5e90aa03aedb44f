// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/curve_on_surface.h"

#include <Geom2d_BSplineCurve.hxx>
#include <Geom2d_Circle.hxx>
#include <Geom2d_Line.hxx>
#include <GeomAdaptor_Curve.hxx>
#include <Geom_BSplineCurve.hxx>
#include <Geom_Circle.hxx>
#include <Geom_ConicalSurface.hxx>
#include <Geom_Line.hxx>
#include <Geom_Plane.hxx>
#include <TColStd_Array1OfReal.hxx>
#include <TColgp_Array1OfPnt2d.hxx>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "core/cad/analytic_fit.h"
#include "core/cad/spline_fit.h"

namespace deform::cad {

namespace {

constexpr int probes = 16;
constexpr double exact_share = 1e-3;  ///< of the tolerance, for lines and circles
constexpr double at_pole = 10;        ///< tolerances from the axis
constexpr double beside_pole = 100;   ///< likewise

class Projection {
 public:
  Projection(const Geom_ElementarySurface& surface, const CurveRange& range, const Geom2d_Curve& guess, double tolerance)
      : surface_(surface), curve_(range.curve, range.from, range.to), guess_(guess), range_(range), tolerance_(tolerance) {}

  gp_Pnt2d operator()(double t) const {
    const gp_Pnt2d foot = foot_of(t);
    if (!surface_.IsKind(STANDARD_TYPE(Geom_ConicalSurface)) || radius_at(foot) > at_pole * tolerance_) return foot;
    // At the apex every u is the same place: that of the curve beside it goes on.
    const double length = range_.to - range_.from, back = t - range_.from < range_.to - t ? 1 : -1;
    for (double share = 1e-3; share < 0.5; share *= 2) {
      const gp_Pnt2d beside = foot_of(t + back * share * length);
      if (radius_at(beside) > beside_pole * tolerance_) return {beside.X(), foot.Y()};
    }
    return foot;
  }
  const GeomAdaptor_Curve& curve() const { return curve_; }
  /// Lengths of a step of u and of v.
  std::array<double, 2> metric(double t) const {
    const gp_Pnt2d p = (*this)(t);
    gp_Pnt ignored;
    gp_Vec along_u, along_v;
    surface_.D1(p.X(), p.Y(), ignored, along_u, along_v);
    return {along_u.Magnitude(), along_v.Magnitude()};
  }

 private:
  gp_Pnt2d foot_of(double t) const {
    const gp_Pnt p = curve_.Value(t);
    const std::array<double, 2> uv = analytic_parameters(surface_, {p.X(), p.Y(), p.Z()}, guess_.Value(t).X());
    return {uv[0], uv[1]};
  }
  double radius_at(const gp_Pnt2d& uv) const {
    gp_Pnt ignored;
    gp_Vec along_u, along_v;
    surface_.D1(uv.X(), uv.Y(), ignored, along_u, along_v);
    return along_u.Magnitude();
  }

  const Geom_ElementarySurface& surface_;
  const GeomAdaptor_Curve curve_;
  const Geom2d_Curve& guess_;
  const CurveRange range_;
  const double tolerance_;
};

/// Whether a curve in (u, v) is the projection, up to a length.
bool agrees(const Geom2d_Curve& curve, const Projection& projection, const CurveRange& range, const std::array<double, 2>& metric,
            double length) {
  for (int k = 0; k <= probes; ++k) {
    const double t = range.from + (range.to - range.from) * k / probes;
    const gp_Pnt2d p = curve.Value(t), q = projection(t);
    if (!(std::hypot(metric[0] * (p.X() - q.X()), metric[1] * (p.Y() - q.Y())) <= length)) return false;
  }
  return true;
}

}  // namespace

Handle(Geom2d_Curve) curve_on_surface(const Handle(Geom_ElementarySurface) & surface, const CurveRange& range,
                                      const Handle(Geom2d_Curve) & guess, double tolerance) {
  const Projection projection(*surface, range, *guess, tolerance);
  std::array<double, 2> metric{};
  for (const double share : {0.02, 0.5, 0.98}) {
    const auto here = projection.metric(range.from + share * (range.to - range.from));
    metric = {std::max(metric[0], here[0]), std::max(metric[1], here[1])};
  }
  const bool line = range.curve->IsKind(STANDARD_TYPE(Geom_Line)), circle = range.curve->IsKind(STANDARD_TYPE(Geom_Circle));
  if (line || circle) {  // both have lines in (u, v) of unit speed
    const gp_Pnt2d a = projection(range.from), b = projection(range.to);
    const double length = range.to - range.from;
    const gp_Vec2d way(a, b);
    if (std::abs(way.Magnitude() / length - 1) < 1e-9) {
      const Handle(Geom2d_Curve) straight = new Geom2d_Line(gp_Pnt2d(a.XY() - range.from / length * way.XY()), gp_Dir2d(way));
      if (agrees(*straight, projection, range, metric, exact_share * tolerance)) return straight;
    }
  }
  const auto plane = Handle(Geom_Plane)::DownCast(surface);
  if (circle && !plane.IsNull()) {
    const gp_Circ c = Handle(Geom_Circle)::DownCast(range.curve)->Circ();
    const gp_Ax3& frame = plane->Position();
    const auto flat = [&](const gp_Dir& d) { return gp_Vec2d(d.Dot(frame.XDirection()), d.Dot(frame.YDirection())); };
    const gp_Vec2d x = flat(c.XAxis().Direction()), y = flat(c.YAxis().Direction());
    if (x.Magnitude() > 0.5 && y.Magnitude() > 0.5) {
      const gp_Vec away(frame.Location(), c.Location());
      const gp_Pnt2d centre(away.Dot(gp_Vec(frame.XDirection())), away.Dot(gp_Vec(frame.YDirection())));
      const Handle(Geom2d_Curve) round = new Geom2d_Circle(gp_Ax22d(centre, gp_Dir2d(x), gp_Dir2d(y)), c.Radius());
      if (agrees(*round, projection, range, metric, exact_share * tolerance)) return round;
    }
  }
  const auto spline_curve = Handle(Geom_BSplineCurve)::DownCast(range.curve);
  if (!spline_curve.IsNull() && !plane.IsNull()) {  // affine: the control points are projected
    TColgp_Array1OfPnt2d poles(1, spline_curve->NbPoles());
    for (int k = 1; k <= poles.Length(); ++k) {
      const gp_Pnt p = spline_curve->Pole(k);
      const auto uv = analytic_parameters(*surface, {p.X(), p.Y(), p.Z()}, 0);
      poles(k) = gp_Pnt2d(uv[0], uv[1]);
    }
    if (spline_curve->IsRational()) {
      return Handle(Geom2d_Curve)(new Geom2d_BSplineCurve(poles, *spline_curve->Weights(), spline_curve->Knots(),
                                                          spline_curve->Multiplicities(), spline_curve->Degree(),
                                                          spline_curve->IsPeriodic()));
    }
    return Handle(Geom2d_Curve)(new Geom2d_BSplineCurve(poles, spline_curve->Knots(), spline_curve->Multiplicities(),
                                                        spline_curve->Degree(), spline_curve->IsPeriodic()));
  }
  const int intervals = projection.curve().NbIntervals(GeomAbs_C2);
  TColStd_Array1OfReal ends(1, intervals + 1);
  projection.curve().Intervals(ends, GeomAbs_C2);
  std::vector<double> breaks{range.from};
  const double least = 1e-9 * (range.to - range.from);
  for (int k = 2; k <= intervals; ++k) {
    if (ends(k) > breaks.back() + least && ends(k) < range.to - least) breaks.push_back(ends(k));
  }
  breaks.push_back(range.to);
  // Close enough for what happens between the knots of the curve.
  const int pieces = spline_curve.IsNull() ? 8 : std::max(8, 4 * spline_curve->NbKnots());
  SplineFit fit(SplineAxis(breaks), (range.to - range.from) / pieces);
  do {
    std::vector<double> wanted;
    fit.want([&](const SplineFit::Parameters& at) { wanted.push_back(at[0]); });
    for (const double t : wanted) {
      const gp_Pnt2d p = projection(t);
      fit.give({t, 0}, {metric[0] * p.X(), metric[1] * p.Y(), 0});
    }
  } while (fit.refine(tolerance));
  const Handle(Geom2d_BSplineCurve) spline = fit.plane_curve();
  for (int k = 1; k <= spline->NbPoles(); ++k) {
    spline->SetPole(k, gp_Pnt2d(spline->Pole(k).X() / metric[0], spline->Pole(k).Y() / metric[1]));
  }
  return Handle(Geom2d_Curve)(spline);
}

}  // namespace deform::cad
