// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/operators/shell_operators.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <random>

#include "core/mesh/adjacency.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/support/expect_error.h"
#include "tests/support/linear_algebra.h"

namespace deform::shell_operators_test {
namespace {

/// A plane grid with its inner points shaken, as triangles, quads or hexagons (two quads).
Mesh shaken(unsigned n, double amount, unsigned quads_per_face) {
  Mesh grid = test::quad_grid(n, n);
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(-amount, amount);
  for (Vec3& x : grid.points) {
    if (x[0] > 0 && x[0] < n && x[1] > 0 && x[1] < n) x = {x[0] + uniform(random), x[1] + uniform(random), 0};
  }
  if (quads_per_face == 1) return grid;
  Mesh mesh;
  mesh.points = grid.points;
  for (PointId j = 0; j < n; ++j) {
    for (PointId i = 0; i < n; i += 2) {
      const PointId a = i + (n + 1) * j, b = a + n + 1;
      mesh.face_points.insert(mesh.face_points.end(), {a, a + 1, a + 2, b + 2, b + 1, b});
      mesh.face_sizes.push_back(6);
    }
  }
  return mesh;
}

Eigen::VectorXd field(const Mesh& mesh, const std::function<double(const Vec3&)>& f) {
  Eigen::VectorXd u(static_cast<Eigen::Index>(mesh.point_count()));
  for (std::size_t i = 0; i < mesh.point_count(); ++i) u[static_cast<Eigen::Index>(i)] = f(mesh.points[i]);
  return u;
}

double largest_inside(const Mesh& mesh, const Eigen::VectorXd& values) {
  const std::vector<char> rim = Adjacency(mesh).boundary_points();
  double largest = 0;
  for (std::size_t i = 0; i < rim.size(); ++i) {
    if (!rim[i]) largest = std::max(largest, std::abs(values[static_cast<Eigen::Index>(i)]));
  }
  return largest;
}

TEST(ShellOperators, LinearFieldsAreHarmonicInsideAPlane) {
  for (const unsigned quads : {1u, 2u}) {
    const Mesh mesh = shaken(10, 0.2, quads);
    const ShellOperators operators = shell_operators(mesh, 4);
    const Eigen::VectorXd u = field(mesh, [](const Vec3& x) { return 3 + 2 * x[0] - 0.7 * x[1]; });
    EXPECT_LT(largest_inside(mesh, operators.laplacian * u), 1e-12);
    EXPECT_LT((operators.laplacian * Eigen::VectorXd::Ones(u.size())).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_NEAR(operators.areas.sum(), 100 / 16.0, 1e-12);
    EXPECT_GT(operators.areas.minCoeff(), 0);
    EXPECT_EQ(operators.flat_triangles, 0u);
  }
}

TEST(ShellOperators, TellHowMuchOfTheAreaIsStretched) {
  Mesh mesh = test::quad_grid(10, 10);
  EXPECT_EQ(shell_operators(mesh, 4).stretched_area, 0);
  for (Vec3& p : mesh.points) p[0] = p[0] <= 8 ? p[0] : 8 + 20 * (p[0] - 8);
  EXPECT_NEAR(shell_operators(mesh, 4).stretched_area, 40.0 / 48, 1e-12);
  for (Vec3& p : mesh.points) p[1] *= 20;  // now the others
  EXPECT_NEAR(shell_operators(mesh, 4).stretched_area, 8.0 / 48, 1e-12);
}

TEST(ShellOperators, GradientsOfLinearFieldsAreExact) {
  const Mesh mesh = shaken(8, 0.3, 1);
  const double scale = 2;
  const SparseMatrix G = shell_gradient(mesh, scale);
  const Eigen::VectorXd u = field(mesh, [](const Vec3& x) { return 1 + 2 * x[0] - 3 * x[1]; });
  const Eigen::VectorXd g = G * u;
  const std::vector<Triangle> triangles = fan_triangles(mesh);
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const auto* c = triangles[t].corners;
    const Vec3 &a = mesh.points[c[0]], &b = mesh.points[c[1]], &d = mesh.points[c[2]];
    const double area = 0.5 * std::abs((b[0] - a[0]) * (d[1] - a[1]) - (b[1] - a[1]) * (d[0] - a[0])) / (scale * scale);
    const auto row = static_cast<Eigen::Index>(3 * t);
    EXPECT_NEAR(g[row], 2 * scale * std::sqrt(area), 1e-12);
    EXPECT_NEAR(g[row + 1], -3 * scale * std::sqrt(area), 1e-12);
    EXPECT_NEAR(g[row + 2], 0, 1e-12);
  }
}

TEST(ShellOperators, TheLaplacianIsTheSquareOfTheGradient) {
  Mesh mesh = test::tetrahedron();
  for (const Mesh& m : {mesh, shaken(6, 0.2, 2), test::non_manifold_edge(), test::flipped_neighbour()}) {
    const SparseMatrix G = shell_gradient(m, 1.7);
    const Eigen::MatrixXd expected = Eigen::MatrixXd(SparseMatrix(G.transpose() * G));
    const Eigen::MatrixXd L = Eigen::MatrixXd(shell_operators(m, 1.7).laplacian);
    EXPECT_LT((expected + L).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_LT((L - L.transpose()).cwiseAbs().maxCoeff(), 1e-14);
  }
}

/// On a regular grid the cotangent Laplacian is the five-point stencil, which is exact for quadratic fields.
TEST(ShellOperators, QuadraticFieldsOnARegularGrid) {
  const Mesh mesh = test::quad_grid(9, 7);
  const ShellOperators operators = shell_operators(mesh, 9);
  const Eigen::VectorXd u = field(mesh, [](const Vec3& x) { return (x[0] * x[0] + 3 * x[1] * x[1] + x[0] * x[1]) / 81; });
  const Eigen::VectorXd laplace = (operators.laplacian * u).cwiseQuotient(operators.areas);
  EXPECT_LT(largest_inside(mesh, laplace - Eigen::VectorXd::Constant(u.size(), 8)), 1e-10);
}

/// Mixed areas of Meyer et al. 2003, figure 4: Voronoi in an acute triangle, half and quarters in an obtuse one.
TEST(ShellOperators, AreasOfOneTriangle) {
  const Mesh right = test::make_mesh({{0, 0, 0}, {2, 0, 0}, {0, 2, 0}}, {{0, 1, 2}});
  EXPECT_TRUE(shell_operators(right, 1).areas.isApprox(Eigen::Vector3d(1, 0.5, 0.5), 1e-14));
  const Mesh obtuse = test::make_mesh({{0, 0, 0}, {4, 1, 0}, {-4, 1, 0}}, {{0, 1, 2}});
  EXPECT_TRUE(shell_operators(obtuse, 1).areas.isApprox(Eigen::Vector3d(2, 1, 1), 1e-14));
}

TEST(ShellOperators, FlatTrianglesStayFinite) {
  Mesh mesh = test::quad_grid(4, 4);
  const auto add = [&](std::initializer_list<PointId> face) {
    mesh.face_points.insert(mesh.face_points.end(), face);
    mesh.face_sizes.push_back(static_cast<std::uint32_t>(face.size()));
  };
  mesh.points.push_back(mesh.points[12]);  // 25: coincides with the middle
  add({0, 1, 2});                          // a cap
  add({12, 25, 13});                       // a needle without width
  add({12, 12, 13});                       // an edge
  add({7, 7, 7});                          // a point
  add({3, 4});                             // not a face
  add({5});
  const ShellOperators operators = shell_operators(mesh, 1);
  EXPECT_EQ(operators.flat_triangles, 2u);
  EXPECT_EQ(operators.first_flat, 16u);
  const Eigen::MatrixXd L = Eigen::MatrixXd(operators.laplacian);
  EXPECT_TRUE(L.allFinite());
  EXPECT_LT(test::symmetric_eigenvalues(L).maxCoeff(), 1e-9);
  EXPECT_GT(operators.areas.minCoeff(), 0);
  // The doubled points are tied together.
  EXPECT_GT(L(12, 25), 1e3);
}

TEST(ShellOperators, SomeFacesOnly) {
  const Mesh mesh = test::quad_grid(3, 1);
  const ShellOperators some = shell_operators(mesh, 1, {1, 0, 1});
  EXPECT_NEAR(some.areas.sum(), 2, 1e-14);
  EXPECT_EQ(some.laplacian.coeff(1, 2), 0);
  EXPECT_EQ(fan_triangles(mesh, {0, 1, 0}).size(), 2u);
}

TEST(ShellOperators, ScaleIsChecked) {
  const Mesh mesh = test::tetrahedron();
  test::expect_error(ErrorCode::invalid_argument, {"scale", "positive"}, [&] { shell_operators(mesh, 0); });
  test::expect_error(ErrorCode::invalid_argument, {"scale", "positive"}, [&] { shell_gradient(mesh, HUGE_VAL); });
}

TEST(ShellOperators, AssemblyCanBeStopped) {
  std::stop_source stop;
  RunContext context;
  context.stop = stop.get_token();
  stop.request_stop();
  test::expect_error(ErrorCode::cancelled, {}, [&] { shell_operators(test::tetrahedron(), 1, {}, context); });
}

}  // namespace
}  // namespace deform::shell_operators_test
