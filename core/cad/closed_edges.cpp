// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/closed_edges.h"

#include <BRep_Tool.hxx>
#include <Eigen/Geometry>
#include <Geom_Surface.hxx>
#include <cmath>
#include <set>

#include "core/cad/edge_map.h"
#include "core/cad/model_graph.h"

namespace deform::cad {

namespace {

using Eigen::Vector3d;

constexpr int samples = 180;
constexpr double noticed = 0.02;  ///< of the way round

/// What an edge is to the faces around it.
struct Uses {
  std::vector<std::set<int>> at_vertex;  ///< edges, by vertex
  std::vector<char> seam;                ///< on periodic surfaces only
  std::vector<char> closed;              ///< starts where it ends, and is no seam
};

Uses uses_of(const Model& model, const ModelGraph& graph) {
  Uses uses;
  uses.at_vertex.resize(model.vertex_count());
  uses.seam.assign(model.edge_count(), 0);
  uses.closed.assign(model.edge_count(), 0);
  std::vector<char> other(model.edge_count(), 0);
  for (int f = 0; f < model.face_count(); ++f) {
    const auto surface = BRep_Tool::Surface(model.face(f));
    const bool periodic = surface->IsUPeriodic() || surface->IsVPeriodic();
    for (const Coedge& use : model.coedges[f]) (use.seam && periodic ? uses.seam : other)[use.edge] = 1;
  }
  for (int e = 0; e < model.edge_count(); ++e) {
    if (other[e]) uses.seam[e] = 0;
    const auto [first, last] = graph.ends[e];
    for (const int end : {first, last}) {
      if (end >= 0) uses.at_vertex[end - graph.first_vertex].insert(e);
    }
    uses.closed[e] = !uses.seam[e] && first >= 0 && first == last && !BRep_Tool::Degenerated(model.edge(e));
  }
  return uses;
}

/// The one closed edge that starts at a vertex with nothing but seams beside it; -1: none.
int only_closed(const Uses& uses, int vertex) {
  int found = -1;
  for (const int e : uses.at_vertex[vertex]) {
    if (uses.seam[e]) continue;
    if (!uses.closed[e] || found >= 0) return -1;
    found = e;
  }
  return found;
}

Vector3d point(const gp_Pnt& p) { return {p.X(), p.Y(), p.Z()}; }

/// A closed curve around its middle, with a root mean square size of 1.
struct Ring {
  std::vector<Vector3d> points;
  Vector3d normal = Vector3d::Zero();  ///< of length 1, or 0
};

Ring normalized(std::vector<Vector3d> points) {
  Ring ring;
  Vector3d centre = Vector3d::Zero();
  for (const Vector3d& p : points) centre += p / static_cast<double>(points.size());
  double square = 0;
  for (Vector3d& p : points) {
    p -= centre;
    square += p.squaredNorm() / static_cast<double>(points.size());
  }
  if (square > 0) {
    for (Vector3d& p : points) p /= std::sqrt(square);
  }
  for (std::size_t i = 0; i < points.size(); ++i) ring.normal += points[i].cross(points[(i + 1) % points.size()]);
  if (ring.normal.norm() > 1e-3) {
    ring.normal.normalize();
  } else {
    ring.normal.setZero();
  }
  ring.points = std::move(points);
  return ring;
}

/// The fraction of the partner at which the start of an edge lies best.
double best_phase(const TopoDS_Edge& edge, const TopoDS_Edge& partner, int sense, const Eigen::Matrix3d& turn) {
  const EdgeMap map(edge, partner, sense, 0);
  const BRepAdaptor_Curve from(edge), to(partner);
  std::vector<Vector3d> old, now;
  for (int i = 0; i < samples; ++i) {
    const double t = map.at(static_cast<double>(i) / samples);
    old.push_back(turn * point(from.Value(t)));
    now.push_back(point(to.Value(map(t))));
  }
  Ring a = normalized(std::move(old));
  const Ring b = normalized(std::move(now));
  if (a.normal.norm() > 0 && b.normal.norm() > 0) {
    const auto least = Eigen::Quaterniond::FromTwoVectors(a.normal, b.normal);
    for (Vector3d& p : a.points) p = least * p;
  }
  std::vector<double> costs(samples, 0.0);
  for (int shift = 0; shift < samples; ++shift) {
    for (int i = 0; i < samples; ++i) costs[shift] += (b.points[(i + shift) % samples] - a.points[i]).squaredNorm();
  }
  int best = 0;  // of equal ones, such as of a square, the least turn
  for (int shift = 1; shift < samples; ++shift) {
    const auto turns = [](int s) { return std::min(s, samples - s); };
    if (costs[shift] < costs[best] - 1e-9 || (costs[shift] < costs[best] + 1e-9 && turns(shift) < turns(best))) best = shift;
  }
  const double left = costs[(best + samples - 1) % samples], right = costs[(best + 1) % samples];
  const double bend = left - 2 * costs[best] + right;
  const double phase = (best + (bend > 0 ? 0.5 * (left - right) / bend : 0)) / samples;
  return phase - std::floor(phase);
}

}  // namespace

ClosedEdges closed_edges(const Model& before, const Model& after, const Correspondence& partners) {
  ClosedEdges found;
  found.phases.assign(before.edge_count(), 0);
  found.loose.assign(before.edge_count(), 0);
  found.start_edge.assign(before.vertex_count(), -1);
  if (partners.same_parameters) return found;
  const ModelGraph old = graph_of(before), now = graph_of(after);
  const Uses old_uses = uses_of(before, old), now_uses = uses_of(after, now);
  std::vector<int> starts(before.vertex_count(), -1), pairs(old.size_of_graph(), -1);
  for (int f = 0; f < before.face_count(); ++f) pairs[f] = partners.faces[f];
  for (int e = 0; e < before.edge_count(); ++e) {
    if (!old_uses.seam[e]) pairs[old.first_edge + e] = now.first_edge + partners.edges[e];
  }
  for (int v = 0; v < before.vertex_count(); ++v) {
    const int e = only_closed(old_uses, v), partner = only_closed(now_uses, partners.vertices[v]);
    if (e >= 0 && partner == partners.edges[e]) {
      starts[v] = e;
    } else {
      pairs[old.first_vertex + v] = now.first_vertex + partners.vertices[v];
    }
  }
  const Placement placement = best_placement(old, now, pairs);
  for (int v = 0; v < before.vertex_count(); ++v) {
    const int e = starts[v];
    if (e < 0) continue;
    const double phase = best_phase(before.edge(e), after.edge(partners.edges[e]), partners.edge_senses[e], placement.turn);
    if (std::min(phase, 1 - phase) < noticed) continue;
    found.phases[e] = phase;
    found.start_edge[v] = e;
    for (const int seam : old_uses.at_vertex[v]) {
      if (old_uses.seam[seam]) found.loose[seam] = 1;
    }
  }
  return found;
}

}  // namespace deform::cad
