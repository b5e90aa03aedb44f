// SPDX-License-Identifier: GPL-3.0-or-later
// Curves and surfaces that core/cad fits, against what OpenCASCADE says of the same points: where surfaces begin to count, curves
// in (u, v), splines through a function, and the way from one edge to its partner.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <BRepAdaptor_Curve.hxx>
#include <BRepBuilderAPI_MakeEdge.hxx>
#include <BRepPrimAPI_MakeSphere.hxx>
#include <BRep_Tool.hxx>
#include <Eigen/LU>
#include <GCPnts_AbscissaPoint.hxx>
#include <Geom2d_BSplineCurve.hxx>
#include <Geom2d_Circle.hxx>
#include <Geom2d_Line.hxx>
#include <Geom_BSplineCurve.hxx>
#include <Geom_Circle.hxx>
#include <Geom_ConicalSurface.hxx>
#include <Geom_CylindricalSurface.hxx>
#include <Geom_Ellipse.hxx>
#include <Geom_Line.hxx>
#include <Geom_Plane.hxx>
#include <Geom_SphericalSurface.hxx>
#include <TColStd_Array1OfInteger.hxx>
#include <TColStd_Array1OfReal.hxx>
#include <TColgp_Array1OfPnt.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "core/base/vectors.h"
#include "core/cad/analytic_fit.h"
#include "core/cad/curve_on_surface.h"
#include "core/cad/edge_map.h"
#include "core/cad/spline_fit.h"

namespace deform::cad::cad_fits_test {
namespace {

constexpr double pi = std::numbers::pi;

Vec3 coordinates(const gp_Pnt& p) { return {p.X(), p.Y(), p.Z()}; }

struct Moved {
  std::string name;
  Handle(Geom_ElementarySurface) rest, target;
  std::array<double, 4> patch;
};

TEST(AnalyticFit, PointsKeepTheirParameters) {
  gp_Ax3 here(gp_Pnt(1, 2, 3), gp_Dir(1, 2, 2), gp_Dir(2, -2, 1)), there(gp_Pnt(-2, 0, 5), gp_Dir(2, 1, 2), gp_Dir(1, 2, -2));
  for (const char* hand : {"right", "left"}) {
    SCOPED_TRACE(hand);
    for (const double u : {0.0, 1.5, 3.0, 4.5}) {
      const std::vector<Moved> cases{
          {"plane", new Geom_Plane(here), new Geom_Plane(there), {u, u + 2, -1, 1}},
          {"cylinder", new Geom_CylindricalSurface(here, 1), new Geom_CylindricalSurface(there, 1.3), {u, u + 1, 0, 2}},
          {"cone", new Geom_ConicalSurface(here, 0.3, 1), new Geom_ConicalSurface(there, 0.4, 1.2), {u, u + 1, 0, 2}},
          {"sphere", new Geom_SphericalSurface(here, 1), new Geom_SphericalSurface(there, 1.2), {u, u + 1, -0.3, 0.9}}};
      for (const Moved& one : cases) {
        SCOPED_TRACE(one.name + " from " + std::to_string(u));
        Eigen::Matrix3Xd before(3, 49), after(3, 49);
        std::vector<std::array<double, 2>> parameters;
        for (int i = 0; i < 49; ++i) {
          const auto& [u0, u1, v0, v1] = one.patch;
          parameters.push_back({u0 + (u1 - u0) * (i % 7) / 6, v0 + (v1 - v0) * (i / 7) / 6});
          const Vec3 a = coordinates(one.rest->Value(parameters[i][0], parameters[i][1])),
                     b = coordinates(one.target->Value(parameters[i][0], parameters[i][1]));
          before.col(i) << a[0], a[1], a[2];
          after.col(i) << b[0], b[1], b[2];
        }
        const AnalyticFit fit = analytic_fit(one.rest, before, after);
        ASSERT_FALSE(fit.surface.IsNull());
        EXPECT_LT(fit.largest, 1e-9);
        EXPECT_EQ(fit.surface->Position().Direct(), one.rest->Position().Direct());
        const auto uv_of = [&](int i) {
          return analytic_parameters(*fit.surface, {after(0, i), after(1, i), after(2, i)}, parameters[i][0]);
        };
        // v of cylinders and cones counts from the middle of the places.
        const double up = uv_of(0)[1] - parameters[0][1];
        if (one.name == "plane" || one.name == "sphere") EXPECT_NEAR(up, 0, 1e-8);
        for (int i = 0; i < 49; ++i) {
          EXPECT_NEAR(uv_of(i)[0], parameters[i][0], 1e-8);
          EXPECT_NEAR(uv_of(i)[1] - parameters[i][1], up, 1e-8);
        }
      }
    }
    here.YReverse();
    there.YReverse();
  }
}

TEST(AnalyticFit, TellsParametersAndDistancesOfAnyPoint) {
  const gp_Ax3 frame(gp_Pnt(1, 2, 3), gp_Dir(1, 2, 2), gp_Dir(2, -2, 1));
  const std::vector<Handle(Geom_ElementarySurface)> surfaces{new Geom_Plane(frame), new Geom_CylindricalSurface(frame, 2),
                                                             new Geom_ConicalSurface(frame, 0.3, 2),
                                                             new Geom_SphericalSurface(frame, 2)};
  for (const auto& surface : surfaces) {
    SCOPED_TRACE(surface->DynamicType()->Name());
    const double turn = surface->IsUPeriodic() ? 2 * pi : 0;
    for (const double u : {0.3, 2.0, 5.0}) {
      for (const double off : {-0.2, 0.0, 0.4}) {
        gp_Pnt p;
        gp_Vec du, dv;
        surface->D1(u, 0.5, p, du, dv);
        gp_Vec n = du.Crossed(dv);
        n.Normalize();
        const Vec3 place = coordinates(p.Translated(off * n));
        EXPECT_NEAR(analytic_distance(*surface, place), std::abs(off), 1e-12);
        for (const int turns : {-1, 0, 2}) {
          const auto uv = analytic_parameters(*surface, place, u + turns * turn + 0.4);
          EXPECT_NEAR(uv[0], u + turns * turn, 1e-12);
          EXPECT_NEAR(uv[1], 0.5, 1e-12);
        }
      }
    }
  }
}

TEST(BestMotion, IsTheRotationTheShiftAndTheScaleThatThePlacesMadeAndNeverAMirror) {
  std::mt19937 engine(2);
  std::uniform_real_distribution<double> share(-1, 1);
  Eigen::Matrix3Xd before(3, 20);
  for (int i = 0; i < 20; ++i) before.col(i) << share(engine), 2 * share(engine), 1 + share(engine);
  const gp_Ax1 axis(gp_Pnt(1, -1, 2), gp_Dir(2, 1, 2));
  for (const double scale : {1.0, 2.5}) {
    gp_Trsf motion, grows;
    motion.SetRotation(axis, 2.2);
    grows.SetScale(gp_Pnt(3, 1, 0), scale);
    motion.PreMultiply(grows);
    Eigen::Matrix3Xd after(3, 20);
    const auto moved = [&](const Eigen::Vector3d& p) {
      const gp_Pnt q = gp_Pnt(p[0], p[1], p[2]).Transformed(motion);
      return Eigen::Vector3d(q.X(), q.Y(), q.Z());
    };
    for (int i = 0; i < 20; ++i) after.col(i) = moved(before.col(i));
    const RigidMotion found = scale == 1 ? best_motion(before, after) : best_similarity(before, after);
    EXPECT_NEAR(found.scale, scale, 1e-13);
    const gp_Trsf same = transformation_of(found);
    for (const Eigen::Vector3d& p : {Eigen::Vector3d(5, -2, 1), Eigen::Vector3d(0, 3, -4)}) {
      EXPECT_LT((found(p) - moved(p)).norm(), 1e-12);
      const gp_Pnt q = gp_Pnt(p[0], p[1], p[2]).Transformed(same), r = gp_Pnt(p[0], p[1], p[2]).Transformed(motion);
      EXPECT_LT(q.Distance(r), 1e-12);
    }
    EXPECT_NEAR(best_motion(before, after).rotation.determinant(), 1, 1e-13);
    EXPECT_EQ(best_motion(before, after).scale, 1);
  }
  const Eigen::Matrix3Xd mirrored = Eigen::Vector3d(1, 1, -1).asDiagonal() * before;
  EXPECT_NEAR(best_motion(before, mirrored).rotation.determinant(), 1, 1e-13);
}

/// A cubic spline from p(0) to p(1) of a curve with four poles, whose speed is uneven.
Handle(Geom_BSplineCurve) spline_through(const std::array<gp_Pnt, 4>& poles, double from, double to) {
  TColgp_Array1OfPnt points(1, 4);
  for (int k = 0; k < 4; ++k) points(k + 1) = poles[k];
  TColStd_Array1OfReal knots(1, 2);
  knots(1) = from, knots(2) = to;
  TColStd_Array1OfInteger times(1, 2);
  times.Init(4);
  return new Geom_BSplineCurve(points, knots, times, 3);
}

TEST(EdgeMap, GoesByTheParameterAndByTheLengthWhereTypesDiffer) {
  const Handle(Geom_Curve) line = new Geom_Line(gp_Pnt(0, 0, 0), gp_Dir(1, 1, 0));
  const Handle(Geom_Curve) spline =
      spline_through({gp_Pnt(0, 0, 0), gp_Pnt(0.1, 0, 0), gp_Pnt(0.3, 0.2, 0), gp_Pnt(4, 1, 0)}, 2, 5);
  const Handle(Geom_Curve) other =
      spline_through({gp_Pnt(0, 0, 0), gp_Pnt(3, 1, 0), gp_Pnt(3.2, 2, 0), gp_Pnt(3.3, 2, 0)}, -1, 1);
  struct Edge {
    TopoDS_Edge edge;
    double from, to;
  };
  const auto edge = [](const Handle(Geom_Curve) & curve, double from, double to) {
    return Edge{BRepBuilderAPI_MakeEdge(curve, from, to).Edge(), from, to};
  };
  const Edge straight = edge(line, 1, 4), bow = edge(spline, 2, 5), other_bow = edge(other, -1, 1);
  const auto length_share = [](const Edge& of, double t) {
    const BRepAdaptor_Curve curve(of.edge);
    return GCPnts_AbscissaPoint::Length(curve, of.from, t, 1e-12) / GCPnts_AbscissaPoint::Length(curve, of.from, of.to, 1e-12);
  };
  const auto parameter_share = [](const Edge& of, double t) { return (t - of.from) / (of.to - of.from); };
  struct Case {
    const Edge &before, &after;
    EdgeMap::Along along;
    bool by_length;
  };
  const auto decides = EdgeMap::Along::type_decides;
  for (const Case& one : {Case{straight, bow, decides, true}, Case{bow, straight, decides, true},
                          Case{bow, other_bow, decides, false}, Case{straight, bow, EdgeMap::Along::parameter, false}}) {
    for (const int sense : {1, -1}) {
      for (const double phase : {0.0, 0.3}) {
        SCOPED_TRACE(std::to_string(one.by_length) + " " + std::to_string(sense) + " " + std::to_string(phase));
        const EdgeMap map(one.before.edge, one.after.edge, sense, phase, one.along);
        EXPECT_FALSE(map.degenerate());
        EXPECT_EQ(map.at(0), one.before.from);
        EXPECT_EQ(map.at(1), one.before.to);
        for (const double share : {0.0, 0.25, 0.6, 0.69, 0.71, 1.0}) {
          const double t = map.at(share);
          double expected = (one.by_length ? length_share(one.before, t) : parameter_share(one.before, t)) + phase;
          if (phase != 0) expected -= std::floor(expected);
          if (sense < 0) expected = 1 - expected;
          EXPECT_NEAR(one.by_length ? length_share(one.after, map(t)) : parameter_share(one.after, map(t)), expected, 1e-8)
              << share;
        }
        if (phase == 0) {
          const double start = sense > 0 ? one.after.from : one.after.to, end = sense > 0 ? one.after.to : one.after.from;
          for (const double beyond : {0.0, 0.1}) {
            EXPECT_EQ(map(one.before.from - beyond), start) << "ends go to ends with all bits, also what is beyond them";
            EXPECT_EQ(map(one.before.to + beyond), end);
          }
        }
      }
    }
  }
}

TEST(EdgeMap, EdgesWithoutALengthGoByTheParameter) {
  const TopoDS_Shape ball = BRepPrimAPI_MakeSphere(1).Shape();
  for (TopExp_Explorer at(ball, TopAbs_EDGE); at.More(); at.Next()) {
    const TopoDS_Edge edge = TopoDS::Edge(at.Current());
    const EdgeMap map(edge, edge, -1, 0);
    EXPECT_EQ(map.degenerate(), BRep_Tool::Degenerated(edge));
    EXPECT_NEAR(map(map.at(0.25)), map.at(0.75), 1e-14);
  }
}

/// Asks for all that a fit wants; returns how often.
template <typename Function>
int feed(SplineFit& fit, const Function& function) {
  std::map<SplineFit::Parameters, int> asked;
  fit.want([&](const SplineFit::Parameters& at) { ++asked[at]; });
  for (const auto& [at, times] : asked) {
    EXPECT_EQ(times, 1);
    fit.give(at, function(at));
  }
  return static_cast<int>(asked.size());
}

TEST(SplineFit, ASurfaceHasTheValuesOfTheFunction) {
  // Cubic along both but for corners at the breaks, so that the nodes tell all.
  const auto cubic = [](const SplineFit::Parameters& at) {
    const double u = at[0], v = at[1], corner = std::abs(u - 0.5);
    return Vec3{u * u * u - v + corner, u * v * v * v + 2, u * u * v - 3 * v * v + corner * v};
  };
  SplineFit fit(SplineAxis({0, 0.5, 2}), SplineAxis({-1, 1}), {0.2, 0.3});
  EXPECT_EQ(fit.axes(), 2);
  feed(fit, cubic);
  EXPECT_FALSE(fit.refine(1e-10)) << "nothing is off";
  EXPECT_TRUE(fit.refine_around({{0.1, 0.9}})) << "both axes become finer";
  EXPECT_EQ(fit.axis(0).nodes().size(), 8u);
  EXPECT_EQ(fit.axis(1).nodes().size(), 5u);
  EXPECT_GT(feed(fit, cubic), 0);
  const Handle(Geom_BSplineSurface) surface = fit.surface();
  EXPECT_EQ(surface->UDegree(), 3);
  EXPECT_EQ(surface->NbUPoles(), 8);
  EXPECT_EQ(surface->NbVPoles(), 5);
  for (const double u : {0.0, 0.1, 0.5, 0.8, 1.7, 2.0}) {
    for (const double v : {-1.0, -0.4, 0.3, 0.95, 1.0}) {
      EXPECT_LT(norm(fit.value({u, v}) - cubic({u, v})), 1e-12) << u << " " << v;
      EXPECT_LT(norm(coordinates(surface->Value(u, v)) - cubic({u, v})), 1e-12) << u << " " << v;
    }
  }
}

TEST(SplineFit, ACurveIsRefinedWhereItIsOff) {
  const auto wave = [](const SplineFit::Parameters& at) {
    const double s = 20 * (at[0] - 2.2);  // a bump in the first quarter
    return Vec3{at[0], std::exp(-s * s), at[0] * at[0]};
  };
  SplineFit fit(SplineAxis({2, 4}), 0.05);
  EXPECT_EQ(fit.axes(), 1);
  int rounds = 0;
  do {
    feed(fit, wave);
    ASSERT_LT(++rounds, 20);
  } while (fit.refine(1e-5));
  EXPECT_EQ(feed(fit, wave), 0) << "all is known";
  const Handle(Geom_BSplineCurve) curve = fit.curve();
  const Handle(Geom2d_BSplineCurve) flat = fit.plane_curve();
  for (int k = 0; k <= 400; ++k) {
    const double t = 2 + 0.005 * k;
    const Vec3 expected = wave({t, 0});
    EXPECT_LT(norm(fit.value({t, 0}) - expected), 5e-5) << t;
    EXPECT_LT(norm(coordinates(curve->Value(t)) - expected), 5e-5) << t;
    const gp_Pnt2d p = flat->Value(t);
    EXPECT_LT(std::hypot(p.X() - expected[0], p.Y() - expected[1]), 5e-5) << t;
  }
  const auto& nodes = fit.axis(0).nodes();
  const auto near = [&](double from, double to) {
    return std::count_if(nodes.begin(), nodes.end(), [&](double t) { return from <= t && t < to; });
  };
  EXPECT_GT(near(2, 2.5), 4 * near(3, 4)) << "nodes are where the bump is";
}

/// Checks that a curve in (u, v) takes the surface along a curve with the same parameter, on the side of the guess.
void expect_same(const Handle(Geom_ElementarySurface) & surface, const CurveRange& range, const Handle(Geom2d_Curve) & found,
                 const Handle(Geom2d_Curve) & guess, double tolerance) {
  for (int k = 0; k <= 200; ++k) {
    const double t = range.from + (range.to - range.from) * k / 200;
    const gp_Pnt2d uv = found->Value(t);
    EXPECT_LT(surface->Value(uv.X(), uv.Y()).Distance(range.curve->Value(t)), tolerance) << t;
    if (surface->IsUPeriodic()) EXPECT_LT(std::abs(uv.X() - guess->Value(t).X()), pi) << t;
  }
}

TEST(CurveOnSurface, RunsWhereTheCurveDoes) {
  const gp_Ax3 frame(gp_Pnt(1, 2, 3), gp_Dir(1, 2, 2), gp_Dir(2, -2, 1));
  const gp_Vec x(frame.XDirection()), y(frame.YDirection()), z(frame.Direction());
  const gp_Pnt o = frame.Location();
  const auto at = [&](double a, double b, double c) { return o.Translated(a * x + b * y + c * z); };
  const Handle(Geom_ElementarySurface) plane = new Geom_Plane(frame), cylinder = new Geom_CylindricalSurface(frame, 2),
                                       cone = new Geom_ConicalSurface(frame, 0.3, 2),
                                       sphere = new Geom_SphericalSurface(frame, 2);
  const gp_Pnt apex = Handle(Geom_ConicalSurface)::DownCast(cone)->Apex();
  const auto straight = [](const gp_Pnt& a, const gp_Pnt& b) {
    return Handle(Geom_Curve)(new Geom_Line(a, gp_Dir(gp_Vec(a, b))));
  };
  const auto circle = [](const gp_Pnt& at, const gp_Vec& axis, const gp_Vec& start, double radius) {
    return Handle(Geom_Curve)(new Geom_Circle(gp_Ax2(at, gp_Dir(axis), gp_Dir(start)), radius));
  };
  const Handle(Geom_BSplineCurve) bow = spline_through({at(1, 0, 0), at(2, 1, 0), at(-1, 2, 0), at(-3, -1, 0)}, 2, 5);
  Handle(Geom_BSplineCurve) rational = Handle(Geom_BSplineCurve)::DownCast(bow->Copy());
  rational->SetWeight(2, 3);
  const gp_Dir slanted(z + x);  // cuts the cylinder in an ellipse
  const Handle(Geom_Curve) flat_ellipse = new Geom_Ellipse(gp_Ax2(at(1, 0, 0), gp_Dir(z), gp_Dir(x)), 3, 1);
  const Handle(Geom_Curve) ellipse = new Geom_Ellipse(gp_Ax2(o, slanted, gp_Dir(x - z)), 2 * std::sqrt(2.0), 2);
  const auto line_type = STANDARD_TYPE(Geom2d_Line), circle_type = STANDARD_TYPE(Geom2d_Circle),
             spline_type = STANDARD_TYPE(Geom2d_BSplineCurve);
  struct Case {
    std::string name;
    Handle(Geom_ElementarySurface) surface;
    CurveRange range;
    double u;       ///< of the guess at the start
    double turned;  ///< until its end
    Handle(Standard_Type) type;
  };
  const std::vector<Case> cases{
      {"line on a plane", plane, {straight(at(1, 0, 0), at(0, 1, 0)), 1, 4}, 0, 0, line_type},
      {"circle on a plane", plane, {circle(at(1, 1, 0), z, y, 1.5), 0.5, 5}, 0, 0, circle_type},
      {"circle on a plane, clockwise", plane, {circle(at(2, 0, 0), -z, y, 1.5), 0.5, 5}, 0, 0, circle_type},
      {"spline on a plane", plane, {Handle(Geom_Curve)(bow), 2, 5}, 0, 0, spline_type},
      {"rational spline on a plane", plane, {Handle(Geom_Curve)(rational), 2, 5}, 0, 0, spline_type},
      {"ellipse on a plane", plane, {flat_ellipse, 0, 4}, 0, 0, spline_type},
      {"ruling of a cylinder", cylinder, {straight(at(0, 2, 0), at(0, 2, 1)), -1, 2}, pi / 2, 0, line_type},
      {"ruling of a cylinder, one turn on", cylinder, {straight(at(0, 2, 0), at(0, 2, 1)), -1, 2}, 2.5 * pi, 0, line_type},
      {"circle of a cylinder", cylinder, {circle(at(0, 0, 1), z, x, 2), 0.5, 5}, 0.5, 4.5, line_type},
      {"circle of a cylinder over its seam", cylinder, {circle(at(0, 0, 1), z, x, 2), 5, 8}, 5 - 2 * pi, 3, line_type},
      {"circle of a cylinder, clockwise", cylinder, {circle(at(0, 0, 1), -z, y, 2), 0.5, 3}, pi / 2 - 0.5, -2.5, line_type},
      {"ellipse of a cylinder", cylinder, {ellipse, 0.5, 5}, 0.5, 4.5, spline_type},
      {"ruling of a cone", cone, {straight(apex, at(0, 2, 0)), 1, 5}, pi / 2, 0, line_type},
      {"ruling of a cone from its apex", cone, {straight(apex, at(0, -2, 0)), 0, 5}, 1.5 * pi, 0, line_type},
      {"circle of a cone", cone, {circle(o, z, x, 2), 0.5, 5}, 0.5, 4.5, line_type},
      {"parallel of a sphere", sphere, {circle(at(0, 0, 1), z, x, std::sqrt(3.0)), 0.5, 5}, 0.5, 4.5, line_type},
      {"meridian of a sphere", sphere, {circle(o, x, y, 2), -1, 1}, pi / 2, 0, line_type},
      {"oblique circle of a sphere", sphere, {circle(o, z + 0.5 * y, x, 2), 0.2, 2.8}, 0.2, 2.6, spline_type}};
  const double tolerance = 1e-5;
  for (const Case& one : cases) {
    SCOPED_TRACE(one.name);
    // A line in the parameter of the curve, of which v does not count.
    TColgp_Array1OfPnt2d ends(1, 2);
    ends(1) = gp_Pnt2d(one.u, 0), ends(2) = gp_Pnt2d(one.u + one.turned, 1);
    TColStd_Array1OfReal knots(1, 2);
    knots(1) = one.range.from, knots(2) = one.range.to;
    TColStd_Array1OfInteger times(1, 2);
    times.Init(2);
    const Handle(Geom2d_Curve) guess = new Geom2d_BSplineCurve(ends, knots, times, 1);
    const Handle(Geom2d_Curve) found = curve_on_surface(one.surface, one.range, guess, tolerance);
    EXPECT_STREQ(found->DynamicType()->Name(), one.type->Name());
    expect_same(one.surface, one.range, found, guess,
                one.type == spline_type && one.name.find("spline") == std::string::npos ? 2 * tolerance : 1e-9);
  }
}

}  // namespace
}  // namespace deform::cad::cad_fits_test
