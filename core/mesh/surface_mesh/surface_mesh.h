// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <memory>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/base/types.h"
#include "core/mesh/mesh.h"
#include "core/mesh/surface_mesh/handles.h"
#include "core/mesh/surface_mesh/properties.h"

namespace deform {

class OneRings;
class SurfaceMesh;
template <typename HandleType>
class EntityRange;
template <typename Step>
class CirculatorRange;
struct OutgoingStep;
struct NeighbourStep;
struct FaceAroundVertexStep;
struct HalfedgeOfFaceStep;
struct VertexOfFaceStep;

/// A renumbering of entities: entry i of a list is the former index of entity i.
struct Reordering {
  std::vector<std::uint32_t> vertices, edges, faces;
};

/// A polygonal 2-manifold with or without boundary as half-edges in arrays (thesis appendix A; D. Sieger, M. Botsch, Design,
/// implementation, and evaluation of the Surface_mesh data structure, 2011), for algorithms that change connectivity.
///
/// Half-edges 2 e and 2 e + 1 are the opposite directions of edge e. A half-edge stores its target, the next half-edge of its
/// face or hole, and the face to its left, which is none on the boundary. A vertex stores one outgoing half-edge, one on the
/// boundary if it has one; none if it is isolated. The previous half-edge is not stored, so a closed triangle mesh with points
/// and normals of vertices and faces in double precision takes 180 bytes per vertex.
///
///   SurfaceMesh mesh(input);                                      // throws if not manifold
///   auto weight = mesh.add_property<EdgeHandle, double>("weight", 1.0);
///   for (const VertexHandle v : mesh.vertices())
///     for (const VertexHandle w : mesh.neighbours(v)) ...
///   if (mesh.can_collapse(h)) mesh.collapse(h);                   // marks as removed
///   mesh.garbage_collection();                                    // invalidates handles
///
/// Removed entities keep their indices until garbage_collection(); ranges skip them, even if they are removed during the
/// loop. Any number of threads may call const members while none calls others. Handles must be valid and not removed
/// (undefined otherwise).
class SurfaceMesh {
 public:
  SurfaceMesh() = default;
  /// Takes the points and faces of a mesh and keeps their numbers. Throws Error(invalid_argument) if mesh.validate() does, and if
  /// the faces are not a 2-manifold, naming the edge as paired_corners() does or the vertex whose faces form more than one fan.
  explicit SurfaceMesh(const Mesh& mesh);
  /// Returns points and faces, without groups. Vertices and faces keep their numbers; throws Error(failed_precondition) if there
  /// are removed entities.
  Mesh to_mesh() const;

  // The number of entities that are not removed, and the number of slots, an upper bound of all indices.
  std::size_t vertex_count() const { return vertices_.size() - removed_vertices_; }
  std::size_t edge_count() const { return edge_slots() - removed_edges_; }
  std::size_t face_count() const { return faces_.size() - removed_faces_; }
  std::size_t vertex_slots() const { return vertices_.size(); }
  std::size_t halfedge_slots() const { return halfedges_.size(); }
  std::size_t edge_slots() const { return halfedges_.size() / 2; }
  std::size_t face_slots() const { return faces_.size(); }
  bool has_removed() const { return (removed_vertices_ | removed_edges_ | removed_faces_) != 0; }
  bool is_removed(VertexHandle v) const { return vertices_[v.index()] == removed; }
  bool is_removed(HalfedgeHandle h) const { return halfedges_[h.index()].target == removed; }
  bool is_removed(EdgeHandle e) const { return is_removed(halfedge(e)); }
  bool is_removed(FaceHandle f) const { return faces_[f.index()] == removed; }
  /// Changes with every change of connectivity.
  std::uint64_t topology_stamp() const { return stamp_; }
  /// Bytes of the arrays and all properties, without one_rings().
  std::size_t bytes() const;
  /// Reserves memory for this total number of entities.
  void reserve(std::size_t vertices, std::size_t edges, std::size_t faces);

  // Relations.
  HalfedgeHandle next(HalfedgeHandle h) const { return HalfedgeHandle(halfedges_[h.index()].next); }
  /// Found by walking around the face, or around the source on the boundary.
  HalfedgeHandle previous(HalfedgeHandle h) const;
  static HalfedgeHandle opposite(HalfedgeHandle h) { return HalfedgeHandle(h.index() ^ 1); }
  VertexHandle target(HalfedgeHandle h) const { return VertexHandle(halfedges_[h.index()].target); }
  VertexHandle source(HalfedgeHandle h) const { return target(opposite(h)); }
  FaceHandle face(HalfedgeHandle h) const { return FaceHandle(halfedges_[h.index()].face); }  ///< invalid on the boundary
  HalfedgeHandle halfedge(VertexHandle v) const { return HalfedgeHandle(vertices_[v.index()]); }
  HalfedgeHandle halfedge(FaceHandle f) const { return HalfedgeHandle(faces_[f.index()]); }
  static HalfedgeHandle halfedge(EdgeHandle e) { return HalfedgeHandle(2 * e.index()); }
  static EdgeHandle edge(HalfedgeHandle h) { return EdgeHandle(h.index() / 2); }
  /// The next outgoing half-edge of the source, clockwise seen from outside.
  HalfedgeHandle rotated(HalfedgeHandle h) const { return next(opposite(h)); }
  /// The half-edge from a to b; invalid if there is no such edge.
  HalfedgeHandle find_halfedge(VertexHandle a, VertexHandle b) const;
  bool is_boundary(HalfedgeHandle h) const { return halfedges_[h.index()].face == none; }
  bool is_boundary(EdgeHandle e) const { return is_boundary(halfedge(e)) || is_boundary(opposite(halfedge(e))); }
  /// Isolated vertices count as boundary.
  bool is_boundary(VertexHandle v) const { return is_isolated(v) || is_boundary(halfedge(v)); }
  bool is_isolated(VertexHandle v) const { return vertices_[v.index()] == none; }
  std::size_t valence(VertexHandle v) const;  ///< number of edges
  std::size_t degree(FaceHandle f) const;     ///< number of corners
  bool is_triangle(FaceHandle f) const { return next(next(next(halfedge(f)))) == halfedge(f); }

  // Ranges in ascending order, and around an entity: clockwise around vertices, counter-clockwise around faces.
  EntityRange<VertexHandle> vertices() const;
  EntityRange<HalfedgeHandle> halfedges() const;
  EntityRange<EdgeHandle> edges() const;
  EntityRange<FaceHandle> faces() const;
  CirculatorRange<OutgoingStep> outgoing(VertexHandle v) const;
  CirculatorRange<NeighbourStep> neighbours(VertexHandle v) const;
  CirculatorRange<FaceAroundVertexStep> faces(VertexHandle v) const;
  CirculatorRange<HalfedgeOfFaceStep> halfedges(FaceHandle f) const;
  CirculatorRange<VertexOfFaceStep> vertices(FaceHandle f) const;
  /// The one-rings as compressed rows; sweeps over the whole mesh are several times faster with them than with circulators.
  /// Rebuilt if connectivity has changed since the last call; the reference is valid until it changes.
  const OneRings& one_rings();

  // Geometry. points() includes the slots of removed vertices.
  const Vec3& point(VertexHandle v) const { return points_[v.index()]; }
  void set_point(VertexHandle v, const Vec3& x) { points_[v.index()] = x; }
  std::span<const Vec3> points() const { return points_; }
  std::span<Vec3> points() { return points_; }

  // Properties of one kind of entity: add_property<FaceHandle, Vec3>("normal", {}). See PropertySet.
  template <typename HandleType, typename T>
  Property<HandleType, T> add_property(const std::string& name, T initial = {}) {
    PropertySet& properties = properties_of<HandleType>();
    properties.grow(slots_of<HandleType>());
    return Property<HandleType, T>(properties.template add<T>(name, std::move(initial)));
  }
  /// Returns an invalid property if there is none of this name; throws Error(invalid_argument) if it has another type.
  template <typename HandleType, typename T>
  Property<HandleType, T> find_property(const std::string& name) {
    return Property<HandleType, T>(properties_of<HandleType>().template find<T>(name));
  }
  template <typename HandleType, typename T>
  void remove_property(Property<HandleType, T>& property) {
    properties_of<HandleType>().remove(property.name());
    property = {};
  }

  // Changes of connectivity.
  VertexHandle add_vertex(const Vec3& point);
  /// Adds a face with these corners, counter-clockwise seen from outside. Throws Error(invalid_argument) naming the edge or
  /// vertex, and leaves the mesh unchanged, for fewer than three corners, a repeated corner, an edge that already has a face on
  /// this side, or a vertex without a gap for the face. A vertex may have several fans while a mesh is being built.
  FaceHandle add_face(std::span<const VertexHandle> corners);
  /// Removes a face and the edges that have no other face; their vertices may become isolated. The remaining faces may meet in a
  /// single vertex.
  void remove(FaceHandle f);
  void remove(EdgeHandle e);    ///< with its faces
  void remove(VertexHandle v);  ///< with its faces
  /// Whether the edge has two triangles whose opposite corners are not connected yet.
  bool can_flip(EdgeHandle e) const;
  /// Makes the edge connect the opposite corners of its two triangles. Requires can_flip(e).
  void flip(EdgeHandle e);
  /// The link condition (T. K. Dey, H. Edelsbrunner, S. Guha, D. V. Nekhayev, Topology preserving edge contraction, 1999),
  /// extended to faces of higher degree: after the collapse the surface is a manifold of the same topology.
  bool can_collapse(HalfedgeHandle h) const;
  /// Merges the source of h into its target and removes the source, the edge and its triangles. Requires can_collapse(h).
  void collapse(HalfedgeHandle h);
  /// Inserts a vertex into the edge. Each adjacent triangle is split in two; other faces get one more corner.
  VertexHandle split(EdgeHandle e, const Vec3& point);
  /// Inserts a vertex into the face and connects it with all corners. The face keeps its first half-edge. In a triangle, the
  /// outgoing half-edge of the new vertex is opposite to the face, so that collapsing it restores the face.
  VertexHandle split(FaceHandle f, const Vec3& point);
  /// Cuts a face between the targets of two of its half-edges, which must not be neighbours in it. Returns the half-edge from the
  /// target of `from` to that of `to`; its face is the new one.
  HalfedgeHandle split(HalfedgeHandle from, HalfedgeHandle to);
  /// Drops removed entities and renumbers the others without gaps, in the same order.
  void garbage_collection();
  /// Renumbers all entities so that neighbours are close in memory: vertices along a Morton curve, faces by their smallest
  /// vertex, edges in the order of the faces. Also collects garbage. Deterministic.
  Reordering reorder();
  /// Throws Error(internal) naming the first entity with inconsistent relations. For tests and assertions.
  void check() const;

 private:
  static constexpr std::uint32_t none = 0xFFFFFFFF, removed = 0xFFFFFFFE;
  struct HalfedgeRecord {
    std::uint32_t next, target, face;
  };
  struct Link {
    HalfedgeHandle from, to;
  };

  template <typename HandleType>
  PropertySet& properties_of() {
    if constexpr (std::is_same_v<HandleType, VertexHandle>) return vertex_properties_;
    if constexpr (std::is_same_v<HandleType, HalfedgeHandle>) return halfedge_properties_;
    if constexpr (std::is_same_v<HandleType, EdgeHandle>) return edge_properties_;
    if constexpr (std::is_same_v<HandleType, FaceHandle>) return face_properties_;
  }
  template <typename HandleType>
  std::size_t slots_of() const {
    if constexpr (std::is_same_v<HandleType, VertexHandle>) return vertices_.size();
    if constexpr (std::is_same_v<HandleType, HalfedgeHandle>) return halfedges_.size();
    if constexpr (std::is_same_v<HandleType, EdgeHandle>) return edge_slots();
    if constexpr (std::is_same_v<HandleType, FaceHandle>) return faces_.size();
  }

  void link_faces(const Mesh& mesh);
  void link_boundary();
  void check_fans() const;
  HalfedgeHandle new_edge(VertexHandle source, VertexHandle target);
  FaceHandle new_face(HalfedgeHandle h);
  void set_next(HalfedgeHandle h, HalfedgeHandle next) { halfedges_[h.index()].next = next.index(); }
  void set_face(HalfedgeHandle h, FaceHandle f) { halfedges_[h.index()].face = f.index(); }
  void set_target(HalfedgeHandle h, VertexHandle v) { halfedges_[h.index()].target = v.index(); }
  void set_halfedge(VertexHandle v, HalfedgeHandle h) { vertices_[v.index()] = h.index(); }
  void set_halfedge(FaceHandle f, HalfedgeHandle h) { faces_[f.index()] = h.index(); }
  void prefer_boundary(VertexHandle v);
  void mark_removed(VertexHandle v);
  void mark_removed(EdgeHandle e);
  void mark_removed(FaceHandle f);
  HalfedgeHandle insert_vertex(EdgeHandle e, VertexHandle v);
  void merge_two_sided(HalfedgeHandle kept, HalfedgeHandle dropped);
  bool allows_collapse(HalfedgeHandle h, VertexHandle apex) const;
  bool share_other_polygon(HalfedgeHandle h) const;
  bool joins_two_faces_all_around(HalfedgeHandle h) const;
  HalfedgeHandle free_gap(HalfedgeHandle inner_previous, HalfedgeHandle inner_next) const;
  void unlink(EdgeHandle e);
  void renumber(const Reordering& order);

  // Connectivity: numbers, `none` or `removed` (of a half-edge in its target).
  std::vector<std::uint32_t> vertices_;  // an outgoing half-edge
  std::vector<HalfedgeRecord> halfedges_;
  std::vector<std::uint32_t> faces_;  // a half-edge
  std::size_t removed_vertices_ = 0, removed_edges_ = 0, removed_faces_ = 0;
  std::uint64_t stamp_ = 0;

  Points points_;
  PropertySet vertex_properties_, halfedge_properties_, edge_properties_, face_properties_;

  std::shared_ptr<const OneRings> rings_;  // built at rings_stamp_
  std::uint64_t rings_stamp_ = 0;
};

/// The entities of a kind that are not removed, ascending. Skips entities that are removed during the loop and does not visit
/// those that are added.
template <typename HandleType>
class EntityRange {
 public:
  class Iterator {
   public:
    using iterator_category = std::input_iterator_tag;
    using value_type = HandleType;
    using difference_type = std::ptrdiff_t;
    using pointer = const value_type*;
    using reference = value_type;

    Iterator(const SurfaceMesh& mesh, std::uint32_t index, std::uint32_t end) : mesh_(&mesh), index_(index), end_(end) { skip(); }
    HandleType operator*() const { return HandleType(index_); }
    Iterator& operator++() {
      ++index_;
      skip();
      return *this;
    }
    Iterator operator++(int) {
      Iterator before = *this;
      ++*this;
      return before;
    }
    bool operator==(const Iterator& other) const { return index_ == other.index_; }

   private:
    void skip() {
      if (!mesh_->has_removed()) return;
      while (index_ < end_ && mesh_->is_removed(HandleType(index_))) ++index_;
    }
    const SurfaceMesh* mesh_;
    std::uint32_t index_, end_;
  };

  EntityRange(const SurfaceMesh& mesh, std::size_t count) : mesh_(mesh), count_(static_cast<std::uint32_t>(count)) {}
  Iterator begin() const { return {mesh_, 0, count_}; }
  Iterator end() const { return {mesh_, count_, count_}; }

 private:
  const SurfaceMesh& mesh_;
  std::uint32_t count_;
};

/// The entities around a vertex or face, each once. The connectivity around it must not change during the loop.
template <typename Step>
class CirculatorRange {
 public:
  class Iterator {
   public:
    using iterator_category = std::input_iterator_tag;
    using value_type = decltype(Step::value(std::declval<const SurfaceMesh&>(), HalfedgeHandle()));
    using difference_type = std::ptrdiff_t;
    using pointer = const value_type*;
    using reference = value_type;

    Iterator(const SurfaceMesh& mesh, HalfedgeHandle start) : mesh_(&mesh), at_(start), start_(start) { skip(); }
    value_type operator*() const { return Step::value(*mesh_, at_); }
    Iterator& operator++() {
      advance();
      skip();
      return *this;
    }
    Iterator operator++(int) {
      Iterator before = *this;
      ++*this;
      return before;
    }
    bool operator==(const Iterator& other) const { return at_ == other.at_; }

   private:
    void advance() {
      at_ = Step::next(*mesh_, at_);
      if (at_ == start_) at_ = {};
    }
    void skip() {
      if constexpr (Step::skips_boundary) {
        while (at_.valid() && mesh_->is_boundary(at_)) advance();
      }
    }
    const SurfaceMesh* mesh_;
    HalfedgeHandle at_, start_;
  };

  CirculatorRange(const SurfaceMesh& mesh, HalfedgeHandle start) : mesh_(mesh), start_(start) {}
  Iterator begin() const { return {mesh_, start_}; }
  Iterator end() const { return {mesh_, {}}; }

 private:
  const SurfaceMesh& mesh_;
  HalfedgeHandle start_;
};

struct OutgoingStep {
  static constexpr bool skips_boundary = false;
  static HalfedgeHandle next(const SurfaceMesh& mesh, HalfedgeHandle h) { return mesh.rotated(h); }
  static HalfedgeHandle value(const SurfaceMesh&, HalfedgeHandle h) { return h; }
};
struct NeighbourStep : OutgoingStep {
  static VertexHandle value(const SurfaceMesh& mesh, HalfedgeHandle h) { return mesh.target(h); }
};
struct FaceAroundVertexStep : OutgoingStep {
  static constexpr bool skips_boundary = true;
  static FaceHandle value(const SurfaceMesh& mesh, HalfedgeHandle h) { return mesh.face(h); }
};
struct HalfedgeOfFaceStep {
  static constexpr bool skips_boundary = false;
  static HalfedgeHandle next(const SurfaceMesh& mesh, HalfedgeHandle h) { return mesh.next(h); }
  static HalfedgeHandle value(const SurfaceMesh&, HalfedgeHandle h) { return h; }
};
/// Starts with the target of the first half-edge of the face.
struct VertexOfFaceStep : HalfedgeOfFaceStep {
  static VertexHandle value(const SurfaceMesh& mesh, HalfedgeHandle h) { return mesh.target(h); }
};

inline EntityRange<VertexHandle> SurfaceMesh::vertices() const { return {*this, vertex_slots()}; }
inline EntityRange<HalfedgeHandle> SurfaceMesh::halfedges() const { return {*this, halfedge_slots()}; }
inline EntityRange<EdgeHandle> SurfaceMesh::edges() const { return {*this, edge_slots()}; }
inline EntityRange<FaceHandle> SurfaceMesh::faces() const { return {*this, face_slots()}; }
inline CirculatorRange<OutgoingStep> SurfaceMesh::outgoing(VertexHandle v) const { return {*this, halfedge(v)}; }
inline CirculatorRange<NeighbourStep> SurfaceMesh::neighbours(VertexHandle v) const { return {*this, halfedge(v)}; }
inline CirculatorRange<FaceAroundVertexStep> SurfaceMesh::faces(VertexHandle v) const { return {*this, halfedge(v)}; }
inline CirculatorRange<HalfedgeOfFaceStep> SurfaceMesh::halfedges(FaceHandle f) const { return {*this, halfedge(f)}; }
inline CirculatorRange<VertexOfFaceStep> SurfaceMesh::vertices(FaceHandle f) const { return {*this, halfedge(f)}; }

}  // namespace deform
