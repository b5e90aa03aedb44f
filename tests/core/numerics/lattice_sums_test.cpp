// SPDX-License-Identifier: GPL-3.0-or-later
// Sums over the functions of a lattice, against those over all control points with the recursion of de Boor in long double.
#include "core/numerics/lattice/lattice_sums.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/core/numerics/every_target.h"
#include "tests/core/numerics/random_points.h"

namespace deform {
namespace {

using Real = long double;

constexpr std::array<LatticeBasis, 3> all_bases{LatticeBasis::uniform_cubic, LatticeBasis::clamped_cubic,
                                                LatticeBasis::bernstein};

/// Knot k of the functions of degree `degree` along an axis.
Real knot(LatticeBasis basis, std::size_t points, std::size_t degree, std::size_t k) {
  const Real spans = static_cast<Real>(points - degree), at = (static_cast<Real>(k) - static_cast<Real>(degree)) / spans;
  return basis == LatticeBasis::uniform_cubic ? at : std::min(std::max(at, Real(0)), Real(1));
}

Real de_boor(const std::vector<Real>& t, std::size_t i, std::size_t degree, Real u) {
  if (degree == 0) return (u == 1 ? t[i] < 1 && t[i + 1] == 1 : t[i] <= u && u < t[i + 1]) ? 1 : 0;
  const Real wide = t[i + degree] - t[i], next = t[i + degree + 1] - t[i + 1];
  return (wide > 0 ? (u - t[i]) / wide * de_boor(t, i, degree - 1, u) : 0) +
         (next > 0 ? (t[i + degree + 1] - u) / next * de_boor(t, i + 1, degree - 1, u) : 0);
}

/// All functions along an axis at u.
std::vector<Real> values_along(LatticeBasis basis, std::size_t points, double u) {
  const std::size_t degree = basis == LatticeBasis::bernstein ? points - 1 : 3;
  std::vector<Real> t, values;
  for (std::size_t k = 0; k < points + degree + 1; ++k) t.push_back(knot(basis, points, degree, k));
  for (std::size_t i = 0; i < points; ++i) values.push_back(de_boor(t, i, degree, u));
  return values;
}

std::vector<Vec3> random_vectors(std::size_t count, unsigned seed) {
  const auto values = test::random_values(3 * count, seed);
  std::vector<Vec3> vectors(count);
  for (std::size_t i = 0; i < count; ++i) vectors[i] = {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
  return vectors;
}

/// Within spans, at knots and at both ends.
std::vector<Vec3> places(std::size_t spans) {
  std::vector<Vec3> u = test::random_points(50, 4);
  for (Vec3& x : u) {
    for (double& c : x) c = std::min(1.0, std::abs(c));
  }
  for (std::size_t k = 0; k <= spans; ++k) {
    const double at = static_cast<double>(k) / static_cast<double>(spans);
    u.push_back({at, 0.37, 1 - at});
    u.push_back({0.61, at, std::nextafter(at, 0.5)});
  }
  u.push_back({0, 0, 0});
  u.push_back({1, 1, 1});
  return u;
}

TEST(LatticeSums, AreThoseOverAllControlPoints) {
  const std::array<std::size_t, 3> points{5, 7, 4};
  for (const LatticeBasis basis : all_bases) {
    const Lattice lattice({}, points, basis);
    const LatticeSums sums(lattice);
    const std::vector<Vec3> values = random_vectors(lattice.size(), 2), u = places(lattice.axis(1).spans());
    const Vec3* const vectors = values.data();
    test::on_every_target([&] {
      std::vector<Vec3> found(u.size());
      sums(u, {&vectors, 1}, found.data());
      for (std::size_t n = 0; n < u.size(); ++n) {
        std::array<std::vector<Real>, 3> along;
        for (std::size_t a = 0; a < 3; ++a) along[a] = values_along(basis, points[a], u[n][a]);
        std::array<Real, 3> expected{};
        for (std::size_t p = 0; p < values.size(); ++p) {
          const Real weight = along[0][p % points[0]] * along[1][p / points[0] % points[1]] * along[2][p / points[0] / points[1]];
          for (std::size_t c = 0; c < 3; ++c) expected[c] += weight * values[p][c];
        }
        for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(found[n][c], static_cast<double>(expected[c]), 4e-15) << n << " " << c;
      }
    });
  }
}

TEST(LatticeSums, DependOnTheirPlaceAndVectorAlone) {
  for (const LatticeBasis basis : all_bases) {
    const Lattice lattice({}, {6, 5, 8}, basis);
    const LatticeSums sums(lattice);
    const std::vector<Vec3> a = random_vectors(lattice.size(), 2), b = random_vectors(lattice.size(), 3);
    std::vector<Vec3> u = places(3);
    u[7][0] = -1;
    const std::vector<const Vec3*> both{a.data(), b.data(), a.data()};
    test::on_every_target([&] {
      std::vector<Vec3> together(3 * u.size());
      sums(u, both, together.data());
      std::vector<PointId> rows;
      for (std::size_t n = u.size(); n-- > 0;) rows.push_back(static_cast<PointId>(n));
      std::vector<Vec3> alone(u.size());
      sums(u, rows, {&both[1], 1}, alone.data());
      for (std::size_t n = 0; n < u.size(); ++n) {
        EXPECT_EQ(together[3 * n + 1], alone[u.size() - 1 - n]) << n;
        EXPECT_EQ(together[3 * n], together[3 * n + 2]) << n;
      }
      EXPECT_EQ(together[3 * 7], Vec3{}) << "outside";
    });
  }
}

}  // namespace
}  // namespace deform
