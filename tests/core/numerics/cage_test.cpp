// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 3.4: mean value coordinates of cages. The reference is quadrature of their definition.
#include "core/numerics/cage/cage.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>

#include "core/numerics/cage/mean_value.h"
#include "core/numerics/lattice/spline_axis.h"
#include "tests/core/numerics/cages.h"
#include "tests/support/expect_error.h"

namespace deform::cage_test {
namespace {

using test::CageMesh;

std::vector<CageMesh> cages() {
  return {test::box_cage({-1, -0.5, 0}, {1, 1, 1}), test::l_cage(), test::bumpy_torus(9, 6, 1), test::bumpy_torus(24, 12, 2)};
}

std::vector<double> coordinates(const Cage& cage, const Vec3& x) {
  MeanValue::Scratch scratch;
  std::vector<double> out(cage.size());
  MeanValue(cage).evaluate(x, scratch, out);
  return out;
}

/// |sum - 1| and the distance of what they give from x, over the diagonal.
std::pair<double, double> missed(const Cage& cage, const Vec3& x, const std::vector<double>& values) {
  double sum = 0;
  Vec3 place{};
  for (std::size_t i = 0; i < cage.size(); ++i) {
    sum += values[i];
    place = place + values[i] * (cage.vertices()[i] - x);
  }
  return {std::abs(sum - 1), norm(place) / cage.diagonal()};
}

TEST(MeanValue, AddsUpToOneAndReproducesPoints) {
  for (const CageMesh& mesh : cages()) {
    const Cage cage = mesh.cage();
    double sums = 0, places = 0, sizes = 0;
    for (const Vec3& x : test::points_around(cage, 10000, 3)) {
      const std::vector<double> values = coordinates(cage, x);
      const auto [sum, place] = missed(cage, x, values);
      sums = std::max(sums, sum);
      places = std::max(places, place);
      for (const double value : values) sizes = std::max(sizes, std::isfinite(value) ? std::abs(value) : 1e300);
    }
    EXPECT_LT(sums, 1e-12);
    EXPECT_LT(places, 1e-12);
    EXPECT_LT(sizes, 20);  // none explodes where its triangle is seen edge-on
  }
}

TEST(Cage, HasWhatItWasMadeFrom) {
  for (const CageMesh& mesh : cages()) {
    const Cage cage = mesh.cage();
    EXPECT_EQ(cage.vertices(), mesh.vertices);
    EXPECT_EQ(cage.size(), mesh.vertices.size());
    EXPECT_EQ(cage.triangles().size(), mesh.triangles.size());
    EXPECT_EQ(cage.edges().size() * 2, mesh.triangles.size() * 3) << "two triangles along each";
    Vec3 low = mesh.vertices.at(0), high = low;
    for (const Vec3& x : mesh.vertices) {
      for (std::size_t k = 0; k < 3; ++k) low[k] = std::min(low[k], x[k]), high[k] = std::max(high[k], x[k]);
    }
    EXPECT_NEAR(cage.diagonal(), norm(high - low), 1e-15 * cage.diagonal());
  }
}

/// Integrals of lambda_i h / |p - x|^4 over a triangle: what a cone from x over it contributes to the definition. Triangles near
/// x are cut in four.
void add_quadrature(const std::array<Vec3, 3>& corners, const std::array<Vec3, 3>& lambdas, double height, const Vec3& x,
                    std::array<double, 3>& sums, int depth) {
  double size = 0, nearest = 1e300;
  for (std::size_t k = 0; k < 3; ++k) {
    size = std::max(size, distance(corners[k], corners[(k + 1) % 3]));
    nearest = std::min(nearest, distance(corners[k], x));
  }
  if (size > 0.5 * (nearest - 0.5 * size) && depth < 40) {
    std::array<Vec3, 3> middles, between;
    for (std::size_t k = 0; k < 3; ++k) {
      middles[k] = lerp(corners[(k + 1) % 3], corners[(k + 2) % 3], 0.5);
      between[k] = lerp(lambdas[(k + 1) % 3], lambdas[(k + 2) % 3], 0.5);
    }
    add_quadrature(middles, between, height, x, sums, depth + 1);
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t l = (k + 1) % 3, m = (k + 2) % 3;
      add_quadrature({corners[k], middles[m], middles[l]}, {lambdas[k], between[m], between[l]}, height, x, sums, depth + 1);
    }
    return;
  }
  static const GaussRule rule = gauss_rule(10);
  const double twice = norm(cross(corners[1] - corners[0], corners[2] - corners[0]));
  for (std::size_t i = 0; i < 10; ++i) {
    for (std::size_t j = 0; j < 10; ++j) {
      const double u = rule.nodes[i], v = rule.nodes[j];
      const double weight = rule.weights[i] * rule.weights[j] * u * twice * height;
      const Vec3 p = lerp(corners[0], lerp(corners[1], corners[2], v), u);
      const Vec3 lambda = lerp(lambdas[0], lerp(lambdas[1], lambdas[2], v), u);
      const double d2 = squared_distance(p, x);
      for (std::size_t k = 0; k < 3; ++k) sums[k] += weight * lambda[k] / (d2 * d2);
    }
  }
}

std::vector<double> by_quadrature(const Cage& cage, const Vec3& x) {
  std::vector<double> result(cage.size(), 0.0);
  for (const auto& face : cage.faces()) {
    std::array<Vec3, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) corners[k] = cage.vertices()[face.corners[k]];
    std::array<double, 3> sums{};
    const std::array<Vec3, 3> lambdas{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    add_quadrature(corners, lambdas, dot(face.normal, corners[0] - x), x, sums, 0);
    for (std::size_t k = 0; k < 3; ++k) result[face.corners[k]] += sums[k];
  }
  const double sum = std::accumulate(result.begin(), result.end(), 0.0);
  for (double& value : result) value /= sum;
  return result;
}

double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
  return largest;
}

TEST(MeanValue, IsTheIntegralOfItsDefinition) {
  for (const CageMesh& mesh : cages()) {
    const Cage cage = mesh.cage();
    const Box box = bounding_box(cage.vertices());
    std::mt19937_64 random(4);
    std::uniform_real_distribution<double> uniform(-0.3, 1.3);
    for (int i = 0; i < 6; ++i) {
      Vec3 x{};
      for (int k = 0; k < 3; ++k) x[k] = box.min[k] + box.side(k) * uniform(random);
      EXPECT_LT(largest_difference(coordinates(cage, x), by_quadrature(cage, x)), 1e-10);
    }
  }
}

// The planes x = 1 and y = 0 of two faces run through the inside of this cage. The published formula loses as many digits as the
// height has zeros.
TEST(MeanValue, KeepsItsDigitsBesideFacesInTheirPlanes) {
  const Cage cage = test::l_cage().cage();
  for (const double height : {0.0, 1e-15, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3, 0.02, 0.05, 0.1}) {
    for (const double sign : {-1.0, 1.0}) {
      const Vec3 x{1 + sign * height, -0.4, 0.3};
      EXPECT_LT(largest_difference(coordinates(cage, x), by_quadrature(cage, x)), 3e-14) << height;
      const Vec3 near_edge{1 + sign * height, -0.003, 0.31};
      EXPECT_LT(largest_difference(coordinates(cage, near_edge), by_quadrature(cage, near_edge)), 1e-11) << height;
    }
  }
}

TEST(MeanValue, GoesToBarycentricCoordinatesOnTheCage) {
  for (const CageMesh& mesh : {test::l_cage(), test::bumpy_torus(9, 6, 1)}) {
    const Cage cage = mesh.cage();
    for (std::size_t i = 0; i < cage.size(); ++i) {
      std::vector<double> expected(cage.size(), 0.0);
      expected[i] = 1;
      EXPECT_EQ(coordinates(cage, cage.vertices()[i]), expected);
    }
    for (const auto& face : cage.faces()) {
      for (const Vec3& lambda : {Vec3{0.2, 0.3, 0.5}, Vec3{0.98, 0.01, 0.01}, Vec3{0.4, 0.6, 0}}) {
        Vec3 x{};
        std::vector<double> expected(cage.size(), 0.0);
        for (std::size_t k = 0; k < 3; ++k) {
          expected[face.corners[k]] = lambda[k];
          x = x + lambda[k] * cage.vertices()[face.corners[k]];
        }
        EXPECT_LT(largest_difference(coordinates(cage, x), expected), 1e-13);
        for (const double height : {1e-4, 1e-7, 1e-10, 1e-13, 1e-15}) {
          for (const double sign : {-1.0, 1.0}) {
            // Distances over the diagonal, but for the logarithm of the height near edges.
            EXPECT_LT(largest_difference(coordinates(cage, x + (sign * height) * face.normal), expected), 200 * height + 1e-13);
          }
        }
      }
    }
  }
}

TEST(MeanValue, DoesNotDependOnUnits) {
  const CageMesh mesh = test::bumpy_torus(9, 6, 1);
  const Cage cage = mesh.cage();
  for (const double unit : {std::ldexp(1.0, -600), std::ldexp(1.0, 600)}) {
    CageMesh other = mesh;
    for (Vec3& x : other.vertices) x = unit * x;
    const Cage scaled = other.cage();
    for (const Vec3& x : test::points_around(cage, 100, 5)) EXPECT_EQ(coordinates(scaled, unit * x), coordinates(cage, x));
  }
  // Far from the origin places are rounded to 1e6 epsilon.
  CageMesh shifted = mesh;
  const Vec3 shift{1e6, -2e6, 5e5};
  for (Vec3& x : shifted.vertices) x = x + shift;
  const Cage far = shifted.cage();
  for (const Vec3& x : test::points_around(cage, 300, 6)) {
    const Vec3 moved = x + shift;
    EXPECT_LT(missed(far, moved, coordinates(far, moved)).second, 1e-12);
  }
}

TEST(Cage, FacesOutwards) {
  CageMesh mesh = test::l_cage();
  const std::vector<double> expected = coordinates(mesh.cage(), {0.3, 0.2, 0.1});
  for (Cage::Triangle& triangle : mesh.triangles) std::swap(triangle[0], triangle[2]);
  const Cage turned = mesh.cage();
  EXPECT_LT(largest_difference(coordinates(turned, {0.3, 0.2, 0.1}), expected), 1e-15);
  for (const auto& face : turned.faces()) {
    const auto& [a, b, c] = face.corners;
    const auto& v = turned.vertices();
    EXPECT_GT(dot(face.normal, cross(v[b] - v[a], v[c] - v[a])), 0);
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 up = v[face.corners[k]] - v[face.corners[(k + 1) % 3]];
      EXPECT_NEAR(dot(up, face.inwards[k]) / turned.scale(), face.altitudes[k], 1e-15);
    }
  }
}

TEST(Cage, RefusesWhatIsNotClosed) {
  const CageMesh good = test::l_cage();
  const auto refused = [](const CageMesh& mesh, const std::vector<const char*>& parts) {
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { mesh.cage(); });
  };
  CageMesh mesh = good;
  mesh.triangles.pop_back();
  refused(mesh, {"triangles[", "open at the edge between vertices", "no other triangle"});
  mesh = good;
  std::swap(mesh.triangles[3][0], mesh.triangles[3][1]);
  refused(mesh, {"triangles[3]", " and ", "both run along the edge between vertices", "same direction"});
  mesh = good;
  mesh.triangles.push_back(mesh.triangles[0]);
  const std::string added = " and triangles[" + std::to_string(good.triangles.size()) + "]: they share the edge";
  refused(mesh, {"triangles[0], ", added.c_str()});
  mesh = good;
  mesh.vertices[4][1] = std::numeric_limits<double>::quiet_NaN();
  refused(mesh, {"vertices[4]: must be finite"});
  mesh = good;
  mesh.vertices.push_back({0, 0, 0});
  refused(mesh, {"vertices[12]: no triangle has it"});
  mesh = good;
  mesh.triangles[2][1] = 12;
  refused(mesh, {"triangles[2]: vertex 12 is out of range, there are 12"});
  mesh = good;
  mesh.triangles[2][1] = mesh.triangles[2][0];
  refused(mesh, {"triangles[2]: has vertex", "twice"});
  mesh = good;
  mesh.vertices[0] = mesh.vertices[1];
  refused(mesh, {"the edge between vertices 0 and 1 has no length"});
  mesh = good;
  for (Vec3& x : mesh.vertices) x[2] = 0;
  refused(mesh, {"has no length"});
  mesh = good;
  mesh.vertices[0] = lerp(mesh.vertices[1], mesh.vertices[7], 0.3);
  refused(mesh, {"is degenerate"});
  refused({{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}, {0, 2, 1}}}, {"there are 3, a cage takes 4 to 10000"});
  refused({std::vector<Vec3>(10001), {}}, {"there are 10001"});
  // Two tetrahedra that have one vertex in common.
  mesh = {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {-1, 0, 0}, {0, -1, 0}, {0, 0, -1}}, {}};
  for (const auto& [a, b, c] : {Cage::Triangle{1, 2, 3}, Cage::Triangle{5, 4, 6}}) {
    mesh.triangles.insert(mesh.triangles.end(), {{a, b, c}, {0, b, a}, {0, c, b}, {0, a, c}});
  }
  refused(mesh, {"vertices[0]: its triangles meet at this vertex only"});
}

}  // namespace
}  // namespace deform::cage_test
