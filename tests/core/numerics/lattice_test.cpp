// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 3.2: lattices of tensor-product splines. The reference is the recursion of de Boor in long double and the sum over all
// control points.
#include "core/numerics/lattice/lattice.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "core/base/vectors.h"
#include "core/numerics/lattice/moved_lattice.h"
#include "tests/support/expect_error.h"

namespace deform::lattice_test {
namespace {

using Real = long double;

constexpr std::array<LatticeBasis, 3> all_bases{LatticeBasis::uniform_cubic, LatticeBasis::clamped_cubic,
                                                LatticeBasis::bernstein};

/// Knots written out again.
std::vector<Real> knots_of(LatticeBasis basis, std::size_t points) {
  std::vector<Real> knots;
  if (basis == LatticeBasis::bernstein) {
    knots.assign(points, 0);
    knots.insert(knots.end(), points, 1);
    return knots;
  }
  for (std::size_t k = 0; k < points + 4; ++k) {
    Real knot = (static_cast<Real>(k) - 3) / static_cast<Real>(points - 3);
    if (basis == LatticeBasis::clamped_cubic) knot = std::min(std::max(knot, Real(0)), Real(1));
    knots.push_back(knot);
  }
  return knots;
}

/// N_i of a degree at u, or its derivative (of a polynomial piece: the one that u lies in, the last at u = 1).
Real de_boor(const std::vector<Real>& t, std::size_t i, std::size_t degree, Real u, std::size_t derivative) {
  if (degree == 0) {
    const bool in_piece = u == 1 ? t[i] < 1 && t[i + 1] == 1 : t[i] <= u && u < t[i + 1];
    return derivative == 0 && in_piece ? 1 : 0;
  }
  const Real wide = t[i + degree] - t[i], next = t[i + degree + 1] - t[i + 1];
  const std::size_t low = degree - 1;
  if (derivative > 0) {
    const Real a = wide > 0 ? de_boor(t, i, low, u, derivative - 1) / wide : 0;
    const Real b = next > 0 ? de_boor(t, i + 1, low, u, derivative - 1) / next : 0;
    return static_cast<Real>(degree) * (a - b);
  }
  const Real a = wide > 0 ? (u - t[i]) / wide * de_boor(t, i, low, u, 0) : 0;
  const Real b = next > 0 ? (t[i + degree + 1] - u) / next * de_boor(t, i + 1, low, u, 0) : 0;
  return a + b;
}

std::vector<double> places() {
  std::vector<double> u{0, 1, 0.5, 0.25, 1e-13, 1 - 1e-13};
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> uniform;
  for (int i = 0; i < 40; ++i) u.push_back(uniform(random));
  return u;
}

/// All values at u, those of functions that are not evaluated being 0.
std::vector<double> values_at(const SplineAxis& axis, double u, std::size_t derivative) {
  std::array<double, SplineAxis::most_order> some{};
  const std::size_t span = axis.span(u);
  axis.evaluate(span, u, derivative, some.data());
  std::vector<double> all(axis.size(), 0.0);
  for (std::size_t r = 0; r < axis.order(); ++r) all[span + r] = some[r];
  return all;
}

TEST(SplineAxis, IsDeBoorsRecursion) {
  for (const LatticeBasis basis : all_bases) {
    for (const std::size_t points : {4u, 5u, 9u, 16u}) {
      SCOPED_TRACE(testing::Message() << static_cast<int>(basis) << " " << points);
      const SplineAxis axis(basis, points);
      const std::vector<Real> t = knots_of(basis, points);
      for (const double u : places()) {
        for (std::size_t d = 0; d <= 2; ++d) {
          const std::vector<double> values = values_at(axis, u, d);
          Real size = 0;
          std::vector<Real> wanted;
          for (std::size_t i = 0; i < points; ++i) {
            wanted.push_back(de_boor(t, i, axis.degree(), u, d));
            size = std::max(size, std::abs(wanted.back()));
          }
          // At a knot rounding decides about the span: second derivatives of cubic splines have a kink there.
          for (std::size_t i = 0; i < points; ++i) EXPECT_NEAR(values[i], wanted[i], 2e-12 * size) << i << " " << u << " " << d;
        }
      }
    }
  }
}

TEST(SplineAxis, AddsUpToOneAndReproducesTheLine) {
  for (const LatticeBasis basis : all_bases) {
    const SplineAxis axis(basis, 11);
    for (const double u : places()) {
      const std::vector<double> values = values_at(axis, u, 0);
      double one = 0, line = 0;
      for (std::size_t i = 0; i < values.size(); ++i) {
        EXPECT_GE(values[i], -1e-15);
        one += values[i];
        line += axis.greville(i) * values[i];
      }
      EXPECT_NEAR(one, 1, 1e-15 * 8);
      EXPECT_NEAR(line, u, 1e-15 * 8);
    }
  }
}

TEST(SplineAxis, SupportsHaveFourSpans) {
  const SplineAxis axis(LatticeBasis::uniform_cubic, 12);  // 9 spans
  for (std::size_t i = 0; i < 12; ++i) {
    for (int s = 0; s < 900; ++s) {
      const double u = (s + 0.5) / 900;
      const double at = u * 9 + 3;  // in spans from the first knot
      const bool reached = at > static_cast<double>(i) && at < static_cast<double>(i) + 4;
      EXPECT_EQ(values_at(axis, u, 0)[i] > 0, reached) << i << " " << u;
    }
  }
}

TEST(SplineAxis, GramIsTheIntegral) {
  for (const LatticeBasis basis : all_bases) {
    const SplineAxis axis(basis, 7);
    const std::vector<Real> t = knots_of(basis, 7);
    for (const auto& [p, q] : {std::pair<std::size_t, std::size_t>{0, 0}, {1, 1}, {2, 2}, {2, 0}, {0, 1}}) {
      const Eigen::MatrixXd G = axis.gram(p, q);
      // Simpson's rule composed finely enough for its error of h^4 (times derivatives of the product) to vanish.
      const std::size_t spans = axis.spans(), per_span = 4000 / spans;
      Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic> S = decltype(S)::Zero(7, 7);
      for (std::size_t s = 0; s < spans; ++s) {
        const Real h = Real(1) / static_cast<Real>(spans * per_span);
        for (std::size_t n = 0; n <= per_span; ++n) {
          // Inside of the span: at its ends the second derivatives of neighbouring pieces differ.
          Real u = static_cast<Real>(s) / static_cast<Real>(spans) + static_cast<Real>(n) * h;
          if (n == 0) u += 1e-12L;
          if (n == per_span) u -= 1e-12L;
          const Real weight = h / 3 * (n == 0 || n == per_span ? 1 : n % 2 == 1 ? 4 : 2);
          for (Eigen::Index i = 0; i < 7; ++i) {
            const Real a = de_boor(t, static_cast<std::size_t>(i), axis.degree(), u, p);
            if (a == 0) continue;
            for (Eigen::Index j = 0; j < 7; ++j) {
              S(i, j) += weight * a * de_boor(t, static_cast<std::size_t>(j), axis.degree(), u, q);
            }
          }
        }
      }
      const double size = G.cwiseAbs().maxCoeff();
      for (Eigen::Index i = 0; i < 7; ++i) {
        for (Eigen::Index j = 0; j < 7; ++j) {
          EXPECT_NEAR(G(i, j), static_cast<double>(S(i, j)), 1e-8 * size) << p << q << " " << i << " " << j;
        }
      }
    }
  }
}

TEST(SplineAxis, GaussRuleIsExact) {
  for (std::size_t count = 1; count <= SplineAxis::most_order; ++count) {
    const GaussRule rule = gauss_rule(count);
    for (std::size_t power = 0; power < 2 * count; ++power) {
      double sum = 0;
      for (std::size_t g = 0; g < count; ++g) sum += rule.weights[g] * std::pow(rule.nodes[g], static_cast<double>(power));
      EXPECT_NEAR(sum, 1 / (static_cast<double>(power) + 1), 4e-15) << count << " " << power;
    }
  }
}

LatticeFrame turned_frame() { return {{1, -2, 0.5}, {{{2, 1, 0}, {-0.5, 1, 0.3}, {0.2, -0.3, 1.5}}}}; }

std::vector<Vec3> inner_points(const Lattice& lattice, std::size_t count, unsigned seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform;
  std::vector<Vec3> x(count);
  for (Vec3& p : x) p = lattice.place({uniform(random), uniform(random), uniform(random)});
  return x;
}

TEST(Lattice, IsTheSumOverAllControlPoints) {
  std::mt19937_64 random(2);
  std::normal_distribution<double> normal;
  for (const LatticeBasis basis : all_bases) {
    const std::array<std::size_t, 3> points{5, 4, 7};
    const Lattice lattice(turned_frame(), points, basis);
    std::vector<Vec3> values(lattice.size());
    for (Vec3& value : values) value = {normal(random), normal(random), normal(random)};
    for (const Vec3& x : inner_points(lattice, 50, 3)) {
      const std::optional<Vec3> u = lattice.inside(x);
      ASSERT_TRUE(u);
      std::array<Real, 3> wanted{};
      for (std::size_t p = 0; p < lattice.size(); ++p) {
        const std::array<std::size_t, 3> index{p % 5, p / 5 % 4, p / 20};
        Real phi = 1;
        for (std::size_t k = 0; k < 3; ++k) {
          const std::size_t degree = basis == LatticeBasis::bernstein ? points[k] - 1 : 3;
          phi *= de_boor(knots_of(basis, points[k]), index[k], degree, (*u)[k], 0);
        }
        for (std::size_t k = 0; k < 3; ++k) wanted[k] += phi * values[p][k];
      }
      const Vec3 sum = lattice.sum(values, *u);
      for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(sum[k], static_cast<double>(wanted[k]), 1e-13);
    }
  }
}

TEST(Lattice, AtRestIsItsFrame) {
  for (const LatticeBasis basis : all_bases) {
    const Lattice lattice(turned_frame(), {6, 5, 4}, basis);
    const std::vector<Vec3> control = lattice.control_points();
    for (const Vec3& x : inner_points(lattice, 100, 4)) {
      const Vec3 u = *lattice.inside(x);
      EXPECT_LT(distance(lattice.sum(control, u), x), 1e-14 * 5);
      EXPECT_LT(distance(lattice.place(u), x), 1e-14 * 5);
    }
  }
}

TEST(Lattice, DerivativesAreDifferences) {
  const Lattice lattice(turned_frame(), {6, 5, 4}, LatticeBasis::clamped_cubic);
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  std::vector<Vec3> values(lattice.size());
  for (Vec3& value : values) value = {normal(random), normal(random), normal(random)};
  constexpr double h = 1e-5;
  const Vec3 u{0.37, 0.61, 0.43};
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t more = 0; more < 3; ++more) {
      std::array<std::size_t, 3> low{}, high{};
      ++low[more];
      high = low;
      ++high[k];
      Vec3 above = u, below = u;
      above[k] += h;
      below[k] -= h;
      const Vec3 difference = (lattice.sum(values, above, low) - lattice.sum(values, below, low)) / (2 * h);
      const Vec3 exact = lattice.sum(values, u, high);
      EXPECT_LT(distance(difference, exact), 1e-6 * (1 + norm(exact)));
    }
  }
}

TEST(Lattice, NamesThePointsOutside) {
  const Lattice lattice({{0, 0, 0}, {{{2, 0, 0}, {0, 1, 0}, {0, 0, 1}}}}, {5, 4, 4}, LatticeBasis::uniform_cubic);
  const std::vector<Vec3> points{{1, 0.5, 0.5}, {2.001, 0.5, 0.5}, {0, 0, 0}, {2, 1, 1}, {1, -1e-3, 0.5}, {1, 0.5, std::nan("")}};
  const LatticeCoordinates at = coordinates_in(lattice, points);
  EXPECT_EQ(at.outside, (std::vector<std::uint32_t>{1, 4, 5}));
  EXPECT_EQ(at.u[0], (Vec3{0.5, 0.5, 0.5}));
  EXPECT_EQ(at.u[3], (Vec3{1, 1, 1}));
  EXPECT_EQ(coordinates_in(lattice, std::vector<Vec3>{{3, 0, 0}, {0, 0, 0}}).outside, (std::vector<std::uint32_t>{0}));
}

TEST(Lattice, RefusesFramesWithoutVolume) {
  const auto refused = [](const LatticeFrame& frame) {
    test::expect_error(ErrorCode::invalid_argument, {"axes"}, [&] { Lattice(frame, {4, 4, 4}, LatticeBasis::uniform_cubic); });
  };
  refused({{0, 0, 0}, {{{1, 0, 0}, {0, 1, 0}, {1, 1, 0}}}});
  refused({{0, 0, 0}, {{{1, 0, 0}, {0, 1, 0}, {0, 0, 0}}}});
  refused({{0, 0, 0}, {{{1, 0, 0}, {0, 1, 0}, {0, 0, std::numeric_limits<double>::infinity()}}}});
  test::expect_error(ErrorCode::invalid_argument, {"3 points", "at least 4"}, [] {
    Lattice({}, {4, 3, 4}, LatticeBasis::clamped_cubic);
  });
  test::expect_error(ErrorCode::invalid_argument, {"17 points", "2 to 16"}, [] {
    Lattice({}, {4, 3, 17}, LatticeBasis::bernstein);
  });
}

/// A lattice bent round an axis and twisted.
std::vector<Vec3> bent(const Lattice& lattice) {
  std::vector<Vec3> control = lattice.control_points();
  for (Vec3& c : control) {
    const double angle = 0.5 * c[0], radius = 4 + c[2], lift = c[1] + 0.1 * c[0] * c[2];
    c = {radius * std::sin(angle), lift, radius * std::cos(angle)};
  }
  return control;
}

// Thesis 3.2: x(u(x)) = x for all points.
TEST(MovedLattice, NewtonFindsAllPoints) {
  for (const LatticeBasis basis : all_bases) {
    const Lattice lattice({{0, 0, 0}, {{{4, 0, 0}, {0, 2, 0}, {0, 0, 2}}}}, {9, 6, 5}, basis);
    const MovedLattice moved(lattice, bent(lattice));
    const double D = bounding_box(bent(lattice)).diagonal();
    std::mt19937_64 random(6);
    std::uniform_real_distribution<double> uniform;
    std::vector<Vec3> u, x;
    for (int i = 0; i < 3000; ++i) {
      u.push_back({uniform(random), uniform(random), uniform(random)});
      for (std::size_t k = 0; k < 3 && i % 10 == 0; ++k) u.back()[k] = std::round(u.back()[k]);  // corners
      x.push_back(moved.place(u.back()));
    }
    const LatticeCoordinates at = moved.coordinates(x);
    EXPECT_TRUE(at.outside.empty());
    for (std::size_t i = 0; i < u.size(); ++i) {
      EXPECT_LT(distance(moved.place(at.u[i]), x[i]), 1e-12 * D);
      EXPECT_LT(distance(at.u[i], u[i]), 1e-10);
    }
  }
}

TEST(MovedLattice, NamesThePointsOutside) {
  const Lattice lattice({{0, 0, 0}, {{{4, 0, 0}, {0, 2, 0}, {0, 0, 2}}}}, {9, 6, 5}, LatticeBasis::uniform_cubic);
  const MovedLattice moved(lattice, bent(lattice));
  const Vec3 inside = moved.place({0.5, 0.5, 1}), away = inside + Vec3{0, 0, 1e-3};
  EXPECT_TRUE(moved.coordinates(inside));
  EXPECT_FALSE(moved.coordinates(away));
  EXPECT_EQ(moved.coordinates(std::vector<Vec3>{inside, away, {0, 0, 0}}).outside, (std::vector<std::uint32_t>{1, 2}));
}

TEST(MovedLattice, RefusesFolds) {
  const Lattice lattice({{0, 0, 0}, {{{4, 0, 0}, {0, 1, 0}, {0, 0, 1}}}}, {12, 4, 4}, LatticeBasis::uniform_cubic);
  std::vector<Vec3> inside_out = lattice.control_points(), overlapping = inside_out;
  for (Vec3& c : inside_out) c[2] = 1 - c[2];
  const MovedLattice mirrored(lattice, inside_out);
  test::expect_error(ErrorCode::invalid_argument, {"point 1", "det dx/du"}, [&] {
    mirrored.coordinates(std::vector<Vec3>{{9, 9, 9}, {2, 0.5, 0.5}});
  });
  // Wound up by more than a turn, so that its ends lie in one place.
  for (Vec3& c : overlapping) {
    const double angle = 1.9 * c[0], radius = 2 + c[2];
    c = {radius * std::sin(angle), c[1], radius * std::cos(angle)};
  }
  const MovedLattice wound(lattice, overlapping);
  const Vec3 twice = wound.place({0.03, 0.5, 0.5});
  test::expect_error(ErrorCode::invalid_argument, {"two different coordinates"}, [&] { wound.coordinates(twice); });
  EXPECT_TRUE(wound.coordinates(wound.place({0.5, 0.5, 0.5})));
}

}  // namespace
}  // namespace deform::lattice_test
