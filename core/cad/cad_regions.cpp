// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/cad_regions.h"

#include <BRepAdaptor_Curve.hxx>
#include <BRepAdaptor_Surface.hxx>
#include <BRepBndLib.hxx>
#include <BRepBuilderAPI_MakeVertex.hxx>
#include <BRepBuilderAPI_Transform.hxx>
#include <BRepExtrema_DistShapeShape.hxx>
#include <BRepGProp.hxx>
#include <BRepTools.hxx>
#include <BRepTopAdaptor_FClass2d.hxx>
#include <BRep_Tool.hxx>
#include <Bnd_Box.hxx>
#include <GCPnts_AbscissaPoint.hxx>
#include <GProp_GProps.hxx>
#include <GProp_PrincipalProps.hxx>
#include <Standard_Failure.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Iterator.hxx>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <set>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/cad/coordinates.h"
#include "core/cad/document.h"
#include "core/cad/model.h"
#include "core/cad/node_owners.h"
#include "core/mesh/region.h"

namespace deform::cad {

namespace {

constexpr double same = 1e-7;       ///< of D and of radians: two faces lie on one surface
constexpr double symmetric = 1e-6;  ///< of D

using Kind = CadShape::Kind;

double from_axis(const CadShape& shape, const Vec3& p) {
  const Vec3 w = p - shape.point;
  return norm(w - dot(w, shape.axis) * shape.axis);
}

/// Distance of a point from the unbounded shape.
double distance_from(const CadShape& shape, const Vec3& p) {
  const Vec3 w = p - shape.point;
  const double along = dot(w, shape.axis);
  switch (shape.kind) {
    case Kind::plane:
      return std::abs(along);
    case Kind::cylinder:
      return std::abs(from_axis(shape, p) - shape.radius);
    case Kind::sphere:
      return std::abs(norm(w) - shape.radius);
    case Kind::cone:
      return std::abs(from_axis(shape, p) * std::cos(shape.half_angle) - along * std::sin(shape.half_angle));
    case Kind::line:
      return from_axis(shape, p);
    case Kind::circle:
      return std::hypot(along, from_axis(shape, p) - shape.radius);
    default:
      return 0;
  }
}

CadShape face_shape(const Model& model, int f) {
  const BRepAdaptor_Surface surface(model.face(f));
  CadShape shape;
  shape.type = surface_type(model.face(f));
  shape.numbers = {f + 1};
  GProp_GProps properties;
  BRepGProp::SurfaceProperties(model.face(f), properties);
  shape.size = std::abs(properties.Mass());
  if (surface.GetType() == GeomAbs_Plane) {
    shape.kind = Kind::plane;
    shape.point = coordinates(surface.Plane().Location());
    shape.axis = coordinates(surface.Plane().Axis().Direction());
  } else if (surface.GetType() == GeomAbs_Cylinder) {
    shape.kind = Kind::cylinder;
    shape.point = coordinates(surface.Cylinder().Location());
    shape.axis = coordinates(surface.Cylinder().Axis().Direction());
    shape.radius = surface.Cylinder().Radius();
  } else if (surface.GetType() == GeomAbs_Sphere) {
    shape.kind = Kind::sphere;
    shape.point = coordinates(surface.Sphere().Location());
    shape.radius = surface.Sphere().Radius();
  } else if (surface.GetType() == GeomAbs_Cone) {
    shape.kind = Kind::cone;
    shape.point = coordinates(surface.Cone().Apex());
    shape.axis = coordinates(surface.Cone().Axis().Direction());
    shape.half_angle = surface.Cone().SemiAngle();
    if (shape.half_angle < 0) shape.axis = -1 * shape.axis, shape.half_angle = -shape.half_angle;
  }
  return shape;
}

CadShape edge_shape(const Model& model, int e) {
  const BRepAdaptor_Curve curve(model.edge(e));
  CadShape shape;
  shape.kind = Kind::other_edge;
  shape.type = "curve";
  shape.numbers = {e + 1};
  shape.size = GCPnts_AbscissaPoint::Length(curve);
  shape.closed = curve.Value(curve.FirstParameter()).Distance(curve.Value(curve.LastParameter())) < same * model.diagonal;
  if (curve.GetType() == GeomAbs_Line) {
    shape.kind = Kind::line;
    shape.type = "line";
    shape.point = coordinates(curve.Value(curve.FirstParameter()));
    shape.axis = coordinates(curve.Line().Direction());
  } else if (curve.GetType() == GeomAbs_Circle) {
    shape.kind = Kind::circle;
    shape.type = shape.closed ? "circle" : "arc";
    shape.point = coordinates(curve.Circle().Location());
    shape.axis = coordinates(curve.Circle().Axis().Direction());
    shape.radius = curve.Circle().Radius();
  }
  return shape;
}

/// Whether two faces lie on one surface of an elementary type.
bool same_surface(const CadShape& a, const CadShape& b, double diagonal) {
  if (a.kind != b.kind || a.kind == Kind::other_face) return false;
  const double limit = same * diagonal;
  if (a.kind != Kind::sphere && norm(cross(a.axis, b.axis)) > same) return false;
  if (std::abs(a.radius - b.radius) > limit || std::abs(a.half_angle - b.half_angle) > same) return false;
  if (a.kind == Kind::plane) return distance_from(a, b.point) <= limit;
  if (a.kind == Kind::cylinder) return from_axis(a, b.point) <= limit;
  return distance(a.point, b.point) <= limit && (a.kind != Kind::cone || dot(a.axis, b.axis) > 0);
}

class Finder {
 public:
  Finder(const Mesh& mesh, Model&& model, const std::vector<std::string>& names, double tolerance, const RunContext& context)
      : mesh_(mesh), model_(std::move(model)), names_(names), tolerance_(tolerance), context_(context) {}

  CadRegions find() {
    find_faces();
    find_edges();
    place_nodes();
    find_mirrors();
    regions_.diagonal = model_.diagonal;
    for (const CadShape& face : regions_.faces) regions_.area += face.size;
    return std::move(regions_);
  }

 private:
  /// Faces on one surface that share an edge become one.
  void find_faces() {
    std::vector<CadShape> single;
    std::vector<std::set<int>> users(model_.edge_count());
    for (int f = 0; f < model_.face_count(); ++f) {
      single.push_back(face_shape(model_, f));
      for (const Coedge& use : model_.coedges[f]) {
        if (!BRep_Tool::Degenerated(model_.edge(use.edge))) users[use.edge].insert(f);
      }
    }
    std::vector<int> first(single.size());
    std::iota(first.begin(), first.end(), 0);
    const auto root = [&](int f) {
      while (first[f] != f) f = first[f];
      return f;
    };
    for (const std::set<int>& faces : users) {
      for (const int f : faces) {
        const int a = root(*faces.begin()), b = root(f);
        if (a != b && same_surface(single[*faces.begin()], single[f], model_.diagonal)) first[std::max(a, b)] = std::min(a, b);
      }
    }
    shape_of_.assign(single.size(), -1);
    for (int f = 0; f < model_.face_count(); ++f) {
      const int r = root(f);
      if (r == f) {
        shape_of_[f] = static_cast<int>(regions_.faces.size());
        regions_.faces.push_back(single[f]);
      } else {
        shape_of_[f] = shape_of_[r];
        regions_.faces[shape_of_[f]].numbers.push_back(f + 1);
        regions_.faces[shape_of_[f]].size += single[f].size;
      }
    }
    std::map<std::string, int> uses;
    for (const std::string& name : names_) ++uses[name];
    for (CadShape& shape : regions_.faces) {
      const std::string& own = names_[shape.numbers.front() - 1];
      const std::string type = shape.kind == Kind::other_face ? "face" : shape.type;
      const bool good = shape.numbers.size() == 1 && !own.empty() && own != "NONE" && uses[own] == 1;
      shape.name = good ? own : type + "_" + std::to_string(shape.numbers.front());
    }
  }

  void find_edges() {
    edge_of_.assign(model_.edge_count(), -1);
    std::vector<std::set<int>> on(model_.edge_count());
    for (int f = 0; f < model_.face_count(); ++f) {
      for (const Coedge& use : model_.coedges[f]) on[use.edge].insert(shape_of_[f]);
    }
    std::vector<int> uses(model_.edge_count(), 0);
    for (const auto& coedges : model_.coedges) {
      for (const Coedge& use : coedges) ++uses[use.edge];
    }
    for (int e = 0; e < model_.edge_count(); ++e) {
      if (BRep_Tool::Degenerated(model_.edge(e)) || (on[e].size() == 1 && uses[e] > 1)) continue;  // seams
      CadShape shape = edge_shape(model_, e);
      shape.name = shape.type + "_" + std::to_string(e + 1);
      shape.lies_on.assign(on[e].begin(), on[e].end());
      edge_of_[e] = static_cast<int>(regions_.edges.size());
      regions_.edges.push_back(std::move(shape));
    }
  }

  void place_nodes() {
    const std::vector<PointId> nodes = select(Region{Region::Boundary{}}, mesh_, "the boundary of the mesh");
    if (nodes.empty()) {
      throw Error(ErrorCode::invalid_argument, "the mesh has no faces and no cells: nothing lies on the CAD model");
    }
    const std::vector<Owner> owners = owners_of(model_, mesh_, nodes, tolerance_, context_);
    std::vector<std::set<int>> edges_at(model_.vertex_count()), faces_at(model_.edge_count());
    for (int e = 0; e < model_.edge_count(); ++e) {
      for (TopoDS_Iterator end(model_.edge(e)); end.More(); end.Next()) {
        const int v = model_.vertices.FindIndex(end.Value()) - 1;
        if (v >= 0) edges_at[v].insert(e);
      }
    }
    for (int f = 0; f < model_.face_count(); ++f) {
      for (const Coedge& use : model_.coedges[f]) faces_at[use.edge].insert(f);
    }
    std::vector<std::set<PointId>> on_face(regions_.faces.size()), on_edge(regions_.edges.size());
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      regions_.farthest = std::max(regions_.farthest, owners[i].distance);
      std::set<int> edges;
      if (owners[i].kind == Owner::Kind::vertex) edges = edges_at[owners[i].index];
      if (owners[i].kind == Owner::Kind::edge) edges = {owners[i].index};
      if (owners[i].kind == Owner::Kind::face) on_face[shape_of_[owners[i].index]].insert(nodes[i]);
      for (const int e : edges) {
        if (edge_of_[e] >= 0) on_edge[edge_of_[e]].insert(nodes[i]);
        for (const int f : faces_at[e]) on_face[shape_of_[f]].insert(nodes[i]);
      }
    }
    regions_.nodes = nodes.size();
    for (std::size_t k = 0; k < on_face.size(); ++k) take(on_face[k], regions_.faces[k]);
    for (std::size_t k = 0; k < on_edge.size(); ++k) take(on_edge[k], regions_.edges[k]);
  }

  void take(const std::set<PointId>& points, CadShape& shape) const {
    shape.points.assign(points.begin(), points.end());
    double squares = 0;
    for (const PointId p : points) {
      const double d = distance_from(shape, mesh_.points[p]);
      shape.largest = std::max(shape.largest, d);
      squares += d * d;
    }
    if (!points.empty()) shape.rms = std::sqrt(squares / static_cast<double>(points.size()));
  }

  /// Points of the model that a mirror image has to meet: the vertices, and a few of each face.
  std::vector<gp_Pnt> probes() const {
    std::vector<gp_Pnt> probes;
    for (int v = 0; v < model_.vertex_count(); ++v) probes.push_back(BRep_Tool::Pnt(model_.vertex(v)));
    for (int f = 0; f < model_.face_count(); ++f) {
      const TopoDS_Face face = model_.face(f);
      const BRepTopAdaptor_FClass2d region(face, 1e-9);
      double u0 = 0, u1 = 0, v0 = 0, v1 = 0;
      BRepTools::UVBounds(face, u0, u1, v0, v1);
      constexpr std::array<double, 4> shares{0.137, 0.411, 0.653, 0.889};
      for (const double a : shares) {
        for (const double b : shares) {
          const double u = u0 + a * (u1 - u0), v = v0 + b * (v1 - v0);
          if (region.Perform(gp_Pnt2d(u, v)) == TopAbs_IN) probes.push_back(BRep_Tool::Surface(face)->Value(u, v));
        }
      }
    }
    return probes;
  }

  void find_mirrors() {
    GProp_GProps properties;
    BRepGProp::SurfaceProperties(model_.shape, properties);
    const gp_Pnt centroid = properties.CentreOfMass();
    Bnd_Box box;
    BRepBndLib::AddOptimal(model_.shape, box, false, false);
    const gp_Pnt middle((box.CornerMin().XYZ() + box.CornerMax().XYZ()) / 2);
    const GProp_PrincipalProps principal = properties.PrincipalProperties();
    std::vector<gp_Dir> normals{gp::DX(), gp::DY(), gp::DZ()};
    for (const gp_Vec& axis : {principal.FirstAxisOfInertia(), principal.SecondAxisOfInertia(), principal.ThirdAxisOfInertia()}) {
      if (axis.Magnitude() < 0.5) continue;
      const gp_Dir normal(axis);
      const auto known = [&](const gp_Dir& other) { return normal.IsParallel(other, 1e-4); };
      if (std::none_of(normals.begin(), normals.end(), known)) normals.push_back(normal);
    }
    const std::vector<gp_Pnt> points = probes();
    for (const gp_Dir& normal : normals) {
      context_.check();
      // The middle of the box is more accurate, but in the plane only if the box is the same in the mirror.
      const bool along_axis = normal.IsParallel(gp::DX(), 0) || normal.IsParallel(gp::DY(), 0) || normal.IsParallel(gp::DZ(), 0);
      const gp_Pnt& centre = along_axis ? middle : centroid;
      gp_Trsf mirror;
      mirror.SetMirror(gp_Ax2(centre, normal));
      const auto meets = [&](const gp_Pnt& p) { return on_a_face(p.Transformed(mirror)); };
      if (std::all_of(points.begin(), points.end(), meets)) {
        regions_.mirrors.push_back({coordinates(centre), coordinates(normal)});
      }
    }
  }

  bool on_a_face(const gp_Pnt& p) const {
    const TopoDS_Vertex vertex = BRepBuilderAPI_MakeVertex(p).Vertex();
    for (int f = 0; f < model_.face_count(); ++f) {
      const BRepExtrema_DistShapeShape found(vertex, model_.face(f));
      if (found.IsDone() && found.Value() <= symmetric * model_.diagonal) return true;
    }
    return false;
  }

  const Mesh& mesh_;
  const Model model_;
  const std::vector<std::string> names_;
  const double tolerance_;
  const RunContext& context_;
  CadRegions regions_;
  std::vector<int> shape_of_, edge_of_;  ///< of faces and edges of the model; -1: none
};

}  // namespace

CadRegions cad_regions(const Mesh& mesh, const RegionsRequest& request, const RunContext& context) {
  if (!(request.scale > 0 && request.scale < 1e12)) throw Error(ErrorCode::invalid_argument, "scale: must be over 0");
  if (!(request.tolerance >= 0 && request.tolerance < 1e300)) {
    throw Error(ErrorCode::invalid_argument, "tolerance: must be 0 or more");
  }
  mesh.validate();
  try {
    Document document = read_document(request.model);
    gp_Trsf scaling;
    scaling.SetScale(gp_Pnt(0, 0, 0), request.scale);
    std::vector<std::string> names;
    for (Part& part : document.parts) {
      if (request.scale != 1) part.shape = BRepBuilderAPI_Transform(part.shape, scaling, true).Shape();
      const int count = make_model(part.shape, request.model.string()).face_count();
      const std::size_t first = names.size();
      names.resize(first + static_cast<std::size_t>(count));
      for (const FaceMark& mark : part.faces) names[first + static_cast<std::size_t>(mark.face)] = mark.name;
    }
    Model model = model_of(document, request.model.string());
    names.resize(static_cast<std::size_t>(model.face_count()));
    const double tolerance = request.tolerance > 0 ? request.tolerance : 1e-4 * model.diagonal;
    CadRegions regions = Finder(mesh, std::move(model), names, tolerance, context).find();
    regions.notes = document.notes;
    return regions;
  } catch (const Standard_Failure& failure) {
    throw Error(ErrorCode::internal, std::string("OpenCASCADE failed: ") + failure.GetMessageString());
  }
}

}  // namespace deform::cad
