// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/deformed_shape.h"

#include <BRepAdaptor_Surface.hxx>
#include <BRepCheck.hxx>
#include <BRepCheck_Analyzer.hxx>
#include <BRepCheck_ListOfStatus.hxx>
#include <BRepCheck_Result.hxx>
#include <BRepTools_Modification.hxx>
#include <BRepTools_Modifier.hxx>
#include <BRep_Builder.hxx>
#include <BRep_Tool.hxx>
#include <Geom2d_BSplineCurve.hxx>
#include <Geom2d_Curve.hxx>
#include <Geom2d_Line.hxx>
#include <Geom_BSplineCurve.hxx>
#include <Geom_ConicalSurface.hxx>
#include <Precision.hxx>
#include <TColStd_Array1OfInteger.hxx>
#include <TColStd_Array1OfReal.hxx>
#include <TColgp_Array1OfPnt2d.hxx>
#include <TopExp.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <sstream>

#include "core/base/error.h"
#include "core/cad/curve_on_surface.h"

namespace deform::cad {

namespace {

constexpr int least_gap_samples = 23;
constexpr int samples_per_knot = 3;
constexpr double gap_margin = 1.2;
constexpr double curve_share = 0.1;  ///< of the tolerance, for curves in (u, v)

/// Hands the geometry of a refitting to BRepTools_Modifier.
class RefitModification : public BRepTools_Modification {
 public:
  RefitModification(const Model& model, const Refitting& refitting, double curve_tolerance)
      : model_(model), refitting_(refitting), curve_tolerance_(curve_tolerance) {}

  Standard_Boolean NewSurface(const TopoDS_Face& face, Handle(Geom_Surface) & surface, TopLoc_Location& place,
                              Standard_Real& tolerance, Standard_Boolean& reverse_wires,
                              Standard_Boolean& reverse_face) override {
    const int f = model_.faces.FindIndex(face) - 1;
    if (f < 0) return false;
    surface = refitting_.surface(f);
    place.Identity();
    tolerance = BRep_Tool::Tolerance(face);
    reverse_wires = reverse_face = false;
    return true;
  }

  Standard_Boolean NewCurve(const TopoDS_Edge& edge, Handle(Geom_Curve) & curve, TopLoc_Location& place,
                            Standard_Real& tolerance) override {
    const int e = model_.edges.FindIndex(edge) - 1;
    if (e < 0) return false;
    curve = refitting_.curve(e);  // null for degenerate edges, as before
    place.Identity();
    tolerance = BRep_Tool::Tolerance(edge);
    return true;
  }

  Standard_Boolean NewPoint(const TopoDS_Vertex& vertex, gp_Pnt& point, Standard_Real& tolerance) override {
    const int v = model_.vertices.FindIndex(vertex) - 1;
    if (v < 0) return false;
    const Vec3& place = refitting_.vertex(v);
    point = gp_Pnt(place[0], place[1], place[2]);
    tolerance = BRep_Tool::Tolerance(vertex);
    return true;
  }

  Standard_Boolean NewCurve2d(const TopoDS_Edge& edge, const TopoDS_Face& face, const TopoDS_Edge&, const TopoDS_Face&,
                              Handle(Geom2d_Curve) & curve, Standard_Real& tolerance) override {
    double from = 0, to = 0;
    const Handle(Geom2d_Curve) kept = BRep_Tool::CurveOnSurface(edge, face, from, to);
    if (kept.IsNull()) return false;
    tolerance = Precision::Confusion();
    const int f = model_.faces.FindIndex(face) - 1, e = model_.edges.FindIndex(edge) - 1;
    if (f >= 0 && e >= 0 && !refitting_.reshaped(f).IsNull()) {
      const bool pole = BRep_Tool::Degenerated(edge);
      curve = pole ? pole_curve(f, *kept, from, to)
                   : curve_on_surface(refitting_.reshaped(f), {refitting_.curve(e), from, to}, kept, curve_tolerance_);
    } else {
      curve = Handle(Geom2d_Curve)::DownCast(kept->Copy());
      // Readers of STEP take the ends of lines from the places of vertices, which is not exact where the curve in space is a
      // spline.
      if (kept->IsKind(STANDARD_TYPE(Geom2d_Line)) && f >= 0 && refitting_.refit(f) == Refit::fitted)
        curve = straight(kept->Value(from), kept->Value(to), from, to);
    }
    return true;
  }

  Standard_Boolean NewParameter(const TopoDS_Vertex& vertex, const TopoDS_Edge& edge, Standard_Real& parameter,
                                Standard_Real& tolerance) override {
    if (vertex.IsNull()) return false;
    parameter = BRep_Tool::Parameter(vertex, edge);
    tolerance = Precision::Confusion();
    return true;
  }

  GeomAbs_Shape Continuity(const TopoDS_Edge& edge, const TopoDS_Face& first, const TopoDS_Face& second, const TopoDS_Edge&,
                           const TopoDS_Face&, const TopoDS_Face&) override {
    return BRep_Tool::Continuity(edge, first, second);
  }

 private:
  /// A straight spline from parameter to parameter.
  static Handle(Geom2d_Curve) straight(const gp_Pnt2d& start, const gp_Pnt2d& end, double from, double to) {
    TColgp_Array1OfPnt2d ends(1, 2);
    ends(1) = start, ends(2) = end;
    TColStd_Array1OfReal knots(1, 2);
    knots(1) = from, knots(2) = to;
    TColStd_Array1OfInteger multiplicities(1, 2);
    multiplicities.Init(2);
    return new Geom2d_BSplineCurve(ends, knots, multiplicities, 1);
  }

  /// At the apex of a reshaped cone, from the u of the edges that end there.
  Handle(Geom2d_Curve) pole_curve(int f, const Geom2d_Curve& kept, double from, double to) const {
    const auto cone = Handle(Geom_ConicalSurface)::DownCast(refitting_.reshaped(f));
    const double v = -cone->RefRadius() / std::sin(cone->SemiAngle());
    return straight({u_at(f, kept.Value(from)), v}, {u_at(f, kept.Value(to)), v}, from, to);
  }

  /// On a reshaped face, where an edge ended at a place in (u, v) of the original.
  double u_at(int f, const gp_Pnt2d& place) const {
    double u = place.X(), nearest = std::numeric_limits<double>::infinity();
    for (const Coedge& use : model_.coedges[f]) {
      if (BRep_Tool::Degenerated(model_.edge(use.edge))) continue;
      double from = 0, to = 0;
      const TopoDS_Shape edge = model_.edge(use.edge).Oriented(use.sense > 0 ? TopAbs_FORWARD : TopAbs_REVERSED);
      const Handle(Geom2d_Curve) kept = BRep_Tool::CurveOnSurface(TopoDS::Edge(edge), model_.face(f), from, to);
      for (const double t : {from, to}) {
        const double off = kept->Value(t).Distance(place);
        if (off >= nearest) continue;
        nearest = off;
        const CurveRange range{refitting_.curve(use.edge), from, to};
        u = curve_on_surface(refitting_.reshaped(f), range, kept, curve_tolerance_)->Value(t).X();
      }
    }
    return u;
  }

  const Model& model_;
  const Refitting& refitting_;
  const double curve_tolerance_;
};

/// Widens vertices until they hold the point.
void reach(const TopoDS_Edge& edge, bool at_start, const gp_Pnt& point) {
  const TopoDS_Vertex vertex = at_start ? TopExp::FirstVertex(edge) : TopExp::LastVertex(edge);
  if (vertex.IsNull()) return;
  BRep_Builder().UpdateVertex(vertex, gap_margin * BRep_Tool::Pnt(vertex).Distance(point));
}

}  // namespace

double set_tolerances(const TopoDS_Shape& shape) {
  double largest = 0;
  const BRep_Builder builder;
  for (TopExp_Explorer face(shape, TopAbs_FACE); face.More(); face.Next()) {
    const TopoDS_Face forward = TopoDS::Face(face.Current().Oriented(TopAbs_FORWARD));
    const BRepAdaptor_Surface surface(forward, false);  // it keeps what it knows of a span
    for (TopExp_Explorer used(forward, TopAbs_EDGE); used.More(); used.Next()) {
      const TopoDS_Edge edge = TopoDS::Edge(used.Current());
      double from = 0, to = 0, a = 0, b = 0;
      const Handle(Geom2d_Curve) on_face = BRep_Tool::CurveOnSurface(edge, forward, from, to);
      const Handle(Geom_Curve) curve = BRep_Tool::Curve(edge, a, b);
      if (on_face.IsNull()) continue;
      double gap = 0;
      const TopoDS_Edge along = TopoDS::Edge(edge.Oriented(TopAbs_FORWARD));
      const auto spline = Handle(Geom_BSplineCurve)::DownCast(curve);
      const int gap_samples =
          spline.IsNull() ? least_gap_samples : std::max(least_gap_samples, samples_per_knot * spline->NbKnots());
      for (int k = 0; k < gap_samples; ++k) {
        const double t = from + (to - from) * k / (gap_samples - 1);
        const gp_Pnt2d uv = on_face->Value(t);
        const gp_Pnt place = surface.Value(uv.X(), uv.Y());
        if (curve.IsNull()) {
          reach(along, true, place);
          continue;
        }
        const gp_Pnt own = curve->Value(t);
        gap = std::max(gap, own.Distance(place));
        if (k != 0 && k != gap_samples - 1) continue;
        reach(along, k == 0, own);
        reach(along, k == 0, place);
      }
      largest = std::max(largest, gap);
      builder.UpdateEdge(edge, std::max(gap_margin * gap, Precision::Confusion()));
    }
  }
  // A vertex is at least as wide as its edges.
  for (TopExp_Explorer used(shape, TopAbs_EDGE); used.More(); used.Next()) {
    const TopoDS_Edge edge = TopoDS::Edge(used.Current());
    for (const TopoDS_Vertex& vertex : {TopExp::FirstVertex(edge), TopExp::LastVertex(edge)}) {
      if (!vertex.IsNull()) builder.UpdateVertex(vertex, BRep_Tool::Tolerance(edge));
    }
  }
  return largest;
}

DeformedShape deformed_shape(const TopoDS_Shape& part, const Model& model, const Refitting& refitting, double tolerance) {
  BRepTools_Modifier modifier(part, new RefitModification(model, refitting, curve_share * tolerance));
  if (!modifier.IsDone()) throw Error(ErrorCode::internal, model.name + ": OpenCASCADE could not rebuild the model");
  DeformedShape deformed{modifier.ModifiedShape(part)};
  deformed.largest_gap = set_tolerances(deformed.shape);
  return deformed;
}

void widen(const TopoDS_Shape& shape) {
  const BRep_Builder builder;
  for (const TopAbs_ShapeEnum kind : {TopAbs_EDGE, TopAbs_VERTEX}) {
    TopTools_IndexedMapOfShape found;
    TopExp::MapShapes(shape, kind, found);
    for (int i = 1; i <= found.Extent(); ++i) {
      if (kind == TopAbs_EDGE) {
        builder.UpdateEdge(TopoDS::Edge(found(i)), 2 * BRep_Tool::Tolerance(TopoDS::Edge(found(i))));
      } else {
        builder.UpdateVertex(TopoDS::Vertex(found(i)), 2 * BRep_Tool::Tolerance(TopoDS::Vertex(found(i))));
      }
    }
  }
}

std::string faults_of(const TopoDS_Shape& shape) {
  const BRepCheck_Analyzer analyzer(shape, true, true);
  if (analyzer.IsValid()) return {};
  constexpr int most = 4;
  int found = 0;
  std::ostringstream text;
  constexpr std::array<std::pair<TopAbs_ShapeEnum, const char*>, 6> kinds{{{TopAbs_VERTEX, "vertex"},
                                                                           {TopAbs_EDGE, "edge"},
                                                                           {TopAbs_WIRE, "loop"},
                                                                           {TopAbs_FACE, "face"},
                                                                           {TopAbs_SHELL, "shell"},
                                                                           {TopAbs_SOLID, "solid"}}};
  const auto report = [&](const char* kind, int number, const BRepCheck_ListOfStatus& list, const std::string& where) {
    for (const BRepCheck_Status status : list) {
      if (status == BRepCheck_NoError) continue;
      std::ostringstream name;
      BRepCheck::Print(status, name);
      std::string what = name.str();
      while (!what.empty() && (what.back() == '\n' || what.back() == ' ')) what.pop_back();
      if (++found <= most) text << (found > 1 ? "; " : "") << kind << ' ' << number << where << ": " << what;
    }
  };
  TopTools_IndexedMapOfShape faces;
  TopExp::MapShapes(shape, TopAbs_FACE, faces);
  for (const auto& [type, kind] : kinds) {
    TopTools_IndexedMapOfShape shapes;
    TopExp::MapShapes(shape, type, shapes);
    for (int i = 1; i <= shapes.Extent(); ++i) {
      const Handle(BRepCheck_Result)& result = analyzer.Result(shapes(i));
      if (result.IsNull()) continue;
      report(kind, i, result->Status(), "");
      for (result->InitContextIterator(); result->MoreShapeInContext(); result->NextShapeInContext()) {
        const int face = faces.FindIndex(result->ContextualShape());
        report(kind, i, result->StatusOnShape(), face > 0 ? " on face " + std::to_string(face) : "");
      }
    }
  }
  if (found > most) text << "; and " << found - most << " more";
  return found > 0 ? text.str() : "the shape as a whole";
}

}  // namespace deform::cad
