// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/model_graph.h"

#include <BRepAdaptor_Curve.hxx>
#include <BRepAdaptor_Surface.hxx>
#include <BRepGProp.hxx>
#include <BRepTools.hxx>
#include <BRep_Tool.hxx>
#include <Eigen/Geometry>
#include <GProp_GProps.hxx>
#include <TopExp.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Wire.hxx>
#include <cmath>

#include "core/base/vectors.h"
#include "core/cad/coordinates.h"
#include "core/numerics/dense/decompositions.h"

namespace deform::cad {

namespace {

constexpr double normal_weight = 0.1;

Eigen::Vector3d column(const Vec3& v) { return {v[0], v[1], v[2]}; }

Vec3 place_of_edge(const TopoDS_Edge& edge) {
  if (BRep_Tool::Degenerated(edge)) return coordinates(BRep_Tool::Pnt(TopExp::FirstVertex(edge)));
  const BRepAdaptor_Curve curve(edge);
  if (curve.Value(curve.FirstParameter()).Distance(curve.Value(curve.LastParameter())) > 1e-7) {
    return coordinates(curve.Value(0.5 * (curve.FirstParameter() + curve.LastParameter())));
  }
  Vec3 sum{};  // a closed curve: its middle, wherever it starts
  constexpr int samples = 16;
  for (int i = 0; i < samples; ++i) {
    const double t = curve.FirstParameter() + i * (curve.LastParameter() - curve.FirstParameter()) / samples;
    sum = sum + coordinates(curve.Value(t));
  }
  return sum / samples;
}

/// 1 where the material lies on the side of the axis or centre of an elementary surface, as of a shaft, -1 for bores, 0 for
/// others.
int bulge(const BRepAdaptor_Surface& surface, int sense) {
  gp_Pnt p;
  gp_Vec du, dv;
  surface.D1(0.5 * (surface.FirstUParameter() + surface.LastUParameter()),
             0.5 * (surface.FirstVParameter() + surface.LastVParameter()), p, du, dv);
  gp_Vec outwards;
  const auto from_axis = [&](const gp_Ax1& axis) {
    const gp_Vec from(axis.Location(), p);
    return from - gp_Vec(axis.Direction()) * from.Dot(axis.Direction());
  };
  switch (surface.GetType()) {
    case GeomAbs_Cylinder:
      outwards = from_axis(surface.Cylinder().Axis());
      break;
    case GeomAbs_Cone:
      outwards = from_axis(surface.Cone().Axis());
      break;
    case GeomAbs_Sphere:
      outwards = gp_Vec(surface.Sphere().Location(), p);
      break;
    case GeomAbs_Torus: {
      const gp_Vec radial = from_axis(surface.Torus().Axis());
      if (radial.Magnitude() < 1e-12) return 0;
      outwards = gp_Vec(surface.Torus().Location(), p) - radial * (surface.Torus().MajorRadius() / radial.Magnitude());
      break;
    }
    default:
      return 0;
  }
  const double along = du.Crossed(dv).Dot(outwards);
  return along > 0 ? sense : along < 0 ? -sense : 0;
}

std::vector<int> kind_of(const Model& model, int f, const BRepAdaptor_Surface& surface) {
  const bool solid = model.solids.Extent() > 0;  // sheets have no inside
  return {0, static_cast<int>(surface.GetType()), solid ? bulge(surface, model.face_sense(f)) : 0};
}

void measure(ModelGraph& graph, int faces, double diagonal) {
  for (int f = 0; f < faces; ++f) graph.centre = graph.centre + graph.places[f] / faces;
  double square = 0;
  for (int f = 0; f < faces; ++f) square += squared_distance(graph.places[f], graph.centre) / faces;
  graph.size = square > 1e-12 * diagonal * diagonal ? std::sqrt(square) : diagonal;
}

class GraphMaker {
 public:
  GraphMaker(const Model& model, FaceTypes types) : model_(model), types_(types) {
    graph_.first_edge = model.face_count();
    graph_.first_vertex = graph_.first_edge + model.edge_count();
    graph_.first_wire = graph_.first_vertex + model.vertex_count();
    graph_.first_solid = graph_.first_wire + model.wires.Extent();
    const int size = graph_.first_solid + model.solids.Extent();
    graph_.neighbours.resize(size);
    graph_.kinds.resize(size);
    graph_.places.resize(graph_.first_wire);
    graph_.normals.resize(graph_.first_edge);
    graph_.ends.resize(model.edge_count(), {-1, -1});
  }

  ModelGraph make() {
    for (int f = 0; f < model_.face_count(); ++f) add_face(f);
    for (int w = 0; w < model_.wires.Extent(); ++w) {
      for (TopExp_Explorer edge(model_.wires(w + 1), TopAbs_EDGE); edge.More(); edge.Next()) {
        link(graph_.first_wire + w, graph_.first_edge + model_.edges.FindIndex(edge.Current()) - 1);
      }
    }
    for (int e = 0; e < model_.edge_count(); ++e) add_edge(e);
    for (int v = 0; v < model_.vertex_count(); ++v) {
      graph_.kinds[graph_.first_vertex + v] = {2};
      graph_.places[graph_.first_vertex + v] = coordinates(BRep_Tool::Pnt(model_.vertex(v)));
    }
    for (int s = 0; s < model_.solids.Extent(); ++s) {
      graph_.kinds[graph_.first_solid + s] = {4};
      for (TopExp_Explorer face(model_.solids(s + 1), TopAbs_FACE); face.More(); face.Next()) {
        link(graph_.first_solid + s, model_.faces.FindIndex(face.Current()) - 1);
      }
    }
    measure(graph_, model_.face_count(), model_.diagonal);
    return std::move(graph_);
  }

 private:
  void link(int a, int b) {
    graph_.neighbours[a].push_back(b);
    graph_.neighbours[b].push_back(a);
  }

  void add_face(int f) {
    const BRepAdaptor_Surface surface(model_.face(f));
    graph_.kinds[f] = types_ == FaceTypes::known ? kind_of(model_, f, surface) : std::vector<int>{0};
    GProp_GProps properties;
    BRepGProp::SurfaceProperties(model_.face(f), properties);
    graph_.places[f] = coordinates(properties.CentreOfMass());
    if (surface.GetType() == GeomAbs_Plane) {
      gp_Dir normal = surface.Plane().Axis().Direction();
      if (!surface.Plane().Direct()) normal.Reverse();
      graph_.normals[f] = static_cast<double>(model_.face_sense(f)) * Vec3{normal.X(), normal.Y(), normal.Z()};
    }
    const TopoDS_Wire outer =
        surface.GetType() == GeomAbs_Plane && types_ == FaceTypes::known ? BRepTools::OuterWire(model_.face(f)) : TopoDS_Wire();
    for (TopExp_Explorer wire(model_.face(f), TopAbs_WIRE); wire.More(); wire.Next()) {
      const int node = graph_.first_wire + model_.wires.FindIndex(wire.Current()) - 1;
      link(f, node);
      graph_.kinds[node] = {3, !outer.IsNull() && outer.IsSame(wire.Current()) ? 1 : 0};
    }
  }

  void add_edge(int e) {
    const TopoDS_Edge edge = model_.edge(e);
    const int node = graph_.first_edge + e;
    graph_.kinds[node] = {1, BRep_Tool::Degenerated(edge) ? 1 : 0};
    graph_.places[node] = place_of_edge(edge);
    for (TopExp_Explorer vertex(edge, TopAbs_VERTEX); vertex.More(); vertex.Next()) link(node, vertex_node(vertex.Current()));
    graph_.ends[e] = {vertex_node(TopExp::FirstVertex(edge)), vertex_node(TopExp::LastVertex(edge))};
  }

  int vertex_node(const TopoDS_Shape& vertex) const {
    return vertex.IsNull() ? -1 : graph_.first_vertex + model_.vertices.FindIndex(vertex) - 1;
  }

  const Model& model_;
  const FaceTypes types_;
  ModelGraph graph_;
};

}  // namespace

ModelGraph graph_of(const Model& model, FaceTypes types) { return GraphMaker(model, types).make(); }

std::vector<std::vector<int>> kinds_of_faces(const Model& model) {
  std::vector<std::vector<int>> kinds;
  for (int f = 0; f < model.face_count(); ++f) kinds.push_back(kind_of(model, f, BRepAdaptor_Surface(model.face(f))));
  return kinds;
}

std::string ModelGraph::name(const Model& model, int node) const {
  if (node < first_edge) return model.face_name(node);
  if (node < first_vertex) return "edge " + std::to_string(node - first_edge + 1);
  if (node < first_wire) return "vertex " + std::to_string(node - first_vertex + 1);
  return "a loop or solid";
}

std::string ModelGraph::loops(int face) const {
  std::size_t loops = 0, edges = 0;
  for (const int w : neighbours[face]) {
    if (w >= first_solid) continue;
    ++loops;
    edges += neighbours[w].size() - 1;
  }
  return std::to_string(loops) + (loops == 1 ? " loop" : " loops") + " of " + std::to_string(edges) +
         (edges == 1 ? " edge" : " edges") + " in all";
}

std::string ModelGraph::bulge(int face) const {
  if (kinds[face].size() < 3 || kinds[face][2] == 0) return "";
  return kinds[face][2] < 0 ? " and is hollow" : " and bulges";
}

Placement best_placement(const ModelGraph& before, const ModelGraph& after, std::span<const int> pairs) {
  Placement best;
  int count = 0;
  const auto each = [&](const auto& use) {
    for (int i = 0; i < before.first_wire; ++i) {
      if (pairs[i] >= 0) use(i, pairs[i]);
    }
  };
  each([&](int, int) { ++count; });
  if (count == 0) return best;
  each([&](int i, int j) {
    best.from = best.from + before.places[i] / count;
    best.to = best.to + after.places[j] / count;
  });
  Eigen::Matrix3d cross = Eigen::Matrix3d::Zero();
  double square_before = 0, square_after = 0;
  each([&](int i, int j) {
    const Vec3 a = before.places[i] - best.from, b = after.places[j] - best.to;
    cross += column(b) * column(a).transpose() / (before.size * after.size);
    if (i < before.first_edge) cross += normal_weight * column(after.normals[j]) * column(before.normals[i]).transpose();
    square_before += dot(a, a);
    square_after += dot(b, b);
  });
  // What lies on one axis leaves the turn about it open: none.
  cross += 1e-6 * cross.norm() * Eigen::Matrix3d::Identity();
  const auto found = svd(cross);
  Eigen::Matrix3d flip = Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d straight = found.U * found.V.transpose();
  if (straight.col(0).cross(straight.col(1)).dot(straight.col(2)) < 0) flip(2, 2) = -1;
  best.turn = found.U * flip * found.V.transpose();
  if (square_before > 0 && square_after > 0) best.scale = std::sqrt(square_after / square_before);
  return best;
}

}  // namespace deform::cad
