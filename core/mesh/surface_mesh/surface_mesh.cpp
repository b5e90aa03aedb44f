// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/surface_mesh/surface_mesh.h"

#include <algorithm>
#include <cassert>
#include <numeric>

#include "core/base/error.h"
#include "core/mesh/surface_mesh/morton_order.h"
#include "core/mesh/surface_mesh/one_rings.h"
#include "core/mesh/surface_mesh/paired_corners.h"

namespace deform {

namespace {

std::string name_of(VertexHandle v) { return "vertex " + std::to_string(v.index()); }

std::string edge_name(VertexHandle a, VertexHandle b) {
  return "edge " + std::to_string(a.index()) + "-" + std::to_string(b.index());
}

[[noreturn]] void refuse(const std::string& what) { throw Error(ErrorCode::invalid_argument, what); }

/// Entry order[i] of the result is i; what `order` leaves out is none.
std::vector<std::uint32_t> inverse(const std::vector<std::uint32_t>& order, std::size_t slots) {
  std::vector<std::uint32_t> inverted(slots, 0xFFFFFFFF);
  for (std::uint32_t i = 0; i < order.size(); ++i) inverted[order[i]] = i;
  return inverted;
}

template <typename Range>
std::vector<std::uint32_t> numbers(const Range& range) {
  std::vector<std::uint32_t> listed;
  for (const auto handle : range) listed.push_back(handle.index());
  return listed;
}

template <typename T>
void gather(std::vector<T>& values, const std::vector<std::uint32_t>& order) {
  std::vector<T> gathered(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) gathered[i] = values[order[i]];
  values = std::move(gathered);
}

}  // namespace

// Construction.

SurfaceMesh::SurfaceMesh(const Mesh& mesh) {
  mesh.validate();
  link_faces(mesh);
  link_boundary();
  check_fans();
  points_ = mesh.points;
  vertex_properties_.resize(vertices_.size());
  halfedge_properties_.resize(halfedges_.size());
  edge_properties_.resize(edge_slots());
  face_properties_.resize(faces_.size());
}

void SurfaceMesh::link_faces(const Mesh& mesh) {
  // Becomes, corner by corner, the half-edge of the corner: edges are numbered as faces meet them.
  std::vector<std::uint32_t> pairs = paired_corners(mesh);
  const std::size_t inner =
      static_cast<std::size_t>(std::count_if(pairs.begin(), pairs.end(), [](std::uint32_t c) { return c != no_corner; }));
  const std::size_t edge_count = pairs.size() - inner / 2;
  if (2 * edge_count >= removed) refuse("too many edges for handles of 32 bits");
  halfedges_.resize(2 * edge_count);
  vertices_.assign(mesh.point_count(), none);
  faces_.resize(mesh.face_count());
  std::uint32_t corner = 0, edges = 0;
  for (std::uint32_t face = 0; face < faces_.size(); ++face) {
    const std::uint32_t first = corner, end = corner + mesh.face_sizes[face];
    for (; corner < end; ++corner) {
      const std::uint32_t other = pairs[corner];
      const std::uint32_t h = other < corner ? pairs[other] ^ 1 : 2 * edges++;
      pairs[corner] = h;
      const PointId source = mesh.face_points[corner], target = mesh.face_points[corner + 1 == end ? first : corner + 1];
      halfedges_[h].target = target;
      halfedges_[h].face = face;
      if (other == no_corner) halfedges_[h ^ 1] = {none, source, none};
      if (vertices_[source] == none) vertices_[source] = h;
    }
    for (std::uint32_t c = first; c < end; ++c) halfedges_[pairs[c]].next = pairs[c + 1 == end ? first : c + 1];
    faces_[face] = pairs[end - 1];
  }
}

void SurfaceMesh::link_boundary() {
  const auto count = static_cast<std::uint32_t>(halfedges_.size());
  for (std::uint32_t h = 0; h < count; ++h) {
    if (halfedges_[h].face != none) continue;
    const std::uint32_t source = halfedges_[h ^ 1].target;
    const std::uint32_t known = vertices_[source];
    if (known != none && halfedges_[known].face == none) {
      refuse("not a 2-manifold: the faces at vertex " + std::to_string(source) + " form more than one fan");
    }
    vertices_[source] = h;
  }
  for (std::uint32_t h = 0; h < count; ++h) {
    if (halfedges_[h].face == none) halfedges_[h].next = vertices_[halfedges_[h].target];
  }
}

// Every half-edge must be met in the walk around its source.
void SurfaceMesh::check_fans() const {
  std::vector<std::uint32_t> valences(vertices_.size(), 0);
  for (const HalfedgeRecord& h : halfedges_) ++valences[h.target];
  for (std::uint32_t v = 0; v < vertices_.size(); ++v) {
    if (valences[v] != 0 && valence(VertexHandle(v)) != valences[v]) {
      refuse("not a 2-manifold: the faces at vertex " + std::to_string(v) + " form more than one fan");
    }
  }
}

Mesh SurfaceMesh::to_mesh() const {
  if (has_removed()) throw Error(ErrorCode::failed_precondition, "a mesh with removed entities needs garbage_collection() first");
  Mesh mesh;
  mesh.points = points_;
  mesh.face_sizes.reserve(face_count());
  for (const FaceHandle f : faces()) {
    const std::size_t begin = mesh.face_points.size();
    for (const VertexHandle v : vertices(f)) mesh.face_points.push_back(v.index());
    mesh.face_sizes.push_back(static_cast<std::uint32_t>(mesh.face_points.size() - begin));
  }
  return mesh;
}

std::size_t SurfaceMesh::bytes() const {
  return vertices_.capacity() * sizeof(std::uint32_t) + halfedges_.capacity() * sizeof(HalfedgeRecord) +
         faces_.capacity() * sizeof(std::uint32_t) + points_.capacity() * sizeof(Vec3) + vertex_properties_.bytes() +
         halfedge_properties_.bytes() + edge_properties_.bytes() + face_properties_.bytes();
}

void SurfaceMesh::reserve(std::size_t vertices, std::size_t edges, std::size_t faces) {
  vertices_.reserve(vertices);
  points_.reserve(vertices);
  halfedges_.reserve(2 * edges);
  faces_.reserve(faces);
  vertex_properties_.grow(vertices);
  halfedge_properties_.grow(2 * edges);
  edge_properties_.grow(edges);
  face_properties_.grow(faces);
}

// Relations.

HalfedgeHandle SurfaceMesh::previous(HalfedgeHandle h) const {
  if (is_boundary(h)) {
    HalfedgeHandle incoming = opposite(h);
    while (next(incoming) != h) incoming = opposite(next(incoming));
    return incoming;
  }
  HalfedgeHandle before = next(next(h));
  while (next(before) != h) before = next(before);
  return before;
}

HalfedgeHandle SurfaceMesh::find_halfedge(VertexHandle a, VertexHandle b) const {
  for (const HalfedgeHandle h : outgoing(a)) {
    if (target(h) == b) return h;
  }
  return {};
}

std::size_t SurfaceMesh::valence(VertexHandle v) const {
  std::size_t count = 0;
  for ([[maybe_unused]] const HalfedgeHandle h : outgoing(v)) ++count;
  return count;
}

std::size_t SurfaceMesh::degree(FaceHandle f) const {
  std::size_t count = 0;
  for ([[maybe_unused]] const HalfedgeHandle h : halfedges(f)) ++count;
  return count;
}

const OneRings& SurfaceMesh::one_rings() {
  if (rings_ == nullptr || rings_stamp_ != stamp_) {
    rings_ = std::make_shared<const OneRings>(*this);
    rings_stamp_ = stamp_;
  }
  return *rings_;
}

// Adding.

VertexHandle SurfaceMesh::add_vertex(const Vec3& point) {
  if (vertices_.size() + 1 >= removed) refuse("too many vertices for handles of 32 bits");
  vertices_.push_back(none);
  points_.push_back(point);
  vertex_properties_.grow(vertices_.size());
  ++stamp_;
  return VertexHandle(static_cast<std::uint32_t>(vertices_.size() - 1));
}

HalfedgeHandle SurfaceMesh::new_edge(VertexHandle source, VertexHandle target) {
  const std::size_t h = halfedges_.size();
  if (h + 2 >= removed) refuse("too many edges for handles of 32 bits");
  halfedges_.push_back({none, target.index(), none});
  halfedges_.push_back({none, source.index(), none});
  halfedge_properties_.grow(halfedges_.size());
  edge_properties_.grow(edge_slots());
  return HalfedgeHandle(static_cast<std::uint32_t>(h));
}

FaceHandle SurfaceMesh::new_face(HalfedgeHandle h) {
  faces_.push_back(h.index());
  face_properties_.grow(faces_.size());
  return FaceHandle(static_cast<std::uint32_t>(faces_.size() - 1));
}

// A boundary half-edge that ends where inner_previous does, in a gap that the new face does not use.
HalfedgeHandle SurfaceMesh::free_gap(HalfedgeHandle inner_previous, HalfedgeHandle inner_next) const {
  HalfedgeHandle gap = opposite(inner_next);
  do {
    gap = opposite(next(gap));
  } while (!is_boundary(gap) || gap == inner_previous);
  return next(gap) == inner_next ? HalfedgeHandle() : gap;
}

FaceHandle SurfaceMesh::add_face(std::span<const VertexHandle> corners) {
  const std::size_t n = corners.size();
  if (n < 3) refuse("a face has three corners or more, not " + std::to_string(n));
  std::vector<HalfedgeHandle> sides(n);
  std::vector<char> is_new(n);
  for (std::size_t i = 0; i < n; ++i) {
    const auto before = corners.first(i);
    if (std::find(before.begin(), before.end(), corners[i]) != before.end()) refuse("the face repeats " + name_of(corners[i]));
  }
  for (std::size_t i = 0; i < n; ++i) {
    const VertexHandle a = corners[i], b = corners[(i + 1) % n];
    if (!is_boundary(a)) refuse("no gap for the face at " + name_of(a));
    sides[i] = find_halfedge(a, b);
    is_new[i] = !sides[i].valid();
    if (!is_new[i] && !is_boundary(sides[i])) refuse(edge_name(a, b) + " has a face on this side");
  }
  // Links are made at the end, because finding neighbours needs the old ones.
  std::vector<Link> links;
  for (std::size_t i = 0; i < n; ++i) {
    const HalfedgeHandle inner_previous = sides[i], inner_next = sides[(i + 1) % n];
    if (is_new[i] || is_new[(i + 1) % n] || next(inner_previous) == inner_next) continue;
    // Other faces lie between the two sides: they move into another gap of the vertex.
    const HalfedgeHandle gap = free_gap(inner_previous, inner_next);
    if (!gap.valid()) refuse("no gap for the face at " + name_of(corners[(i + 1) % n]));
    links.push_back({gap, next(inner_previous)});
    links.push_back({previous(inner_next), next(gap)});
    links.push_back({inner_previous, inner_next});
  }
  for (std::size_t i = 0; i < n; ++i) {
    if (is_new[i]) sides[i] = new_edge(corners[i], corners[(i + 1) % n]);
  }
  const FaceHandle f = new_face(sides[n - 1]);
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t j = (i + 1) % n;
    const VertexHandle v = corners[j];
    const HalfedgeHandle outer_next = opposite(sides[i]), outer_previous = opposite(sides[j]);
    if (is_new[i] && is_new[j]) {
      const HalfedgeHandle gap = halfedge(v);
      links.push_back({gap.valid() ? previous(gap) : outer_previous, outer_next});
      if (gap.valid()) links.push_back({outer_previous, gap});
      if (!gap.valid()) set_halfedge(v, outer_next);
    } else if (is_new[i]) {
      links.push_back({previous(sides[j]), outer_next});
      set_halfedge(v, outer_next);
    } else if (is_new[j]) {
      links.push_back({outer_previous, next(sides[i])});
      set_halfedge(v, next(sides[i]));
    }
    if (is_new[i] || is_new[j]) links.push_back({sides[i], sides[j]});
  }
  for (const HalfedgeHandle side : sides) set_face(side, f);
  for (const Link& link : links) set_next(link.from, link.to);
  for (const VertexHandle v : corners) prefer_boundary(v);
  ++stamp_;
  return f;
}

// The outgoing half-edge of a boundary vertex lies on the boundary.
void SurfaceMesh::prefer_boundary(VertexHandle v) {
  if (is_isolated(v)) return;
  for (const HalfedgeHandle h : outgoing(v)) {
    if (is_boundary(h)) {
      set_halfedge(v, h);
      return;
    }
  }
}

// Removing.

void SurfaceMesh::mark_removed(VertexHandle v) {
  vertices_[v.index()] = removed;
  ++removed_vertices_;
}

void SurfaceMesh::mark_removed(EdgeHandle e) {
  set_target(halfedge(e), VertexHandle(removed));
  set_target(opposite(halfedge(e)), VertexHandle(removed));
  ++removed_edges_;
}

void SurfaceMesh::mark_removed(FaceHandle f) {
  faces_[f.index()] = removed;
  ++removed_faces_;
}

// Takes an edge without faces out of the boundary.
void SurfaceMesh::unlink(EdgeHandle e) {
  const HalfedgeHandle h = halfedge(e), o = opposite(h);
  const VertexHandle a = source(h), b = target(h);
  const HalfedgeHandle before_h = previous(h), before_o = previous(o), after_h = next(h), after_o = next(o);
  set_next(before_h, after_o);
  set_next(before_o, after_h);
  if (halfedge(a) == h) set_halfedge(a, after_o == h ? HalfedgeHandle() : after_o);
  if (halfedge(b) == o) set_halfedge(b, after_h == o ? HalfedgeHandle() : after_h);
  mark_removed(e);
}

void SurfaceMesh::remove(FaceHandle f) {
  const std::vector<HalfedgeHandle> sides = [&] {
    std::vector<HalfedgeHandle> around;
    for (const HalfedgeHandle h : halfedges(f)) around.push_back(h);
    return around;
  }();
  std::vector<VertexHandle> corners;
  for (const HalfedgeHandle h : sides) {
    corners.push_back(target(h));
    set_face(h, {});
  }
  for (const HalfedgeHandle h : sides) {
    if (is_boundary(opposite(h))) unlink(edge(h));
  }
  mark_removed(f);
  for (const VertexHandle v : corners) prefer_boundary(v);
  ++stamp_;
}

void SurfaceMesh::remove(EdgeHandle e) {
  const FaceHandle first = face(halfedge(e)), second = face(opposite(halfedge(e)));
  if (first.valid()) remove(first);
  if (second.valid() && second != first) remove(second);
}

void SurfaceMesh::remove(VertexHandle v) {
  std::vector<FaceHandle> around;
  for (const FaceHandle f : faces(v)) around.push_back(f);
  for (const FaceHandle f : around) remove(f);
  mark_removed(v);
  ++stamp_;
}

// Flips.

bool SurfaceMesh::can_flip(EdgeHandle e) const {
  if (is_boundary(e)) return false;
  const HalfedgeHandle h = halfedge(e), o = opposite(h);
  if (!is_triangle(face(h)) || !is_triangle(face(o))) return false;
  const VertexHandle a = target(next(h)), b = target(next(o));
  return a != b && !find_halfedge(a, b).valid();
}

void SurfaceMesh::flip(EdgeHandle e) {
  assert(can_flip(e));
  const HalfedgeHandle h = halfedge(e), o = opposite(h);
  const HalfedgeHandle h1 = next(h), h2 = next(h1), o1 = next(o), o2 = next(o1);
  const VertexHandle source_of_h = target(o), target_of_h = target(h);
  const FaceHandle f = face(h), g = face(o);
  // h goes from the corner opposite in g to the one opposite in f.
  set_target(h, target(h1));
  set_target(o, target(o1));
  halfedges_[h.index()].next = h2.index();
  set_next(h2, o1);
  set_next(o1, h);
  set_next(o, o2);
  set_next(o2, h1);
  set_next(h1, o);
  set_face(o1, f);
  set_face(h1, g);
  set_halfedge(f, h);
  set_halfedge(g, o);
  if (halfedge(source_of_h) == h) set_halfedge(source_of_h, o1);
  if (halfedge(target_of_h) == o) set_halfedge(target_of_h, h1);
  ++stamp_;
}

// Collapses.

// Checks one side of the edge: a triangle must not be attached by this edge alone, and its apex must keep more than one edge.
bool SurfaceMesh::allows_collapse(HalfedgeHandle h, VertexHandle apex) const {
  if (!apex.valid()) return true;
  const HalfedgeHandle first = next(h), second = next(first);
  if (is_boundary(opposite(first)) && is_boundary(opposite(second))) return false;
  return is_boundary(apex) || rotated(rotated(second)) != second;
}

// Whether a face with more than three corners, other than those of the edge, has both end points.
bool SurfaceMesh::share_other_polygon(HalfedgeHandle h) const {
  const FaceHandle left = face(h), right = face(opposite(h));
  for (const FaceHandle f : faces(source(h))) {
    if (f == left || f == right || is_triangle(f)) continue;
    for (const VertexHandle v : vertices(f)) {
      if (v == target(h)) return true;
    }
  }
  return false;
}

bool SurfaceMesh::can_collapse(HalfedgeHandle h) const {
  const HalfedgeHandle o = opposite(h);
  const VertexHandle v0 = source(h), v1 = target(h);
  const auto apex_of = [&](HalfedgeHandle side) {
    return is_boundary(side) || next(next(next(side))) != side ? VertexHandle() : target(next(side));
  };
  const VertexHandle left = apex_of(h), right = apex_of(o);
  if (left.valid() && left == right) return false;
  if (!allows_collapse(h, left) || !allows_collapse(o, right)) return false;
  if (is_boundary(v0) && is_boundary(v1) && !is_boundary(edge(h))) return false;
  std::size_t valence0 = 0;
  for (const VertexHandle v : neighbours(v0)) {
    ++valence0;
    if (v != v1 && v != left && v != right && find_halfedge(v, v1).valid()) return false;
  }
  const std::size_t triangles = (left.valid() ? 1U : 0U) + (right.valid() ? 1U : 0U);
  if (valence0 + valence(v1) == 4 + triangles && joins_two_faces_all_around(h)) return false;
  return !share_other_polygon(h);
}

// Whether v1, left with two edges, would have two faces with the same corners, as a tetrahedron would.
bool SurfaceMesh::joins_two_faces_all_around(HalfedgeHandle h) const {
  const HalfedgeHandle o = opposite(h);
  std::vector<std::vector<VertexHandle>> left_over;
  std::vector<FaceHandle> around;
  for (const VertexHandle v : {source(h), target(h)}) {
    for (const FaceHandle f : faces(v)) {
      if ((f == face(h) || f == face(o)) && is_triangle(f)) continue;
      if (std::find(around.begin(), around.end(), f) != around.end()) continue;
      around.push_back(f);
      std::vector<VertexHandle>& corners = left_over.emplace_back();
      for (const VertexHandle corner : vertices(f)) {
        if (corner != source(h) && corner != target(h)) corners.push_back(corner);
      }
      std::sort(corners.begin(), corners.end());
    }
  }
  return left_over.size() == 2 && left_over[0] == left_over[1];
}

// A face between two vertices is left of `kept`, right of `dropped` is another: the two edges become one.
void SurfaceMesh::merge_two_sided(HalfedgeHandle kept, HalfedgeHandle dropped) {
  const HalfedgeHandle outer = opposite(dropped);
  const VertexHandle from = target(dropped), to = target(kept);
  const FaceHandle collapsed = face(kept), beyond = face(outer);
  set_next(previous(outer), kept);
  set_next(kept, next(outer));
  set_face(kept, beyond);
  if (beyond.valid() && halfedge(beyond) == outer) set_halfedge(beyond, kept);
  if (halfedge(to) == dropped) set_halfedge(to, opposite(kept));
  if (halfedge(from) == outer) set_halfedge(from, kept);
  mark_removed(edge(dropped));
  mark_removed(collapsed);
}

void SurfaceMesh::collapse(HalfedgeHandle h) {
  assert(can_collapse(h));
  const HalfedgeHandle o = opposite(h);
  const VertexHandle v0 = target(o), v1 = target(h);
  const HalfedgeHandle after_h = next(h), before_h = previous(h), after_o = next(o), before_o = previous(o);
  const bool on_boundary = is_boundary(v0);
  HalfedgeHandle incoming = o;
  do {
    set_target(incoming, v1);
    incoming = opposite(next(incoming));
  } while (incoming != o);
  set_next(before_h, after_h);
  set_next(before_o, after_o);
  if (!is_boundary(h)) set_halfedge(face(h), after_h);
  if (!is_boundary(o)) set_halfedge(face(o), after_o);
  if (halfedge(v1) == o) set_halfedge(v1, after_h);
  mark_removed(v0);
  const bool left = !is_boundary(h) && next(after_h) == before_h && next(before_h) == after_h;
  const bool right = !is_boundary(o) && next(after_o) == before_o && next(before_o) == after_o;
  mark_removed(edge(h));
  if (left) merge_two_sided(after_h, before_h);
  if (right) merge_two_sided(before_o, after_o);
  if (on_boundary) prefer_boundary(v1);
  ++stamp_;
}

// Splits.

// h keeps its target: the new edge goes from its old source to v, before it. Gives the new half-edge to v.
HalfedgeHandle SurfaceMesh::insert_vertex(EdgeHandle e, VertexHandle v) {
  const HalfedgeHandle h = halfedge(e), o = opposite(h);
  const VertexHandle old_source = target(o);
  const HalfedgeHandle before_h = previous(h), after_o = next(o);
  const HalfedgeHandle fresh = new_edge(old_source, v), back = opposite(fresh);
  set_next(before_h, fresh);
  set_next(fresh, h);
  set_face(fresh, face(h));
  set_next(o, back);
  set_next(back, after_o == h ? fresh : after_o);
  set_face(back, face(o));
  set_target(o, v);
  if (halfedge(old_source) == h) set_halfedge(old_source, fresh);
  set_halfedge(v, is_boundary(back) ? back : h);
  return fresh;
}

HalfedgeHandle SurfaceMesh::split(HalfedgeHandle from, HalfedgeHandle to) {
  const FaceHandle f = face(from);
  const HalfedgeHandle after_from = next(from), after_to = next(to);
  const HalfedgeHandle h = new_edge(target(from), target(to)), o = opposite(h);
  // f keeps what runs from `from` over h; the new face has o.
  set_next(to, o);
  set_next(o, after_from);
  set_next(from, h);
  set_next(h, after_to);
  set_face(h, f);
  set_halfedge(f, h);
  const FaceHandle g = new_face(o);
  for (const HalfedgeHandle side : halfedges(g)) set_face(side, g);
  ++stamp_;
  return o;
}

VertexHandle SurfaceMesh::split(EdgeHandle e, const Vec3& point) {
  const HalfedgeHandle h = halfedge(e), o = opposite(h);
  const bool left = !is_boundary(h) && is_triangle(face(h)), right = !is_boundary(o) && is_triangle(face(o));
  const VertexHandle v = add_vertex(point);
  const HalfedgeHandle fresh = insert_vertex(e, v);
  if (left) split(fresh, next(h));
  if (right) split(o, next(opposite(fresh)));
  return v;
}

VertexHandle SurfaceMesh::split(FaceHandle f, const Vec3& point) {
  const VertexHandle v = add_vertex(point);
  const HalfedgeHandle first = halfedge(f), first_spoke(static_cast<std::uint32_t>(halfedges_.size()));
  // A spoke leads from the target of a side to v. Side, spoke and the spoke before, outwards, make a triangle.
  const auto connect = [&](HalfedgeHandle before, HalfedgeHandle spoke) {
    set_next(spoke, opposite(before));
    set_face(opposite(before), face(spoke));
  };
  HalfedgeHandle side = first, before;
  do {
    const HalfedgeHandle following = next(side), spoke = new_edge(target(side), v);
    const FaceHandle g = side == first ? f : new_face(side);
    set_face(side, g);
    set_face(spoke, g);
    set_next(side, spoke);
    set_next(opposite(spoke), following);
    if (before.valid()) connect(before, spoke);
    before = spoke;
    side = following;
  } while (side != first);
  connect(before, first_spoke);
  set_halfedge(v, HalfedgeHandle(first_spoke.index() + 3));  // of the second spoke, outwards
  return v;
}

// Renumbering.

void SurfaceMesh::renumber(const Reordering& order) {
  const std::vector<std::uint32_t> vertex_of = inverse(order.vertices, vertex_slots());
  const std::vector<std::uint32_t> edge_of = inverse(order.edges, edge_slots());
  const std::vector<std::uint32_t> face_of = inverse(order.faces, face_slots());
  const auto halfedge_of = [&](std::uint32_t h) { return h >= removed ? h : 2 * edge_of[h / 2] + h % 2; };
  std::vector<HalfedgeRecord> records(2 * order.edges.size());
  std::vector<std::uint32_t> halfedge_order(records.size());
  for (std::size_t i = 0; i < records.size(); ++i) {
    halfedge_order[i] = 2 * order.edges[i / 2] + static_cast<std::uint32_t>(i % 2);
    const HalfedgeRecord& old = halfedges_[halfedge_order[i]];
    records[i] = {halfedge_of(old.next), vertex_of[old.target], old.face == none ? none : face_of[old.face]};
  }
  halfedges_ = std::move(records);
  gather(vertices_, order.vertices);
  gather(points_, order.vertices);
  gather(faces_, order.faces);
  for (std::uint32_t& h : vertices_) h = halfedge_of(h);
  for (std::uint32_t& h : faces_) h = halfedge_of(h);
  vertex_properties_.gather(order.vertices);
  halfedge_properties_.gather(halfedge_order);
  edge_properties_.gather(order.edges);
  face_properties_.gather(order.faces);
  removed_vertices_ = removed_edges_ = removed_faces_ = 0;
  ++stamp_;
}

void SurfaceMesh::garbage_collection() {
  if (!has_removed()) return;
  const auto only_last_ones = [&](std::size_t count, auto handle) {
    for (std::uint32_t i = 0; i < count; ++i) {
      if (is_removed(decltype(handle)(i))) return false;
    }
    return true;
  };
  const std::size_t vertices_left = vertex_count(), edges_left = edge_count(), faces_left = face_count();
  if (!only_last_ones(vertices_left, VertexHandle()) || !only_last_ones(edges_left, EdgeHandle()) ||
      !only_last_ones(faces_left, FaceHandle())) {
    return renumber({numbers(vertices()), numbers(edges()), numbers(faces())});
  }
  // Nothing refers to the last ones.
  vertices_.resize(vertices_left);
  points_.resize(vertices_left);
  halfedges_.resize(2 * edges_left);
  faces_.resize(faces_left);
  vertex_properties_.resize(vertices_.size());
  halfedge_properties_.resize(halfedges_.size());
  edge_properties_.resize(edge_slots());
  face_properties_.resize(faces_.size());
  removed_vertices_ = removed_edges_ = removed_faces_ = 0;
  ++stamp_;
}

Reordering SurfaceMesh::reorder() {
  Reordering order;
  order.vertices = numbers(vertices());
  sort_along_morton_curve(points_, order.vertices);
  const std::vector<std::uint32_t> vertex_of = inverse(order.vertices, vertex_slots());
  std::vector<std::uint32_t> least(face_slots());
  for (const FaceHandle f : faces()) {
    least[f.index()] = none;
    for (const VertexHandle v : vertices(f)) least[f.index()] = std::min(least[f.index()], vertex_of[v.index()]);
  }
  order.faces = numbers(faces());
  std::stable_sort(order.faces.begin(), order.faces.end(), [&](std::uint32_t a, std::uint32_t b) { return least[a] < least[b]; });
  std::vector<char> met(edge_slots(), 0);
  order.edges.reserve(edge_count());
  for (const std::uint32_t f : order.faces) {
    for (const HalfedgeHandle h : halfedges(FaceHandle(f))) {
      const std::uint32_t e = edge(h).index();
      if (!met[e]) order.edges.push_back(e);
      met[e] = 1;
    }
  }
  renumber(order);
  return order;
}

void SurfaceMesh::check() const {
  const auto require = [](bool holds, const char* what, std::uint32_t index) {
    if (!holds) throw Error(ErrorCode::internal, "half-edge mesh: " + std::string(what) + " at " + std::to_string(index));
  };
  std::vector<std::uint32_t> incoming(vertex_slots(), 0), sides(face_slots(), 0);
  std::vector<char> followed(halfedge_slots(), 0);
  for (const HalfedgeHandle h : halfedges()) {
    const std::uint32_t i = h.index();
    require(!is_removed(opposite(h)), "an edge is removed on one side only", i);
    require(next(h).index() < halfedge_slots() && !is_removed(next(h)), "next half-edge that is not there", i);
    require(!followed[next(h).index()]++, "two half-edges have the same next", i);
    require(target(h).index() < vertex_slots() && !is_removed(target(h)), "target that is not there", i);
    require(source(next(h)) == target(h), "the next half-edge starts elsewhere", i);
    require(source(h) != target(h), "half-edge from a vertex to itself", i);
    require(face(next(h)) == face(h), "the next half-edge has another face", i);
    require(!is_boundary(h) || !is_boundary(opposite(h)), "edge without faces", i);
    ++incoming[target(h).index()];
    if (is_boundary(h)) {
      require(is_boundary(halfedge(source(h))), "boundary vertex whose half-edge has a face", source(h).index());
      continue;
    }
    require(face(h).index() < face_slots() && !is_removed(face(h)), "face that is not there", i);
    ++sides[face(h).index()];
  }
  for (const VertexHandle v : vertices()) {
    require(is_isolated(v) || source(halfedge(v)) == v, "vertex with the half-edge of another", v.index());
    require(valence(v) == incoming[v.index()], "vertex that is not circulated whole", v.index());
  }
  for (const FaceHandle f : faces()) {
    require(face(halfedge(f)) == f, "face with the half-edge of another", f.index());
    require(sides[f.index()] >= 3 && degree(f) == sides[f.index()], "face that is not circulated whole", f.index());
  }
}

}  // namespace deform
