// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/core/mesh/remeshing/decimation.h"

#include <array>
#include <queue>
#include <string>
#include <tuple>
#include <vector>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/mesh/remeshing/triangles.h"

namespace deform {

namespace {

/// x^T A x + 2 b^T x + c: squared distances from planes, times weights. A is symmetric: xx, xy, xz, yy, yz, zz.
struct Quadric {
  std::array<double, 6> A{};
  Vec3 b{};
  double c = 0;

  void add(const Quadric& other) {
    for (std::size_t i = 0; i < 6; ++i) A[i] += other.A[i];
    b = b + other.b;
    c += other.c;
  }
  double operator()(const Vec3& x) const {
    const Vec3 Ax{A[0] * x[0] + A[1] * x[1] + A[2] * x[2], A[1] * x[0] + A[3] * x[1] + A[4] * x[2],
                  A[2] * x[0] + A[4] * x[1] + A[5] * x[2]};
    return dot(x, Ax) + 2 * dot(b, x) + c;
  }
};

/// The quadric of the plane through p with the area normal n.
Quadric plane_quadric(const Vec3& n, const Vec3& p) {
  const double area = length(n);
  if (area == 0) return {};
  const Vec3 unit = n / area;
  const double d = -dot(unit, p);
  Quadric q{{unit[0] * unit[0], unit[0] * unit[1], unit[0] * unit[2], unit[1] * unit[1], unit[1] * unit[2], unit[2] * unit[2]},
            d * unit,
            d * d};
  for (double& a : q.A) a *= area;
  q.b = area * q.b;
  q.c *= area;
  return q;
}

class Decimation {
 public:
  explicit Decimation(const SurfaceMesh& input)
      : mesh_(input), middle_(middle()), quadrics_(mesh_.vertex_slots()), versions_(mesh_.vertex_slots(), 0) {
    for (const FaceHandle f : mesh_.faces()) {
      const Quadric plane = plane_quadric(area_normal(mesh_, f), place(mesh_.target(mesh_.halfedge(f))));
      for (const VertexHandle v : mesh_.vertices(f)) quadrics_[v.index()].add(plane);
    }
    for (const VertexHandle v : mesh_.vertices()) enqueue(v);
  }

  SurfaceMesh run(std::size_t vertices) {
    while (mesh_.vertex_count() > vertices && !queue_.empty()) {
      const Candidate best = queue_.top();
      queue_.pop();
      const HalfedgeHandle h(best.halfedge);
      const VertexHandle v0(best.source);
      if (versions_[best.source] != best.version) continue;
      const VertexHandle v1 = mesh_.target(h);
      quadrics_[v1.index()].add(quadrics_[v0.index()]);
      ++versions_[best.source];
      mesh_.collapse(h);
      enqueue(v1);
      for (const VertexHandle v : mesh_.neighbours(v1)) enqueue(v);
    }
    mesh_.garbage_collection();
    return std::move(mesh_);
  }

 private:
  /// The best collapse of a vertex; out of date when the version of the vertex is another.
  struct Candidate {
    double cost;
    std::uint32_t source, halfedge, version;
    bool operator<(const Candidate& other) const { return std::tie(other.cost, other.source) < std::tie(cost, source); }
  };

  // Quadrics lose digits far from the origin.
  Vec3 middle() const {
    const Box box = bounding_box(mesh_.points());
    return 0.5 * (box.min + box.max);
  }
  Vec3 place(VertexHandle v) const { return mesh_.point(v) - middle_; }

  void enqueue(VertexHandle v) {
    Candidate best{0, v.index(), 0, ++versions_[v.index()]};
    bool found = false;
    for (const HalfedgeHandle h : mesh_.outgoing(v)) {
      const VertexHandle target = mesh_.target(h);
      const Vec3 x = place(target);
      const double cost = quadrics_[v.index()](x) + quadrics_[target.index()](x);
      if (found && cost >= best.cost) continue;
      if (!mesh_.can_collapse(h) || would_fold(mesh_, h, mesh_.point(target))) continue;
      best.cost = cost;
      best.halfedge = h.index();
      found = true;
    }
    if (found) queue_.push(best);
  }

  SurfaceMesh mesh_;
  Vec3 middle_;
  std::vector<Quadric> quadrics_;
  std::vector<std::uint32_t> versions_;
  std::priority_queue<Candidate> queue_;
};

}  // namespace

SurfaceMesh decimated(const SurfaceMesh& mesh, std::size_t vertices) {
  if (vertices < 4)
    throw Error(ErrorCode::invalid_argument, "vertices: a closed surface has 4 or more, not " + std::to_string(vertices));
  check_closed_triangles(mesh);
  return Decimation(mesh).run(vertices);
}

}  // namespace deform
