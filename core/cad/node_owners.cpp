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
#include <TopExp.hxx>
#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <set>
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

/// Distance of a point from the nearest point of an edge, and its parameter. Projections go on beyond the ends of arcs and lines.
double distance_from(const BRepAdaptor_Curve& edge, const gp_Pnt& p, double& t) {
  gp_Pnt foot;
  const double d = ShapeAnalysis_Curve().Project(edge, p, 1e-12, foot, t, false);
  const double first = edge.FirstParameter(), last = edge.LastParameter();
  if (edge.IsPeriodic()) t = ElCLib::InPeriod(t, first, first + edge.Period());
  if (t >= first && t <= last) return d;
  const double from_first = edge.Value(first).Distance(p), from_last = edge.Value(last).Distance(p);
  t = from_first < from_last ? first : last;
  return std::min(from_first, from_last);
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
    faces_at_edge_.resize(model.edge_count());
    faces_at_vertex_.resize(model.vertex_count());
    for (int f = 0; f < model.face_count(); ++f) {
      for (const Coedge& use : model.coedges[f]) {
        faces_at_edge_[use.edge].insert(f);
        for (const TopoDS_Vertex& end : {TopExp::FirstVertex(model.edge(use.edge)), TopExp::LastVertex(model.edge(use.edge))}) {
          if (!end.IsNull()) faces_at_vertex_[model.vertices.FindIndex(end) - 1].insert(f);
        }
      }
    }
  }

  /// Where a point lies on a face, which it may leave by the tolerance; nothing where it is farther.
  std::optional<Owner> on_face(int f, const Vec3& x) const {
    const gp_Pnt p(x[0], x[1], x[2]);
    const Place& place = faces_[f];
    gp_Pnt2d uv;
    if (place.box.IsOut(p) || !project(place, x, uv)) return std::nullopt;
    const Owner found = placed(f, uv, p);
    if (found.distance > tolerance_) return std::nullopt;
    if (place.region->Perform(gp_Pnt2d(found.uv[0], found.uv[1])) != TopAbs_OUT) return found;
    for (const Coedge& use : model_.coedges[f]) {
      if (edges_[use.edge].box.IsVoid() || edges_[use.edge].box.IsOut(p)) continue;
      double t = 0;
      if (distance_from(edges_[use.edge].curve, p, t) <= tolerance_) return found;
    }
    return std::nullopt;
  }

  /// Out of the solid, of length 1; 0 where there is none.
  Vec3 normal(int f, const std::array<double, 2>& uv) const {
    gp_Pnt p;
    gp_Vec du, dv;
    faces_[f].surface->Surface()->D1(uv[0], uv[1], p, du, dv);
    const gp_Vec n = du.Crossed(dv);
    if (!(n.Magnitude() > 1e-12 * du.Magnitude() * dv.Magnitude())) return {};
    return static_cast<double>(model_.face_sense(f)) / n.Magnitude() * Vec3{n.X(), n.Y(), n.Z()};
  }

  /// The owner among what all faces of a node have in common. Nothing where it is on none of that.
  std::optional<Owner> owner_among(const std::set<int>& faces, const Vec3& x, double snap) {
    const gp_Pnt p(x[0], x[1], x[2]);
    // On several faces, it lies on what they share, as far as the tolerance goes.
    snap = faces.size() > 1 ? std::max(snap_, tolerance_) : std::clamp(snap, snap_, std::max(snap_, tolerance_));
    const auto shared = [&](const std::set<int>& around) {
      return std::includes(around.begin(), around.end(), faces.begin(), faces.end());
    };
    Owner best{Owner::Kind::vertex, -1, {}, snap};
    // A vertex only as near as ever: the edge beside it is within the tolerance, too.
    if (faces.size() > 1) best.distance = std::min(snap, std::max(snap_, side_share * tolerance_));
    for (int v = 0; v < model_.vertex_count(); ++v) {
      const double d = BRep_Tool::Pnt(model_.vertex(v)).Distance(p);
      if (d <= best.distance && shared(faces_at_vertex_[v])) best = {Owner::Kind::vertex, v, {}, d};
    }
    if (best.index >= 0) return best;
    best.distance = snap;
    for (int e = 0; e < model_.edge_count(); ++e) {
      if (!shared(faces_at_edge_[e]) || edges_[e].box.IsVoid() || edges_[e].box.IsOut(p)) continue;
      double t = 0;
      const double d = distance_from(edges_[e].curve, p, t);
      if (d <= best.distance) best = {Owner::Kind::edge, e, {t, 0}, d};
    }
    if (best.index >= 0) return best;
    if (faces.size() > 1) {  // three faces meet in a vertex
      best.distance = snap;
      for (int v = 0; v < model_.vertex_count(); ++v) {
        const double d = BRep_Tool::Pnt(model_.vertex(v)).Distance(p);
        if (d <= best.distance && shared(faces_at_vertex_[v])) best = {Owner::Kind::vertex, v, {}, d};
      }
      return best.index >= 0 ? std::optional(best) : std::nullopt;
    }
    return on_face(*faces.begin(), x);
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
      double t = 0;
      const double d = distance_from(edges_[e].curve, p, t);
      if (d <= best.distance) best = {Owner::Kind::edge, e, {t, 0}, d};
    }
    if (best.index >= 0) return best;
    best.distance = tolerance_;
    for (int f = 0; f < model_.face_count(); ++f) {
      const Place& place = faces_[f];
      if (place.box.IsOut(p)) continue;
      gp_Pnt2d uv;
      if (!project(place, x, uv)) continue;
      const Owner found = placed(f, uv, p);
      if (found.distance > best.distance) continue;
      if (place.region->Perform(gp_Pnt2d(found.uv[0], found.uv[1])) == TopAbs_OUT) continue;
      best = found;
    }
    if (best.index < 0) return std::nullopt;
    return best;
  }

 private:
  /// The owner of a foot, in the period of the face.
  Owner placed(int f, const gp_Pnt2d& uv, const gp_Pnt& p) const {
    const Place& place = faces_[f];
    const Handle(Geom_Surface)& surface = place.surface->Surface();
    double u = uv.X(), v = uv.Y();
    if (surface->IsUPeriodic()) u = ElCLib::InPeriod(u, place.u0, place.u0 + surface->UPeriod());
    if (surface->IsVPeriodic()) v = ElCLib::InPeriod(v, place.v0, place.v0 + surface->VPeriod());
    return {Owner::Kind::face, f, {u, v}, surface->Value(u, v).Distance(p)};
  }

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
  std::vector<std::set<int>> faces_at_edge_, faces_at_vertex_;
};

/// Faces of the mesh of which a file says that they lie on one face of the model.
struct Entity {
  std::string name;    ///< "surface 12", "group \"inlet\""
  int hint = -1;       ///< the face of the model that has its number or name; -1: none
  bool named = false;  ///< by its name
  std::vector<FaceId> faces;
};

struct Candidate {
  int face = 0;
  double side = 0;  ///< mean cosine of the faces of the mesh and the normal of the model
};

class EntityMatching {
 public:
  EntityMatching(const Model& model, const Mesh& mesh, double tolerance)
      : model_(model), mesh_(mesh), offsets_(mesh.face_offsets()), finder_(model, tolerance) {}

  KnownFaces match(const std::vector<Entity>& entities) {
    KnownFaces known;
    known.of_mesh_face.assign(mesh_.face_count(), -1);
    std::vector<std::vector<Candidate>> candidates;
    for (const Entity& entity : entities) candidates.push_back(candidates_of(entity));
    // To which side of the model the mesh is turned, where that is clear.
    int out = 0, in = 0;
    for (const auto& found : candidates) {
      if (found.size() == 1) ++(found.front().side > 0 ? out : in);
    }
    const double side = in == 0 && out > 0 ? 1 : out == 0 && in > 0 ? -1 : 0;
    std::size_t doubtful = 0;
    std::string examples;
    for (std::size_t i = 0; i < entities.size(); ++i) {
      const int face = chosen(entities[i], candidates[i], side);
      if (face < 0) {
        if (++doubtful <= 3) examples += (examples.empty() ? "" : ", ") + entities[i].name;
        continue;
      }
      for (const FaceId f : entities[i].faces) known.of_mesh_face[f] = face;
    }
    if (doubtful > 0) {
      known.notes.push_back(std::to_string(doubtful) + " of " + std::to_string(entities.size()) +
                            " entities and named groups of the mesh lie on no single face of " + model_.name + ", such as " +
                            examples + ": the nodes on them are sorted by distance alone.");
    }
    return known;
  }

 private:
  std::span<const PointId> corners(FaceId f) const {
    return std::span(mesh_.face_points).subspan(offsets_[f], mesh_.face_sizes[f]);
  }

  /// Faces of the model on which all nodes of the entity lie, and along which its faces lie.
  std::vector<Candidate> candidates_of(const Entity& entity) const {
    std::vector<Candidate> found;
    const std::size_t step = 1 + (entity.faces.size() - 1) / most_probes;
    for (int f = 0; f < model_.face_count(); ++f) {
      double along = 0, all = 0;
      bool on = true;
      for (std::size_t i = 0; on && i < entity.faces.size(); i += step) {
        const auto nodes = corners(entity.faces[i]);
        Vec3 area{}, normal{};
        for (std::size_t k = 0; k < nodes.size(); ++k) {
          const Vec3& p = mesh_.points[nodes[k]];
          if (k > 0) area = area + cross(mesh_.points[nodes[k - 1]] - mesh_.points[nodes[0]], p - mesh_.points[nodes[0]]);
          const auto place = finder_.on_face(f, p);
          on = on && place.has_value();
          if (place) normal = normal + finder_.normal(f, place->uv);
        }
        if (!on || length(normal) == 0) continue;
        along += dot(area, normal) / length(normal);
        all += length(area);
      }
      if (on && all > 0 && std::abs(along) > along_surface * all) found.push_back({f, along / all});
    }
    return found;
  }

  /// -1: none.
  static int chosen(const Entity& entity, const std::vector<Candidate>& candidates, double side) {
    if (candidates.size() == 1) {
      // A name that another face has is no proof, but then the mesh is not named as the model.
      return entity.named && candidates.front().face != entity.hint ? -1 : candidates.front().face;
    }
    std::vector<int> left;
    for (const Candidate& candidate : candidates) {
      if (side == 0 || side * candidate.side > 0) left.push_back(candidate.face);
    }
    if (left.size() == 1) return entity.named && left.front() != entity.hint ? -1 : left.front();
    return std::find(left.begin(), left.end(), entity.hint) != left.end() ? entity.hint : -1;
  }

  static constexpr std::size_t most_probes = 100;
  static constexpr double along_surface = 0.5;  ///< cosine

  const Model& model_;
  const Mesh& mesh_;
  const std::vector<std::uint64_t> offsets_;
  const Finder finder_;
};

std::vector<Entity> entities_of(const Model& model, const Mesh& mesh, std::span<const std::int32_t> tags) {
  std::map<std::int32_t, Entity> by_tag;
  if (tags.size() == mesh.face_count()) {
    for (FaceId f = 0; f < tags.size(); ++f) {
      if (tags[f] != 0) by_tag[tags[f]].faces.push_back(f);
    }
  }
  std::vector<Entity> entities;
  for (auto& [tag, entity] : by_tag) {
    entity.name = "surface " + std::to_string(tag);
    if (model.numbered && tag >= 1 && tag <= model.face_count()) entity.hint = tag - 1;
    entities.push_back(std::move(entity));
  }
  std::map<std::string, std::vector<int>> named;
  for (std::size_t f = 0; f < model.face_names.size(); ++f) {
    if (!model.face_names[f].empty()) named[model.face_names[f]].push_back(static_cast<int>(f));
  }
  for (const Group& group : mesh.groups) {
    const auto face = named.find(group.name);
    if (group.faces.empty() || face == named.end() || face->second.size() > 1) continue;
    entities.push_back({"group \"" + group.name + "\"", face->second.front(), true, group.faces});
  }
  return entities;
}

/// Faces of the model around each point of the mesh; none where one of its faces is not known.
std::vector<std::set<int>> faces_at_points(const Mesh& mesh, const std::vector<int>& known) {
  std::vector<std::set<int>> around(mesh.point_count());
  std::vector<char> open(mesh.point_count(), 0);
  std::size_t corner = 0;
  for (std::size_t f = 0; f < mesh.face_sizes.size(); ++f) {
    for (std::uint32_t k = 0; k < mesh.face_sizes[f]; ++k, ++corner) {
      const PointId p = mesh.face_points[corner];
      if (known[f] < 0)
        open[p] = 1;
      else
        around[p].insert(known[f]);
    }
  }
  for (std::size_t p = 0; p < around.size(); ++p) {
    if (open[p]) around[p].clear();
  }
  return around;
}

/// The shortest side of the faces at each point; 0 where there is none.
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

KnownFaces known_faces(const Model& model, const Mesh& mesh, std::span<const std::int32_t> entities, double tolerance) {
  const std::vector<Entity> found = entities_of(model, mesh, entities);
  if (found.empty()) return {};
  return EntityMatching(model, mesh, tolerance).match(found);
}

std::vector<Owner> owners_of(const Model& model, const Mesh& mesh, std::span<const PointId> nodes, double tolerance,
                             const RunContext& context, const KnownFaces& known) {
  std::vector<std::set<int>> around;
  if (!known.of_mesh_face.empty()) around = faces_at_points(mesh, known.of_mesh_face);
  const std::span<const Vec3> points = mesh.points;
  const std::vector<double> sides = shortest_sides(mesh);
  Finder finder(model, tolerance);
  std::vector<Owner> owners;
  std::size_t lost = 0;
  std::string ids;
  for (const PointId node : nodes) {
    if (owners.size() % 256 == 0) context.check();
    std::optional<Owner> owner;
    if (!around.empty() && !around[node].empty())
      owner = finder.owner_among(around[node], points[node], side_share * sides[node]);
    if (!owner) owner = finder.owner(points[node], side_share * sides[node]);
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
