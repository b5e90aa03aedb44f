// SPDX-License-Identifier: GPL-3.0-or-later
// Sums over the functions of a lattice, against those over all control points with the recursion of de Boor in long double.
#include "core/numerics/lattice/lattice_sums.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/core/numerics/every_target.h"
#include "tests/core/numerics/random_points.h"

namespace deform::lattice_sums_test {
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

/// sum_p values[p] phi_p(u) over all control points.
std::array<Real, 3> sum_of_all(LatticeBasis basis, const std::array<std::size_t, 3>& points, const std::vector<Vec3>& values,
                               const Vec3& u) {
  std::array<std::vector<Real>, 3> along;
  for (std::size_t a = 0; a < 3; ++a) along[a] = values_along(basis, points[a], u[a]);
  std::array<Real, 3> sum{};
  for (std::size_t p = 0; p < values.size(); ++p) {
    const Real weight = along[0][p % points[0]] * along[1][p / points[0] % points[1]] * along[2][p / points[0] / points[1]];
    for (std::size_t c = 0; c < 3; ++c) sum[c] += weight * values[p][c];
  }
  return sum;
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
        const auto expected = sum_of_all(basis, points, values, u[n]);
        for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(found[n][c], static_cast<double>(expected[c]), 4e-15) << n << " " << c;
      }
    });
  }
}

/// Blocks of points: of each, most of the first `same` lie in one cell, every `step`-th elsewhere, and the last is outside.
std::vector<Vec3> in_one_cell(std::size_t same, std::size_t step) {
  std::vector<Vec3> u = test::random_points(3 * LatticeSums::block + 5, static_cast<unsigned>(7 * same + step));
  for (std::size_t n = 0; n < u.size(); ++n) {
    const std::size_t i = n % LatticeSums::block;
    for (double& c : u[n]) c = std::min(1.0, std::abs(c));
    // Within the second span along each axis of 3, 4 and 2 spans, at its begin every fifth.
    const std::array<double, 3> begin{1.0 / 3, 0.25, 0.5};
    for (std::size_t a = 0; a < 3 && i < same && i % step != step - 1; ++a) {
      u[n][a] = i % 5 == a ? begin[a] : begin[a] + 0.24 * u[n][a];
    }
    if (i == LatticeSums::block - 1) u[n][0] = -1;
  }
  return u;
}

TEST(LatticeSums, AreTheSameForPointsThatShareACell) {
  const std::array<std::size_t, 3> points{6, 7, 5};
  for (const LatticeBasis basis : all_bases) {
    const Lattice lattice({}, points, basis);
    const LatticeSums sums(lattice);
    const std::vector<Vec3> a = random_vectors(lattice.size(), 2), b = random_vectors(lattice.size(), 3);
    const std::array<const Vec3*, 2> both{a.data(), b.data()};
    for (std::size_t same = 1; same <= LatticeSums::block; ++same) {
      const std::vector<Vec3> u = in_one_cell(same, same % 3 == 0 ? 4 : LatticeSums::block + 1);
      std::vector<std::array<std::array<Real, 3>, 2>> expected(u.size());
      for (std::size_t n = 0; n < u.size(); ++n) {
        if (u[n][0] < 0) continue;
        expected[n] = {sum_of_all(basis, points, a, u[n]), sum_of_all(basis, points, b, u[n])};
      }
      test::on_every_target([&] {
        std::vector<Vec3> found(2 * u.size()), alone(2);
        sums(u, both, found.data());
        for (std::size_t n = 0; n < u.size(); ++n) {
          sums({&u[n], 1}, both, alone.data());
          for (std::size_t d = 0; d < 2; ++d) {
            EXPECT_EQ(found[2 * n + d], alone[d]) << same << " " << n;
            for (std::size_t c = 0; c < 3; ++c) {
              EXPECT_NEAR(alone[d][c], static_cast<double>(expected[n][d][c]), 4e-15) << same << " " << n;
            }
          }
        }
        // The same in tiles, also of fewer points, and of rows that do not follow each other.
        for (const std::size_t some : {LatticeSums::block, same}) {
          std::vector<PointId> rows;
          for (std::size_t i = 0; i < some; ++i) rows.push_back(static_cast<PointId>(LatticeSums::block + (i * same) % 21));
          std::vector<double> tile(6 * LatticeSums::block, 77);
          sums.tile(u, rows, both, tile.data());
          for (std::size_t k = 0; k < 6; ++k) {
            for (std::size_t i = 0; i < LatticeSums::block; ++i) {
              const double value = tile[k * LatticeSums::block + i];
              EXPECT_EQ(value, i < some ? found[2 * rows[i] + k / 3][k % 3] : 77) << same << " " << k << " " << i;
            }
          }
        }
      });
    }
  }
}

/// The coordinates in a turned and sheared frame are solved for in long double too.
TEST(LatticeSums, AreThoseOfTheirPlacesInATurnedFrame) {
  const LatticeFrame frame{{0.3, -2, 1}, {{{1.2, 0.9, -0.1}, {-0.8, 1.1, 0.2}, {0.3, 0.1, 2}}}};
  const std::array<std::size_t, 3> points{6, 5, 7};
  const auto solve = [&](const Vec3& x) {
    const auto det = [](const std::array<std::array<Real, 3>, 3>& m) {
      return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
             m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    };
    std::array<std::array<Real, 3>, 3> axes{};
    for (std::size_t a = 0; a < 3; ++a) std::copy(frame.axes[a].begin(), frame.axes[a].end(), axes[a].begin());
    std::array<Real, 3> u{};
    for (std::size_t a = 0; a < 3; ++a) {
      auto replaced = axes;
      for (std::size_t c = 0; c < 3; ++c) replaced[a][c] = static_cast<Real>(x[c]) - frame.origin[c];
      u[a] = det(replaced) / det(axes);
    }
    return u;
  };
  for (const LatticeBasis basis : all_bases) {
    const Lattice lattice(frame, points, basis);
    const LatticeSums sums(lattice);
    const std::vector<Vec3> values = random_vectors(lattice.size(), 5);
    const Vec3* const vectors = values.data();
    std::vector<Vec3> x;
    for (const Vec3& u : in_one_cell(12, 4)) x.push_back(lattice.place({std::abs(u[0]) * 0.9, u[1], u[2]}));
    const LatticeCoordinates at = coordinates_in(lattice, x);
    EXPECT_TRUE(at.outside.empty());
    std::vector<Vec3> found(x.size());
    sums(at.u, {&vectors, 1}, found.data());
    for (std::size_t n = 0; n < x.size(); ++n) {
      const auto u = solve(x[n]);
      const Vec3 rounded{static_cast<double>(u[0]), static_cast<double>(u[1]), static_cast<double>(u[2])};
      const auto expected = sum_of_all(basis, points, values, rounded);
      // The coordinates have roundings of their own, and the slope of the sums is about that of the spans.
      for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(found[n][c], static_cast<double>(expected[c]), 1e-13) << n << " " << c;
    }
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
}  // namespace deform::lattice_sums_test
