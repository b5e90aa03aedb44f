// SPDX-License-Identifier: GPL-3.0-or-later
#include <OpenMesh/Core/Mesh/PolyMesh_ArrayKernelT.hh>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <algorithm>
#include <stdexcept>
#include <vector>

#include "tests/bench/connectivity_tests.h"

namespace deform::bench {
namespace {

struct Traits : OpenMesh::DefaultTraits {
  using Point = OpenMesh::Vec3d;
  using Normal = OpenMesh::Vec3d;
  VertexAttributes(OpenMesh::Attributes::Normal | OpenMesh::Attributes::Status);
  FaceAttributes(OpenMesh::Attributes::Normal | OpenMesh::Attributes::Status);
  EdgeAttributes(OpenMesh::Attributes::Status);
};
using Triangles = OpenMesh::TriMesh_ArrayKernelT<Traits>;
using Polygons = OpenMesh::PolyMesh_ArrayKernelT<Traits>;

template <typename M>
class OpenMeshTests final : public ConnectivityTests {
  using Point = typename M::Point;

 public:
  explicit OpenMeshTests(const Mesh& input) {
    mesh_.reserve(input.point_count(), input.face_points.size() / 2, input.face_count());
    for (const Vec3& p : input.points) mesh_.add_vertex(Point(p[0], p[1], p[2]));
    std::size_t corner = 0;
    std::vector<typename M::VertexHandle> corners;
    for (const std::uint32_t size : input.face_sizes) {
      corners.clear();
      for (std::uint32_t i = 0; i < size; ++i) corners.emplace_back(static_cast<int>(input.face_points[corner++]));
      // The first half-edge decides with which corner circulators begin: as in the file.
      if (!mesh_.add_face(corners).is_valid()) throw std::runtime_error("OpenMesh refuses a face");
    }
  }

  double circulators(int times) override {
    std::uint64_t sum = 0;
    for (int i = 0; i < times; ++i) {
      for (auto v = mesh_.vertices_begin(), end = mesh_.vertices_end(); v != end; ++v) {
        for (auto f = mesh_.cvf_iter(*v); f.is_valid(); ++f) sum += static_cast<std::uint64_t>(f->idx());
      }
      for (auto f = mesh_.faces_begin(), end = mesh_.faces_end(); f != end; ++f) {
        for (auto v = mesh_.cfv_iter(*f); v.is_valid(); ++v) sum += static_cast<std::uint64_t>(v->idx());
      }
    }
    return static_cast<double>(sum);
  }

  double barycentre(int times) override {
    Point sum(0, 0, 0);
    for (int i = 0; i < times; ++i) {
      sum = Point(0, 0, 0);
      for (auto v = mesh_.vertices_begin(), end = mesh_.vertices_end(); v != end; ++v) sum += mesh_.point(*v);
      const Point centre = sum / static_cast<double>(mesh_.n_vertices());
      for (auto v = mesh_.vertices_begin(), end = mesh_.vertices_end(); v != end; ++v) mesh_.point(*v) -= centre;
    }
    return sum[0] + sum[1] + sum[2];
  }

  double normals(int times) override {
    for (int i = 0; i < times; ++i) {
      for (auto f = mesh_.faces_begin(), end = mesh_.faces_end(); f != end; ++f) {
        auto corner = mesh_.cfv_iter(*f);
        const Point& a = mesh_.point(*corner);
        const Point& b = mesh_.point(*++corner);
        const Point& c = mesh_.point(*++corner);
        const Point n = (b - a) % (c - a);
        mesh_.set_normal(*f, n / n.norm());
      }
      for (auto v = mesh_.vertices_begin(), end = mesh_.vertices_end(); v != end; ++v) {
        Point n(0, 0, 0);
        for (auto f = mesh_.cvf_iter(*v); f.is_valid(); ++f) n += mesh_.normal(*f);
        mesh_.set_normal(*v, n / n.norm());
      }
    }
    double sum = 0;
    for (const auto v : mesh_.vertices()) sum += mesh_.normal(v)[0] * v.idx();
    return sum;
  }

  double smoothing(int times) override {
    for (int i = 0; i < times; ++i) {
      for (auto v = mesh_.vertices_begin(), end = mesh_.vertices_end(); v != end; ++v) {
        if (mesh_.is_boundary(*v)) continue;
        Point sum(0, 0, 0);
        double count = 0;
        for (auto w = mesh_.cvv_iter(*v); w.is_valid(); ++w) {
          sum += mesh_.point(*w);
          ++count;
        }
        mesh_.point(*v) = sum / count;
      }
    }
    double sum = 0;
    for (const auto v : mesh_.vertices()) sum += mesh_.point(v)[0] * v.idx();
    return sum;
  }

  void copy() override { copy_ = mesh_; }

  double subdivide() override {
    if constexpr (std::is_same_v<M, Triangles>) return subdivide_triangles();
    return 0;
  }

  double collapse() override {
    M& m = copy_;
    const std::size_t nv = m.n_vertices(), ne = m.n_edges(), nf = m.n_faces();
    m.reserve(nv + nf, ne + 3 * nf, 3 * nf);
    for (std::size_t f = 0; f < nf; ++f) m.split(m.face_handle(static_cast<unsigned>(f)), m.add_vertex(Point(0, 0, 0)));
    for (std::size_t v = nv; v < nv + nf; ++v) m.collapse(m.halfedge_handle(m.vertex_handle(static_cast<unsigned>(v))));
    m.garbage_collection();
    return static_cast<double>(m.n_vertices() + m.n_edges() + m.n_faces());
  }

 private:
  double subdivide_triangles() {
    M& m = copy_;
    const std::size_t nv = m.n_vertices(), ne = m.n_edges(), nf = m.n_faces();
    m.reserve(nv + nf, ne + 3 * nf, 3 * nf);
    std::vector<Point> moved(nv);
    for (auto v = m.vertices_begin(), end = m.vertices_end(); v != end; ++v) {
      Point sum(0, 0, 0);
      std::size_t n = 0;
      for (auto w = m.cvv_iter(*v); w.is_valid(); ++w) {
        sum += m.point(*w);
        ++n;
      }
      const double a = sqrt3_weight(n);
      moved[static_cast<std::size_t>(v->idx())] = (1 - a) * m.point(*v) + (a / static_cast<double>(n)) * sum;
    }
    for (std::size_t i = 0; i < nf; ++i) {
      const auto f = m.face_handle(static_cast<unsigned>(i));
      Point sum(0, 0, 0);
      for (auto v = m.cfv_iter(f); v.is_valid(); ++v) sum += m.point(*v);
      m.split(f, m.add_vertex(sum / 3.0));
    }
    for (std::size_t v = 0; v < nv; ++v) m.set_point(m.vertex_handle(static_cast<unsigned>(v)), moved[v]);
    for (std::size_t e = 0; e < ne; ++e) m.flip(m.edge_handle(static_cast<unsigned>(e)));
    double sum = 0;
    for (const auto v : m.vertices()) sum += m.point(v)[0] * v.idx();
    return sum;
  }

  M mesh_, copy_;
};

}  // namespace

std::unique_ptr<ConnectivityTests> openmesh_tests(const Mesh& mesh) {
  const bool triangles =
      std::all_of(mesh.face_sizes.begin(), mesh.face_sizes.end(), [](std::uint32_t size) { return size == 3; });
  if (triangles) return std::make_unique<OpenMeshTests<Triangles>>(mesh);
  return std::make_unique<OpenMeshTests<Polygons>>(mesh);
}

}  // namespace deform::bench
