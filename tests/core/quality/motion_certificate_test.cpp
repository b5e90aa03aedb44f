// SPDX-License-Identifier: GPL-3.0-or-later
// What is said of motions without looking at roots, against the roots: cells of all kinds, moved as far as the bounds allow, at
// random and in the direction that hurts most; and tolerances that are known in closed form.
#include "core/quality/motion_certificate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <random>
#include <string>

#include "core/base/vectors.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/core/quality/cell_by_cell.h"
#include "tests/core/quality/cell_shapes.h"

namespace deform::motion_certificate_test {
namespace {

using namespace test;
using quality::CellTolerance;
using quality::MotionCertificate;
using quality::MovingCells;

constexpr double units[] = {1e-3, 1, 1e3};

Points mapped(Points points, const std::function<Vec3(const Vec3&)>& map) {
  for (Vec3& p : points) p = map(p);
  return points;
}

/// Displaced from rest by `size` times a direction.
Points moved(const Points& rest, const Points& direction, double size) {
  Points points(rest.size());
  for (std::size_t i = 0; i < rest.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) points[i][k] = rest[i][k] + size * direction[i][k];
  }
  return points;
}

struct Case {
  std::string name;
  Points rest;
  CellSet cells;
};

/// One mesh of every kind of cells; the sets borrow from here.
class Kinds {
 public:
  explicit Kinds(std::mt19937_64& random) {
    for (std::size_t i = 0; i < element_types; ++i) elements_.push_back(one(static_cast<ElementType>(i)));
    for (std::size_t i = 0; i < element_types; ++i) {
      const auto type = static_cast<ElementType>(i);
      const Points rest = shaken(reference(type), shape(type).quadratic() ? 0.02 : 0.12, random);
      cases.push_back({shape(type).name, rest, &elements_[i]});
      cases.push_back({std::string("left-handed ") + shape(type).name,
                       mapped(rest,
                              [](const Vec3& p) {
                                return Vec3{-p[0], p[1], p[2]};
                              }),
                       &elements_[i]});
    }
    const auto thin = [&](const Points& points) {
      return shaken(mapped(points, [](const Vec3& p) { return Vec3{p[0], p[1], 1e-3 * p[2]}; }), 5e-5, random);
    };
    cases.push_back({"cubes", shaken(grid_.points, 0.1, random), &grid_.cells});
    cases.push_back({"cubes with flat faces", grid_.points, &grid_.cells});
    cases.push_back({"layers", thin(grid_.points), &grid_.cells});
    cases.push_back({"layers of hexahedra", thin(reference(ElementType::hexahedron)),
                     &elements_[static_cast<std::size_t>(ElementType::hexahedron)]});
    cases.push_back({"tetrahedra by faces", shaken(reference(ElementType::tetrahedron), 0.1, random), &tetrahedron_});
    cases.push_back({"quads",
                     mapped(shaken(plane_.points, 0.1, random),
                            [](const Vec3& p) {
                              return Vec3{p[0], p[1], 0};
                            }),
                     &plane_});
  }
  Kinds(const Kinds&) = delete;
  Kinds& operator=(const Kinds&) = delete;

  std::vector<Case> cases;

 private:
  std::vector<Elements> elements_;
  Grid grid_ = grid(2, 2, 1);
  Mesh plane_ = quad_grid(2, 2);
  PolyhedralCells tetrahedron_{{0, 3, 6, 9, 12}, {0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2}, {0, 0, 0, 0}, {}, 1, {}};
};

/// Everything about the cells of a mesh that the tests ask for.
struct Subject {
  Subject(const Points& points, const CellSet& set) : rest(points), cells(moving(set, points)) {
    left_out.resize(cells->size());
    determinants.resize(cells->size());
    for (std::size_t c = 0; c < cells->size(); ++c) {
      const auto state = cells->state(rest, c);
      left_out[c] = state.inverted;
      determinants[c] = state.determinant;
    }
    certificate.emplace(rest, *cells, left_out, determinants, RunContext{});
  }

  bool proven(const Points& points, std::size_t c) const { return certificate->bound(c, certificate->stretch(points, c)).sound; }

  Points rest;
  std::unique_ptr<MovingCells> cells;
  std::vector<char> left_out;
  std::vector<double> determinants;
  std::optional<MotionCertificate> certificate;
};

/// The largest multiple of a direction of which the certificate says that cell c bears it; 0: none.
double limit(const Subject& subject, const Points& direction, std::size_t c, double size) {
  double low = 0, high = size;
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (low + high);
    (subject.proven(moved(subject.rest, direction, middle), c) ? low : high) = middle;
  }
  return low;
}

/// Roots and states must agree with what is said about a motion.
void expect_borne(const Subject& subject, const Points& to, std::size_t c) {
  const auto bound = subject.certificate->bound(c, subject.certificate->stretch(to, c));
  ASSERT_TRUE(bound.sound);
  EXPECT_EQ(subject.cells->first_inversion(subject.rest, to, c, 1), std::numeric_limits<double>::infinity());
  const auto state = subject.cells->state(to, c);
  EXPECT_FALSE(state.inverted);
  EXPECT_GE(state.determinant, bound.determinant);
}

/// For every node the direction in which the normalized determinant falls fastest.
Points downhill(const Subject& subject, std::size_t c, double size, bool plane) {
  Points direction(subject.rest.size());
  const double step = 1e-6 * size;
  for (const PointId p : subject.cells->nodes().of(c)) {
    Points points = subject.rest;
    for (std::size_t k = 0; k < (plane ? 2u : 3u); ++k) {
      points[p][k] = subject.rest[p][k] + step;
      const double above = subject.cells->state(points, c).determinant;
      points[p][k] = subject.rest[p][k] - step;
      direction[p][k] = subject.cells->state(points, c).determinant - above;
      points[p][k] = subject.rest[p][k];
    }
    const double norm = std::hypot(direction[p][0], direction[p][1], direction[p][2]);
    for (double& x : direction[p]) x = norm > 0 ? x / norm : 0;
  }
  return direction;
}

TEST(MotionCertificate, NeverPassesACellThatItsRootsSayInverts) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::size_t borne = 0;
  for (int round = 0; round < 40; ++round) {
    const Kinds kinds(random);
    for (const Case& tested : kinds.cases) {
      SCOPED_TRACE(tested.name);
      const double unit = units[round % 3];
      const bool plane = std::holds_alternative<const Mesh*>(tested.cells);
      const Points rest = mapped(tested.rest, [&](const Vec3& p) { return unit * p; });
      const Subject subject(rest, tested.cells);
      const std::size_t c = static_cast<std::size_t>(round) % subject.cells->size();
      if (subject.left_out[c]) continue;
      // At random, in the worst direction, linear, and both.
      Points at_random(rest.size()), linear(rest.size());
      std::array<Vec3, 3> map;
      for (Vec3& row : map) row = {uniform(random), uniform(random), uniform(random)};
      for (std::size_t i = 0; i < rest.size(); ++i) {
        at_random[i] = {uniform(random), uniform(random), plane ? 0.0 : uniform(random)};
        const Vec3 x = (1 / unit) * rest[i];
        linear[i] = {dot(map[0], x), dot(map[1], x), plane ? 0.0 : dot(map[2], x)};
      }
      Points both = moved(linear, at_random, 0.02);
      for (const Points& direction : {at_random, downhill(subject, c, unit, plane), linear, both}) {
        const double most = limit(subject, direction, c, 4 * unit);
        if (most == 0) continue;
        for (const double share : {1.0, 0.5, 0.1}) expect_borne(subject, moved(rest, direction, share * most), c);
        ++borne;
      }
    }
  }
  EXPECT_GT(borne, 3500u);
}

// At most this many times what the bounds allow inverts: they are of some use, and the motions above come near to what matters.
TEST(MotionCertificate, IsNotFarFromWhatInverts) {
  std::mt19937_64 random(3);
  const Kinds kinds(random);
  for (const Case& tested : kinds.cases) {
    SCOPED_TRACE(tested.name);
    const Subject subject(tested.rest, tested.cells);
    const bool layers = tested.name.find("layers") != std::string::npos;
    const Points direction = downhill(subject, 0, layers ? 1e-3 : 1, std::holds_alternative<const Mesh*>(tested.cells));
    const double most = limit(subject, direction, 0, 4);
    ASSERT_GT(most, 0);
    const double farther = 1000 * subject.cells->first_inversion(subject.rest, moved(subject.rest, direction, 1000 * most), 0, 1);
    EXPECT_GT(farther, 1);
    if (tested.name != "layers") {  // whose sides are warped
      EXPECT_LT(farther, 40);
    }
  }
}

// |F^-1| of a corner of a right-angled tetrahedron with legs 1, 2, 4: the heights are the legs there, others elsewhere.
TEST(MotionCertificate, ToleranceOfElements) {
  const Elements tetrahedron = one(ElementType::tetrahedron), cube = one(ElementType::hexahedron);
  const auto tolerance = [](const Points& rest, const CellSet& cells) {
    const auto all = moving(cells, rest);
    return all->motion_tolerance(rest, 0, all->state(rest, 0).determinant);
  };
  const CellTolerance hexahedron = tolerance(reference(ElementType::hexahedron), &cube);
  EXPECT_NEAR(hexahedron.radius, 0.4 / (2 * 3), 1e-14);
  EXPECT_EQ(hexahedron.determinant, 1);
  EXPECT_NEAR(hexahedron.loss, 4 * 0.4, 1e-14);
  // Three heights of a tetrahedron at each corner: 3 volumes over areas. Those at the corner with all three legs: 1, 2, 4.
  const double far = std::sqrt(4 + 16 + 64) / 2, volume = 8.0 / 6;
  const std::array<double, 4> areas{far, 4, 2, 1};
  double largest = 0;
  for (std::size_t left_out = 0; left_out < 4; ++left_out) {
    double sum = 0;
    for (std::size_t f = 0; f < 4; ++f) sum += f == left_out ? 0 : areas[f] / (3 * volume);
    largest = std::max(largest, sum);
  }
  const Points legs{{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {0, 0, 4}};
  EXPECT_NEAR(tolerance(legs, &tetrahedron).radius, 0.4 / (2 * largest), 1e-14);
  const Mesh square = quad_grid(1, 1);
  EXPECT_NEAR(tolerance(square.points, &square).radius, 0.4 / (2 * 2), 1e-14);
}

/// The loss of a cube by hand: all faces are alike, ways and areas 1/2 and 1.
double loss_of_cube(double chi, double r) {
  r += 1e-12 * std::sqrt(3);
  const double e = chi * r * (4 * (1 + std::sqrt(2)) + 4 * 2.6 * r), sizes = 2;
  const double centre = r + e / 3 / (sizes - e), across = r, area = 2 * std::sqrt(2) * r + 2 * r * r;
  const double pyramid = area / 2 + across + area * 2 * centre;
  const double volume = 6 * pyramid, left = 3 - volume;
  const double moment = 6 * (centre / 2 + pyramid / 2 + (pyramid + centre) * 2 * centre);
  const double cell = 0.75 * moment / left + volume / left * centre;
  const double product = area / 2 + across + cell + area * (centre + cell), way = 2 * (centre + cell);
  if (e >= sizes / 2 || volume >= 1.5 || product >= 0.45) return std::numeric_limits<double>::infinity();
  return 2 * product + way + area + way * area;
}

TEST(MotionCertificate, ToleranceOfACube) {
  for (const double unit : units) {
    const Grid g = grid(1, 1, 1);
    const Points rest = mapped(g.points, [&](const Vec3& p) { return unit * p; });
    const auto cells = moving(&g.cells, rest);
    const CellTolerance found = cells->motion_tolerance(rest, 0, 1);
    EXPECT_EQ(found.condition, 3);
    const double r = found.radius / unit;
    EXPECT_NEAR(found.loss / loss_of_cube(3, r), 1, 1e-9);
    EXPECT_EQ(loss_of_cube(3, r / 0.79), std::numeric_limits<double>::infinity()) << "the radius is not much too small";
    EXPECT_NEAR(found.warp_loss, 0, 1e-9);
    EXPECT_NEAR(found.determinant, 1, 1e-9);
  }
}

// Affine motions leave nothing but rounding, so how far they may go is what the condition says.
TEST(MotionCertificate, AffineMotionsAreBorneUpToTheirCondition) {
  const Grid g = grid(1, 1, 1);
  const Subject subject(g.points, &g.cells);
  const auto stretched = [&](double by) {
    return mapped(g.points, [&](const Vec3& p) { return Vec3{p[0] + 7, p[1], by * p[2]}; });
  };
  // Longer: largest singular value `by`; shorter: the least one, and the largest is bounded by sqrt(1 + (1 - by)^2).
  EXPECT_TRUE(subject.proven(stretched(2.99), 0));
  EXPECT_FALSE(subject.proven(stretched(3.01), 0));
  const double shorter = 0.3602;  // sqrt(1 + (1 - x)^2) = 3 x
  EXPECT_NEAR(std::hypot(1, 1 - shorter), 3 * shorter, 0.13);
  double low = 0.3, high = 1;
  for (int k = 0; k < 50; ++k) (subject.proven(stretched(0.5 * (low + high)), 0) ? high : low) = 0.5 * (low + high);
  EXPECT_NEAR(std::hypot(1, 1 - high), 3 * high, 1e-5);
  // Turned by an angle: least eigenvalue of the symmetric part cos - 1.
  const auto turned = [&](double angle) {
    return mapped(g.points, [&](const Vec3& p) {
      return Vec3{std::cos(angle) * p[0] - std::sin(angle) * p[1], std::sin(angle) * p[0] + std::cos(angle) * p[1], p[2]};
    });
  };
  EXPECT_TRUE(subject.proven(turned(0.9), 0));
  EXPECT_FALSE(subject.proven(turned(1.3), 0)) << "cos < 0.3";
}

// The same of many cells at once in single precision: what all of them have in common is not counted against any.
TEST(MotionCertificate, AffineMotionsOfManyCellsLeaveNoDoubt) {
  const Grid g = grid(5, 4, 3);
  const Subject subject(g.points, &g.cells);
  const auto doubtful = [&](const std::function<Vec3(const Vec3&)>& map) {
    std::vector<std::uint32_t> found;
    subject.certificate->doubtful(mapped(g.points, map), -std::numeric_limits<double>::infinity(), 0,
                                  subject.certificate->block_count(), found);
    return found.size();
  };
  const double c = std::cos(0.8), s = std::sin(0.8);
  EXPECT_EQ(doubtful([&](const Vec3& p) { return Vec3{c * p[0] - s * p[1] + 7, s * p[0] + c * p[1], p[2]}; }), 0u);
  EXPECT_EQ(doubtful([](const Vec3& p) { return Vec3{p[0], 2.5 * p[1] + 0.2 * p[2], p[2] - 3}; }), 0u);
  // Bent: an affine motion of each cell besides.
  EXPECT_EQ(doubtful([](const Vec3& p) { return Vec3{p[0], p[1], p[2] + 0.05 * p[0] * p[0]}; }), 0u);
  EXPECT_EQ(doubtful([](const Vec3& p) { return Vec3{p[0], p[1], -p[2]}; }), g.cells.cell_count) << "inside out";
}

// Every second node of a cube by d: no linear map is nearer to that than none, and all are within d of the middle.
TEST(MotionCertificate, WhatIsNotAffineIsBorneUpToTheRadius) {
  const Elements hexahedron = one(ElementType::hexahedron);
  const Grid g = grid(1, 1, 1);
  const std::pair<Points, CellSet> cubes[] = {{reference(ElementType::hexahedron), &hexahedron}, {g.points, &g.cells}};
  for (const auto& [rest, cells] : cubes) {
    const Subject subject(rest, cells);
    const double radius = subject.cells->motion_tolerance(rest, 0, subject.determinants[0]).radius;
    const auto at = [&](double d) {
      return mapped(rest, [&](const Vec3& p) {
        return Vec3{p[0] + (std::lround(p[0] + p[1] + p[2]) % 2 == 0 ? d : -d), p[1], p[2]};
      });
    };
    const auto doubtful = [&](double d, double floor) {
      std::vector<std::uint32_t> found;
      subject.certificate->doubtful(at(d), floor, 0, subject.certificate->block_count(), found);
      return found.size();
    };
    const double any = -std::numeric_limits<double>::infinity();
    EXPECT_TRUE(subject.proven(at(0.9999 * radius), 0));
    EXPECT_FALSE(subject.proven(at(1.0001 * radius), 0));
    EXPECT_EQ(doubtful(0.999 * radius, any), 0u) << "in single precision, too";
    EXPECT_EQ(doubtful(1.001 * radius, any), 1u);
    const auto bound = subject.certificate->bound(0, subject.certificate->stretch(at(0.1 * radius), 0));
    const CellTolerance tolerance = subject.cells->motion_tolerance(rest, 0, subject.determinants[0]);
    EXPECT_NEAR(bound.determinant, tolerance.determinant - 0.1 * tolerance.loss, 1e-5);
    EXPECT_EQ(doubtful(0.1 * radius, bound.determinant - 1e-3), 0u);
    EXPECT_EQ(doubtful(0.1 * radius, bound.determinant + 1e-3), 1u);
  }
}

TEST(MotionCertificate, SaysNothingOfCellsThatAreNearlyCollapsed) {
  for (const double height : {1e-3, 1e-9, 1e-12}) {
    const Elements tetrahedron = one(ElementType::tetrahedron);
    Points rest = reference(ElementType::tetrahedron);
    rest[3][2] = 1e-2 * height;
    const Subject subject(rest, &tetrahedron);
    EXPECT_EQ(subject.proven(rest, 0), height == 1e-3) << "1e-6 is the least determinant";
  }
  Grid g = grid(1, 1, 1);
  for (Vec3& p : g.points) {
    if (p[2] > 0.5) p = {p[0] + 2e4, p[1], p[2]};
  }
  EXPECT_FALSE(Subject(g.points, &g.cells).proven(g.points, 0)) << "sheared: the cosine of a pyramid is 5e-5";
}

}  // namespace
}  // namespace deform::motion_certificate_test
