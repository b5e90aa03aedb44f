// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/face_warp.h"

#include <BRepAdaptor_Surface.hxx>
#include <BRepTools.hxx>
#include <BRep_Tool.hxx>
#include <Geom2d_Curve.hxx>
#include <TopoDS.hxx>
#include <algorithm>
#include <utility>

namespace deform::cad {

namespace {

Eigen::Vector2d scaled(const Parameters& uv, const std::array<double, 2>& scale) { return {uv[0] * scale[0], uv[1] * scale[1]}; }

}  // namespace

Handle(Geom2d_Curve) curve_of(const Model& model, int face, const Coedge& use) {
  double first = 0, last = 0;
  const TopoDS_Edge edge = TopoDS::Edge(model.edge(use.edge).Oriented(use.sense > 0 ? TopAbs_FORWARD : TopAbs_REVERSED));
  return BRep_Tool::CurveOnSurface(edge, model.face(face), first, last);
}

std::array<double, 2> parameter_lengths(const TopoDS_Face& face) {
  const BRepAdaptor_Surface surface(face);
  double u0 = 0, u1 = 0, v0 = 0, v1 = 0, along_u = 0, along_v = 0;
  BRepTools::UVBounds(face, u0, u1, v0, v1);
  constexpr int n = 8;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      gp_Pnt p;
      gp_Vec du, dv;
      surface.D1(u0 + (i + 0.5) / n * (u1 - u0), v0 + (j + 0.5) / n * (v1 - v0), p, du, dv);
      along_u += du.Magnitude() / (n * n);
      along_v += dv.Magnitude() / (n * n);
    }
  }
  const double size = std::max(along_u * (u1 - u0), along_v * (v1 - v0));
  if (!(size > 0) || !(along_u > 0) || !(along_v > 0)) return {1, 1};
  return {along_u / size, along_v / size};
}

std::vector<BoundaryPair> boundary_pairs(const Model& before, const Model& after, const Correspondence& partners, int face,
                                         const std::vector<EdgeMap>& edges, const std::vector<int>& samples,
                                         const std::array<double, 2>& scale) {
  std::vector<BoundaryPair> pairs;
  for (const Coedge& use : before.coedges[face]) {
    const int sense = use.sense * partners.edge_senses[use.edge] * partners.face_senses[face];
    const auto old_curve = curve_of(before, face, use);
    const auto new_curve = curve_of(after, partners.faces[face], {partners.edges[use.edge], sense, use.seam});
    if (old_curve.IsNull() || new_curve.IsNull()) continue;
    const EdgeMap& map = edges[use.edge];
    for (int i = 0; i <= samples[use.edge]; ++i) {
      const double t = map.at(static_cast<double>(i) / samples[use.edge]);
      const gp_Pnt2d a = old_curve->Value(t), b = new_curve->Value(map(t));
      // Corners are met by two edges.
      const bool known = std::any_of(pairs.begin(), pairs.end(), [&](const BoundaryPair& pair) {
        return (scaled(pair.from, scale) - scaled({a.X(), a.Y()}, scale)).squaredNorm() < 1e-18;
      });
      if (!known) pairs.push_back({{a.X(), a.Y()}, {b.X(), b.Y()}});
    }
  }
  return pairs;
}

FaceWarp::FaceWarp(const Model& before, const Model& after, const Correspondence& partners, int face,
                   const std::vector<EdgeMap>& edges, const std::vector<int>& samples)
    : scale_(parameter_lengths(before.face(face))) {
  const std::vector<BoundaryPair> pairs = boundary_pairs(before, after, partners, face, edges, samples, scale_);
  std::vector<Eigen::Vector2d> centres;
  Eigen::MatrixXd shifts(static_cast<Eigen::Index>(pairs.size()), 2);
  for (const auto& [from, to] : pairs) {
    shifts.row(static_cast<Eigen::Index>(centres.size())) << to[0] - from[0], to[1] - from[1];
    centres.push_back(scaled(from, scale_));
  }
  if (pairs.size() < 3 || shifts.cwiseAbs().maxCoeff() < 1e-13) return;
  shift_ = ThinPlate(std::move(centres), shifts);
}

Parameters FaceWarp::operator()(const Parameters& uv) const {
  if (shift_.is_zero()) return uv;
  const Eigen::RowVectorXd shift = shift_(scaled(uv, scale_));
  return {uv[0] + shift[0], uv[1] + shift[1]};
}

}  // namespace deform::cad
