// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/node_owners.h"

#include <BRepAdaptor_Curve.hxx>
#include <BRepAdaptor_Surface.hxx>
#include <BRepBndLib.hxx>
#include <BRepTools.hxx>
#include <BRepTopAdaptor_FClass2d.hxx>
#include <BRep_Tool.hxx>
#include <Bnd_Box.hxx>
#include <ElCLib.hxx>
#include <Geom_Surface.hxx>
#include <ShapeAnalysis_Curve.hxx>
#include <ShapeAnalysis_Surface.hxx>
#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/cad/face_warp.h"
#include "core/numerics/sampling/point_tree.h"

namespace deform::cad {

namespace {

/// A face, or an edge, as nodes are projected onto it.
struct Place {
  Bnd_Box box;
  BRepAdaptor_Curve curve;
  Handle(ShapeAnalysis_Surface) surface;
  std::unique_ptr<BRepTopAdaptor_FClass2d> region;
  double u0 = 0, u1 = 0, v0 = 0, v1 = 0;
  std::vector<Parameters> sample_uv;         ///< of surfaces whose projection is iterative
  std::unique_ptr<const PointTree> samples;  ///< the same in space
  double spacing = 0;                        ///< largest distance of neighbouring samples
};

constexpr int samples_along = 48;
constexpr double side_share = 0.02;  ///< of the shortest side at a node

/// Planes, cylinders, cones, spheres and tori are projected onto by a formula.
bool is_elementary(const TopoDS_Face& face) { return BRepAdaptor_Surface(face, false).GetType() <= GeomAbs_Torus; }

/// A grid in (u, v), from whose nearest node projections start (thesis 6.2).
void sample(Place& place) {
  const Handle(Geom_Surface)& surface = place.surface->Surface();
  std::vector<Vec3> points;
  for (int j = 0; j <= samples_along; ++j) {
    for (int i = 0; i <= samples_along; ++i) {
      const double u = place.u0 + i * (place.u1 - place.u0) / samples_along;
      const double v = place.v0 + j * (place.v1 - place.v0) / samples_along;
      const gp_Pnt p = surface->Value(u, v);
      place.sample_uv.push_back({u, v});
      points.push_back({p.X(), p.Y(), p.Z()});
      const std::size_t k = points.size() - 1;
      if (i > 0) place.spacing = std::max(place.spacing, distance(points[k], points[k - 1]));
      if (j > 0) place.spacing = std::max(place.spacing, distance(points[k], points[k - samples_along - 1]));
    }
  }
  place.samples = std::make_unique<const PointTree>(points);
}

class Finder {
 public:
  Finder(const Model& model, double tolerance) : model_(model), tolerance_(tolerance), snap_(1e-6 * model.diagonal) {
    for (int e = 0; e < model.edge_count(); ++e) {
      Place& place = edges_.emplace_back();
      if (BRep_Tool::Degenerated(model.edge(e))) continue;  // an empty box
      place.curve.Initialize(model.edge(e));
      BRepBndLib::Add(model.edge(e), place.box);
      place.box.Enlarge(std::max(snap_, tolerance));
    }
    for (int f = 0; f < model.face_count(); ++f) {
      const TopoDS_Face face = model.face(f);
      Place& place = faces_.emplace_back();
      place.surface = new ShapeAnalysis_Surface(BRep_Tool::Surface(face));
      place.region = std::make_unique<BRepTopAdaptor_FClass2d>(face, 1e-9);
      BRepTools::UVBounds(face, place.u0, place.u1, place.v0, place.v1);
      BRepBndLib::Add(face, place.box);
      place.box.Enlarge(tolerance);
      if (!is_elementary(face)) sample(place);
    }
  }

  /// snap: how far the node may be from a vertex or edge that holds it.
  std::optional<Owner> owner(const Vec3& x, double snap) {
    const gp_Pnt p(x[0], x[1], x[2]);
    snap = std::clamp(snap, snap_, std::max(snap_, tolerance_));
    Owner best{Owner::Kind::vertex, -1, {}, snap};
    for (int v = 0; v < model_.vertex_count(); ++v) {
      const double d = BRep_Tool::Pnt(model_.vertex(v)).Distance(p);
      if (d <= best.distance) best = {Owner::Kind::vertex, v, {}, d};
    }
    if (best.index >= 0) return best;
    for (int e = 0; e < model_.edge_count(); ++e) {
      if (edges_[e].box.IsVoid() || edges_[e].box.IsOut(p)) continue;
      gp_Pnt foot;
      double t = 0;
      const double d = ShapeAnalysis_Curve().Project(edges_[e].curve, p, 1e-12, foot, t, false);
      if (d <= best.distance) best = {Owner::Kind::edge, e, {t, 0}, d};
    }
    if (best.index >= 0) return best;
    best.distance = tolerance_;
    for (int f = 0; f < model_.face_count(); ++f) {
      const Place& place = faces_[f];
      if (place.box.IsOut(p)) continue;
      const Handle(Geom_Surface)& surface = place.surface->Surface();
      gp_Pnt2d uv;
      if (!project(place, x, uv)) continue;
      double u = uv.X(), v = uv.Y();
      if (surface->IsUPeriodic()) u = ElCLib::InPeriod(u, place.u0, place.u0 + surface->UPeriod());
      if (surface->IsVPeriodic()) v = ElCLib::InPeriod(v, place.v0, place.v0 + surface->VPeriod());
      const double d = surface->Value(u, v).Distance(p);
      if (d > best.distance) continue;
      if (place.region->Perform(gp_Pnt2d(u, v)) == TopAbs_OUT) continue;
      best = {Owner::Kind::face, f, {u, v}, d};
    }
    if (best.index < 0) return std::nullopt;
    return best;
  }

 private:
  /// (u, v) of the foot of a point. False where the face is certainly farther than the tolerance.
  bool project(const Place& place, const Vec3& x, gp_Pnt2d& uv) const {
    const gp_Pnt p(x[0], x[1], x[2]);
    if (place.samples) {
      const PointTree::Near near = place.samples->nearest(x);
      if (std::sqrt(near.square) > tolerance_ + 2 * place.spacing) return false;
      const Parameters& start = place.sample_uv[near.point];
      uv = place.surface->NextValueOfUV(gp_Pnt2d(start[0], start[1]), p, 1e-12);
      if (place.surface->Surface()->Value(uv.X(), uv.Y()).Distance(p) <= snap_) return true;
    }
    uv = place.surface->ValueOfUV(p, 1e-12);
    return true;
  }

  const Model& model_;
  const double tolerance_, snap_;
  std::deque<Place> edges_, faces_;
};

/// Of the faces at each point; 0 where there is none.
std::vector<double> shortest_sides(const Mesh& mesh) {
  std::vector<double> shortest(mesh.point_count(), 0);
  std::size_t first = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    for (std::uint32_t k = 0; k < size; ++k) {
      const PointId a = mesh.face_points[first + k], b = mesh.face_points[first + (k + 1) % size];
      const double side = distance(mesh.points[a], mesh.points[b]);
      for (const PointId p : {a, b}) {
        if (side > 0 && (shortest[p] == 0 || side < shortest[p])) shortest[p] = side;
      }
    }
    first += size;
  }
  return shortest;
}

}  // namespace

std::vector<Owner> owners_of(const Model& model, const Mesh& mesh, std::span<const PointId> nodes, double tolerance,
                             const RunContext& context) {
  const std::span<const Vec3> points = mesh.points;
  const std::vector<double> sides = shortest_sides(mesh);
  Finder finder(model, tolerance);
  std::vector<Owner> owners;
  std::size_t lost = 0;
  std::string ids;
  for (const PointId node : nodes) {
    if (owners.size() % 256 == 0) context.check();
    const auto owner = finder.owner(points[node], side_share * sides[node]);
    owners.push_back(owner.value_or(Owner{}));
    if (owner) continue;
    if (++lost <= 5) ids += (ids.empty() ? "" : ", ") + std::to_string(node);
  }
  if (lost > 0) {
    throw Error(ErrorCode::invalid_argument,
                std::to_string(lost) + " of " + std::to_string(nodes.size()) + " nodes of the boundary are farther than " +
                    number_digits(tolerance) + " from " + model.name + ", such as " + ids + "; the model is " +
                    number_digits(model.diagonal) + " across, the mesh " + number_digits(bounding_box(points).diagonal()) +
                    ": another unit needs --scale, a coarse model a larger --tolerance");
  }
  return owners;
}

}  // namespace deform::cad
