// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Geom2d_Curve.hxx>
#include <Geom_Curve.hxx>
#include <Geom_ElementarySurface.hxx>

namespace deform::cad {

/// A curve in space and the part of it that counts.
struct CurveRange {
  Handle(Geom_Curve) curve;
  double from = 0, to = 0;
};

/// The curve in (u, v) of a curve near an analytic surface (analytic_fit.h), in the same parameter: a line or circle where it is
/// one, else a spline that meets it within the tolerance, a length. u lies near that of `guess`, a curve over the same range.
Handle(Geom2d_Curve) curve_on_surface(const Handle(Geom_ElementarySurface) & surface, const CurveRange& range,
                                      const Handle(Geom2d_Curve) & guess, double tolerance);

}  // namespace deform::cad
