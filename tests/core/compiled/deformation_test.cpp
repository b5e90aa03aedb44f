// SPDX-License-Identifier: GPL-3.0-or-later
// Points and derivatives of deformations whose right answers are known: every point that follows goes by a weighted mean of the
// motions of the handles.
#include "core/compiled/deformation.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <random>

#include "tests/core/compiled/contents.h"
#include "tests/support/expect_error.h"

namespace deform::compiled::deformation_test {
namespace {

using deform::test::expect_error;

const std::vector<double> at{0.3, 0.4, -0.2, 0.1, 0.7};
const std::vector<double> direction{0.5, -0.3, 0.8, 0.2, -0.6};

/// Rodrigues' formula for one point.
Vec3 turned(const Vec3& x, const Vec3& axis, const Vec3& centre, double angle) {
  const Vec3 a = axis / norm(axis), r = x - centre;
  return centre + std::cos(angle) * r + std::sin(angle) * cross(a, r) + (1 - std::cos(angle)) * dot(a, r) * a;
}

/// The motions of the handles of Blend, from their description.
Vec3 moved(const Vec3& x, std::size_t handle, std::span<const double> v) {
  if (handle == 0) {
    const Vec3 tilted = turned(x + v[0] * Vec3{0.1, 0, 1}, {0.2, 1, 0.1}, {0.4, 0.1, 0}, v[1]);
    return turned(tilted, {0, 0, 1}, {0, 0.2, 0}, 0.5 * v[2]) + v[3] * Vec3{0, 0.3, 0.4};
  }
  const Vec3 c{1, 0.5, 0};
  const Vec3 grown = c + (1 + v[2]) * (x - c);
  const Vec3 n = Vec3{0, 1, 1} / norm(Vec3{0, 1, 1});
  const Vec3 stretched = grown + v[3] * dot(n, grown - c) * n;
  return turned(stretched, {1, 0, 0}, c, 0.25 * v[4]);
}

Points expected(const Content& content, std::span<const double> v) {
  Points points;
  for (std::size_t i = 0; i < content.points(); ++i) {
    const Vec3& x = content.rest[i];
    const std::uint32_t region = content.regions[i];
    Vec3 y = x;
    if (region == 0 || region == 1) y = moved(x, region, v);
    if (region == following_region) {
      for (std::size_t h = 0; h < 2; ++h) y = y + test::pull(x, h) * (moved(x, h, v) - x);
    }
    points.push_back(y);
  }
  return points;
}

std::vector<double> evaluated(const Deformation& deformation, const std::vector<double>& designs, int threads = 1) {
  std::vector<double> points(designs.size() / deformation.variables() * 3 * deformation.points());
  deformation.evaluate(designs, points, threads);
  return points;
}

std::vector<double> designs_of(std::size_t count) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(-0.5, 0.5);
  std::vector<double> designs(5 * count);
  for (double& x : designs) x = uniform(random);
  return designs;
}

TEST(CompiledDeformation, MovesPointsAsTheMotionsSay) {
  const Deformation deformation(test::Blend(1000).content);
  const std::vector<double> points = evaluated(deformation, at);
  const Points right = expected(deformation.content(), at);
  for (std::size_t i = 0; i < right.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(points[3 * i + k], right[i][k], 1e-14 * 10) << i;
  }
}

TEST(CompiledDeformation, RestIsRestToTheLastBit) {
  const Deformation deformation(test::Blend(333).content);
  const std::vector<double> points = evaluated(deformation, std::vector<double>(5, 0.0));
  EXPECT_EQ(std::memcmp(points.data(), deformation.content().rest.data(), points.size() * sizeof(double)), 0);
}

TEST(CompiledDeformation, BitsDependOnNothingButTheDesign) {
  for (const std::uint32_t planes : {0u, 1u}) {
    test::Blend blend(20000, planes);
    for (std::size_t i = 0; i < 80 && planes > 0; ++i) blend.content.on_planes[i] = 0;  // handles move freely
    const Deformation deformation(std::move(blend.content));
    const std::vector<double> designs = designs_of(37);
    const std::vector<double> together = evaluated(deformation, designs);
    EXPECT_EQ(evaluated(deformation, designs, 3), together);
    EXPECT_EQ(evaluated(deformation, designs, 0), together);
    const std::size_t size = 3 * deformation.points();
    for (std::size_t i = 0; i < 37; i += 6) {
      const std::vector<double> alone = evaluated(deformation, {designs.begin() + static_cast<std::ptrdiff_t>(5 * i),
                                                                designs.begin() + static_cast<std::ptrdiff_t>(5 * i + 5)});
      EXPECT_EQ(std::memcmp(alone.data(), together.data() + i * size, size * sizeof(double)), 0) << i;
    }
  }
}

TEST(CompiledDeformation, FloatsAreRoundedOnce) {
  const Deformation deformation(test::Blend(500).content);
  const std::vector<double> points = evaluated(deformation, at);
  std::vector<float> rounded(points.size());
  deformation.evaluate(at, rounded);
  for (std::size_t i = 0; i < points.size(); ++i) EXPECT_EQ(rounded[i], static_cast<float>(points[i])) << i;
  std::vector<double> vectors(points.size());
  std::vector<float> rounded_vectors(points.size());
  deformation.jacobian_vector(at, direction, vectors);
  deformation.jacobian_vector(at, direction, rounded_vectors);
  for (std::size_t i = 0; i < points.size(); ++i) EXPECT_EQ(rounded_vectors[i], static_cast<float>(vectors[i])) << i;
}

TEST(CompiledDeformation, DerivativesAreThoseOfThePoints) {
  for (const std::uint32_t planes : {0u, 2u}) {
    test::Blend blend(3000, planes);
    for (std::size_t i = 0; i < 80 && planes > 0; ++i) blend.content.on_planes[i] = 0;
    const Deformation deformation(std::move(blend.content));
    const std::size_t size = 3 * deformation.points();
    std::vector<double> vectors(size);
    deformation.jacobian_vector(at, direction, vectors);
    constexpr double h = 1e-6;
    std::vector<double> above = at, below = at;
    for (std::size_t k = 0; k < at.size(); ++k) {
      above[k] += h * direction[k];
      below[k] -= h * direction[k];
    }
    const std::vector<double> plus = evaluated(deformation, above), minus = evaluated(deformation, below);
    for (std::size_t i = 0; i < size; ++i) EXPECT_NEAR(vectors[i], (plus[i] - minus[i]) / (2 * h), 2e-9) << i;

    // <w, J v> = <J^T w, v>, for threads and floats too.
    std::mt19937_64 random(8);
    std::normal_distribution<double> normal;
    std::vector<double> cotangent(size), gradient(5), threaded(5), from_floats(5), from_rounded(5);
    std::vector<float> floats(size);
    for (std::size_t i = 0; i < size; ++i) floats[i] = static_cast<float>(cotangent[i] = normal(random));
    deformation.vector_jacobian(at, cotangent, gradient);
    double left = 0, right = 0, lengths = 0;
    for (std::size_t i = 0; i < size; ++i) {
      left += cotangent[i] * vectors[i];
      lengths += std::abs(cotangent[i] * vectors[i]);
    }
    for (std::size_t k = 0; k < 5; ++k) right += gradient[k] * direction[k];
    EXPECT_NEAR(left, right, 1e-13 * lengths);
    deformation.vector_jacobian(at, cotangent, threaded, 3);
    EXPECT_EQ(threaded, gradient);
    deformation.vector_jacobian(at, floats, from_floats);
    const std::vector<double> widened(floats.begin(), floats.end());
    deformation.vector_jacobian(at, widened, from_rounded);
    EXPECT_EQ(from_floats, from_rounded);
  }
}

TEST(CompiledDeformation, PointsOfPlanesStayInThem) {
  test::Blend blend(2000, 2);
  for (std::size_t i = 0; i < 80; ++i) blend.content.on_planes[i] = 0;
  const Deformation deformation(std::move(blend.content));
  const std::vector<double> points = evaluated(deformation, at);
  std::size_t on = 0, moving = 0;
  for (std::size_t i = 0; i < deformation.points(); ++i) {
    for (std::size_t k = 0; k < 2; ++k) {
      if ((deformation.content().on_planes[i] >> k & 1u) == 0) continue;
      EXPECT_EQ(points[3 * i + k], 0.0) << i;
      ++on;
      if (points[3 * i + 2] != deformation.content().rest[i][2]) ++moving;
    }
  }
  EXPECT_GT(on, 100u);
  EXPECT_GT(moving, 100u);
}

TEST(CompiledDeformation, RefusesBadDesigns) {
  const Deformation deformation(test::Blend(100).content);
  std::vector<double> points(300), vectors(300), gradient(5);
  const auto refused = [&](std::vector<const char*> says, const std::function<void()>& call) {
    expect_error(ErrorCode::invalid_argument, says, call);
  };
  const auto evaluate = [&](std::vector<double> values) { return [&, values] { deformation.evaluate(values, points); }; };
  refused({"designs[0].variables[1] (\"turn\"): 1.1 is outside of its bounds [-1, 1]"}, evaluate({0, 1.1, 0, 0, 0}));
  refused({"variables[4] (\"roll\")", "finite"}, evaluate({0, 0, 0, 0, std::nan("")}));
  {
    test::Blend unbounded(100);
    for (Variable& variable : unbounded.content.variables) {
      variable.lower = -HUGE_VAL;
      variable.upper = HUGE_VAL;
    }
    const Deformation wide(std::move(unbounded.content));
    refused({"designs[0].variables[1] (\"turn\"): 1e+300 turns by more than 1e12 radians"}, [&] {
      wide.evaluate(std::vector<double>{0, 1e300, 0, 0, 0}, points);
    });
    wide.evaluate(std::vector<double>{0, 1e10, 0, 0, 0}, points);
    refused({"designs[0]: variables: they move handle \"left\" farther than a number can say"}, [&] {
      wide.evaluate(std::vector<double>{1.7e308, 0, 0, 1.7e308, 0}, points);
    });
  }
  refused({"designs: 4 numbers", "5 variables"}, evaluate({0, 0, 0, 0}));
  refused({"points: expected 600 numbers", "got 300"}, evaluate(std::vector<double>(10, 0.0)));
  refused({"direction: expected 5"}, [&] { deformation.jacobian_vector(at, std::vector<double>(4), vectors); });
  refused({"direction[2]: must be finite"}, [&] {
    deformation.jacobian_vector(at, std::vector<double>{0, 0, HUGE_VAL, 0, 0}, vectors);
  });
  refused({"vectors: expected 300"}, [&] { deformation.jacobian_vector(at, direction, std::span(vectors).first(3)); });
  refused({"cotangent: expected 300"},
          [&] { deformation.vector_jacobian(at, std::span<const double>(vectors).first(3), gradient); });
  vectors[7] = std::nan("");
  refused({"cotangent[2]: must be finite"}, [&] { deformation.vector_jacobian(at, std::span<const double>(vectors), gradient); });
  // Beside a bound by rounding in floats: the bound.
  std::vector<double> beside(300), on(300);
  deformation.evaluate(std::vector<double>{static_cast<double>(2.0f) * (1 + 1e-8), 0, 0, 0, 0}, beside);
  deformation.evaluate(std::vector<double>{2, 0, 0, 0, 0}, on);
  EXPECT_EQ(beside, on);
}

TEST(CompiledDeformation, RefusesCoincidentPointsThatPart) {
  test::Blend blend(100);
  blend.content.rest[45] = blend.content.rest[5];
  blend.content.coincident = {{5, 45}};
  const Deformation deformation(std::move(blend.content));
  std::vector<double> points(300);
  expect_error(ErrorCode::invalid_argument, {"designs[0]: points 5 (handle \"left\") and 45 (handle \"right\") coincide"},
               [&] { deformation.evaluate(at, points); });
  EXPECT_NO_THROW(deformation.evaluate(std::vector<double>(5, 0.0), points));
}

TEST(CompiledDeformation, CoincidentPointsMayGoTogetherOrBothStay) {
  for (const Pair pair : {Pair{5, 6}, Pair{5, 88}, Pair{88, 5}, Pair{88, 99}}) {
    test::Blend blend(100);
    blend.content.rest[pair.second] = blend.content.rest[pair.first];
    blend.content.coincident = {pair};
    const bool parts = blend.content.regions[pair.first] != blend.content.regions[pair.second];
    const Deformation deformation(std::move(blend.content));
    std::vector<double> points(300);
    EXPECT_NO_THROW(deformation.evaluate(std::vector<double>(5, 0.0), points)) << pair.first << " " << pair.second;
    // The second handle alone moves neither.
    EXPECT_NO_THROW(deformation.evaluate(std::vector<double>{0, 0, 0, 0, 1}, points)) << pair.first << " " << pair.second;
    if (!parts) {
      EXPECT_NO_THROW(deformation.evaluate(at, points)) << pair.first << " " << pair.second;
      continue;
    }
    const auto name = [](std::uint32_t id) { return id == 5 ? "5 (handle \"left\")" : "88 (fixed)"; };
    const std::string names = std::string("points ") + name(pair.first) + " and " + name(pair.second) + " coincide";
    expect_error(ErrorCode::invalid_argument, {names.c_str()}, [&] { deformation.evaluate(at, points); });
  }
}

TEST(CompiledDeformation, RefusesToLeaveSymmetryPlanes) {
  const Deformation deformation(test::Blend(100, 1).content);
  std::vector<double> points(300), gradient(5);
  expect_error(ErrorCode::invalid_argument, {"lies on symmetry[0]", "difference"}, [&] { deformation.evaluate(at, points); });
  expect_error(ErrorCode::invalid_argument, {"direction: moves point", "symmetry[0]"},
               [&] { deformation.jacobian_vector(std::vector<double>(5, 0.0), direction, points); });
  expect_error(ErrorCode::invalid_argument, {"variable \"up\": moves point"},
               [&] { deformation.vector_jacobian(std::vector<double>(5, 0.0), std::span<const double>(points), gradient); });
}

TEST(CompiledDeformation, ReportsErrorsAsTheBasisHasThem) {
  test::Blend blend(200);
  const Deformation deformation(blend.content);
  // A translation by 0.5 of "left": the field 1 alone, with the coefficients (0.05, 0, 0.5).
  const Report report = deformation.report(std::vector<double>{0.5, 0, 0, 0, 0});
  const double length = std::hypot(0.05, 0.5);
  EXPECT_NEAR(report.prescribed_displacement, length, 1e-15);
  EXPECT_NEAR(report.interpolation_residual, 1e-12 * length, 1e-24);
  // No coordinate is larger than 2: that of the points, and what adds up to where the handle goes.
  const double rounded = 2 + std::sqrt(2.05 * 2.05 + 2 * 2 + 2.5 * 2.5);
  EXPECT_NEAR(report.error, (2 * 1e-14 + 1e-13 + 2e-13) * length + rounded * std::numeric_limits<double>::epsilon(), 1e-25);
  EXPECT_TRUE(report.converged);
  blend.content.allowed_error = 1e-16;
  EXPECT_FALSE(Deformation(blend.content).report(std::vector<double>{0.5, 0, 0, 0, 0}).converged);
  blend.content.allowed_error = 1e-9;
  EXPECT_TRUE(Deformation(blend.content).report(std::vector<double>{0.5, 0, 0, 0, 0}).converged);
}

TEST(CompiledDeformation, ReportsHandlesThatAreMirroredOrFlattened) {
  test::Blend blend(50);
  for (Variable& variable : blend.content.variables) variable.lower = -10;
  const Deformation deformation(blend.content);
  const auto doubts = [&](double grown, double stretched) {
    return deformation.report(std::vector<double>{0.5, 0.3, grown, stretched, 0.7}).doubts;
  };
  using Texts = std::vector<std::string>;
  const std::string handle = "handle \"" + blend.content.handles[1].name + "\"", grow = blend.content.variables[2].name;
  EXPECT_EQ(doubts(0.3, -0.9), Texts{});
  EXPECT_EQ(doubts(-3, 0), Texts{handle + " is mirrored by " + grow + " = -3: its linear map has determinant -8"});
  EXPECT_EQ(doubts(-1, 0), Texts{handle + " is flattened by " + grow + " = -1: its linear map has determinant 0"});
  EXPECT_EQ(doubts(-3, -2), Texts{}) << "mirrored twice";
}

TEST(CompiledDeformation, ReportsPointsThatHaveStrayed) {
  test::Blend blend(400);
  for (Variable& variable : blend.content.variables) variable.lower = -10;
  EXPECT_TRUE(Deformation(blend.content).size().stray.empty());
  EXPECT_EQ(Deformation(blend.content).size().judged_by, bounding_box(blend.content.rest).diagonal());
  blend.content.rest[399][1] = 1e15;
  const Deformation deformation(blend.content);
  // Nine tenths of the sides of the box in which the others are, 2 x 1 x 1.
  EXPECT_NEAR(deformation.size().judged_by, 0.9 * std::sqrt(6.0), 0.1);
  const std::vector<std::string> told = deformation.report(std::vector<double>{0.5, 0, -3, 0, 0}).doubts;
  ASSERT_EQ(told.size(), 2u);
  EXPECT_NE(told[0].find("is mirrored by"), std::string::npos) << told[0];
  EXPECT_NE(told[1].find("but the bounding box is 1e+15 long"), std::string::npos) << told[1];
}

TEST(CompiledDeformation, DoubtsWhatReducedCentresMayHaveChanged) {
  test::Blend blend(200);
  const std::vector<double> values{0.5, 0, 0, 0, 0};
  blend.content.reduction_error = 1e-6;
  EXPECT_TRUE(Deformation(blend.content).report(values).doubts.empty());
  blend.content.reduction_error = 0.25;
  const std::vector<std::string> told = Deformation(blend.content).report(values).doubts;
  ASSERT_EQ(told.size(), 1u);
  EXPECT_NE(told[0].find("points may be 0.25 of the largest prescribed displacement"), std::string::npos) << told[0];
}

TEST(CompiledDeformation, MissesHandleAndFixedPointsByTheLargestDistance) {
  const Deformation deformation(test::Blend(200).content);
  std::vector<double> points(600);
  deformation.evaluate(at, points);
  EXPECT_LT(deformation.largest_misfit(at, points), 1e-15);
  // Points of a handle, fixed ones, and others that may be anywhere.
  for (const auto& [id, region] :
       {std::pair<std::size_t, std::uint32_t>{5, 0}, {50, 1}, {88, fixed_region}, {81, following_region}}) {
    ASSERT_EQ(deformation.content().regions[id], region);
    std::vector<double> off = points;
    off[3 * id] += 0.03;
    off[3 * id + 2] -= 0.04;
    off[3 * 6 + 1] += 0.01;
    EXPECT_NEAR(deformation.largest_misfit(at, off), region == following_region ? 0.01 : 0.05, 1e-12) << id;
  }
  expect_error(ErrorCode::invalid_argument, {"points: has 3 numbers, must have 600"},
               [&] { (void)deformation.largest_misfit(at, std::span(points).first(3)); });
}

TEST(CompiledDeformation, ReportsMisfitsWhereTheBasisHasThem) {
  test::Blend blend(200);
  blend.content.misfits = true;
  const double length = std::hypot(0.05, 0.5);
  const double rounding = (2 + std::sqrt(2.05 * 2.05 + 2 * 2 + 2.5 * 2.5)) * std::numeric_limits<double>::epsilon();
  const Report hard = Deformation(blend.content).report(std::vector<double>{0.5, 0, 0, 0, 0});
  EXPECT_NEAR(hard.interpolation_residual, 1e-14 * length, 1e-25);
  EXPECT_NEAR(hard.error, (1e-14 + 1e-13 + 2e-13) * length + rounding, 1e-25);
  // Points that follow are not off by what handles are missed by.
  blend.content.held = false;
  blend.content.bases.clear();
  blend.add_basis(7);
  const Report soft = Deformation(blend.content).report(std::vector<double>{0.5, 0, 0, 0, 0});
  EXPECT_NEAR(soft.interpolation_residual, 1e-14 * length, 1e-25);
  EXPECT_NEAR(soft.error, (1e-13 + 2e-13) * length + rounding, 1e-25);
}

}  // namespace
}  // namespace deform::compiled::deformation_test
