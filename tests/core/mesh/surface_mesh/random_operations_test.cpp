// SPDX-License-Identifier: GPL-3.0-or-later
// Random operations on small meshes: after each of them the half-edges are consistent and the faces are those of the model.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <random>
#include <string>

#include "core/base/error.h"
#include "core/mesh/surface_mesh/surface_mesh.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/core/mesh/surface_mesh/face_sets.h"
#include "tests/support/long_tests.h"

namespace deform::random_operations_test {
namespace {

using test::Corners;
using test::FaceSets;

constexpr std::size_t most_faces = 60;

class RandomOperations {
 public:
  RandomOperations(const Mesh& start, bool triangles_only, unsigned seed)
      : mesh_(start), triangles_only_(triangles_only), random_(seed), tags_(mesh_.add_property<VertexHandle, int>("tag", -1)) {
    model_ = test::face_sets(mesh_);
    for (const VertexHandle v : mesh_.vertices()) tag(v);
  }

  void step() {
    const bool large = mesh_.face_count() > most_faces, small = mesh_.face_count() < 8;
    switch (pick(large ? 6 : 12)) {
      case 0:
      case 1:
      case 2:
        return small ? add_face() : collapse();
      case 3:
        return small ? split_face() : remove();
      case 4:
        return flip();
      case 5:
        return pick(10) == 0 ? renumber() : flip();
      case 6:
        return split_edge();
      case 7:
        return split_face();
      case 8:
        return cut_face();
      case 9:
        return add_vertex();
      default:
        return add_face();
    }
  }

  void verify() {
    mesh_.check();
    ASSERT_TRUE(test::face_sets(mesh_) == model_);
    ASSERT_EQ(mesh_.vertex_count(), model_.vertices.size());
    ASSERT_EQ(mesh_.face_count(), model_.faces.size());
    for (const VertexHandle v : mesh_.vertices()) ASSERT_EQ(tags_[v], tag_of_[v.index()]) << v.index();
  }

  /// How often each operation was done, and how often its condition forbade it.
  std::map<std::string, std::size_t> counts;

 private:
  std::size_t pick(std::size_t count) { return std::uniform_int_distribution<std::size_t>(0, count - 1)(random_); }
  Vec3 somewhere() { return {static_cast<double>(pick(1000)), static_cast<double>(pick(1000)), static_cast<double>(pick(1000))}; }
  void tag(VertexHandle v) { tags_[v] = tag_of_[v.index()] = next_tag_++; }

  HalfedgeHandle any_halfedge() {
    if (mesh_.edge_count() == 0) return {};
    for (;;) {
      const HalfedgeHandle h(static_cast<std::uint32_t>(pick(mesh_.halfedge_slots())));
      if (!mesh_.is_removed(h)) return h;
    }
  }
  FaceHandle any_face() {
    if (mesh_.face_count() == 0) return {};
    for (;;) {
      const FaceHandle f(static_cast<std::uint32_t>(pick(mesh_.face_slots())));
      if (!mesh_.is_removed(f)) return f;
    }
  }
  Corners corners(FaceHandle f) const {
    Corners found;
    for (const VertexHandle v : mesh_.vertices(f)) found.push_back(v.index());
    return test::canonical(found);
  }
  /// The face of the model along a -> b, or nothing.
  Corners along(std::uint32_t a, std::uint32_t b) const {
    const auto edges = *test::directed_edges(model_);
    const auto found = edges.find({a, b});
    return found == edges.end() ? Corners() : found->second;
  }
  static std::uint32_t third(const Corners& face, std::uint32_t a, std::uint32_t b) {
    return *std::find_if(face.begin(), face.end(), [&](std::uint32_t v) { return v != a && v != b; });
  }

  void collapse() {
    const HalfedgeHandle h = any_halfedge();
    if (!h.valid()) return;
    const std::uint32_t a = mesh_.source(h).index(), b = mesh_.target(h).index();
    const FaceSets after = test::collapsed(model_, a, b);
    const bool allowed = mesh_.can_collapse(h);
    if (triangles_only_) {
      ASSERT_EQ(allowed, test::meets_link_condition(model_, a, b)) << a << " -> " << b;
    }
    std::size_t triangles = 0;
    for (const Corners& side : {along(a, b), along(b, a)}) triangles += side.size() == 3;
    const bool same = after.faces.size() + triangles == model_.faces.size() && test::is_manifold(after) &&
                      test::topology(after) == test::topology(model_);
    ASSERT_EQ(allowed, same) << a << " -> " << b;
    ++counts[allowed ? "collapse" : "collapse refused"];
    if (!allowed) return;
    mesh_.collapse(h);
    model_ = after;
  }

  void flip() {
    const HalfedgeHandle h = any_halfedge();
    if (!h.valid()) return;
    const std::uint32_t a = mesh_.source(h).index(), b = mesh_.target(h).index();
    const Corners left = along(a, b), right = along(b, a);
    bool expected = left.size() == 3 && right.size() == 3;
    if (expected) {
      const std::uint32_t c = third(left, a, b), d = third(right, a, b);
      expected = c != d && along(c, d).empty() && along(d, c).empty();
    }
    ASSERT_EQ(mesh_.can_flip(SurfaceMesh::edge(h)), expected);
    ++counts[expected ? "flip" : "flip refused"];
    if (!expected) return;
    const std::uint32_t c = third(left, a, b), d = third(right, a, b);
    mesh_.flip(SurfaceMesh::edge(h));
    model_.faces.erase(left);
    model_.faces.erase(right);
    model_.faces.insert(test::canonical({c, a, d}));
    model_.faces.insert(test::canonical({d, b, c}));
  }

  void split_edge() {
    const HalfedgeHandle h = any_halfedge();
    if (!h.valid()) return;
    const std::uint32_t a = mesh_.source(h).index(), b = mesh_.target(h).index();
    const VertexHandle v = mesh_.split(SurfaceMesh::edge(h), somewhere());
    tag(v);
    for (const auto& [from, to] : {std::pair(a, b), std::pair(b, a)}) {
      Corners face = along(from, to);
      if (face.empty()) continue;
      model_.faces.erase(face);
      if (face.size() == 3) {
        const std::uint32_t apex = third(face, a, b);
        model_.faces.insert(test::canonical({from, v.index(), apex}));
        model_.faces.insert(test::canonical({v.index(), to, apex}));
      } else {
        face.insert(std::find(face.begin(), face.end(), from) + 1, v.index());
        model_.faces.insert(test::canonical(face));
      }
    }
    model_.vertices.insert(v.index());
    ++counts["split edge"];
  }

  void split_face() {
    const FaceHandle f = any_face();
    if (!f.valid()) return;
    const Corners face = corners(f);
    const VertexHandle v = mesh_.split(f, somewhere());
    tag(v);
    model_.faces.erase(face);
    for (std::size_t i = 0; i < face.size(); ++i) {
      model_.faces.insert(test::canonical({face[i], face[(i + 1) % face.size()], v.index()}));
    }
    model_.vertices.insert(v.index());
    ++counts["split face"];
  }

  void cut_face() {
    const FaceHandle f = any_face();
    if (!f.valid() || mesh_.is_triangle(f)) return;
    std::vector<HalfedgeHandle> sides;
    for (const HalfedgeHandle h : mesh_.halfedges(f)) sides.push_back(h);
    const HalfedgeHandle from = sides[pick(sides.size())], to = mesh_.next(mesh_.next(from));
    const std::uint32_t a = mesh_.target(from).index(), b = mesh_.target(to).index();
    if (!along(a, b).empty() || !along(b, a).empty()) return;
    const Corners face = corners(f);
    const std::uint32_t between = mesh_.target(mesh_.next(from)).index();
    mesh_.split(from, to);
    model_.faces.erase(face);
    model_.faces.insert(test::canonical({a, between, b}));
    Corners rest = face;
    std::erase(rest, between);
    model_.faces.insert(test::canonical(rest));
    ++counts["cut face"];
  }

  void add_vertex() {
    if (mesh_.vertex_count() > most_faces) return;
    const VertexHandle v = mesh_.add_vertex(somewhere());
    tag(v);
    model_.vertices.insert(v.index());
    ++counts["add vertex"];
  }

  // Beside a boundary edge or on its own, with corners that leave the surface a manifold.
  void add_face() {
    std::vector<std::uint32_t> all(model_.vertices.begin(), model_.vertices.end());
    if (all.size() < 4) return add_vertex();
    for (int attempt = 0; attempt < 8; ++attempt) {
      std::vector<std::uint32_t> chosen;
      const HalfedgeHandle h = any_halfedge();
      if (h.valid() && mesh_.is_boundary(h)) {
        chosen = {mesh_.source(h).index(), mesh_.target(h).index()};
        if (pick(2) == 0) chosen.push_back(mesh_.target(mesh_.next(h)).index());
      }
      const std::size_t degree = triangles_only_ || pick(2) == 0 ? 3 : 4;
      while (chosen.size() < degree) chosen.push_back(all[pick(all.size())]);
      FaceSets after = model_;
      const bool is_new = after.faces.insert(test::canonical(chosen)).second;
      std::vector<VertexHandle> handles;
      for (const std::uint32_t v : chosen) handles.emplace_back(v);
      if (!is_new || !test::is_manifold(after)) {
        if (test::directed_edges(after) && is_new) continue;  // another fan, which is allowed on the way
        const std::size_t slots = mesh_.halfedge_slots();
        EXPECT_THROW(mesh_.add_face(handles), Error);
        ASSERT_EQ(mesh_.halfedge_slots(), slots);
        ++counts["add face refused"];
        continue;
      }
      mesh_.add_face(handles);
      model_ = after;
      ++counts["add face"];
      return;
    }
  }

  void remove() {
    const FaceHandle f = any_face();
    if (!f.valid()) return;
    const VertexHandle v = mesh_.target(mesh_.halfedge(f));
    const std::size_t kind = pick(3);
    FaceSets after = model_;
    if (kind == 0) after.faces.erase(corners(f));
    if (kind == 1) {
      std::erase_if(after.faces,
                    [&](const Corners& face) { return std::find(face.begin(), face.end(), v.index()) != face.end(); });
      after.vertices.erase(v.index());
    }
    const HalfedgeHandle h = mesh_.halfedge(f);
    if (kind == 2) {
      after.faces.erase(along(mesh_.source(h).index(), v.index()));
      after.faces.erase(along(v.index(), mesh_.source(h).index()));
    }
    if (!test::is_manifold(after)) return;
    if (kind == 0) mesh_.remove(f);
    if (kind == 1) mesh_.remove(v);
    if (kind == 2) mesh_.remove(SurfaceMesh::edge(h));
    model_ = after;
    ++counts["remove"];
  }

  // Properties of all kinds follow.
  void renumber() {
    auto ends = mesh_.add_property<EdgeHandle, int>("ends", -1);
    auto to = mesh_.add_property<HalfedgeHandle, int>("to", -1);
    auto sum = mesh_.add_property<FaceHandle, int>("sum", -1);
    const auto ends_of = [&](EdgeHandle e) {
      return tags_[mesh_.source(SurfaceMesh::halfedge(e))] + tags_[mesh_.target(SurfaceMesh::halfedge(e))];
    };
    const auto sum_of = [&](FaceHandle f) {
      int total = 0;
      for (const VertexHandle v : mesh_.vertices(f)) total += tags_[v];
      return total;
    };
    for (const EdgeHandle e : mesh_.edges()) ends[e] = ends_of(e);
    for (const HalfedgeHandle h : mesh_.halfedges()) to[h] = tags_[mesh_.target(h)];
    for (const FaceHandle f : mesh_.faces()) sum[f] = sum_of(f);
    std::vector<std::uint32_t> order(model_.vertices.begin(), model_.vertices.end());
    std::vector<Vec3> points;
    if (pick(2) == 0) {
      for (const std::uint32_t v : order) points.push_back(mesh_.point(VertexHandle(v)));
      mesh_.garbage_collection();
    } else {
      const std::vector<Vec3> old(mesh_.points().begin(), mesh_.points().end());
      order = mesh_.reorder().vertices;
      for (const std::uint32_t v : order) points.push_back(old[v]);
    }
    ASSERT_FALSE(mesh_.has_removed());
    ASSERT_TRUE(std::equal(points.begin(), points.end(), mesh_.points().begin(), mesh_.points().end()));
    std::map<std::uint32_t, std::uint32_t> number_of;
    for (std::uint32_t i = 0; i < order.size(); ++i) number_of[order[i]] = i;
    FaceSets renumbered;
    std::map<std::uint32_t, int> tag_of;
    for (const auto& [from, number] : number_of) {
      renumbered.vertices.insert(number);
      tag_of[number] = tag_of_[from];
    }
    for (Corners face : model_.faces) {
      for (std::uint32_t& v : face) v = number_of.at(v);
      renumbered.faces.insert(test::canonical(face));
    }
    model_ = renumbered;
    tag_of_ = tag_of;
    for (const EdgeHandle e : mesh_.edges()) ASSERT_EQ(ends[e], ends_of(e));
    for (const HalfedgeHandle h : mesh_.halfedges()) ASSERT_EQ(to[h], tags_[mesh_.target(h)]);
    for (const FaceHandle f : mesh_.faces()) ASSERT_EQ(sum[f], sum_of(f));
    mesh_.remove_property(ends);
    mesh_.remove_property(to);
    mesh_.remove_property(sum);
    ++counts["renumber"];
  }

  SurfaceMesh mesh_;
  FaceSets model_;
  bool triangles_only_;
  std::mt19937 random_;
  Property<VertexHandle, int> tags_;
  std::map<std::uint32_t, int> tag_of_;
  int next_tag_ = 0;
};

std::size_t operations() { return test::long_tests() ? 1000000 : 20000; }

void run(const std::vector<Mesh>& starts, bool triangles_only) {
  std::map<std::string, std::size_t> counts;
  const std::size_t steps = operations() / starts.size();
  for (std::size_t s = 0; s < starts.size(); ++s) {
    RandomOperations operations(starts[s], triangles_only, static_cast<unsigned>(s + 1));
    for (std::size_t i = 0; i < steps; ++i) {
      SCOPED_TRACE("mesh " + std::to_string(s) + ", operation " + std::to_string(i));
      ASSERT_NO_THROW(operations.step());
      ASSERT_NO_FATAL_FAILURE(operations.verify());
      if (testing::Test::HasFailure()) return;
    }
    for (const auto& [name, count] : operations.counts) counts[name] += count;
  }
  // Nothing is only refused.
  for (const char* name : {"collapse", "collapse refused", "flip", "flip refused", "split edge", "split face", "add vertex",
                           "add face", "add face refused", "remove", "renumber"}) {
    EXPECT_GT(counts[name], steps / 500) << name;
  }
}

TEST(SurfaceMeshRandom, OperationsOnTriangles) {
  Mesh grid = test::quad_grid(3, 3), triangles;
  triangles.points = grid.points;
  for (std::size_t f = 0; f < grid.face_count(); ++f) {
    const PointId* c = &grid.face_points[4 * f];
    triangles.face_sizes.insert(triangles.face_sizes.end(), {3, 3});
    triangles.face_points.insert(triangles.face_points.end(), {c[0], c[1], c[2], c[0], c[2], c[3]});
  }
  run({test::tetrahedron(), triangles, test::one_ring(), test::with_loose_points()}, true);
}

TEST(SurfaceMeshRandom, OperationsOnPolygons) { run({test::quad_grid(3, 2), test::tetrahedron(), test::quad_grid(1, 1)}, false); }

}  // namespace
}  // namespace deform::random_operations_test
