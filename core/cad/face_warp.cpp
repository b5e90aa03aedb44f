// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/face_warp.h"

#include <BRepAdaptor_Surface.hxx>
#include <BRepTools.hxx>
#include <BRep_Tool.hxx>
#include <Eigen/LU>
#include <Geom2d_Curve.hxx>
#include <TopoDS.hxx>
#include <algorithm>
#include <cmath>

namespace deform::cad {

namespace {

double kernel(double square) { return square > 0 ? 0.5 * square * std::log(square) : 0; }

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

FaceWarp::FaceWarp(const Model& before, const Model& after, const Correspondence& partners, int face,
                   const std::vector<EdgeMap>& edges, const std::vector<int>& samples)
    : scale_(parameter_lengths(before.face(face))) {
  std::vector<Eigen::Vector2d> shifts;
  double largest = 0;
  for (const Coedge& use : before.coedges[face]) {
    const int sense = use.sense * partners.edge_senses[use.edge] * partners.face_senses[face];
    const auto old_curve = curve_of(before, face, use);
    const auto new_curve = curve_of(after, partners.faces[face], {partners.edges[use.edge], sense, use.seam});
    if (old_curve.IsNull() || new_curve.IsNull()) continue;
    const EdgeMap& map = edges[use.edge];
    for (int i = 0; i <= samples[use.edge]; ++i) {
      const double t = map.at(static_cast<double>(i) / samples[use.edge]);
      const gp_Pnt2d a = old_curve->Value(t), b = new_curve->Value(map(t));
      const Eigen::Vector2d place = scaled({a.X(), a.Y()});
      // Corners are met by two edges.
      if (std::any_of(centres_.begin(), centres_.end(), [&](const auto& c) { return (c - place).squaredNorm() < 1e-18; }))
        continue;
      centres_.push_back(place);
      shifts.emplace_back(b.X() - a.X(), b.Y() - a.Y());
      largest = std::max(largest, shifts.back().cwiseAbs().maxCoeff());
    }
  }
  const auto n = static_cast<Eigen::Index>(centres_.size());
  if (largest < 1e-13 || n < 3) {
    centres_.clear();
    return;
  }
  Eigen::MatrixXd system = Eigen::MatrixXd::Zero(n + 3, n + 3);
  Eigen::MatrixX2d right = Eigen::MatrixX2d::Zero(n + 3, 2);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j) system(i, j) = kernel((centres_[i] - centres_[j]).squaredNorm());
    system.block<1, 3>(i, n) << centres_[i].x(), centres_[i].y(), 1;
    system.block<3, 1>(n, i) = system.block<1, 3>(i, n).transpose();
    right.row(i) = shifts[i].transpose();
  }
  weights_ = system.partialPivLu().solve(right);
}

Parameters FaceWarp::operator()(const Parameters& uv) const {
  if (centres_.empty()) return uv;
  const auto n = static_cast<Eigen::Index>(centres_.size());
  const Eigen::Vector2d x = scaled(uv);
  Eigen::RowVector2d shift = x.x() * weights_.row(n) + x.y() * weights_.row(n + 1) + weights_.row(n + 2);
  for (Eigen::Index i = 0; i < n; ++i) shift += kernel((x - centres_[i]).squaredNorm()) * weights_.row(i);
  return {uv[0] + shift.x(), uv[1] + shift.y()};
}

}  // namespace deform::cad
