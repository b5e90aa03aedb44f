// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/derivation.h"

#include <BRep_Tool.hxx>
#include <Geom2d_Curve.hxx>
#include <Geom_BSplineSurface.hxx>
#include <Geom_Curve.hxx>
#include <TopExp.hxx>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <sstream>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/cad/face_warp.h"

namespace deform::cad {

namespace {

constexpr const char* beginning = "Deformed by deform cad-apply";
constexpr double agreement = 1e-5;  ///< of D: what writing and reading may change in a sum
constexpr double sure = 1e-2;       ///< square of sizes of a face: (u, v) of partners
constexpr double rounding = 1e-6;   ///< of the size of a face: (u, v) of edges that did not move
constexpr double fitting = 1e-2;    ///< likewise: readers put edges anew on splines, as near as these are

/// The sum of the middles of the edges of each face, each times a number between 0 and 1 that follows from that of the face.
Vec3 sum_of_places(const Model& model) {
  Vec3 sum{};
  for (int f = 0; f < model.face_count(); ++f) {
    const double golden = 0.6180339887498949 * (f + 1);
    std::set<int> edges;
    for (const Coedge& use : model.coedges[f]) edges.insert(use.edge);
    for (const int e : edges) {
      double from = 0, to = 0;
      const Handle(Geom_Curve) curve = BRep_Tool::Curve(model.edge(e), from, to);
      if (curve.IsNull()) continue;
      const gp_Pnt p = curve->Value(0.5 * (from + to));
      sum = sum + (golden - std::floor(golden)) / model.scale * Vec3{p.X(), p.Y(), p.Z()};
    }
  }
  return sum;
}

std::string text_of(const Vec3& sum) { return number_digits(sum[0]) + " " + number_digits(sum[1]) + " " + number_digits(sum[2]); }

std::array<int, 3> counts_of(const Model& model) { return {model.face_count(), model.edge_count(), model.vertex_count()}; }

bool agrees(const Vec3& sum, const Model& model) {
  return distance(sum, sum_of_places(model)) <= agreement * model.diagonal / model.scale;
}

/// Whether the line of `after` names both models as they are.
bool is_derived(const Model& before, const Model& after) {
  if (after.derivation.rfind(beginning, 0) != 0) return false;
  std::istringstream text(after.derivation.substr(std::string(beginning).size()));
  text.imbue(std::locale::classic());
  std::array<int, 3> counts{};
  Vec3 from{}, to{};
  std::string word_from, word_to;
  text >> counts[0] >> counts[1] >> counts[2] >> word_from >> from[0] >> from[1] >> from[2] >> word_to >> to[0] >> to[1] >> to[2];
  if (!text || word_from != "from" || word_to != "to") return false;
  if (counts != counts_of(before) || counts != counts_of(after)) return false;
  return agrees(from, before) && agrees(to, after);
}

/// A use of an edge by a face, in (u, v) scaled to lengths of the old face.
struct PlacedUse {
  int face = 0, sense = 0;
  std::array<Vec3, 3> points{};  ///< first, middle and last as the edge runs
};

/// By edge, ascending by face and sense.
std::vector<std::vector<PlacedUse>> placed_uses(const Model& model, const Model& before) {
  std::vector<std::vector<PlacedUse>> uses(model.edge_count());
  for (int f = 0; f < model.face_count(); ++f) {
    const std::array<double, 2> lengths = parameter_lengths(before.face(f));
    for (const Coedge& use : model.coedges[f]) {
      const auto curve = curve_of(model, f, use);
      if (curve.IsNull()) continue;
      double from = 0, to = 0;
      BRep_Tool::Range(model.edge(use.edge), from, to);
      PlacedUse placed{f, use.sense, {}};
      for (int k = 0; k < 3; ++k) {
        const gp_Pnt2d p = curve->Value(from + 0.5 * k * (to - from));
        placed.points[k] = {lengths[0] * p.X(), lengths[1] * p.Y(), 0};
      }
      uses[use.edge].push_back(placed);
    }
  }
  for (auto& of_edge : uses) {
    std::stable_sort(of_edge.begin(), of_edge.end(), [](const PlacedUse& a, const PlacedUse& b) {
      return std::array{a.face, a.sense} < std::array{b.face, b.sense};
    });
  }
  return uses;
}

std::vector<int> faces_of(const std::vector<PlacedUse>& uses) {
  std::vector<int> faces;
  for (const PlacedUse& use : uses) faces.push_back(use.face);
  return faces;
}

/// Sum of squares on the face where it is least, which may be the only one with the same (u, v); `turned`: as the other one runs
/// backwards.
double misfit(const std::vector<PlacedUse>& uses, const std::vector<PlacedUse>& others, bool turned) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < uses.size(); ++i) {
    double sum = 0;
    for (std::size_t k = 0; k < 3; ++k) sum += squared_distance(uses[i].points[k], others[i].points[turned ? 2 - k : k]);
    least = std::min(least, sum);
  }
  return least;
}

/// An edge that may be the partner of another.
struct Likely {
  double miss = 0;
  int edge = 0, partner = 0;
  bool turned = false;  ///< it runs the other way
};

/// Edges of the same faces with what lies nearest in (u, v), those of least misfit first. Empty where one finds none.
std::vector<Likely> nearest_edges(const Model& before, const Model& after) {
  const auto old = placed_uses(before, before), now = placed_uses(after, before);
  std::map<std::vector<int>, std::vector<int>> by_faces;
  for (int e = 0; e < after.edge_count(); ++e) by_faces[faces_of(now[e])].push_back(e);
  std::vector<Likely> ways;
  for (int e = 0; e < before.edge_count(); ++e) {
    for (const int partner : by_faces[faces_of(old[e])]) {
      const double along = misfit(old[e], now[partner], false), against = misfit(old[e], now[partner], true);
      ways.push_back({std::min(along, against), e, partner, against < along});
    }
  }
  std::stable_sort(ways.begin(), ways.end(), [](const Likely& a, const Likely& b) { return a.miss < b.miss; });
  std::vector<Likely> chosen;
  std::set<int> edges, partners;
  for (const Likely& way : ways) {
    if (edges.count(way.edge) + partners.count(way.partner) > 0) continue;
    edges.insert(way.edge);
    partners.insert(way.partner);
    chosen.push_back(way);
  }
  if (static_cast<int>(chosen.size()) != before.edge_count()) chosen.clear();
  return chosen;
}

/// Faces by their numbers, edges by (u, v), vertices by the edges. Nothing where they contradict each other.
std::optional<std::vector<ForcedPair>> pairs_by_parameters(const Model& before, const Model& after,
                                                           const std::vector<Likely>& edges) {
  std::vector<ForcedPair> pairs;
  for (int f = 1; f <= before.face_count(); ++f) pairs.push_back({ForcedPair::Kind::face, f, f});
  std::map<int, int> vertices;
  for (const Likely& way : edges) {
    pairs.push_back({ForcedPair::Kind::edge, way.edge + 1, way.partner + 1});
    if (way.miss > sure) continue;  // structure may tell which way it runs
    const TopoDS_Edge edge = before.edge(way.edge), partner = after.edge(way.partner);
    for (const bool last : {false, true}) {
      const TopoDS_Vertex v = last ? TopExp::LastVertex(edge) : TopExp::FirstVertex(edge);
      const TopoDS_Vertex w = last != way.turned ? TopExp::LastVertex(partner) : TopExp::FirstVertex(partner);
      if (v.IsNull() || w.IsNull()) continue;
      const int a = before.vertices.FindIndex(v), b = after.vertices.FindIndex(w);
      if (vertices.emplace(a, b).first->second != b) return std::nullopt;
    }
  }
  for (const auto& [a, b] : vertices) pairs.push_back({ForcedPair::Kind::vertex, a, b});
  return pairs;
}

}  // namespace

std::string derivation(const Model& before, const Model& after) {
  const auto [faces, edges, vertices] = counts_of(before);
  return std::string(beginning) + " " + std::to_string(faces) + " " + std::to_string(edges) + " " + std::to_string(vertices) +
         " from " + text_of(sum_of_places(before)) + " to " + text_of(sum_of_places(after));
}

std::optional<Correspondence> derived_partners(const Model& before, const Model& after) {
  if (!is_derived(before, after)) return std::nullopt;
  const std::vector<Likely> edges = nearest_edges(before, after);
  const auto pairs = pairs_by_parameters(before, after, edges);
  if (!pairs) return std::nullopt;
  try {
    Correspondence found = match_models(before, after, *pairs, FaceTypes::left_out);
    found.same_parameters = true;
    std::vector<char> seam(before.edge_count(), 0);
    for (const auto& uses : before.coedges) {
      for (const Coedge& use : uses) seam[use.edge] = seam[use.edge] || use.seam ? 1 : 0;
    }
    for (const Likely& way : edges) {
      // Structure does not say which way seams run that end where they start; of other closed edges (u, v) may not.
      const TopoDS_Edge edge = before.edge(way.edge);
      if (seam[way.edge] && way.miss <= sure && TopExp::FirstVertex(edge).IsSame(TopExp::LastVertex(edge)))
        found.edge_senses[way.edge] = way.turned ? -1 : 1;
    }
    return found;
  } catch (const Error& error) {
    if (error.code() == ErrorCode::failed_precondition) return std::nullopt;
    throw;
  }
}

bool keeps_parameters(const Model& before, const Model& after, const Correspondence& partners, int face,
                      const std::vector<EdgeMap>& edges) {
  constexpr int pieces = 8;
  const int partner = partners.faces[face];
  const std::array<double, 2> lengths = parameter_lengths(before.face(face));
  double farthest = 0, size = 0;
  for (const Coedge& use : before.coedges[face]) {
    const int sense = use.sense * partners.edge_senses[use.edge] * partners.face_senses[face];
    const auto from = curve_of(before, face, use);
    const auto to = curve_of(after, partner, {partners.edges[use.edge], sense, use.seam});
    if (from.IsNull() || to.IsNull()) return false;
    const gp_Pnt2d start = from->Value(edges[use.edge].at(0));
    for (int k = 0; k <= pieces; ++k) {
      const double t = edges[use.edge].at(static_cast<double>(k) / pieces);
      const gp_Pnt2d a = from->Value(t), b = to->Value(edges[use.edge](t));
      farthest = std::max(farthest, std::hypot(lengths[0] * (a.X() - b.X()), lengths[1] * (a.Y() - b.Y())));
      size = std::max(size, std::hypot(lengths[0] * (a.X() - start.X()), lengths[1] * (a.Y() - start.Y())));
    }
  }
  const bool spline = BRep_Tool::Surface(after.face(partner))->IsKind(STANDARD_TYPE(Geom_BSplineSurface));
  return farthest <= (spline ? fitting : rounding) * size;
}

}  // namespace deform::cad
