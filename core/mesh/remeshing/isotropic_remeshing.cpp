// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/remeshing/isotropic_remeshing.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/mesh/remeshing/closest_point.h"
#include "core/mesh/remeshing/triangles.h"

namespace deform {

namespace {

// Botsch and Kobbelt 2004: after a split or collapse an edge is nearer to the target length than before.
constexpr double longest = 4.0 / 3, shortest = 4.0 / 5;
constexpr int passes = 6;                 // of collapses in one round
constexpr double count_tolerance = 0.02;  // of the number of vertices, while the target length still follows it

TriangleCorners corners_of(const SurfaceMesh& mesh, FaceHandle f) {
  const HalfedgeHandle h = mesh.halfedge(f);
  return {mesh.point(mesh.source(h)), mesh.point(mesh.target(h)), mesh.point(mesh.target(mesh.next(h)))};
}

class IsotropicRemeshing {
 public:
  IsotropicRemeshing(const SurfaceMesh& input, const RemeshingOptions& options)
      : options_(options), mesh_(input), sharp_(mesh_.add_property<EdgeHandle, char>("remeshing:sharp", 0)) {
    std::vector<TriangleCorners> triangles;
    std::array<std::vector<TriangleCorners>, kinds> segments;
    double area = 0;
    for (const FaceHandle f : mesh_.faces()) {
      triangles.push_back(corners_of(mesh_, f));
      area += length(area_normal(mesh_, f)) / 2;
    }
    for (const EdgeHandle e : mesh_.edges()) {
      sharp_[e] = kind_in(e);
      if (sharp_[e] == 0) continue;
      const HalfedgeHandle h = SurfaceMesh::halfedge(e);
      const Vec3 &a = mesh_.point(mesh_.source(h)), &b = mesh_.point(mesh_.target(h));
      segments[kind(h)].push_back({a, b, b});
    }
    surface_.emplace(std::move(triangles));
    for (std::size_t k = 0; k < kinds; ++k) curves_[k].emplace(std::move(segments[k]));
    if (!(area > 0)) throw Error(ErrorCode::invalid_argument, "the surface has no area");
    // A closed surface has about two equilateral triangles for each vertex.
    target_ = std::sqrt(area / (static_cast<double>(options_.vertices) * std::sqrt(3.0) / 2));
  }

  SurfaceMesh run() {
    for (int i = 0; i < options_.iterations; ++i) {
      round();
      // The length that gives the count depends on how much longer or shorter than it edges are on the average.
      const double ratio = static_cast<double>(mesh_.vertex_count()) / static_cast<double>(options_.vertices);
      if (i > 0 && std::abs(ratio - 1) > count_tolerance) target_ *= std::clamp(std::sqrt(ratio), 0.8, 1.25);
    }
    meet_count();
    for (int i = 0; i < 5; ++i) {
      improve_angles();
      smooth();
    }
    improve_angles();
    mesh_.garbage_collection();
    mesh_.remove_property(sharp_);
    return std::move(mesh_);
  }

 private:
  void round() {
    split_long_edges();
    collapse_short_edges();
    mesh_.garbage_collection();
    equalize_valences();
    smooth();
  }

  /// The kind of an edge of the surface that came in, as a bit; 0: it is not sharp.
  char kind_in(EdgeHandle e) const {
    const HalfedgeHandle h = SurfaceMesh::halfedge(e);
    for (std::size_t k = 0; k < options_.planes; ++k) {
      const bool lies = mesh_.point(mesh_.source(h))[k] == 0 && mesh_.point(mesh_.target(h))[k] == 0;
      if (lies) return static_cast<char>(1U << (in_plane + k));
    }
    const Vec3 m = area_normal(mesh_, mesh_.face(h)), n = area_normal(mesh_, mesh_.face(SurfaceMesh::opposite(h)));
    return std::atan2(length(cross(m, n)), dot(m, n)) > options_.feature_degrees * std::numbers::pi / 180 ? 1 << by_angle : 0;
  }
  std::size_t kind(HalfedgeHandle h) const {
    return static_cast<std::size_t>(std::countr_zero(static_cast<unsigned char>(sharp_[SurfaceMesh::edge(h)])));
  }
  bool is_sharp(HalfedgeHandle h) const { return sharp_[SurfaceMesh::edge(h)] != 0; }
  std::size_t sharp_edges(VertexHandle v) const {
    std::size_t count = 0;
    for (const HalfedgeHandle h : mesh_.outgoing(v)) count += is_sharp(h) ? 1 : 0;
    return count;
  }
  double edge_length(HalfedgeHandle h) const { return length(mesh_.point(mesh_.target(h)) - mesh_.point(mesh_.source(h))); }
  Vec3 middle(EdgeHandle e) const {
    const HalfedgeHandle h = SurfaceMesh::halfedge(e);
    const Vec3 between = 0.5 * (mesh_.point(mesh_.source(h)) + mesh_.point(mesh_.target(h)));
    return is_sharp(h) ? (*curves_[kind(h)])(between) : between;
  }

  void split(EdgeHandle e) {
    const HalfedgeHandle h = SurfaceMesh::halfedge(e);
    const VertexHandle a = mesh_.source(h), b = mesh_.target(h);
    const char sharp = sharp_[e];
    const VertexHandle v = mesh_.split(e, middle(e));
    for (const HalfedgeHandle out : mesh_.outgoing(v)) {
      const VertexHandle end = mesh_.target(out);
      sharp_[SurfaceMesh::edge(out)] = end == a || end == b ? sharp : char{0};
    }
  }

  void split_long_edges() {
    // Where sharp edges lie close together, a split may land on the wrong one and its edges stay long.
    const std::size_t most = mesh_.vertex_count() + 10 * options_.vertices;
    for (bool changed = true; changed;) {
      changed = false;
      for (const EdgeHandle e : mesh_.edges()) {
        if (edge_length(SurfaceMesh::halfedge(e)) <= longest * target_ || mesh_.vertex_count() >= most) continue;
        split(e);
        changed = true;
      }
    }
  }

  /// Whether the source of h may move into its target, as far as sharp edges go: points on sharp edges stay on them, and corners
  /// stay, but for two that are nearer than half the target length, which cannot show both.
  bool keeps_sharp_edges(HalfedgeHandle h) const {
    const std::size_t count = sharp_edges(mesh_.source(h));
    if (count == 0) return true;
    if (!is_sharp(h)) return false;
    if (count != 2) return edge_length(h) < target_ / 2 && sharp_edges(mesh_.target(h)) != 2;
    return !is_sharp(mesh_.previous(h)) && !is_sharp(mesh_.rotated(h)) && keeps_sharp_shape(h);
  }
  /// Whether sharp edges are straight enough at the source that the point there can go. Those in planes follow the surface, which
  /// may be cut off as well.
  bool keeps_sharp_shape(HalfedgeHandle h) const {
    if (kind(h) != by_angle) return true;
    for (const HalfedgeHandle other : mesh_.outgoing(mesh_.source(h))) {
      if (other == h || !is_sharp(other)) continue;
      const Vec3 &a = mesh_.point(mesh_.target(other)), &b = mesh_.point(mesh_.target(h));
      const Vec3 between = 0.5 * (a + b);
      return distance((*curves_[by_angle])(between), between) <= 0.1 * target_;
    }
    return true;
  }
  /// The symmetry planes in which a vertex lies, as bits.
  unsigned planes_of(VertexHandle v) const {
    unsigned planes = 0;
    for (std::size_t k = 0; k < options_.planes; ++k) planes |= mesh_.point(v)[k] == 0 ? 1U << k : 0;
    return planes;
  }
  /// Whether a collapse or flip would make an edge between vertices in one plane that is not sharp: the surface could not be cut
  /// along those that are.
  bool would_join_in_plane(HalfedgeHandle h) const {
    const VertexHandle source = mesh_.source(h), target = mesh_.target(h);
    const unsigned planes = planes_of(target) & ~planes_of(source);
    if (planes == 0) return false;
    for (const VertexHandle v : mesh_.neighbours(source)) {
      if (v != target && (planes_of(v) & planes) != 0 && !mesh_.find_halfedge(v, target).valid()) return true;
    }
    return false;
  }
  bool would_join_in_plane(EdgeHandle e) const {
    const HalfedgeHandle h = SurfaceMesh::halfedge(e);
    return (planes_of(mesh_.target(mesh_.next(h))) & planes_of(mesh_.target(mesh_.next(SurfaceMesh::opposite(h))))) != 0;
  }
  bool can_collapse(HalfedgeHandle h, double longest_allowed) const {
    if (!keeps_sharp_edges(h) || !mesh_.can_collapse(h) || would_join_in_plane(h)) return false;
    const Vec3& x = mesh_.point(mesh_.target(h));
    for (const VertexHandle v : mesh_.neighbours(mesh_.source(h))) {
      if (distance(mesh_.point(v), x) > longest_allowed) return false;
    }
    return !would_fold(mesh_, h, x);
  }
  bool collapse_either_way(EdgeHandle e, double longest_allowed) {
    for (const HalfedgeHandle h : {SurfaceMesh::halfedge(e), SurfaceMesh::opposite(SurfaceMesh::halfedge(e))}) {
      if (!can_collapse(h, longest_allowed)) continue;
      // The edges of its triangles at the source are merged with those at the target.
      const HalfedgeHandle o = SurfaceMesh::opposite(h);
      sharp_[SurfaceMesh::edge(mesh_.next(h))] |= sharp_[SurfaceMesh::edge(mesh_.previous(h))];
      sharp_[SurfaceMesh::edge(mesh_.previous(o))] |= sharp_[SurfaceMesh::edge(mesh_.next(o))];
      mesh_.collapse(h);
      return true;
    }
    return false;
  }

  void collapse_short_edges() {
    // What is left after some passes is for the next round: a pass over everything for the last few edges would be slow.
    bool changed = true;
    for (int pass = 0; pass < passes && changed; ++pass) {
      changed = false;
      for (const EdgeHandle e : mesh_.edges()) {
        if (edge_length(SurfaceMesh::halfedge(e)) >= shortest * target_) continue;
        changed |= collapse_either_way(e, longest * target_);
      }
    }
  }

  /// Whether the quadrilateral of the edge is flat enough and convex: its triangles stay the same way up.
  bool can_flip(EdgeHandle e) const {
    if (sharp_[e] || !mesh_.can_flip(e) || would_join_in_plane(e)) return false;
    const auto [a, b, c, d] = quadrilateral(e);
    const Vec3 before = cross(b - a, c - a) + cross(a - b, d - b);
    const Vec3 first = cross(d - c, b - c), second = cross(c - d, a - d);
    const double size = length(before);
    return dot(first, before) > 0.3 * length(first) * size && dot(second, before) > 0.3 * length(second) * size &&
           std::min(length(first), length(second)) > 0;
  }
  /// Source, target, and the corner to the left and to the right of its half-edge.
  std::array<Vec3, 4> quadrilateral(EdgeHandle e) const {
    const HalfedgeHandle h = SurfaceMesh::halfedge(e), o = SurfaceMesh::opposite(h);
    return {mesh_.point(mesh_.source(h)), mesh_.point(mesh_.target(h)), mesh_.point(mesh_.target(mesh_.next(h))),
            mesh_.point(mesh_.target(mesh_.next(o)))};
  }

  void equalize_valences() {
    for (const EdgeHandle e : mesh_.edges()) {
      const HalfedgeHandle h = SurfaceMesh::halfedge(e), o = SurfaceMesh::opposite(h);
      const auto excess = [&](VertexHandle v) { return static_cast<int>(mesh_.valence(v)) - 6; };
      const int a = excess(mesh_.source(h)), b = excess(mesh_.target(h));
      const int c = excess(mesh_.target(mesh_.next(h))), d = excess(mesh_.target(mesh_.next(o)));
      const int before = std::abs(a) + std::abs(b) + std::abs(c) + std::abs(d);
      const int after = std::abs(a - 1) + std::abs(b - 1) + std::abs(c + 1) + std::abs(d + 1);
      if (after < before && can_flip(e) && angle_after_flip(e) > std::min(angle_before_flip(e), 15.0)) mesh_.flip(e);
    }
  }
  double angle_before_flip(EdgeHandle e) const {
    const auto [a, b, c, d] = quadrilateral(e);
    return std::min(least_angle(a, b, c), least_angle(b, a, d));
  }
  double angle_after_flip(EdgeHandle e) const {
    const auto [a, b, c, d] = quadrilateral(e);
    return std::min(least_angle(c, d, b), least_angle(d, c, a));
  }
  void improve_angles() {
    for (int pass = 0; pass < 3; ++pass) {
      for (const EdgeHandle e : mesh_.edges()) {
        if (can_flip(e) && angle_after_flip(e) > angle_before_flip(e) + 1e-9) mesh_.flip(e);
      }
    }
  }

  void smooth() {
    for (const VertexHandle v : mesh_.vertices()) {
      const std::size_t count = sharp_edges(v);
      if (count != 0 && count != 2) continue;
      const Vec3 x = count == 2 ? smoothed_along_edges(v) : smoothed_in_surface(v);
      if (keeps_side(v, x) && !would_fold(mesh_, v, x)) mesh_.set_point(v, x);
    }
  }
  /// Whether a place is on the same side of all symmetry planes as a vertex.
  bool keeps_side(VertexHandle v, const Vec3& x) const {
    const auto side = [](double coordinate) { return coordinate > 0 ? 1 : coordinate < 0 ? -1 : 0; };
    for (std::size_t k = 0; k < options_.planes; ++k) {
      if (side(mesh_.point(v)[k]) != side(x[k])) return false;
    }
    return true;
  }
  Vec3 smoothed_in_surface(VertexHandle v) const {
    Vec3 sum{}, normal{};
    double count = 0;
    for (const HalfedgeHandle h : mesh_.outgoing(v)) {
      sum = sum + mesh_.point(mesh_.target(h));
      normal = normal + area_normal(mesh_, mesh_.face(h));
      ++count;
    }
    const Vec3 step = sum / count - mesh_.point(v);
    const double size = dot(normal, normal);
    const Vec3 tangential = size > 0 ? step - (dot(step, normal) / size) * normal : step;
    return (*surface_)(mesh_.point(v) + tangential);
  }
  Vec3 smoothed_along_edges(VertexHandle v) const {
    Vec3 sum{};
    std::array<Vec3, 2> ends{};
    std::array<std::size_t, 2> kinds_there{};
    std::size_t count = 0;
    for (const HalfedgeHandle h : mesh_.outgoing(v)) {
      if (!is_sharp(h)) continue;
      kinds_there[count] = kind(h);
      ends[count++] = mesh_.point(mesh_.target(h));
      sum = sum + ends[count - 1];
    }
    const Vec3 &x = mesh_.point(v), d = x - ends[0], e = ends[1] - x;
    // A corner of the curve stays where it is, but for that of a plane, which follows the surface, and where two of them meet.
    if (kinds_there[0] != kinds_there[1]) return x;
    if (kinds_there[0] == by_angle && dot(d, e) < 0.7 * length(d) * length(e)) return x;
    return (*curves_[kinds_there[0]])(0.5 * sum);
  }

  /// The last vertices too many or too few, by the shortest and longest edges.
  void meet_count() {
    const auto wanted = static_cast<double>(options_.vertices);
    for (int pass = 0; pass < 20; ++pass) {
      const double excess = static_cast<double>(mesh_.vertex_count()) - wanted;
      if (std::abs(excess) <= count_tolerance * wanted) break;
      std::vector<std::pair<double, EdgeHandle>> order;
      for (const EdgeHandle e : mesh_.edges()) order.emplace_back(edge_length(SurfaceMesh::halfedge(e)), e);
      std::sort(order.begin(), order.end());
      if (excess < 0) std::reverse(order.begin(), order.end());
      // Not all at once: what is next to a change waits for the next pass.
      std::size_t left = std::min(static_cast<std::size_t>(std::abs(excess)), std::max<std::size_t>(1, order.size() / 12));
      std::vector<char> touched(mesh_.vertex_slots() + left, 0);
      for (const auto& [size, e] : order) {
        if (left == 0) break;
        if (mesh_.is_removed(e)) continue;
        const HalfedgeHandle h = SurfaceMesh::halfedge(e);
        const VertexHandle a = mesh_.source(h), b = mesh_.target(h);
        if (touched[a.index()] || touched[b.index()]) continue;
        if (excess > 0 && !collapse_either_way(e, 2 * target_)) continue;
        if (excess < 0) split(e);
        touched[a.index()] = touched[b.index()] = 1;
        --left;
      }
      mesh_.garbage_collection();
      equalize_valences();
      smooth();
    }
  }

  enum Kind : std::size_t { by_angle, in_plane, kinds = in_plane + 3 };

  const RemeshingOptions options_;
  SurfaceMesh mesh_;
  Property<EdgeHandle, char> sharp_;                       // bits of kinds
  std::optional<ClosestPoint> surface_;                    // that came in
  std::array<std::optional<ClosestPoint>, kinds> curves_;  // the sharp edges of each kind that came in
  double target_ = 0;                                      // length of edges
};

}  // namespace

void RemeshingOptions::validate() const {
  if (vertices < 4)
    throw Error(ErrorCode::invalid_argument, "vertices: a closed surface has 4 or more, not " + std::to_string(vertices));
  if (!(feature_degrees >= 0 && feature_degrees <= 180)) {
    throw Error(ErrorCode::invalid_argument,
                "feature_degrees: " + number_digits(feature_degrees) + " is out of range, allowed are 0 to 180");
  }
  check_range(static_cast<std::uint64_t>(std::max(iterations, 0)), 1, 1000, "iterations");
  check_range(planes, 0, 3, "planes");
}

SurfaceMesh isotropic_remeshing(const SurfaceMesh& mesh, const RemeshingOptions& options) {
  options.validate();
  check_closed_triangles(mesh);
  return IsotropicRemeshing(mesh, options).run();
}

}  // namespace deform
