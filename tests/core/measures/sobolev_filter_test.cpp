// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/measures/sobolev_filter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "tests/core/measures/measure_checks.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::measures::sobolev_filter_test {
namespace {

using test::expect_error;
using Matrix = std::vector<std::vector<long double>>;

std::vector<double> noise(std::size_t count, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0, 1);
  std::vector<double> field(count);
  for (double& value : field) value = normal(random);
  return field;
}

/// Area and gradients of the hat functions of a triangle, by projections of its corners onto the opposite edges.
struct Hats {
  double area = 0;
  std::array<Vec3, 3> gradients{};
};

Hats hats(const std::array<Vec3, 3>& c) {
  Hats found;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3 from = c[(i + 1) % 3], edge = c[(i + 2) % 3] - from, to = c[i] - from;
    const Vec3 height = to - (dot(to, edge) / dot(edge, edge)) * edge;
    found.area = length(edge) * length(height) / 2;
    found.gradients[i] = height / dot(height, height);
  }
  return found;
}

/// M and A = M + r^2 K, dense.
std::pair<std::vector<double>, Matrix> dense(const Mesh& mesh, const Points& points, double r) {
  const std::size_t n = points.size();
  std::vector<double> mass(n);
  Matrix A(n, std::vector<long double>(n));
  for (std::size_t t = 0; t < mesh.face_count(); ++t) {
    const PointId* const ids = mesh.face_points.data() + 3 * t;
    const Hats found = hats({points[ids[0]], points[ids[1]], points[ids[2]]});
    for (std::size_t i = 0; i < 3; ++i) {
      mass[ids[i]] += found.area / 3;
      A[ids[i]][ids[i]] += found.area / 3;
      for (std::size_t j = 0; j < 3; ++j) A[ids[i]][ids[j]] += r * r * found.area * dot(found.gradients[i], found.gradients[j]);
    }
  }
  return {mass, A};
}

std::vector<double> solved(Matrix A, const std::vector<double>& b) {
  const std::size_t n = b.size();
  std::vector<long double> x(b.begin(), b.end());
  for (std::size_t k = 0; k < n; ++k) {  // positive definite: no pivoting
    for (std::size_t i = k + 1; i < n; ++i) {
      const long double factor = A[i][k] / A[k][k];
      if (factor == 0) continue;
      for (std::size_t j = k; j < n; ++j) A[i][j] -= factor * A[k][j];
      x[i] -= factor * x[k];
    }
  }
  for (std::size_t k = n; k-- > 0;) {
    for (std::size_t j = k + 1; j < n; ++j) x[k] -= A[k][j] * x[j];
    x[k] /= A[k][k];
  }
  return {x.begin(), x.end()};
}

SobolevOptions with(double length, double tolerance = 1e-13) {
  SobolevOptions options;
  options.length = length;
  options.tolerance = tolerance;
  return options;
}

/// A ball, a sheet with rims, and a sheet with a fin: three faces at an edge.
std::vector<Mesh> surfaces(double unit) {
  Mesh fin = test::sheet(6, 5, test::Faces::triangles, [&](std::uint32_t i, std::uint32_t j) {
    return Vec3{unit * i, unit * j, 0};
  });
  fin.points.push_back({2 * unit, 2.5 * unit, unit});
  test::add_face(fin, {2 + 7 * 2, 2 + 7 * 3, static_cast<PointId>(fin.point_count() - 1)});
  return {test::sphere(4 * unit, 2),
          test::sheet(8, 6, test::Faces::triangles,
                      [&](std::uint32_t i, std::uint32_t j) {
                        return Vec3{unit * i + 0.3 * unit * j, unit * j, unit * std::sin(0.5 * i)};
                      }),
          fin};
}

TEST(SobolevFilter, IsTheSolutionOfTheDenseEquations) {
  for (const double unit : {1e-3, 1.0, 1e4}) {
    for (const Mesh& mesh : surfaces(unit)) {
      const std::size_t n = mesh.point_count();
      const Points points = test::shaken(mesh.points, 0.05 * unit, 3);
      const double r = 1.7 * unit;
      const auto [mass, A] = dense(mesh, points, r);
      const SobolevFilter filter(mesh, points, with(r));
      const std::vector<double> f = noise(n, 4);
      std::vector<double> weighted(n);
      for (std::size_t i = 0; i < n; ++i) weighted[i] = mass[i] * f[i];
      const std::vector<double> density = solved(A, weighted), plain = solved(A, f);
      const Filtered of_density = filter.apply(f, 1, SobolevForm::density),
                     of_derivative = filter.apply(f, 1, SobolevForm::derivative),
                     transposed = filter.apply(f, 1, SobolevForm::transposed);
      for (const Filtered* each : {&of_density, &of_derivative, &transposed}) {
        EXPECT_TRUE(each->converged);
        EXPECT_LE(each->residual, 1.01e-13);
        EXPECT_GT(each->iterations, 0U);
      }
      double largest = 0;
      for (const double value : plain) largest = std::max(largest, std::abs(value));
      const std::vector<double> areas = filter.areas();
      for (std::size_t i = 0; i < n; ++i) {
        EXPECT_NEAR(of_density.field[i], density[i], 1e-10);
        EXPECT_NEAR(of_derivative.field[i], plain[i], 1e-10 * largest);
        EXPECT_NEAR(transposed.field[i], mass[i] * plain[i], 1e-10 * largest * mass[i]);
        EXPECT_NEAR(areas[i], mass[i], 1e-13 * unit * unit);
      }
    }
  }
}

TEST(SobolevFilter, KeepsConstantsAndIntegrals) {
  for (const Mesh& mesh : surfaces(1)) {
    const std::size_t n = mesh.point_count();
    const SobolevFilter filter(mesh, mesh.points, with(3));
    for (const double value : filter.apply(std::vector<double>(n, 2.5), 1, SobolevForm::density).field)
      EXPECT_NEAR(value, 2.5, 1e-11);
    const std::vector<double> f = noise(n, 2), g = filter.apply(f, 1, SobolevForm::density).field, areas = filter.areas();
    double before = 0, after = 0, size = 0;
    for (std::size_t i = 0; i < n; ++i) {
      before += areas[i] * f[i];
      after += areas[i] * g[i];
      size += areas[i];
    }
    EXPECT_NEAR(before, after, 1e-11 * size);
  }
}

TEST(SobolevFilter, AgreesWithItsTranspose) {
  const Mesh mesh = test::sphere(1, 4);
  const std::size_t n = mesh.point_count();
  const SobolevFilter filter(mesh, mesh.points, with(0.2, 1e-14));
  const std::vector<double> f = noise(3 * n, 5), w = noise(3 * n, 6);
  const auto product = [&](const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
  };
  EXPECT_NEAR(product(w, filter.apply(f, 3, SobolevForm::density).field),
              product(filter.apply(w, 3, SobolevForm::transposed).field, f), 1e-10);
  const double forth = product(w, filter.apply(f, 3, SobolevForm::derivative).field),
               back = product(filter.apply(w, 3, SobolevForm::derivative).field, f);
  EXPECT_NEAR(forth, back, 1e-11 * std::sqrt(product(w, w) * product(f, f)) / filter.areas()[0]);
}

TEST(SobolevFilter, DampsWavesOnAPlaneAsItsFormulaSays) {
  // cos(k x) has no flux through the rims of its half waves: it is damped by 1 / (1 + r^2 k^2), with an error of the mesh of
  // second order.
  const double k = std::numbers::pi, r = 0.4;
  std::array<double, 2> errors{};
  for (std::size_t level = 0; level < 2; ++level) {
    const std::uint32_t cells = level == 0 ? 10 : 20;
    const Mesh mesh = test::sheet(2 * cells, cells, test::Faces::triangles, [&](std::uint32_t i, std::uint32_t j) {
      return Vec3{1.0 * i / cells, 1.0 * j / cells, 3};
    });
    std::vector<double> f;
    for (const Vec3& p : mesh.points) f.push_back(std::cos(k * p[0]));
    const SobolevFilter filter(mesh, mesh.points, with(r));
    const std::vector<double> g = filter.apply(f, 1, SobolevForm::density).field, areas = filter.areas();
    double square = 0;
    for (std::size_t i = 0; i < g.size(); ++i) square += areas[i] * std::pow(g[i] - f[i] / (1 + r * r * k * k), 2);
    errors[level] = std::sqrt(square);
  }
  EXPECT_LT(errors[1], 2e-3);
  EXPECT_NEAR(errors[0] / errors[1], 4, 0.5);
}

TEST(SobolevFilter, PointsWithTheSameCoordinatesAreOne) {
  const Mesh mesh = test::sphere(1, 3), torn = test::torn(mesh);
  const SobolevFilter whole(mesh, mesh.points, with(0.3)), parts(torn, torn.points, with(0.3));
  const std::vector<double> f = noise(mesh.point_count(), 5);
  std::vector<double> copied, shared;
  std::vector<std::size_t> copies(mesh.point_count());
  for (const PointId corner : mesh.face_points) ++copies[corner];
  for (const PointId corner : mesh.face_points) {
    copied.push_back(f[corner]);
    shared.push_back(f[corner] / static_cast<double>(copies[corner]));
  }
  const std::vector<double> density = whole.apply(f, 1, SobolevForm::density).field,
                            of_copies = parts.apply(copied, 1, SobolevForm::density).field;
  const std::vector<double> gradient = whole.apply(f, 1, SobolevForm::derivative).field,
                            of_shares = parts.apply(shared, 1, SobolevForm::derivative).field;
  for (std::size_t i = 0; i < copied.size(); ++i) {
    EXPECT_NEAR(of_copies[i], density[mesh.face_points[i]], 1e-10);
    EXPECT_NEAR(of_shares[i], gradient[mesh.face_points[i]], 1e-9 * std::abs(gradient[mesh.face_points[i]]) + 1e-9);
    EXPECT_NEAR(parts.areas()[i], whole.areas()[mesh.face_points[i]], 1e-13);
  }
  // The transpose of copies holds, too.
  const std::vector<double> w = noise(copied.size(), 7), g = noise(copied.size(), 8);
  const std::vector<double> forth = parts.apply(g, 1, SobolevForm::density).field,
                            back = parts.apply(w, 1, SobolevForm::transposed).field;
  double left = 0, right = 0;
  for (std::size_t i = 0; i < w.size(); ++i) {
    left += w[i] * forth[i];
    right += back[i] * g[i];
  }
  EXPECT_NEAR(left, right, 1e-9);
}

TEST(SobolevFilter, PointsOffTheSurfaceAndFacesWithoutArea) {
  Mesh mesh = test::sphere(1, 2);
  const std::size_t n = mesh.point_count();
  const std::vector<double> f = noise(n + 2, 3),
                            expected =
                                SobolevFilter(mesh, mesh.points, with(0.5)).apply({f.data(), n}, 1, SobolevForm::density).field;
  mesh.points.push_back({9, 9, 9});
  mesh.points.push_back(0.5 * (mesh.points[mesh.face_points[0]] + mesh.points[mesh.face_points[1]]));
  test::add_face(mesh, {mesh.face_points[0], static_cast<PointId>(n + 1), mesh.face_points[1]});
  const SobolevFilter filter(mesh, mesh.points, with(0.5));
  const std::vector<double> found = filter.apply(f, 1, SobolevForm::density).field;
  for (std::size_t i = 0; i < n; ++i) EXPECT_NEAR(found[i], expected[i], 1e-11);
  for (const std::size_t i : {n, n + 1}) {
    EXPECT_EQ(found[i], f[i]);
    EXPECT_EQ(filter.apply(f, 1, SobolevForm::transposed).field[i], f[i]);
    EXPECT_EQ(filter.apply(f, 1, SobolevForm::derivative).field[i], 0);
    EXPECT_EQ(filter.areas()[i], 0);
  }
}

TEST(SobolevFilter, ComponentsAreFilteredAlike) {
  const Mesh mesh = test::sphere(1, 3);
  const std::size_t n = mesh.point_count();
  const SobolevFilter filter(mesh, mesh.points, with(0.5));
  const std::vector<double> f = noise(3 * n, 9), all = filter.apply(f, 3, SobolevForm::derivative).field;
  for (std::size_t c = 0; c < 3; ++c) {
    std::vector<double> one(n);
    for (std::size_t i = 0; i < n; ++i) one[i] = f[3 * i + c];
    const std::vector<double> alone = filter.apply(one, 1, SobolevForm::derivative).field;
    for (std::size_t i = 0; i < n; ++i) EXPECT_EQ(all[3 * i + c], alone[i]);
  }
}

TEST(SobolevFilter, SameBitsForAnyNumberOfThreads) {
  const Mesh mesh = test::sphere(1, 6);
  const SobolevFilter filter(mesh, mesh.points, with(0.1, 1e-8));
  const std::vector<double> f = noise(mesh.point_count(), 1);
  RunContext one;
  one.threads = 1;
  EXPECT_EQ(filter.apply(f, 1, SobolevForm::density, one).field, filter.apply(f, 1, SobolevForm::density).field);
}

TEST(SobolevFilter, NotConvergingIsAResult) {
  const Mesh mesh = test::sphere(1, 4);
  SobolevOptions options = with(1);
  options.iterations = 3;
  const Filtered found = SobolevFilter(mesh, mesh.points, options).apply(noise(mesh.point_count(), 1), 1, SobolevForm::density);
  EXPECT_FALSE(found.converged);
  EXPECT_EQ(found.iterations, 3U);
  EXPECT_GT(found.residual, 1e-6);
  EXPECT_LT(found.residual, 1);
  const Filtered zero =
      SobolevFilter(mesh, mesh.points, options).apply(std::vector<double>(mesh.point_count()), 1, SobolevForm::density);
  EXPECT_TRUE(zero.converged);
  EXPECT_EQ(zero.field, std::vector<double>(mesh.point_count()));
}

TEST(SobolevFilter, SaysTheResidualOfItsResult) {
  const Mesh mesh = test::sphere(1, 2);
  const std::size_t n = mesh.point_count();
  const auto [mass, A] = dense(mesh, mesh.points, 0.8);
  for (const std::size_t iterations : {1U, 2U, 4U}) {
    SobolevOptions options = with(0.8);
    options.iterations = iterations;
    std::vector<double> b = noise(n, 11);
    b[0] = 50;  // a sum that left it out would show
    const Filtered found = SobolevFilter(mesh, mesh.points, options).apply(b, 1, SobolevForm::derivative);
    long double left = 0, size = 0;
    for (std::size_t i = 0; i < n; ++i) {
      long double row = b[i];
      for (std::size_t j = 0; j < n; ++j) row -= A[i][j] * found.field[j];
      left += row * row;
      size += static_cast<long double>(b[i]) * b[i];
    }
    EXPECT_NEAR(found.residual, static_cast<double>(std::sqrt(left / size)), 1e-12);
  }
}

TEST(SobolevFilter, BadInput) {
  const Mesh mesh = test::sphere(1, 1);
  const auto refused = [&](const std::vector<const char*>& parts, const SobolevOptions& options) {
    expect_error(ErrorCode::invalid_argument, parts, [&] { SobolevFilter(mesh, mesh.points, options); });
  };
  for (const double length : {0.0, -1.0, HUGE_VAL, std::nan("")}) refused({"length: "}, with(length));
  for (const double tolerance : {0.0, 1.0, std::nan("")}) refused({"tolerance: "}, with(1, tolerance));
  SobolevOptions options = with(1);
  options.iterations = 0;
  refused({"iterations: "}, options);
  expect_error(ErrorCode::invalid_argument, {"points: 1, the mesh has 18"}, [&] { SobolevFilter(mesh, Points(1), with(1)); });
  const SobolevFilter filter(mesh, mesh.points, with(1));
  expect_error(ErrorCode::invalid_argument, {"field: 5 numbers, expected 18"},
               [&] { filter.apply(std::vector<double>(5), 1, SobolevForm::density); });
  std::vector<double> field(54);
  field[50] = std::nan("");
  expect_error(ErrorCode::invalid_argument, {"field[16]: not a finite number"},
               [&] { filter.apply(field, 3, SobolevForm::density); });
}

}  // namespace
}  // namespace deform::measures::sobolev_filter_test
