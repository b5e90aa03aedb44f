// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/surface_mesh/one_rings.h"
#include "core/mesh/surface_mesh/surface_mesh.h"
#include "tests/bench/connectivity_tests.h"

namespace deform::bench {
namespace {

/// What the tests read: the circulators of the mesh, or its one-rings.
struct Circulators {
  explicit Circulators(const SurfaceMesh& of) : mesh(of) {}
  auto neighbours(VertexHandle v) const { return mesh.neighbours(v); }
  auto faces(VertexHandle v) const { return mesh.faces(v); }
  auto corners(FaceHandle f) const { return mesh.vertices(f); }
  bool is_boundary(VertexHandle v) const { return mesh.is_boundary(v); }
  const SurfaceMesh& mesh;
};

// The points of a mesh of which nothing is removed are one array; two of them fill three registers.
using Pair = std::array<double, 6>;

Vec3 sum_of(std::span<const Vec3> points) {
  Pair sums{};
  const std::size_t pairs = points.size() / 2;
  for (std::size_t i = 0; i < pairs; ++i) {
    for (std::size_t k = 0; k < 6; ++k) sums[k] += points[2 * i + k / 3][k % 3];
  }
  Vec3 sum{sums[0] + sums[3], sums[1] + sums[4], sums[2] + sums[5]};
  if (points.size() % 2 == 1) sum = sum + points.back();
  return sum;
}

void subtract(const Vec3& centre, std::span<Vec3> points) {
  const Pair both{centre[0], centre[1], centre[2], centre[0], centre[1], centre[2]};
  const std::size_t pairs = points.size() / 2;
  for (std::size_t i = 0; i < pairs; ++i) {
    for (std::size_t k = 0; k < 6; ++k) points[2 * i + k / 3][k % 3] -= both[k];
  }
  if (points.size() % 2 == 1) points.back() = points.back() - centre;
}

template <typename View>
class OwnTests final : public ConnectivityTests {
 public:
  explicit OwnTests(const Mesh& mesh)
      : mesh_(mesh),
        vertex_normals_(mesh_.add_property<VertexHandle, Vec3>("normal")),
        face_normals_(mesh_.add_property<FaceHandle, Vec3>("normal")) {}

  double circulators(int times) override {
    const View view(mesh_);
    std::uint64_t sum = 0;
    for (int i = 0; i < times; ++i) {
      for (const VertexHandle v : mesh_.vertices()) {
        for (const FaceHandle f : view.faces(v)) sum += f.index();
      }
      for (const FaceHandle f : mesh_.faces()) {
        for (const VertexHandle v : view.corners(f)) sum += v.index();
      }
    }
    return static_cast<double>(sum);
  }

  double barycentre(int times) override {
    Vec3 sum{};
    for (int i = 0; i < times; ++i) {
      sum = sum_of(mesh_.points());
      subtract(sum / static_cast<double>(mesh_.vertex_count()), mesh_.points());
    }
    return sum[0] + sum[1] + sum[2];
  }

  double normals(int times) override {
    const View view(mesh_);
    for (int i = 0; i < times; ++i) {
      for (const FaceHandle f : mesh_.faces()) {
        auto corner = view.corners(f).begin();
        const Vec3& a = mesh_.point(*corner);
        const Vec3& b = mesh_.point(*++corner);
        const Vec3& c = mesh_.point(*++corner);
        const Vec3 n = cross(b - a, c - a);
        face_normals_[f] = n / length(n);
      }
      for (const VertexHandle v : mesh_.vertices()) {
        Vec3 n{};
        for (const FaceHandle f : view.faces(v)) n = n + face_normals_[f];
        vertex_normals_[v] = n / length(n);
      }
    }
    double sum = 0;
    for (const VertexHandle v : mesh_.vertices()) sum += vertex_normals_[v][0] * v.index();
    return sum;
  }

  double smoothing(int times) override {
    const View view(mesh_);
    for (int i = 0; i < times; ++i) {
      for (const VertexHandle v : mesh_.vertices()) {
        if (view.is_boundary(v)) continue;
        Vec3 sum{};
        double count = 0;
        for (const VertexHandle w : view.neighbours(v)) {
          sum = sum + mesh_.point(w);
          ++count;
        }
        mesh_.set_point(v, sum / count);
      }
    }
    double sum = 0;
    for (const VertexHandle v : mesh_.vertices()) sum += mesh_.point(v)[0] * v.index();
    return sum;
  }

  void copy() override { copy_ = mesh_; }

  double subdivide() override {
    SurfaceMesh& m = copy_;
    const std::size_t nv = m.vertex_slots(), ne = m.edge_slots(), nf = m.face_slots();
    m.reserve(nv + nf, ne + 3 * nf, 3 * nf);
    Points moved(nv);
    for (const VertexHandle v : m.vertices()) {
      Vec3 sum{};
      std::size_t n = 0;
      for (const VertexHandle w : m.neighbours(v)) {
        sum = sum + m.point(w);
        ++n;
      }
      const double a = sqrt3_weight(n);
      moved[v.index()] = (1 - a) * m.point(v) + (a / static_cast<double>(n)) * sum;
    }
    for (std::uint32_t f = 0; f < nf; ++f) {
      Vec3 sum{};
      for (const VertexHandle v : m.vertices(FaceHandle(f))) sum = sum + m.point(v);
      m.split(FaceHandle(f), sum / 3);
    }
    for (std::uint32_t v = 0; v < nv; ++v) m.set_point(VertexHandle(v), moved[v]);
    for (std::uint32_t e = 0; e < ne; ++e) m.flip(EdgeHandle(e));
    double sum = 0;
    for (const VertexHandle v : m.vertices()) sum += m.point(v)[0] * v.index();
    return sum;
  }

  double collapse() override {
    SurfaceMesh& m = copy_;
    const std::size_t nv = m.vertex_slots(), ne = m.edge_slots(), nf = m.face_slots();
    m.reserve(nv + nf, ne + 3 * nf, 3 * nf);
    for (std::uint32_t f = 0; f < nf; ++f) m.split(FaceHandle(f), {});
    for (auto v = static_cast<std::uint32_t>(nv); v < nv + nf; ++v) m.collapse(m.halfedge(VertexHandle(v)));
    m.garbage_collection();
    return static_cast<double>(m.vertex_count() + m.edge_count() + m.face_count());
  }

 private:
  SurfaceMesh mesh_, copy_;
  Property<VertexHandle, Vec3> vertex_normals_;
  Property<FaceHandle, Vec3> face_normals_;
};

}  // namespace

std::unique_ptr<ConnectivityTests> own_tests(const Mesh& mesh) { return std::make_unique<OwnTests<OneRings>>(mesh); }
std::unique_ptr<ConnectivityTests> own_circulators(const Mesh& mesh) { return std::make_unique<OwnTests<Circulators>>(mesh); }

}  // namespace deform::bench
