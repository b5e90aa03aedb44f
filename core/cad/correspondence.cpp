// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/correspondence.h"

#include <BRepAdaptor_Curve.hxx>
#include <BRepAdaptor_Surface.hxx>
#include <BRepGProp.hxx>
#include <BRep_Tool.hxx>
#include <GProp_GProps.hxx>
#include <TopExp.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <algorithm>
#include <limits>
#include <map>
#include <numeric>
#include <optional>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"

namespace deform::cad {

namespace {

Vec3 vec(const gp_Pnt& p) { return {p.X(), p.Y(), p.Z()}; }

/// Solids, wires, faces, edges and vertices of a model as one graph.
struct Graph {
  std::vector<std::vector<int>> neighbours;
  std::vector<std::vector<int>> kinds;  ///< what an entity is, beside its neighbours
  std::vector<Vec3> places;             ///< of faces, edges and vertices; after normalization
  std::vector<Vec3> normals;            ///< of planes, else 0
  int first_face = 0, first_edge = 0, first_vertex = 0, first_other = 0;

  int size() const { return static_cast<int>(kinds.size()); }
  void link(int a, int b) {
    neighbours[a].push_back(b);
    neighbours[b].push_back(a);
  }
};

Vec3 place_of_edge(const TopoDS_Edge& edge) {
  if (BRep_Tool::Degenerated(edge)) return vec(BRep_Tool::Pnt(TopExp::FirstVertex(edge)));
  const BRepAdaptor_Curve curve(edge);
  if (curve.Value(curve.FirstParameter()).Distance(curve.Value(curve.LastParameter())) > 1e-7) {
    return vec(curve.Value(0.5 * (curve.FirstParameter() + curve.LastParameter())));
  }
  Vec3 sum{};  // a closed curve: its middle, wherever it starts
  constexpr int samples = 16;
  for (int i = 0; i < samples; ++i) {
    const double t = curve.FirstParameter() + i * (curve.LastParameter() - curve.FirstParameter()) / samples;
    sum = sum + vec(curve.Value(t));
  }
  return sum / samples;
}

/// Centre at the mean of the faces' centres, and their root mean square distance from it becomes 1.
void normalize(Graph& graph, int faces, double diagonal) {
  Vec3 centre{};
  for (int f = 0; f < faces; ++f) centre = centre + graph.places[f] / faces;
  double square = 0;
  for (int f = 0; f < faces; ++f) square += squared_distance(graph.places[f], centre) / faces;
  const double size = square > 1e-12 * diagonal * diagonal ? std::sqrt(square) : diagonal;
  for (Vec3& place : graph.places) place = (place - centre) / size;
}

Graph graph_of(const Model& model) {
  Graph graph;
  graph.first_edge = model.face_count();
  graph.first_vertex = graph.first_edge + model.edge_count();
  graph.first_other = graph.first_vertex + model.vertex_count();
  const int first_solid = graph.first_other + model.wires.Extent();
  const int size = first_solid + model.solids.Extent();
  graph.neighbours.resize(size);
  graph.kinds.resize(size);
  graph.places.resize(graph.first_other);
  graph.normals.resize(size);
  for (int f = 0; f < model.face_count(); ++f) {
    const BRepAdaptor_Surface surface(model.face(f));
    graph.kinds[f] = {0, static_cast<int>(surface.GetType())};
    GProp_GProps properties;
    BRepGProp::SurfaceProperties(model.face(f), properties);
    graph.places[f] = vec(properties.CentreOfMass());
    if (surface.GetType() == GeomAbs_Plane) {
      gp_Dir normal = surface.Plane().Axis().Direction();
      if (!surface.Plane().Direct()) normal.Reverse();
      graph.normals[f] = static_cast<double>(model.face_sense(f)) * Vec3{normal.X(), normal.Y(), normal.Z()};
    }
    for (TopExp_Explorer wire(model.face(f), TopAbs_WIRE); wire.More(); wire.Next()) {
      graph.link(f, graph.first_other + model.wires.FindIndex(wire.Current()) - 1);
    }
  }
  for (int w = 0; w < model.wires.Extent(); ++w) {
    graph.kinds[graph.first_other + w] = {3};
    for (TopExp_Explorer edge(model.wires(w + 1), TopAbs_EDGE); edge.More(); edge.Next()) {
      graph.link(graph.first_other + w, graph.first_edge + model.edges.FindIndex(edge.Current()) - 1);
    }
  }
  for (int e = 0; e < model.edge_count(); ++e) {
    const TopoDS_Edge edge = model.edge(e);
    graph.kinds[graph.first_edge + e] = {1, BRep_Tool::Degenerated(edge) ? 1 : 0};
    graph.places[graph.first_edge + e] = place_of_edge(edge);
    for (TopExp_Explorer vertex(edge, TopAbs_VERTEX); vertex.More(); vertex.Next()) {
      graph.link(graph.first_edge + e, graph.first_vertex + model.vertices.FindIndex(vertex.Current()) - 1);
    }
  }
  for (int v = 0; v < model.vertex_count(); ++v) {
    graph.kinds[graph.first_vertex + v] = {2};
    graph.places[graph.first_vertex + v] = vec(BRep_Tool::Pnt(model.vertex(v)));
  }
  for (int s = 0; s < model.solids.Extent(); ++s) {
    graph.kinds[first_solid + s] = {4};
    for (TopExp_Explorer face(model.solids(s + 1), TopAbs_FACE); face.More(); face.Next()) {
      graph.link(first_solid + s, model.faces.FindIndex(face.Current()) - 1);
    }
  }
  normalize(graph, model.face_count(), model.diagonal);
  return graph;
}

/// Colours of the entities of both models; equal colours may be partners.
struct Colours {
  std::vector<int> before, after;
};

class Matching {
 public:
  Matching(const Model& before, const Model& after, std::span<const ForcedPair> pairs)
      : models_{&before, &after}, before_(graph_of(before)), after_(graph_of(after)) {
    for (const ForcedPair& pair : pairs) force(pair);
  }

  Correspondence solve() {
    Colours start = first_colours();
    if (!refine(start)) refuse_structure(start);
    double rival = std::numeric_limits<double>::infinity();
    std::string question;
    Colours best = choose(start, rival, question);
    const double cost = cost_of(best);
    if (rival < 1.5 * cost + 1e-9) {
      throw Error(ErrorCode::failed_precondition, "the correspondence of the CAD models is ambiguous: " + question +
                                                      ", and both fit about as well; name pairs in a file with --map");
    }
    return with_senses(partners(best));
  }

 private:
  void force(const ForcedPair& pair) {
    const int starts[] = {0, 1, 2};
    const auto kind = static_cast<int>(pair.kind);
    const char* names[] = {"face", "edge", "vertex"};
    const auto check = [&](int number, const Model& model) {
      const int counts[] = {model.face_count(), model.edge_count(), model.vertex_count()};
      if (number < 1 || number > counts[starts[kind]]) {
        throw Error(ErrorCode::invalid_argument, "pairs: " + std::string(names[kind]) + " " + std::to_string(number) +
                                                     " is out of range, " + model.name + " has " + std::to_string(counts[kind]));
      }
    };
    check(pair.before, *models_[0]);
    check(pair.after, *models_[1]);
    const auto index = [&](const Graph& graph, int number) {
      return (kind == 0 ? 0 : kind == 1 ? graph.first_edge : graph.first_vertex) + number - 1;
    };
    const std::vector<int> mark{100, static_cast<int>(forced_++)};
    before_.kinds[index(before_, pair.before)] = mark;
    after_.kinds[index(after_, pair.after)] = mark;
  }

  Colours first_colours() const {
    std::map<std::vector<int>, int> ids;
    Colours colours;
    for (const auto& kind : before_.kinds)
      colours.before.push_back(ids.try_emplace(kind, static_cast<int>(ids.size())).first->second);
    for (const auto& kind : after_.kinds)
      colours.after.push_back(ids.try_emplace(kind, static_cast<int>(ids.size())).first->second);
    return colours;
  }

  static bool balanced(const Colours& colours) {
    auto a = colours.before, b = colours.after;
    std::sort(a.begin(), a.end());
    std::sort(b.begin(), b.end());
    return a == b;
  }

  /// Until neighbours tell nothing more apart. False when the two models differ.
  bool refine(Colours& colours) const {
    std::size_t classes = 0;
    while (true) {
      if (!balanced(colours)) return false;
      std::map<std::vector<int>, int> ids;
      const auto next = [&](const Graph& graph, const std::vector<int>& old) {
        std::vector<int> result(old.size());
        for (int i = 0; i < graph.size(); ++i) {
          std::vector<int> key;
          for (const int j : graph.neighbours[i]) key.push_back(old[j]);
          std::sort(key.begin(), key.end());
          key.push_back(old[i]);
          result[i] = ids.try_emplace(std::move(key), static_cast<int>(ids.size())).first->second;
        }
        return result;
      };
      Colours finer;
      finer.before = next(before_, colours.before);
      finer.after = next(after_, colours.after);
      colours = std::move(finer);
      if (ids.size() == classes) return balanced(colours);
      classes = ids.size();
    }
  }

  struct Branch {
    int of = -1;                  ///< of the old model
    std::vector<int> candidates;  ///< of the new one, nearest first
  };

  /// The smallest class of faces with more than one member, else of edges, vertices, others.
  Branch branch(const Colours& colours) const {
    std::map<int, int> sizes;
    for (const int colour : colours.before) ++sizes[colour];
    const int ends[] = {before_.first_edge, before_.first_vertex, before_.first_other, before_.size()};
    int begin = 0;
    for (const int end : ends) {
      Branch found;
      for (int i = begin; i < end; ++i) {
        const int size = sizes[colours.before[i]];
        if (size > 1 && (found.of < 0 || size < sizes[colours.before[found.of]])) found.of = i;
      }
      begin = end;
      if (found.of < 0) continue;
      for (int j = 0; j < after_.size(); ++j) {
        if (colours.after[j] == colours.before[found.of]) found.candidates.push_back(j);
      }
      std::stable_sort(found.candidates.begin(), found.candidates.end(),
                       [&](int a, int b) { return pair_cost(found.of, a) < pair_cost(found.of, b); });
      return found;
    }
    return {};
  }

  double pair_cost(int a, int b) const {
    if (a >= before_.first_other) return 0;
    return squared_distance(before_.places[a], after_.places[b]) + 0.1 * squared_distance(before_.normals[a], after_.normals[b]);
  }

  double cost_of(const Colours& colours) const {
    const std::vector<int> pairs = partners(colours);
    double cost = 0;
    for (std::size_t i = 0; i < pairs.size(); ++i) cost += pair_cost(static_cast<int>(i), pairs[i]);
    return cost;
  }

  static Colours fixed(Colours colours, int a, int b) {
    const int fresh = 1 + std::max(*std::max_element(colours.before.begin(), colours.before.end()),
                                   *std::max_element(colours.after.begin(), colours.after.end()));
    colours.before[a] = fresh;
    colours.after[b] = fresh;
    return colours;
  }

  /// Nearest candidates first, until all are told apart. Nothing when there is no way.
  std::optional<Colours> complete(Colours colours) {
    if (++tries_ > 20000)
      throw Error(ErrorCode::failed_precondition, "the CAD models have too many symmetries; name pairs in a file with --map");
    if (!refine(colours)) return std::nullopt;
    const Branch at = branch(colours);
    if (at.of < 0) return colours;
    for (const int b : at.candidates) {
      if (auto done = complete(fixed(colours, at.of, b))) return done;
    }
    return std::nullopt;
  }

  /// The least cost; `rival` becomes the least cost of another way, `question` says where it turns off.
  Colours choose(Colours colours, double& rival, std::string& question) {
    while (true) {
      const Branch at = branch(colours);
      if (at.of < 0) return colours;
      struct Way {
        int candidate;
        double cost;
      };
      std::vector<Way> ways;
      for (const int b : at.candidates) {
        if (const auto done = complete(fixed(colours, at.of, b))) ways.push_back({b, cost_of(*done)});
      }
      if (ways.empty()) refuse_structure(colours);
      std::stable_sort(ways.begin(), ways.end(), [](const Way& a, const Way& b) { return a.cost < b.cost; });
      if (ways.size() > 1 && ways[1].cost < rival) {
        rival = ways[1].cost;
        question = name(*models_[0], before_, at.of) + " of the old model may be " +
                   name(*models_[1], after_, ways[0].candidate) + " or " + name(*models_[1], after_, ways[1].candidate) +
                   " of the new one";
      }
      colours = fixed(std::move(colours), at.of, ways[0].candidate);
      refine(colours);
    }
  }

  static std::string name(const Model& model, const Graph& graph, int i) {
    if (i < graph.first_edge) return model.face_name(i);
    if (i < graph.first_vertex) return "edge " + std::to_string(i - graph.first_edge + 1);
    if (i < graph.first_other) return "vertex " + std::to_string(i - graph.first_vertex + 1);
    return "a loop or solid";
  }

  /// Names what has no partner: the face that differs from the nearest one of the new model without a partner.
  [[noreturn]] void refuse_structure(const Colours& colours) const {
    const Model &old = *models_[0], &now = *models_[1];
    std::map<int, int> surplus;
    for (const int c : colours.before) ++surplus[c];
    for (const int c : colours.after) --surplus[c];
    std::string text = "the CAD models differ in structure: " + counts(old) + " became " + counts(now);
    const int first = first_with(colours.before, before_.first_edge, surplus, 1);
    const int lone = first_with(colours.after, after_.first_edge, surplus, -1);
    if (first >= 0) {
      int near = -1;
      for (int f = 0; f < after_.first_edge; ++f) {
        if (surplus[colours.after[f]] >= 0) continue;
        if (near < 0 || pair_cost(first, f) < pair_cost(first, near)) near = f;
      }
      text += "; " + old.face_name(first) + " has " + loops(before_, first);
      text += near < 0 ? " and no partner in the new model"
                       : ", the nearest one without a partner in the new model, " + now.face_name(near) + ", has " +
                             loops(after_, near);
    } else if (lone >= 0) {
      text += "; " + now.face_name(lone) + " of the new model has " + loops(after_, lone) + " and no partner in the old one";
    }
    throw Error(ErrorCode::failed_precondition, text);
  }

  static int first_with(const std::vector<int>& colours, int faces, std::map<int, int>& surplus, int sign) {
    for (int f = 0; f < faces; ++f) {
      if (sign * surplus[colours[f]] > 0) return f;
    }
    return -1;
  }

  static std::string counts(const Model& model) {
    return std::to_string(model.face_count()) + " faces, " + std::to_string(model.edge_count()) + " edges and " +
           std::to_string(model.vertex_count()) + " vertices";
  }

  static std::string loops(const Graph& graph, int face) {
    std::size_t loops = 0, edges = 0;
    for (const int w : graph.neighbours[face]) {
      if (graph.kinds[w] != std::vector<int>{3}) continue;
      ++loops;
      edges += graph.neighbours[w].size() - 1;
    }
    return std::to_string(loops) + (loops == 1 ? " loop" : " loops") + " of " + std::to_string(edges) +
           (edges == 1 ? " edge" : " edges") + " in all";
  }

  /// New entity of each old one.
  std::vector<int> partners(const Colours& colours) const {
    std::map<int, int> of;
    for (int j = 0; j < after_.size(); ++j) of[colours.after[j]] = j;
    std::vector<int> pairs;
    for (const int colour : colours.before) pairs.push_back(of.at(colour));
    return pairs;
  }

  Correspondence with_senses(const std::vector<int>& pairs) const {
    Correspondence found;
    for (int i = 0; i < before_.first_edge; ++i) found.faces.push_back(pairs[i]);
    for (int i = before_.first_edge; i < before_.first_vertex; ++i) found.edges.push_back(pairs[i] - after_.first_edge);
    for (int i = before_.first_vertex; i < before_.first_other; ++i) found.vertices.push_back(pairs[i] - after_.first_vertex);
    for (int e = 0; e < static_cast<int>(found.edges.size()); ++e) found.edge_senses.push_back(open_edge_sense(found, e));
    for (int f = 0; f < static_cast<int>(found.faces.size()); ++f) found.face_senses.push_back(face_sense(found, f));
    for (int e = 0; e < static_cast<int>(found.edges.size()); ++e) {
      if (found.edge_senses[e] == 0) found.edge_senses[e] = closed_edge_sense(found, e);
    }
    return found;
  }

  int open_edge_sense(const Correspondence& found, int e) const {
    const Model &old = *models_[0], &now = *models_[1];
    const auto end = [](const Model& model, const TopoDS_Vertex& v) { return v.IsNull() ? -1 : model.vertices.FindIndex(v) - 1; };
    const TopoDS_Edge a = old.edge(e), b = now.edge(found.edges[e]);
    const int a0 = end(old, TopExp::FirstVertex(a)), a1 = end(old, TopExp::LastVertex(a));
    const int b0 = end(now, TopExp::FirstVertex(b));
    if (a0 < 0 || a1 < 0 || a0 == a1) return 0;
    return found.vertices[a0] == b0 ? 1 : -1;
  }

  /// Sense of a use of an edge by a face; 0 when it has none, or both (a seam).
  static int use_of(const Model& model, int face, int edge) {
    int sense = 0;
    for (const Coedge& use : model.coedges[face]) {
      if (use.edge == edge) sense += use.sense;
    }
    return sense;
  }

  int face_sense(const Correspondence& found, int f) const {
    const Model &old = *models_[0], &now = *models_[1];
    int sense = 0;
    for (const Coedge& use : old.coedges[f]) {
      const int vote =
          use_of(old, f, use.edge) * use_of(now, found.faces[f], found.edges[use.edge]) * found.edge_senses[use.edge];
      if (vote == 0) continue;
      if (sense != 0 && sense != vote) refuse_turn(f, found.faces[f]);
      sense = vote;
    }
    const bool solid = old.solids.Extent() > 0 && now.solids.Extent() > 0;
    const int outwards = old.face_sense(f) * now.face_sense(found.faces[f]);
    if (solid && sense != 0 && sense != outwards) refuse_turn(f, found.faces[f]);
    return sense != 0 ? sense : outwards;
  }

  [[noreturn]] void refuse_turn(int f, int partner) const {
    throw Error(ErrorCode::failed_precondition,
                models_[0]->face_name(f) + " of the old model and " + models_[1]->face_name(partner) +
                    " of the new one are partners by structure, but their loops run in opposite "
                    "directions: one model is a mirror image, or inside out; name pairs with --map");
  }

  int closed_edge_sense(const Correspondence& found, int e) const {
    const Model &old = *models_[0], &now = *models_[1];
    for (int f = 0; f < old.face_count(); ++f) {
      const int a = use_of(old, f, e), b = use_of(now, found.faces[f], found.edges[e]);
      if (a * b != 0) return (a * b > 0 ? 1 : -1) * found.face_senses[f];
    }
    const TopoDS_Edge edge = old.edge(e), partner = now.edge(found.edges[e]);
    if (BRep_Tool::Degenerated(edge) || BRep_Tool::Degenerated(partner)) return 1;
    const BRepAdaptor_Curve a(edge), b(partner);  // a closed seam: the way that moves its points less
    double along = 0, against = 0;
    for (int i = 1; i < 8; ++i) {
      const auto at = [&](const BRepAdaptor_Curve& curve, double s) {
        return vec(curve.Value(curve.FirstParameter() + s * (curve.LastParameter() - curve.FirstParameter())));
      };
      along += squared_distance(at(a, i / 8.0) - at(a, 0), at(b, i / 8.0) - at(b, 0));
      against += squared_distance(at(a, i / 8.0) - at(a, 0), at(b, 1 - i / 8.0) - at(b, 0));
    }
    return against < along ? -1 : 1;
  }

  const Model* models_[2];
  Graph before_, after_;
  std::size_t forced_ = 0, tries_ = 0;
};

}  // namespace

Correspondence match_models(const Model& before, const Model& after, std::span<const ForcedPair> pairs) {
  return Matching(before, after, pairs).solve();
}

}  // namespace deform::cad
