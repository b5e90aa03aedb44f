// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/face_region.h"

#include <BRepTools.hxx>
#include <BRep_Tool.hxx>
#include <Geom2dAdaptor_Curve.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Edge.hxx>
#include <TopoDS_Iterator.hxx>
#include <algorithm>
#include <cmath>

namespace deform::cad {

namespace {

/// Corners of a polygon along a curve.
int pieces_of(const Geom2dAdaptor_Curve& curve) {
  switch (curve.GetType()) {
    case GeomAbs_Line:
      return 1;
    case GeomAbs_BSplineCurve:
      return std::clamp(8 * curve.NbKnots(), 16, 2000);
    default:
      return 64;
  }
}

}  // namespace

FaceRegion::FaceRegion(const TopoDS_Face& face) {
  BRepTools::UVBounds(face, box_[0], box_[1], box_[2], box_[3]);
  const TopoDS_Face forward = TopoDS::Face(face.Oriented(TopAbs_FORWARD));
  for (TopoDS_Iterator wire(forward); wire.More(); wire.Next()) {
    if (wire.Value().ShapeType() != TopAbs_WIRE) continue;
    std::vector<std::vector<std::array<double, 2>>> polygons;
    for (TopoDS_Iterator use(wire.Value()); use.More(); use.Next()) {
      const TopoDS_Edge edge = TopoDS::Edge(use.Value());
      if (edge.Orientation() != TopAbs_FORWARD && edge.Orientation() != TopAbs_REVERSED) continue;
      double from = 0, to = 0;
      const Handle(Geom2d_Curve) curve = BRep_Tool::CurveOnSurface(edge, forward, from, to);
      if (curve.IsNull()) continue;
      const Geom2dAdaptor_Curve adaptor(curve, from, to);
      const int pieces = pieces_of(adaptor);
      auto& polygon = polygons.emplace_back();
      for (int k = 0; k <= pieces; ++k) {
        const gp_Pnt2d p = adaptor.Value(from + (to - from) * k / pieces);
        polygon.push_back({p.X(), p.Y()});
      }
    }
    add_wire(std::move(polygons));
  }
  rows_.resize(std::clamp<std::size_t>(segments_.size() / 4, 1, 4096));
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    const auto [low, high] = std::minmax(segments_[i].v0, segments_[i].v1);
    for (std::size_t row = row_of(low); row <= row_of(high); ++row) rows_[row].push_back(static_cast<int>(i));
  }
}

/// The ends of its curves meet up to tolerances; they are joined, so that the polygons close.
void FaceRegion::add_wire(std::vector<std::vector<std::array<double, 2>>> polygons) {
  for (const auto& polygon : polygons) {
    for (std::size_t k = 1; k < polygon.size(); ++k) {
      segments_.push_back({polygon[k - 1][0], polygon[k - 1][1], polygon[k][0], polygon[k][1]});
    }
  }
  std::vector<std::array<double, 2>> ends;
  for (const auto& polygon : polygons) ends.push_back(polygon.front()), ends.push_back(polygon.back());
  const double width = std::max(box_[1] - box_[0], 1e-300), height = std::max(box_[3] - box_[2], 1e-300);
  while (ends.size() >= 2) {
    const std::array<double, 2> end = ends.back();
    ends.pop_back();
    const auto nearest = std::min_element(ends.begin(), ends.end(), [&](const auto& a, const auto& b) {
      return std::hypot((a[0] - end[0]) / width, (a[1] - end[1]) / height) <
             std::hypot((b[0] - end[0]) / width, (b[1] - end[1]) / height);
    });
    if (*nearest != end) segments_.push_back({end[0], end[1], (*nearest)[0], (*nearest)[1]});
    ends.erase(nearest);
  }
}

std::size_t FaceRegion::row_of(double v) const {
  const double share = (v - box_[2]) / std::max(box_[3] - box_[2], 1e-300) * static_cast<double>(rows_.size());
  return static_cast<std::size_t>(std::clamp(share, 0.0, static_cast<double>(rows_.size() - 1)));
}

bool FaceRegion::contains(double u, double v) const {
  if (!(u >= box_[0] && u <= box_[1] && v >= box_[2] && v <= box_[3])) return false;
  bool inside = false;
  for (const int i : rows_[row_of(v)]) {
    const Segment& s = segments_[i];
    if ((s.v0 > v) == (s.v1 > v)) continue;
    if (s.u0 + (v - s.v0) / (s.v1 - s.v0) * (s.u1 - s.u0) > u) inside = !inside;
  }
  return inside;
}

}  // namespace deform::cad
