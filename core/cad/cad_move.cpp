// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/cad_move.h"

#include <BRepAdaptor_Curve.hxx>
#include <BRepAdaptor_Surface.hxx>
#include <BRepBuilderAPI_MakeVertex.hxx>
#include <BRepExtrema_DistShapeShape.hxx>
#include <BRepGProp.hxx>
#include <BRepTools.hxx>
#include <BRepTopAdaptor_FClass2d.hxx>
#include <BRep_Tool.hxx>
#include <GCPnts_AbscissaPoint.hxx>
#include <GProp_GProps.hxx>
#include <Geom2d_Curve.hxx>
#include <Geom_Surface.hxx>
#include <ShapeAnalysis_Surface.hxx>
#include <Standard_Failure.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Iterator.hxx>
#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <unordered_map>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/cad/boundary_triangles.h"
#include "core/cad/closed_edges.h"
#include "core/cad/coordinates.h"
#include "core/cad/correspondence.h"
#include "core/cad/derivation.h"
#include "core/cad/edge_map.h"
#include "core/cad/face_mending.h"
#include "core/cad/face_warp.h"
#include "core/cad/model.h"
#include "core/cad/node_owners.h"
#include "core/cad/normal_warp.h"
#include "core/cad/periodic_warp.h"
#include "core/mesh/region.h"

namespace deform::cad {

namespace {

constexpr double still = 1e-12;         ///< of D: what the model moves less does not move
constexpr double outside_limit = 1e-9;  ///< of D
constexpr std::size_t checked_nodes = 1000;
constexpr int most_samples = 300;                                 ///< of one edge
constexpr double length_tolerance = 1e-3, area_tolerance = 1e-2;  ///< of D; relative
constexpr double much_better = 0.7;                               ///< ratio of distortions

gp_Pnt pnt(const Vec3& p) { return {p[0], p[1], p[2]}; }

class Carrier {
 public:
  Carrier(const Mesh& mesh, const Model& before, const Model& after, const Correspondence& partners, std::vector<PointId> nodes,
          std::vector<Owner> owners)
      : mesh_(mesh),
        before_(before),
        after_(after),
        partners_(partners),
        rings_(closed_edges(before, after, partners)),
        nodes_(std::move(nodes)),
        owners_(std::move(owners)) {
    for (std::size_t i = 0; i < nodes_.size(); ++i) index_[nodes_[i]] = i;
    const auto along = partners.same_parameters ? EdgeMap::Along::parameter : EdgeMap::Along::type_decides;
    for (int e = 0; e < before.edge_count(); ++e) {
      edges_.emplace_back(before.edge(e), after.edge(partners.edges[e]), partners.edge_senses[e], rings_.phases[e], along);
    }
    leave_seams();
    samples_.assign(before.edge_count(), 0);
    for (const Owner& owner : owners_) {
      if (owner.kind == Owner::Kind::edge) samples_[owner.index] += 3;
    }
    sample_thin_faces();
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
    sort_triangles(context);
    for (int f = 0; f < before_.face_count(); ++f) {
      context.check();
      carried.faces.push_back(carry_on_face(f, inside[f], carried.places));
    }
    for (int f = 0; f < before_.face_count(); ++f) {
      context.check();
      even_out(f, inside[f], carried.places);
    }
    for (int f = 0; f < before_.face_count(); ++f) mend(f, carried.places, carried.faces[f], context);
    for (int f = 0; f < before_.face_count(); ++f) {
      for (const Triangle& triangle : triangles_[f]) {
        for (const std::size_t i : triangle.corners) {
          double& largest = carried.faces[f].largest;
          largest = std::max(largest, distance(mesh_.points[nodes_[i]], carried.places[i]));
        }
      }
    }
    measure(carried, context);
    return carried;
  }

 private:
  struct Triangle {
    std::array<std::size_t, 3> corners{};  ///< in nodes_; counter-clockwise seen along du x dv of the old face
  };

  /// A warp between samples that are farther apart than the face is wide leaves it.
  void sample_thin_faces() {
    std::vector<double> lengths(before_.edge_count(), 0.0);
    for (int e = 0; e < before_.edge_count(); ++e) {
      if (!BRep_Tool::Degenerated(before_.edge(e)))
        lengths[e] = GCPnts_AbscissaPoint::Length(BRepAdaptor_Curve(before_.edge(e)), length_tolerance * before_.diagonal);
    }
    for (int f = 0; f < before_.face_count(); ++f) {
      GProp_GProps area;
      BRepGProp::SurfaceProperties(before_.face(f), area, area_tolerance);
      double around = 0;
      for (const Coedge& use : before_.coedges[f]) around += lengths[use.edge];
      if (!(area.Mass() > 0)) continue;
      const double width = 2 * area.Mass() / around;
      for (const Coedge& use : before_.coedges[f])
        samples_[use.edge] = std::max(samples_[use.edge], static_cast<int>(std::min(2 * lengths[use.edge] / width, 1e6)));
    }
  }

  /// Nodes on seams that do not go to a seam lie in the face, those at their ends on the closed edge.
  void leave_seams() {
    for (Owner& owner : owners_) {
      if (owner.kind == Owner::Kind::vertex && rings_.start_edge[owner.index] >= 0) {
        const int e = rings_.start_edge[owner.index];
        owner = {Owner::Kind::edge, e, {edges_[e].at(0), 0}, owner.distance};
      }
      if (owner.kind != Owner::Kind::edge || !rings_.loose[owner.index]) continue;
      for (int f = 0; f < before_.face_count(); ++f) {
        const auto& uses = before_.coedges[f];
        const auto use = std::find_if(uses.begin(), uses.end(), [&](const Coedge& u) { return u.edge == owner.index; });
        if (use == uses.end()) continue;
        const gp_Pnt2d uv = curve_of(before_, f, *use)->Value(owner.uv[0]);
        owner = {Owner::Kind::face, f, {uv.X(), uv.Y()}, owner.distance};
        break;
      }
    }
  }

  /// Whether a face has the (u, v) of its partner, and ends at the same ones.
  bool keeps_parameters(int f) const {
    return partners_.same_parameters && cad::keeps_parameters(before_, after_, partners_, f, edges_);
  }

  /// (u, v) of nodes in a face on its partner.
  std::function<Parameters(const Parameters&)> warp_of(int f) const {
    if (keeps_parameters(f)) return [](const Parameters& uv) { return uv; };
    for (const Coedge& use : before_.coedges[f]) {
      if (use.seam && rings_.loose[use.edge]) return PeriodicWarp(before_, after_, partners_, f, edges_, samples_, rings_.loose);
    }
    return FaceWarp(before_, after_, partners_, f, edges_, samples_);
  }

  /// A node whose place on the model stays is left where the mesh has it.
  void move(const gp_Pnt& from, const gp_Pnt& to, Vec3& place) const {
    if (from.Distance(to) > still * before_.diagonal) place = coordinates(to);
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
    outcome.triangles = triangles_[f].size();
    const auto from = BRep_Tool::Surface(before_.face(f)), to = BRep_Tool::Surface(after_.face(partners_.faces[f]));
    if (!inside.empty()) {
      const auto warp = warp_of(f);
      for (const std::size_t i : inside) {
        const Parameters& uv = owners_[i].uv;
        parameters_[i] = warp(uv);
        move(from->Value(uv[0], uv[1]), to->Value(parameters_[i][0], parameters_[i][1]), places[i]);
      }
    }
    return outcome;
  }

  /// By how much triangles have to keep their shapes better without (u, v) of the partner, which mean little where it has another
  /// type and may run otherwise in free forms. 0: (u, v) count.
  double weight_of_parameters(int f) const {
    const GeomAbs_SurfaceType from = BRepAdaptor_Surface(before_.face(f), false).GetType(),
                              to = BRepAdaptor_Surface(after_.face(partners_.faces[f]), false).GetType();
    const auto& uses = before_.coedges[f];
    const bool loose =
        std::any_of(uses.begin(), uses.end(), [&](const Coedge& use) { return use.seam && rings_.loose[use.edge]; });
    if (loose || keeps_parameters(f)) return 0;
    return from != to ? 1 : to > GeomAbs_Torus ? much_better : 0;
  }

  /// Follows the normals of the old face, carried with its boundary, where triangles keep their shapes better so than by (u, v)
  /// of the partner.
  void even_out(int f, const std::vector<std::size_t>& inside, Points& places) {
    const double weight = inside.empty() ? 0 : weight_of_parameters(f);
    if (weight == 0) return;
    const NormalWarp warp(before_, after_, partners_, f, edges_, samples_);
    std::vector<Parameters> found;
    for (const std::size_t i : inside) {
      const std::optional<Parameters> uv = warp(owners_[i].uv, parameters_[i]);
      if (!uv) return;
      found.push_back(*uv);
    }
    const auto from = BRep_Tool::Surface(before_.face(f)), to = BRep_Tool::Surface(after_.face(partners_.faces[f]));
    std::vector<std::size_t> members;
    const FacePatch patch = patch_of(f, places, members);
    FacePatch other = patch;
    std::unordered_map<std::size_t, std::size_t> local;
    for (std::size_t k = 0; k < members.size(); ++k) local[members[k]] = k;
    for (std::size_t k = 0; k < inside.size(); ++k) {
      const auto known = local.find(inside[k]);
      if (known == local.end()) continue;  // of no triangle
      other.nodes[known->second].uv = found[k];
      other.nodes[known->second].place = coordinates(to->Value(found[k][0], found[k][1]));
    }
    const std::size_t faults = flipped_triangles(to, patch).size() + nodes_outside(f, patch).size(),
                      others = flipped_triangles(to, other).size() + nodes_outside(f, other).size();
    if (others > faults || !(distortion(other) < weight * distortion(patch))) return;
    for (std::size_t k = 0; k < inside.size(); ++k) {
      const std::size_t i = inside[k];
      const Parameters& uv = owners_[i].uv;
      parameters_[i] = found[k];
      places[i] = mesh_.points[nodes_[i]];
      move(from->Value(uv[0], uv[1]), to->Value(found[k][0], found[k][1]), places[i]);
    }
  }

  /// Slides the nodes around what the warp flipped or took out of the face, more of them each time, and keeps what is best.
  void mend(int f, Points& places, FaceOutcome& outcome, const RunContext& context) {
    context.check();
    const auto surface = BRep_Tool::Surface(after_.face(partners_.faces[f]));
    std::vector<std::size_t> members;
    FacePatch patch = patch_of(f, places, members);
    std::vector<std::size_t> flipped = flipped_triangles(surface, patch), outside = nodes_outside(f, patch);
    outcome.warp_flipped = outcome.flipped = flipped.size();
    outcome.warp_outside = outcome.outside = outside.size();
    constexpr std::array<std::size_t, 4> widths{2, 6, 20, 1'000'000};
    for (const std::size_t rings : widths) {
      std::erase_if(flipped, [&](std::size_t t) {  // edges stay
        const auto& nodes = patch.triangles[t].nodes;
        return std::none_of(nodes.begin(), nodes.end(), [&](int i) { return patch.nodes[i].inner; });
      });
      if (flipped.empty() && outside.empty()) break;
      FacePatch slid = patch;
      slide_inner_nodes(surface, slid, flipped, outside, rings, context);
      const std::vector<std::size_t> still_flipped = flipped_triangles(surface, slid), off = nodes_outside(f, slid);
      if (still_flipped.size() + off.size() >= outcome.flipped + outcome.outside) continue;
      outcome.flipped = still_flipped.size();
      outcome.outside = off.size();
      for (std::size_t k = 0; k < members.size(); ++k) {
        if (slid.nodes[k].uv == patch.nodes[k].uv) continue;
        parameters_[members[k]] = slid.nodes[k].uv;
        places[members[k]] = slid.nodes[k].place;
      }
      patch = std::move(slid);
      flipped = still_flipped;
      outside = off;
    }
  }

  /// The mesh on a face as the nodes lie on the new one; `members` become their indices.
  FacePatch patch_of(int f, const Points& places, std::vector<std::size_t>& members) const {
    const int partner = partners_.faces[f];
    FacePatch patch;
    BRepTools::UVBounds(after_.face(partner), patch.box[0], patch.box[1], patch.box[2], patch.box[3]);
    std::unordered_map<std::size_t, int> local;
    for (const Triangle& triangle : triangles_[f]) {
      FacePatch::Triangle& copy = patch.triangles.emplace_back();
      for (int c = 0; c < 3; ++c) {
        const std::size_t i = triangle.corners[c];
        const auto [entry, fresh] = local.try_emplace(i, static_cast<int>(members.size()));
        if (fresh) {
          members.push_back(i);
          const bool inner = owners_[i].kind == Owner::Kind::face && owners_[i].index == f;
          patch.nodes.push_back({places[i], inner ? parameters_[i] : uv_on_edges(partner, i, places[i]), inner, is_pole(f, i)});
        }
        copy.nodes[c] = entry->second;
        copy.shape[c] = mesh_.points[nodes_[i]];
      }
      if (partners_.face_senses[f] < 0) {
        std::swap(copy.nodes[1], copy.nodes[2]);
        std::swap(copy.shape[1], copy.shape[2]);
      }
    }
    return patch;
  }

  /// The parameters of a node on an edge or vertex, or of a neighbouring face where it should have been on the edge.
  Parameters uv_on_edges(int face, std::size_t i, const Vec3& place) const {
    const Owner& owner = owners_[i];
    gp_Pnt2d uv;
    const int entity = owner.kind == Owner::Kind::vertex ? partners_.vertices[owner.index]
                       : owner.kind == Owner::Kind::edge ? partners_.edges[owner.index]
                                                         : -1;
    if (owner.kind == Owner::Kind::face || !place_on(after_, face, owner, entity, parameters_[i], uv)) {
      uv = ShapeAnalysis_Surface(BRep_Tool::Surface(after_.face(face))).ValueOfUV(pnt(place), 1e-12);
    }
    return {uv.X(), uv.Y()};
  }

  /// Inner nodes of a patch that left the trimmed face, as their indices in it.
  std::vector<std::size_t> nodes_outside(int f, const FacePatch& patch) const {
    const TopoDS_Face partner = after_.face(partners_.faces[f]);
    const auto surface = BRep_Tool::Surface(partner);
    BRepTopAdaptor_FClass2d region(partner, 1e-9);
    std::vector<std::size_t> outside;
    const auto is_outside = [&](const Parameters& uv) {
      if (region.Perform(gp_Pnt2d(uv[0], uv[1])) != TopAbs_OUT) return false;
      return distance_from(surface->Value(uv[0], uv[1]), partner) > outside_limit * after_.diagonal;
    };
    for (std::size_t k = 0; k < patch.nodes.size(); ++k) {
      if (patch.nodes[k].inner && is_outside(patch.nodes[k].uv)) outside.push_back(k);
    }
    return outside;
  }

  static double distance_from(const gp_Pnt& place, const TopoDS_Shape& shape) {
    const BRepExtrema_DistShapeShape found(BRepBuilderAPI_MakeVertex(place).Vertex(), shape);
    return found.IsDone() ? found.Value() : 0;
  }

  /// By another search, since that of BRepExtrema misses feet inside of some splines; infinite where the foot is not in the face.
  double distance_of_foot(const Vec3& place, int f) const {
    const TopoDS_Face face = after_.face(f);
    const auto surface = BRep_Tool::Surface(face);
    const gp_Pnt2d uv = ShapeAnalysis_Surface(surface).ValueOfUV(pnt(place), 1e-12);
    if (BRepTopAdaptor_FClass2d(face, 1e-9).Perform(uv) == TopAbs_OUT) return std::numeric_limits<double>::infinity();
    return surface->Value(uv.X(), uv.Y()).Distance(pnt(place));
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

  /// Whether a node is at a vertex to which a side of the face in (u, v) has shrunk.
  bool is_pole(int face, std::size_t i) const {
    const Owner& owner = owners_[i];
    const auto& uses = before_.coedges[face];
    return owner.kind == Owner::Kind::vertex && std::any_of(uses.begin(), uses.end(), [&](const Coedge& use) {
             return edges_[use.edge].degenerate() && vertex_of(use.edge, owner.index);
           });
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
    double least = std::numeric_limits<double>::infinity();
    for (int f = 0; f < before_.face_count(); ++f) {
      if (!std::all_of(corners.begin(), corners.end(), [&](std::size_t i) { return holds(f, i); })) continue;
      const double d = distance_from(pnt(middle), before_.face(f));
      if (d >= least) continue;
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

  /// Sum of the normals of the old face at the corners of a triangle.
  Vec3 normal_at(int face, const std::array<std::size_t, 3>& corners) const {
    Vec3 sum{};
    const auto surface = BRep_Tool::Surface(before_.face(face));
    for (const std::size_t i : corners) {
      gp_Pnt2d uv;
      if ((owners_[i].kind == Owner::Kind::face && owners_[i].index != face) || is_pole(face, i)) continue;
      if (!place_on(before_, face, owners_[i], owners_[i].index, owners_[i].uv, uv)) continue;
      gp_Pnt p;
      gp_Vec du, dv;
      surface->D1(uv.X(), uv.Y(), p, du, dv);
      const gp_Vec n = du.Crossed(dv);
      if (n.Magnitude() > 1e-12 * du.Magnitude() * dv.Magnitude() && n.Magnitude() > 0)
        sum = sum + Vec3{n.X(), n.Y(), n.Z()} / n.Magnitude();
    }
    return sum;
  }

  /// By the faces of the old model; those without an area have no side and are left out.
  void sort_triangles(const RunContext& context) {
    triangles_.resize(before_.face_count());
    std::size_t done = 0;
    for (const std::array<PointId, 3>& points : boundary_triangles(mesh_)) {
      if (done++ % 1024 == 0) context.check();
      Triangle triangle;
      bool all = true;
      for (int c = 0; c < 3; ++c) {
        const auto found = index_.find(points[c]);
        all = all && found != index_.end();
        if (all) triangle.corners[c] = found->second;
      }
      if (!all) continue;
      const int f = face_of(triangle.corners);
      if (f < 0) continue;
      const Vec3 &a = mesh_.points[points[0]], &b = mesh_.points[points[1]], &c = mesh_.points[points[2]];
      const Vec3 area = cross(b - a, c - a);
      const double longest = std::max({squared_distance(a, b), squared_distance(b, c), squared_distance(c, a)});
      const double side = dot(area, normal_at(f, triangle.corners));
      if (length(area) <= 1e-9 * longest || side == 0) continue;
      if (side < 0) std::swap(triangle.corners[1], triangle.corners[2]);
      triangles_[f].push_back(triangle);
    }
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
      double distance = distance_from(pnt(carried.places[i]), entity);
      if (owner.kind == Owner::Kind::face && distance > outside_limit * after_.diagonal) {
        distance = std::min(distance, distance_of_foot(carried.places[i], partners_.faces[owner.index]));
      }
      carried.distance = std::max(carried.distance, distance);
      ++carried.checked;
    }
  }

  const Mesh& mesh_;
  const Model &before_, &after_;
  const Correspondence& partners_;
  const ClosedEdges rings_;
  const std::vector<PointId> nodes_;
  std::vector<Owner> owners_;
  std::unordered_map<PointId, std::size_t> index_;  ///< of a node in nodes_
  std::vector<EdgeMap> edges_;
  std::vector<int> samples_;
  std::vector<std::vector<Triangle>> triangles_;  ///< of the mesh, by face of the old model
  std::vector<Parameters> parameters_;            ///< of the nodes on the new model
};

void check_request(const MoveRequest& request) {
  if (!(request.scale > 0 && request.scale < 1e12)) throw Error(ErrorCode::invalid_argument, "scale: must be over 0");
  if (!(request.tolerance >= 0 && request.tolerance < 1e300))
    throw Error(ErrorCode::invalid_argument, "tolerance: must be 0 or more");
}

bool same_counts(const Model& a, const Model& b) { return a.face_count() == b.face_count() && a.edge_count() == b.edge_count(); }

/// Splines and other surfaces without a shape of their own.
bool has_free_forms(const Model& model) {
  for (int f = 0; f < model.face_count(); ++f) {
    if (BRepAdaptor_Surface(model.face(f), false).GetType() > GeomAbs_Torus) return true;
  }
  return false;
}

/// Which faces became splines, or were.
std::string changed_types(const Model& before, const Model& after, const Correspondence& partners) {
  int count = 0;
  std::string example;
  for (int f = 0; f < before.face_count(); ++f) {
    if (surface_type(before.face(f)) == surface_type(after.face(partners.faces[f]))) continue;
    if (++count == 1) example = before.face_name(f) + ", whose partner is " + after.face_name(partners.faces[f]);
  }
  return std::to_string(count) + " of " + std::to_string(before.face_count()) +
         " faces have another type in the new model, such as " + example + "; the models are paired without the types.";
}

/// Merges faces on one surface and edges on one curve where the structures differ, or agree only when most planes turn, as those
/// of a block that was split along another axis.
Correspondence match(Model& before, Model& after, const std::vector<ForcedPair>& pairs) {
  if (!pairs.empty()) {
    if (same_counts(before, after)) return match_models(before, after, pairs);
    throw Error(ErrorCode::failed_precondition,
                "pairs: given pairs need models with as many faces and edges; there are " + std::to_string(before.face_count()) +
                    " and " + std::to_string(after.face_count()) + " faces, " + std::to_string(before.edge_count()) + " and " +
                    std::to_string(after.edge_count()) + " edges");
  }
  if (std::optional<Correspondence> derived = derived_partners(before, after)) {
    derived->notes.push_back("cad-apply made " + after.name + " of " + before.name +
                             ": faces of equal numbers are partners, and nodes keep their parameters.");
    return *std::move(derived);
  }
  const bool differ = structures_differ(before, after);
  if (!differ) {
    try {
      Correspondence found = match_models(before, after, pairs);
      if (turned_planes(before, after, found) < 0.5) return found;
    } catch (const Error& error) {
      if (error.code() != ErrorCode::failed_precondition) throw;  // else the merged models may have a clear answer
    }
  }
  Model old = unified(before), now = unified(after);
  const bool merged = !same_counts(old, before) || !same_counts(now, after);
  // Faces that became ones of another type, as those of cad-apply, are not merged any more: then counts that agreed would differ.
  const bool comparable = same_counts(old, now) || !same_counts(before, after);
  if (merged && (differ ? comparable : !structures_differ(old, now))) {
    before = std::move(old);
    after = std::move(now);
  }
  const bool retyped = has_free_forms(before) || has_free_forms(after);
  if (!retyped || !structures_differ(before, after) || structures_differ(before, after, FaceTypes::left_out)) {
    return match_models(before, after, pairs);
  }
  Correspondence found = match_models(before, after, pairs, FaceTypes::left_out);
  found.notes.push_back(changed_types(before, after, found));
  return found;
}

}  // namespace

CarriedNodes carry_nodes(const Mesh& mesh, const MoveRequest& request, const RunContext& context) {
  check_request(request);
  mesh.validate();
  try {
    Model before = read_model(request.before, request.scale), after = read_model(request.after, request.scale);
    if (before.unit > 0 && after.unit > 0 && before.unit != after.unit) {
      after = read_model(request.after, request.scale * after.unit / before.unit);
    }
    const Correspondence partners = match(before, after, request.pairs);
    context.check();
    std::vector<PointId> nodes = select(Region{Region::Boundary{}}, mesh, "the boundary of the mesh");
    if (nodes.empty())
      throw Error(ErrorCode::invalid_argument, "the mesh has no faces and no cells: nothing lies on the CAD model");
    const double tolerance = request.tolerance > 0 ? request.tolerance : 1e-4 * before.diagonal;
    const KnownFaces known = known_faces(before, mesh, request.face_entities, tolerance);
    std::vector<Owner> owners = owners_of(before, mesh, nodes, tolerance, context, known);
    CarriedNodes carried = Carrier(mesh, before, after, partners, std::move(nodes), std::move(owners)).carry(context);
    carried.notes = before.notes;
    carried.notes.insert(carried.notes.end(), after.notes.begin(), after.notes.end());
    carried.notes.insert(carried.notes.end(), partners.notes.begin(), partners.notes.end());
    carried.notes.insert(carried.notes.end(), known.notes.begin(), known.notes.end());
    return carried;
  } catch (const Standard_Failure& failure) {
    throw Error(ErrorCode::internal, std::string("OpenCASCADE failed: ") + failure.GetMessageString());
  }
}

}  // namespace deform::cad
