// SPDX-License-Identifier: GPL-3.0-or-later
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/boost/graph/Euler_operations.h>

#include <cmath>
#include <stdexcept>
#include <vector>

#include "tests/bench/connectivity_tests.h"

namespace deform::bench {
namespace {

using Kernel = CGAL::Simple_cartesian<double>;
using Point = Kernel::Point_3;
using Vector = Kernel::Vector_3;
using M = CGAL::Surface_mesh<Point>;
using Vertex = M::Vertex_index;
using Face = M::Face_index;

Vector unit(const Vector& v) { return v / std::sqrt(v.squared_length()); }

class CgalTests final : public ConnectivityTests {
 public:
  explicit CgalTests(const Mesh& input) {
    mesh_.reserve(static_cast<unsigned>(input.point_count()), static_cast<unsigned>(input.face_points.size() / 2),
                  static_cast<unsigned>(input.face_count()));
    for (const Vec3& p : input.points) mesh_.add_vertex(Point(p[0], p[1], p[2]));
    std::size_t corner = 0;
    std::vector<Vertex> corners;
    for (const std::uint32_t size : input.face_sizes) {
      corners.clear();
      for (std::uint32_t i = 0; i < size; ++i) corners.emplace_back(input.face_points[corner++]);
      if (mesh_.add_face(corners) == M::null_face()) throw std::runtime_error("CGAL refuses a face");
    }
    vertex_normals_ = mesh_.add_property_map<Vertex, Vector>("v:normal").first;
    face_normals_ = mesh_.add_property_map<Face, Vector>("f:normal").first;
  }

  double circulators(int times) override {
    std::uint64_t sum = 0;
    for (int i = 0; i < times; ++i) {
      for (const Vertex v : mesh_.vertices()) {
        CGAL::Face_around_target_circulator<M> f(mesh_.halfedge(v), mesh_), end(f);
        do {
          if (*f != M::null_face()) sum += (*f).idx();
        } while (++f != end);
      }
      for (const Face f : mesh_.faces()) {
        CGAL::Vertex_around_face_circulator<M> v(mesh_.halfedge(f), mesh_), end(v);
        do sum += (*v).idx();
        while (++v != end);
      }
    }
    return static_cast<double>(sum);
  }

  double barycentre(int times) override {
    Vector sum(0, 0, 0);
    for (int i = 0; i < times; ++i) {
      sum = Vector(0, 0, 0);
      for (const Vertex v : mesh_.vertices()) sum = sum + (mesh_.point(v) - CGAL::ORIGIN);
      const Vector centre = sum / static_cast<double>(mesh_.number_of_vertices());
      for (const Vertex v : mesh_.vertices()) mesh_.point(v) = mesh_.point(v) - centre;
    }
    return sum.x() + sum.y() + sum.z();
  }

  double normals(int times) override {
    for (int i = 0; i < times; ++i) {
      for (const Face f : mesh_.faces()) {
        auto h = mesh_.halfedge(f);
        const Point& a = mesh_.point(mesh_.target(h));
        h = mesh_.next(h);
        const Point& b = mesh_.point(mesh_.target(h));
        h = mesh_.next(h);
        const Point& c = mesh_.point(mesh_.target(h));
        face_normals_[f] = unit(CGAL::cross_product(b - a, c - a));
      }
      for (const Vertex v : mesh_.vertices()) {
        Vector n(0, 0, 0);
        CGAL::Face_around_target_circulator<M> f(mesh_.halfedge(v), mesh_), end(f);
        do {
          if (*f != M::null_face()) n = n + face_normals_[*f];
        } while (++f != end);
        vertex_normals_[v] = unit(n);
      }
    }
    double sum = 0;
    for (const Vertex v : mesh_.vertices()) sum += vertex_normals_[v].x() * v.idx();
    return sum;
  }

  double smoothing(int times) override {
    for (int i = 0; i < times; ++i) {
      for (const Vertex v : mesh_.vertices()) {
        if (mesh_.is_border(v)) continue;
        Vector sum(0, 0, 0);
        double count = 0;
        CGAL::Vertex_around_target_circulator<M> w(mesh_.halfedge(v), mesh_), end(w);
        do {
          sum = sum + (mesh_.point(*w) - CGAL::ORIGIN);
          ++count;
        } while (++w != end);
        mesh_.point(v) = CGAL::ORIGIN + sum / count;
      }
    }
    return sum_of(mesh_);
  }

  void copy() override { copy_ = mesh_; }

  double subdivide() override {
    M& m = copy_;
    const auto nv = static_cast<unsigned>(m.number_of_vertices()), ne = static_cast<unsigned>(m.number_of_edges()),
               nf = static_cast<unsigned>(m.number_of_faces());
    m.reserve(nv + nf, ne + 3 * nf, 3 * nf);
    std::vector<Point> moved(nv);
    for (const Vertex v : m.vertices()) {
      Vector sum(0, 0, 0);
      std::size_t n = 0;
      CGAL::Vertex_around_target_circulator<M> w(m.halfedge(v), m), end(w);
      do {
        sum = sum + (m.point(*w) - CGAL::ORIGIN);
        ++n;
      } while (++w != end);
      const double a = sqrt3_weight(n);
      moved[v.idx()] = CGAL::ORIGIN + (1 - a) * (m.point(v) - CGAL::ORIGIN) + (a / static_cast<double>(n)) * sum;
    }
    for (unsigned i = 0; i < nf; ++i) {
      const Face f(i);
      Vector sum(0, 0, 0);
      CGAL::Vertex_around_face_circulator<M> v(m.halfedge(f), m), end(v);
      do sum = sum + (m.point(*v) - CGAL::ORIGIN);
      while (++v != end);
      const auto h = CGAL::Euler::add_center_vertex(m.halfedge(f), m);
      m.point(m.target(h)) = CGAL::ORIGIN + sum / 3;
    }
    for (unsigned v = 0; v < nv; ++v) m.point(Vertex(v)) = moved[v];
    for (unsigned e = 0; e < ne; ++e) CGAL::Euler::flip_edge(m.halfedge(M::Edge_index(e)), m);
    return sum_of(m);
  }

  double collapse() override {
    M& m = copy_;
    const auto nv = static_cast<unsigned>(m.number_of_vertices()), ne = static_cast<unsigned>(m.number_of_edges()),
               nf = static_cast<unsigned>(m.number_of_faces());
    m.reserve(nv + nf, ne + 3 * nf, 3 * nf);
    for (unsigned f = 0; f < nf; ++f) {
      m.point(m.target(CGAL::Euler::add_center_vertex(m.halfedge(Face(f)), m))) = Point(0, 0, 0);
    }
    for (unsigned v = nv; v < nv + nf; ++v) CGAL::Euler::collapse_edge(m.edge(m.opposite(m.halfedge(Vertex(v)))), m);
    m.collect_garbage();
    return static_cast<double>(m.number_of_vertices() + m.number_of_edges() + m.number_of_faces());
  }

 private:
  static double sum_of(const M& mesh) {
    double sum = 0;
    for (const Vertex v : mesh.vertices()) sum += mesh.point(v).x() * v.idx();
    return sum;
  }

  M mesh_, copy_;
  M::Property_map<Vertex, Vector> vertex_normals_;
  M::Property_map<Face, Vector> face_normals_;
};

}  // namespace

std::unique_ptr<ConnectivityTests> cgal_tests(const Mesh& mesh) { return std::make_unique<CgalTests>(mesh); }

}  // namespace deform::bench
