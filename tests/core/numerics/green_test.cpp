// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 3.4: Green coordinates of cages and stretched normals. The reference is quadrature of their definition.
#include "core/numerics/cage/green.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/base/vectors.h"
#include "core/numerics/cage/stretched_normal.h"
#include "tests/core/numerics/cages.h"
#include "tests/core/numerics/green_reference.h"

namespace deform::green_test {
namespace {

using test::CageMesh;

std::vector<CageMesh> green_cages() {
  return {test::box_cage({-1, -0.5, 0}, {1, 1, 1}), test::l_cage(), test::bumpy_torus(9, 6, 1), test::bumpy_torus(24, 12, 2)};
}

struct Found {
  std::vector<double> phi, psi;
  int winding = 0;
};

Found found_at(const Cage& cage, const Vec3& x) {
  Green::Scratch scratch;
  Found found{std::vector<double>(cage.size()), std::vector<double>(cage.faces().size()), 0};
  found.winding = Green(cage).evaluate(x, scratch, found.phi, found.psi);
  return found;
}

/// |sum - 1|, and the distance of what they give from x over the diagonal.
std::pair<double, double> green_misses(const Cage& cage, const Vec3& x, const Found& found) {
  double sum = 0;
  Vec3 away{};
  for (std::size_t i = 0; i < cage.size(); ++i) {
    sum += found.phi[i];
    away = away + found.phi[i] * (cage.vertices()[i] - x);
  }
  for (std::size_t t = 0; t < found.psi.size(); ++t) away = away + found.psi[t] * cage.faces()[t].normal;
  return {std::abs(sum - 1), norm(away) / cage.diagonal()};
}

TEST(Green, AddsUpToOneAndReproducesPointsInside) {
  for (const CageMesh& mesh : green_cages()) {
    const Cage cage = mesh.cage();
    double sums = 0, places = 0;
    std::size_t inside = 0;
    for (const Vec3& x : test::points_around(cage, cage.size() > 100 ? 8000 : 35000, 3)) {
      const Found found = found_at(cage, x);
      if (found.winding != 1) continue;
      ++inside;
      const auto [sum, place] = green_misses(cage, x, found);
      sums = std::max(sums, sum);
      places = std::max(places, place);
    }
    EXPECT_GT(inside, cage.size() > 100 ? 2000u : 10000u);
    EXPECT_LT(sums, 2e-14);
    EXPECT_LT(places, 1e-14);
  }
}

// At any distance from edges and vertices, where solid angles are uncertain.
TEST(Green, ReproducesPointsBesideEdgesAndVertices) {
  for (const CageMesh& mesh : green_cages()) {
    const Cage cage = mesh.cage();
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> uniform;
    for (int digits = 1; digits < 17; ++digits) {
      std::size_t inside = 0;
      for (int i = 0; i < 300; ++i) {
        const auto& ends = cage.edges()[random() % cage.edges().size()].ends;
        const Vec3 at = lerp(cage.vertices()[ends[0]], cage.vertices()[ends[1]], i % 3 == 0 ? 0 : uniform(random));
        const Vec3 x = at + std::pow(10.0, -digits) * Vec3{uniform(random) - 0.5, uniform(random) - 0.5, uniform(random) - 0.5};
        const Found found = found_at(cage, x);
        if (found.winding != 1) continue;
        ++inside;
        const auto [sum, place] = green_misses(cage, x, found);
        EXPECT_LT(sum, 2e-14) << digits;
        EXPECT_LT(place, 1e-14) << digits;
      }
      EXPECT_GT(inside, 30u);
    }
  }
}

TEST(Green, TellsInsideFromOutside) {
  const Vec3 low{-1, -0.5, 0}, high{1, 1, 1};
  const Cage cage = test::box_cage(low, high).cage();
  for (const Vec3& x : test::points_around(cage, 20000, 6)) {
    double beyond = -1;
    for (std::size_t k = 0; k < 3; ++k) beyond = std::max({beyond, low[k] - x[k], x[k] - high[k]});
    if (std::abs(beyond) < 2e-14) continue;  // on the cage
    EXPECT_EQ(found_at(cage, x).winding, beyond < 0 ? 1 : 0);
  }
  // Two boxes that overlap, and a box in a box.
  CageMesh both = test::box_cage({0, 0, 0}, {1, 1, 1});
  const auto add = [&](const CageMesh& other, bool cavity) {
    const auto first = static_cast<std::uint32_t>(both.vertices.size());
    both.vertices.insert(both.vertices.end(), other.vertices.begin(), other.vertices.end());
    for (auto [a, b, c] : other.triangles) {
      if (cavity) std::swap(b, c);
      both.triangles.push_back({a + first, b + first, c + first});
    }
  };
  add(test::box_cage({0.5, 0.5, 0.5}, {1.5, 1.5, 1.5}), false);
  EXPECT_EQ(found_at(both.cage(), {0.7, 0.8, 0.9}).winding, 2);
  EXPECT_EQ(found_at(both.cage(), {0.2, 0.8, 0.9}).winding, 1);
  both = test::box_cage({0, 0, 0}, {1, 1, 1});
  add(test::box_cage({0.25, 0.25, 0.25}, {0.75, 0.75, 0.75}), true);
  EXPECT_EQ(found_at(both.cage(), {0.5, 0.4, 0.3}).winding, 0);
  EXPECT_EQ(found_at(both.cage(), {0.1, 0.4, 0.3}).winding, 1);
  EXPECT_EQ(found_at(both.cage(), {0.25, 0.4, 0.3}).winding, 1) << "on the wall of the cavity";
}

void expect_quadrature(const Cage& cage, const Vec3& x, double tolerance, const std::string& what) {
  const Found found = found_at(cage, x);
  if (found.winding != 1) return;
  const auto expected = test::GreenQuadrature(cage).at(x);
  for (std::size_t i = 0; i < expected.phi.size(); ++i) EXPECT_NEAR(found.phi[i], expected.phi[i], tolerance) << what;
  for (std::size_t t = 0; t < expected.psi.size(); ++t) EXPECT_NEAR(found.psi[t], expected.psi[t], tolerance) << what;
}

TEST(Green, IsTheIntegralOfItsDefinition) {
  for (const CageMesh& mesh : {test::box_cage({-1, -0.5, 0}, {1, 1, 1}), test::l_cage(), test::bumpy_torus(9, 6, 1)}) {
    const Cage cage = mesh.cage();
    const Box box = bounding_box(cage.vertices());
    std::mt19937_64 random(4);
    std::uniform_real_distribution<double> uniform;
    for (int i = 0; i < 12; ++i) {
      Vec3 x{};
      for (int k = 0; k < 3; ++k) x[k] = box.min[k] + box.side(k) * uniform(random);
      expect_quadrature(cage, x, 1e-10, "anywhere");
    }
    for (const double distance : {1e-1, 1e-2, 1e-3, 1e-6, 1e-9}) {
      for (int i = 0; i < 2; ++i) {
        const Cage::Face& face = cage.faces()[random() % cage.faces().size()];
        const auto corner = [&](std::size_t k) { return cage.vertices()[face.corners[k]]; };
        const Vec3 edge = lerp(corner(0), corner(1), uniform(random)), inner = lerp(edge, corner(2), uniform(random));
        const Vec3 middle = (corner(0) + corner(1) + corner(2)) / 3;
        expect_quadrature(cage, inner - distance * face.normal, 1e-10, "face");
        const Vec3 inwards = 0.3 * (middle - edge) - face.normal;
        expect_quadrature(cage, edge + (distance / norm(inwards)) * inwards, 1e-10, "edge");
        expect_quadrature(cage, corner(0) + distance * (middle - corner(0) - 0.5 * face.normal), 1e-10, "vertex");
      }
    }
  }
}

TEST(Green, GoesToTheLimitFromInsideOnTheCage) {
  for (const CageMesh& mesh : {test::l_cage(), test::bumpy_torus(9, 6, 1)}) {
    const Cage cage = mesh.cage();
    for (const auto& face : cage.faces()) {
      for (const Vec3& lambda : {Vec3{0.2, 0.3, 0.5}, Vec3{0.9, 0.05, 0.05}, Vec3{0.4, 0.6, 0}, Vec3{1, 0, 0}}) {
        Vec3 x{}, middle{};
        for (std::size_t k = 0; k < 3; ++k) {
          x = x + lambda[k] * cage.vertices()[face.corners[k]];
          middle = middle + cage.vertices()[face.corners[k]] / 3;
        }
        const Found on = found_at(cage, x);
        EXPECT_EQ(on.winding, 1);
        const auto [sum, place] = green_misses(cage, x, on);
        EXPECT_LT(sum, 1e-14);
        EXPECT_LT(place, 1e-14);
        for (const double height : {1e-6, 1e-9, 1e-12}) {
          const Found near = found_at(cage, x + height * (0.1 * (middle - x) - face.normal));
          if (near.winding != 1) continue;  // beside a reflex edge
          for (std::size_t i = 0; i < on.phi.size(); ++i) EXPECT_NEAR(near.phi[i], on.phi[i], 60 * height + 1e-14);
          for (std::size_t t = 0; t < on.psi.size(); ++t) EXPECT_NEAR(near.psi[t], on.psi[t], 60 * height + 1e-14);
        }
      }
    }
  }
}

// Far from the origin coordinates have fewer digits: points on a face are not outside for that.
TEST(Green, DoesNotDependOnUnitsOrPlace) {
  CageMesh mesh = test::l_cage();
  const Cage cage = mesh.cage();
  const double scale = 1000;
  const Vec3 shift{3e6, -2e6, 1e6};
  for (Vec3& v : mesh.vertices) v = scale * v + shift;
  const Cage moved = mesh.cage();
  for (const Vec3& x :
       {Vec3{0.4, 0.5, 0.3}, Vec3{1.5, -0.2, 0.6}, Vec3{0.7, -0.9, 0.01}, Vec3{0.31, 1, 0.2}, Vec3{0.1, 0.77, 0.7}}) {
    const Found found = found_at(cage, x), other = found_at(moved, scale * x + shift);
    ASSERT_EQ(found.winding, 1);
    ASSERT_EQ(other.winding, 1);
    for (std::size_t i = 0; i < found.phi.size(); ++i) EXPECT_NEAR(other.phi[i], found.phi[i], 1e-11);
    for (std::size_t t = 0; t < found.psi.size(); ++t) EXPECT_NEAR(other.psi[t], scale * found.psi[t], 1e-11 * scale);
  }
  CageMesh torus = test::bumpy_torus(9, 6, 1);
  for (Vec3& v : torus.vertices) v = scale * v + shift;
  const Cage oblique = torus.cage();
  for (const auto& [a, b, c] : oblique.triangles()) {
    const Vec3 x = lerp(lerp(torus.vertices[a], torus.vertices[b], 0.3), torus.vertices[c], 0.4);
    EXPECT_EQ(found_at(oblique, x).winding, 1) << "on a face, up to the rounding of its coordinates";
  }
}

const StretchedNormal::Corners some_triangle{{{0.1, 0.2, 0.3}, {1.2, 0.1, 0.5}, {0.4, 0.9, -0.2}}};
const StretchedNormal::Corners moved_triangle{{{0.3, 0.1, 0.2}, {1.0, 0.6, 0.9}, {-0.1, 1.3, 0.4}}};

Vec3 unit_normal(const StretchedNormal::Corners& at) {
  const Vec3 across = cross(at[1] - at[0], at[2] - at[0]);
  return across / norm(across);
}

TEST(StretchedNormal, IsTheMeanOfTheStretchesAlongTheNormal) {
  const StretchedNormal normal(some_triangle);
  EXPECT_EQ(normal.change(some_triangle), Vec3{});
  // The principal stretches from the metric of the map in an orthonormal frame of the triangle.
  const auto frame = [](const StretchedNormal::Corners& at, const Vec3& e, const Vec3& f) {
    const Vec3 u = at[1] - at[0], v = at[2] - at[0];
    return std::array<double, 4>{dot(u, e), dot(v, e), dot(u, f), dot(v, f)};
  };
  const Vec3 u = some_triangle[1] - some_triangle[0], e = u / norm(u), f = cross(unit_normal(some_triangle), e);
  const auto [a, b, c, d] = frame(some_triangle, e, f);
  const double det = a * d - b * c;
  const Vec3 mu = moved_triangle[1] - moved_triangle[0], mv = moved_triangle[2] - moved_triangle[0];
  const Vec3 je = (1 / det) * (d * mu - c * mv), jf = (1 / det) * (a * mv - b * mu);
  const double stretch = std::sqrt((dot(je, je) + dot(jf, jf)) / 2);
  EXPECT_LT(distance(normal.change(moved_triangle), stretch * unit_normal(moved_triangle) - unit_normal(some_triangle)), 1e-14);
}

TEST(StretchedNormal, HasTheseDerivatives) {
  const StretchedNormal normal(some_triangle);
  const StretchedNormal::Corners rates{{{0.5, -0.3, 0.2}, {-0.4, 0.7, 0.1}, {0.3, 0.6, -0.8}}};
  constexpr double h = 1e-5;
  StretchedNormal::Corners above = moved_triangle, below = moved_triangle;
  for (std::size_t k = 0; k < 3; ++k) {
    above[k] = above[k] + h * rates[k];
    below[k] = below[k] - h * rates[k];
  }
  const Vec3 rate = normal.rate(moved_triangle, rates);
  EXPECT_LT(distance(rate, (normal.change(above) - normal.change(below)) / (2 * h)), 1e-9);
  const Vec3 cotangent{0.7, -1.1, 0.4};
  const StretchedNormal::Corners gradient = normal.gradient(moved_triangle, cotangent);
  double sum = 0;
  for (std::size_t k = 0; k < 3; ++k) sum += dot(gradient[k], rates[k]);
  EXPECT_NEAR(sum, dot(rate, cotangent), 1e-14);
}

TEST(StretchedNormal, DoesNotExistOnALine) {
  const StretchedNormal normal(some_triangle);
  EXPECT_TRUE(normal.exists(moved_triangle));
  StretchedNormal::Corners line = moved_triangle;
  line[2] = lerp(line[0], line[1], 0.3);
  EXPECT_FALSE(normal.exists(line));
  line[2] = line[1] = line[0];
  EXPECT_FALSE(normal.exists(line));
}

}  // namespace
}  // namespace deform::green_test
