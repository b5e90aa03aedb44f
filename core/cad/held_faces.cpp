// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/held_faces.h"

#include <BRepBndLib.hxx>
#include <BRepBuilderAPI_MakeVertex.hxx>
#include <BRepExtrema_DistShapeShape.hxx>
#include <BRep_Builder.hxx>
#include <BRep_Tool.hxx>
#include <Bnd_Box.hxx>
#include <ShapeAnalysis_Surface.hxx>
#include <TopoDS_Compound.hxx>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/cad/analytic_fit.h"
#include "core/numerics/sampling/point_tree.h"

namespace deform::cad {

namespace {

constexpr double on_face = 1e-5;        ///< of D: nodes on a face
constexpr double exact = 1e-9;          ///< of D: what is prescribed is met
constexpr std::size_t least_nodes = 8;  /// fewer fit a rigid motion or a surface by chance
constexpr double near_share = 0.05;     ///< of D: nodes that may belong to the model
constexpr double off_model = 1e-4;      ///< of D: files have few digits
constexpr std::size_t most_checked = 500;

PlaceSamples samples_of(const MeshMotion& mesh, const std::vector<PointId>& nodes, double scale) {
  const auto count = static_cast<Eigen::Index>(nodes.size());
  PlaceSamples samples{Eigen::Matrix3Xd(3, count), Eigen::Matrix3Xd(3, count)};
  for (Eigen::Index i = 0; i < count; ++i) {
    const Vec3 before = mesh.rest[nodes[i]] / scale, after = mesh.moved[nodes[i]] / scale;
    samples.before.col(i) << before[0], before[1], before[2];
    samples.after.col(i) << after[0], after[1], after[2];
  }
  return samples;
}

double largest_miss(const RigidMotion& motion, const PlaceSamples& samples) {
  double largest = 0;
  for (Eigen::Index i = 0; i < samples.before.cols(); ++i) {
    largest = std::max(largest, (samples.after.col(i) - motion(samples.before.col(i))).norm());
  }
  return largest;
}

double largest_distance(const Geom_ElementarySurface& surface, const PlaceSamples& samples) {
  double largest = 0;
  for (Eigen::Index i = 0; i < samples.after.cols(); ++i) {
    largest = std::max(largest, analytic_distance(surface, {samples.after(0, i), samples.after(1, i), samples.after(2, i)}));
  }
  return largest;
}

}  // namespace

void check_place(const Model& model, const MeshMotion& mesh, double scale) {
  std::vector<Vec3> nodes;
  for (const PointId id : mesh.boundary) nodes.push_back(mesh.rest[id] / scale);
  if (nodes.empty() || model.vertex_count() == 0) return;
  const PointTree tree(nodes);
  const double near = near_share * model.diagonal;
  int found = 0;
  for (int v = 0; v < model.vertex_count(); ++v) {
    const gp_Pnt p = BRep_Tool::Pnt(model.vertex(v));
    found += tree.nearest({p.X(), p.Y(), p.Z()}).square <= near * near ? 1 : 0;
  }
  if (10 * found >= model.vertex_count()) return;
  Box box;
  for (const Vec3& node : nodes) box.add(scale * node);
  throw Error(ErrorCode::invalid_argument,
              model.name + " is not the model of this mesh: " + std::to_string(model.vertex_count() - found) + " of its " +
                  std::to_string(model.vertex_count()) + " vertices are far from all nodes; the model is " +
                  number_digits(scale * model.diagonal) + " across, the boundary of the mesh " + number_digits(box.diagonal()) +
                  ": another unit needs --scale");
}

std::optional<std::string> doubt_of_place(const Model& model, const MeshMotion& mesh, double scale) {
  TopoDS_Compound faces;  // not the solids, in which points have no distance
  BRep_Builder builder;
  builder.MakeCompound(faces);
  for (int f = 0; f < model.face_count(); ++f) builder.Add(faces, model.face(f));
  Bnd_Box box;
  BRepBndLib::Add(faces, box);
  box.Enlarge(near_share * model.diagonal);
  std::vector<gp_Pnt> near;
  for (const PointId id : mesh.boundary) {
    const Vec3 p = mesh.rest[id] / scale;
    const gp_Pnt place(p[0], p[1], p[2]);
    if (!box.IsOut(place)) near.push_back(place);
  }
  if (near.empty()) return std::nullopt;
  const std::size_t step = 1 + (near.size() - 1) / most_checked;
  std::size_t checked = 0;
  std::size_t off = 0;
  double farthest = 0;
  for (std::size_t i = 0; i < near.size(); i += step) {
    const BRepExtrema_DistShapeShape found(BRepBuilderAPI_MakeVertex(near[i]).Vertex(), faces);
    if (!found.IsDone()) continue;
    ++checked;
    if (found.Value() <= off_model * model.diagonal) continue;
    ++off;
    farthest = std::max(farthest, found.Value());
  }
  if (off == 0) return std::nullopt;
  return model.name + " may not be the model from which the mesh was made: of " + std::to_string(checked) +
         " nodes on the boundary of the mesh in its box, " + std::to_string(off) + " are not on it, the farthest by " +
         number_digits(std::round(1e5 * farthest / model.diagonal) / 1e5) +
         " D; where the mesh is that of a domain around the model, or wraps it, some may be";
}

HeldFaces::HeldFaces(const Model& model, const MeshMotion& mesh, double scale, double limit)
    : model_(model), mesh_(mesh), scale_(scale), limit_(limit) {}

std::vector<PointId> HeldFaces::nodes_on(int f, const FaceRegion& region) const {
  const TopoDS_Face face = model_.face(f);
  const Handle(Geom_Surface) surface = BRep_Tool::Surface(face);
  const auto elementary = is_analytic(surface) ? Handle(Geom_ElementarySurface)::DownCast(surface) : nullptr;
  ShapeAnalysis_Surface projection(surface);
  const double near = on_face * model_.diagonal;
  Bnd_Box box;
  BRepBndLib::Add(face, box);
  box.Enlarge(near);
  std::array<double, 6> ends{};
  box.Get(ends[0], ends[1], ends[2], ends[3], ends[4], ends[5]);
  const double middle = 0.5 * (region.box()[0] + region.box()[1]);
  std::vector<PointId> nodes;
  for (const PointId node : mesh_.boundary) {
    const Vec3 p = mesh_.rest[node] / scale_;
    if (p[0] < ends[0] || p[1] < ends[1] || p[2] < ends[2] || p[0] > ends[3] || p[1] > ends[4] || p[2] > ends[5]) continue;
    std::array<double, 2> uv{};
    if (!elementary.IsNull()) {
      uv = analytic_parameters(*elementary, p, middle);
    } else {
      const gp_Pnt2d at = projection.ValueOfUV(gp_Pnt(p[0], p[1], p[2]), 0.1 * near);
      uv = {at.X(), at.Y()};
    }
    gp_Pnt q;
    gp_Vec along_u, along_v;
    surface->D1(uv[0], uv[1], q, along_u, along_v);
    if (distance({q.X(), q.Y(), q.Z()}, p) > near) continue;
    // Nodes on its boundary, too.
    const double du = 2 * near / std::max(along_u.Magnitude(), 1e-300), dv = 2 * near / std::max(along_v.Magnitude(), 1e-300);
    const auto inside = [&](double a, double b) {
      return region.contains(std::clamp(uv[0] + a * du, region.box()[0], region.box()[1]),
                             std::clamp(uv[1] + b * dv, region.box()[2], region.box()[3]));
    };
    const bool outside_box = uv[0] < region.box()[0] - du || uv[0] > region.box()[1] + du || uv[1] < region.box()[2] - dv ||
                             uv[1] > region.box()[3] + dv;
    if (outside_box) continue;
    if (inside(0, 0) || inside(1, 0) || inside(-1, 0) || inside(0, 1) || inside(0, -1) || inside(1, 1) || inside(-1, -1) ||
        inside(1, -1) || inside(-1, 1)) {
      nodes.push_back(node);
    }
  }
  return nodes;
}

/// How far the nodes may be from what holds them, model units.
double HeldFaces::allowance(const std::vector<PointId>& nodes) const {
  double allowed = exact * model_.diagonal;
  for (const MeshMotion::Kept& kept : mesh_.kept) {
    if (std::includes(kept.points.begin(), kept.points.end(), nodes.begin(), nodes.end())) {
      allowed = std::max(allowed, 1.001 * kept.largest / scale_);
    }
  }
  return allowed;
}

std::optional<HeldFace> HeldFaces::held(int f, const FaceRegion& region, const PlaceSamples& samples) const {
  const Handle(Geom_Surface) surface = BRep_Tool::Surface(model_.face(f));
  const bool rigid = largest_miss(best_motion(samples.before, samples.after), samples) <= limit_;
  const bool analytic = is_analytic(surface);
  if (!rigid && !(analytic && analytic_fit(surface, samples.before, samples.after).largest <= limit_)) return std::nullopt;
  const std::vector<PointId> nodes = nodes_on(f, region);
  if (nodes.size() < least_nodes) return std::nullopt;
  const PlaceSamples on_nodes = samples_of(mesh_, nodes, scale_);
  if (rigid) {
    const RigidMotion motion = best_motion(on_nodes.before, on_nodes.after);
    if (largest_miss(motion, on_nodes) <= exact * model_.diagonal && largest_miss(motion, samples) <= limit_) {
      return HeldFace{transformation_of(motion)};
    }
  }
  if (!analytic) return std::nullopt;
  const AnalyticFit fit = analytic_fit(surface, on_nodes.before, on_nodes.after);
  if (fit.surface.IsNull() || fit.largest > allowance(nodes) || largest_distance(*fit.surface, samples) > limit_)
    return std::nullopt;
  return HeldFace{gp_Trsf(), fit.surface};
}

}  // namespace deform::cad
