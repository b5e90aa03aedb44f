// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/cad_move.h"

#include <BRepAdaptor_Curve.hxx>
#include <BRepBuilderAPI_MakeVertex.hxx>
#include <BRepExtrema_DistShapeShape.hxx>
#include <BRepTools.hxx>
#include <BRepTopAdaptor_FClass2d.hxx>
#include <BRep_Tool.hxx>
#include <Geom2d_Curve.hxx>
#include <Geom_Surface.hxx>
#include <Standard_Failure.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Iterator.hxx>
#include <algorithm>
#include <memory>
#include <unordered_map>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/cad/correspondence.h"
#include "core/cad/edge_map.h"
#include "core/cad/face_warp.h"
#include "core/cad/model.h"
#include "core/cad/node_owners.h"
#include "core/mesh/region.h"

namespace deform::cad {

namespace {

constexpr double still = 1e-12;         ///< of D: what the model moves less does not move
constexpr double outside_limit = 1e-9;  ///< of D
constexpr std::size_t checked_nodes = 1000;
constexpr int most_samples = 300;  ///< of one edge

Vec3 vec(const gp_Pnt& p) { return {p.X(), p.Y(), p.Z()}; }
gp_Pnt pnt(const Vec3& p) { return {p[0], p[1], p[2]}; }

class Carrier {
 public:
  Carrier(const Mesh& mesh, const Model& before, const Model& after, const Correspondence& partners, std::vector<PointId> nodes,
          std::vector<Owner> owners)
      : mesh_(mesh), before_(before), after_(after), partners_(partners), nodes_(std::move(nodes)), owners_(std::move(owners)) {
    for (std::size_t i = 0; i < nodes_.size(); ++i) index_[nodes_[i]] = i;
    for (int e = 0; e < before.edge_count(); ++e) {
      edges_.emplace_back(before.edge(e), after.edge(partners.edges[e]), partners.edge_senses[e]);
    }
    samples_.assign(before.edge_count(), 0);
    for (const Owner& owner : owners_) {
      if (owner.kind == Owner::Kind::edge) samples_[owner.index] += 3;
    }
    for (int& samples : samples_) samples = std::clamp(samples, 20, most_samples);
  }

  CarriedNodes carry(const RunContext& context) {
    CarriedNodes carried;
    carried.nodes = nodes_;
    carried.diagonal = after_.diagonal;
    parameters_.resize(nodes_.size());
    for (const PointId node : nodes_) carried.places.push_back(mesh_.points[node]);
    std::vector<std::vector<std::size_t>> inside(before_.face_count());
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      const Owner& owner = owners_[i];
      carried.farthest = std::max(carried.farthest, owner.distance);
      if (owner.kind == Owner::Kind::face) {
        inside[owner.index].push_back(i);
        ++carried.on_faces;
      } else if (owner.kind == Owner::Kind::edge) {
        carry_on_edge(i, carried.places[i]);
        ++carried.on_edges;
      } else {
        const gp_Pnt from = BRep_Tool::Pnt(before_.vertex(owner.index));
        move(from, BRep_Tool::Pnt(after_.vertex(partners_.vertices[owner.index])), carried.places[i]);
        ++carried.on_vertices;
      }
    }
    for (int f = 0; f < before_.face_count(); ++f) {
      context.check();
      carried.faces.push_back(carry_on_face(f, inside[f], carried.places));
    }
    count_flipped(carried);
    measure(carried, context);
    return carried;
  }

 private:
  /// A node whose place on the model stays is left where the mesh has it.
  void move(const gp_Pnt& from, const gp_Pnt& to, Vec3& place) const {
    if (from.Distance(to) > still * before_.diagonal) place = vec(to);
  }

  void carry_on_edge(std::size_t i, Vec3& place) {
    const Owner& owner = owners_[i];
    const BRepAdaptor_Curve from(before_.edge(owner.index)), to(after_.edge(partners_.edges[owner.index]));
    parameters_[i] = {edges_[owner.index](owner.uv[0]), 0};
    move(from.Value(owner.uv[0]), to.Value(parameters_[i][0]), place);
  }

  FaceOutcome carry_on_face(int f, const std::vector<std::size_t>& inside, Points& places) {
    FaceOutcome outcome;
    outcome.before = f + 1;
    outcome.after = partners_.faces[f] + 1;
    outcome.type = surface_type(before_.face(f));
    outcome.nodes = inside.size();
    if (inside.empty()) return outcome;
    const FaceWarp warp(before_, after_, partners_, f, edges_, samples_);
    const TopoDS_Face partner = after_.face(partners_.faces[f]);
    const auto from = BRep_Tool::Surface(before_.face(f)), to = BRep_Tool::Surface(partner);
    BRepTopAdaptor_FClass2d region(partner, 1e-9);
    for (const std::size_t i : inside) {
      const Parameters& uv = owners_[i].uv;
      parameters_[i] = warp(uv);
      const gp_Pnt place = to->Value(parameters_[i][0], parameters_[i][1]);
      move(from->Value(uv[0], uv[1]), place, places[i]);
      if (region.Perform(gp_Pnt2d(parameters_[i][0], parameters_[i][1])) != TopAbs_OUT) continue;
      if (distance_from(place, partner) > outside_limit * after_.diagonal) ++outcome.outside;
    }
    return outcome;
  }

  static double distance_from(const gp_Pnt& place, const TopoDS_Shape& shape) {
    const BRepExtrema_DistShapeShape found(BRepBuilderAPI_MakeVertex(place).Vertex(), shape);
    return found.IsDone() ? found.Value() : 0;
  }

  /// Faces of the model that hold a node.
  bool holds(int face, std::size_t i) const {
    const Owner& owner = owners_[i];
    if (owner.kind == Owner::Kind::face) return owner.index == face;
    for (const Coedge& use : before_.coedges[face]) {
      if (owner.kind == Owner::Kind::edge ? use.edge == owner.index : vertex_of(use.edge, owner.index)) return true;
    }
    return false;
  }

  bool vertex_of(int edge, int vertex) const {
    for (TopoDS_Iterator end(before_.edge(edge)); end.More(); end.Next()) {
      if (end.Value().IsSame(before_.vertex(vertex))) return true;
    }
    return false;
  }

  /// The face of the model on which a triangle lies: that of an inner corner, else one that holds all corners and is nearest to
  /// its middle. -1: none.
  int face_of(const std::array<std::size_t, 3>& corners) const {
    for (const std::size_t i : corners) {
      if (owners_[i].kind == Owner::Kind::face) return owners_[i].index;
    }
    Vec3 middle{};
    for (const std::size_t i : corners) middle = middle + mesh_.points[nodes_[i]] / 3.0;
    int best = -1;
    double least = 0;
    for (int f = 0; f < before_.face_count(); ++f) {
      if (!std::all_of(corners.begin(), corners.end(), [&](std::size_t i) { return holds(f, i); })) continue;
      const double d = distance_from(pnt(middle), before_.face(f));
      if (best >= 0 && d >= least) continue;
      best = f;
      least = d;
    }
    return best;
  }

  /// (u, v) of a node on a face, with `parameters` for those inside and on edges; false where there are none.
  static bool place_on(const Model& model, int face, const Owner& owner, int entity, const Parameters& parameters, gp_Pnt2d& uv) {
    if (owner.kind == Owner::Kind::face) {
      uv.SetCoord(parameters[0], parameters[1]);
      return true;
    }
    if (owner.kind == Owner::Kind::vertex) {
      uv = BRep_Tool::Parameters(model.vertex(entity), model.face(face));
      return true;
    }
    double first = 0, last = 0;
    const auto curve = BRep_Tool::CurveOnSurface(model.edge(entity), model.face(face), first, last);
    if (!curve.IsNull()) uv = curve->Value(parameters[0]);
    return !curve.IsNull();
  }

  /// Sum of the normals of a face at the corners of a triangle.
  Vec3 normal_at(const Model& model, int face, const std::array<std::size_t, 3>& corners,
                 const std::vector<Parameters>* moved) const {
    Vec3 sum{};
    const auto surface = BRep_Tool::Surface(model.face(face));
    for (const std::size_t i : corners) {
      const Owner& owner = owners_[i];
      int entity = owner.index;
      if (moved && owner.kind == Owner::Kind::edge) entity = partners_.edges[entity];
      if (moved && owner.kind == Owner::Kind::vertex) entity = partners_.vertices[entity];
      gp_Pnt2d uv;
      if (!place_on(model, face, owner, entity, moved ? (*moved)[i] : owner.uv, uv)) continue;
      gp_Pnt p;
      gp_Vec du, dv;
      surface->D1(uv.X(), uv.Y(), p, du, dv);
      const gp_Vec n = du.Crossed(dv);
      if (n.Magnitude() > 1e-12 * du.Magnitude() * dv.Magnitude() && n.Magnitude() > 0)
        sum = sum + Vec3{n.X(), n.Y(), n.Z()} / n.Magnitude();
    }
    return sum;
  }

  void count_flipped(CarriedNodes& carried) const {
    std::size_t corner = 0;
    for (const std::uint32_t size : mesh_.face_sizes) {
      for (std::uint32_t k = 1; k + 1 < size; ++k) {
        const PointId points[] = {mesh_.face_points[corner], mesh_.face_points[corner + k], mesh_.face_points[corner + k + 1]};
        std::array<std::size_t, 3> corners{};
        bool all = true;
        for (int c = 0; c < 3; ++c) {
          const auto found = index_.find(points[c]);
          all = all && found != index_.end();
          if (all) corners[c] = found->second;
        }
        if (all) judge(corners, carried);
      }
      corner += size;
    }
  }

  void judge(const std::array<std::size_t, 3>& corners, CarriedNodes& carried) const {
    const int f = face_of(corners);
    if (f < 0) return;
    FaceOutcome& outcome = carried.faces[f];
    ++outcome.triangles;
    Vec3 old[3], now[3];
    for (int c = 0; c < 3; ++c) {
      old[c] = mesh_.points[nodes_[corners[c]]];
      now[c] = carried.places[corners[c]];
      outcome.largest = std::max(outcome.largest, distance(old[c], now[c]));
    }
    const double side = dot(cross(old[1] - old[0], old[2] - old[0]), normal_at(before_, f, corners, nullptr));
    const double turned =
        dot(cross(now[1] - now[0], now[2] - now[0]), normal_at(after_, partners_.faces[f], corners, &parameters_));
    if (side * turned * partners_.face_senses[f] < 0) ++outcome.flipped;
  }

  /// Against the trimmed entity, by a search that knows nothing of parameters.
  void measure(CarriedNodes& carried, const RunContext& context) const {
    const std::size_t step = 1 + (nodes_.size() - 1) / checked_nodes;
    for (std::size_t i = 0; i < nodes_.size(); i += step) {
      context.check();
      const Owner& owner = owners_[i];
      const TopoDS_Shape entity = owner.kind == Owner::Kind::vertex ? TopoDS_Shape(after_.vertex(partners_.vertices[owner.index]))
                                  : owner.kind == Owner::Kind::edge ? TopoDS_Shape(after_.edge(partners_.edges[owner.index]))
                                                                    : TopoDS_Shape(after_.face(partners_.faces[owner.index]));
      carried.distance = std::max(carried.distance, distance_from(pnt(carried.places[i]), entity));
      ++carried.checked;
    }
  }

  const Mesh& mesh_;
  const Model &before_, &after_;
  const Correspondence& partners_;
  const std::vector<PointId> nodes_;
  const std::vector<Owner> owners_;
  std::unordered_map<PointId, std::size_t> index_;  ///< of a node in nodes_
  std::vector<EdgeMap> edges_;
  std::vector<int> samples_;
  std::vector<Parameters> parameters_;  ///< of the nodes on the new model
};

void check_request(const MoveRequest& request) {
  if (!(request.scale > 0 && request.scale < 1e12)) throw Error(ErrorCode::invalid_argument, "scale: must be over 0");
  if (!(request.tolerance >= 0 && request.tolerance < 1e300))
    throw Error(ErrorCode::invalid_argument, "tolerance: must be 0 or more");
}

}  // namespace

CarriedNodes carry_nodes(const Mesh& mesh, const MoveRequest& request, const RunContext& context) {
  check_request(request);
  mesh.validate();
  try {
    Model before = read_model(request.before, request.scale), after = read_model(request.after, request.scale);
    if (before.face_count() != after.face_count() || before.edge_count() != after.edge_count()) {
      if (!request.pairs.empty()) {
        throw Error(ErrorCode::failed_precondition,
                    "pairs: given pairs need models with as many faces and edges; there are " +
                        std::to_string(before.face_count()) + " and " + std::to_string(after.face_count()) + " faces, " +
                        std::to_string(before.edge_count()) + " and " + std::to_string(after.edge_count()) + " edges");
      }
      before = unified(before);
      after = unified(after);
    }
    const Correspondence partners = match_models(before, after, request.pairs);
    context.check();
    std::vector<PointId> nodes = select(Region{Region::Boundary{}}, mesh, "the boundary of the mesh");
    if (nodes.empty())
      throw Error(ErrorCode::invalid_argument, "the mesh has no faces and no cells: nothing lies on the CAD model");
    const double tolerance = request.tolerance > 0 ? request.tolerance : 1e-4 * before.diagonal;
    std::vector<Owner> owners = owners_of(before, mesh.points, nodes, tolerance, context);
    CarriedNodes carried = Carrier(mesh, before, after, partners, std::move(nodes), std::move(owners)).carry(context);
    carried.notes = before.notes;
    carried.notes.insert(carried.notes.end(), after.notes.begin(), after.notes.end());
    carried.notes.insert(carried.notes.end(), partners.notes.begin(), partners.notes.end());
    return carried;
  } catch (const Standard_Failure& failure) {
    throw Error(ErrorCode::internal, std::string("OpenCASCADE failed: ") + failure.GetMessageString());
  }
}

}  // namespace deform::cad
