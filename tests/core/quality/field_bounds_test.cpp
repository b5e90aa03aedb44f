// SPDX-License-Identifier: GPL-3.0-or-later
// Cells cleared by the coefficients of known fields, against the roots of every cell: random and smooth fields, fields that hurt
// a cell most, cells of all kinds and layers, and fields that say too little, which must not go unnoticed.
#include "core/quality/field_bounds.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/core/quality/cell_by_cell.h"
#include "tests/core/quality/cell_shapes.h"
#include "tests/support/expect_error.h"

namespace deform::field_bounds_test {
namespace {

using namespace test;
using quality::FieldBounds;
using quality::MotionCertificate;
using quality::MovingCells;

/// Fields given by their values: fields[f][point].
class GivenFields : public DisplacementFields {
 public:
  explicit GivenFields(std::vector<std::vector<double>> fields, double told = 1, double error = 0)
      : fields_(std::move(fields)), public_(told), error_(error) {}
  std::size_t count() const override { return fields_.size(); }
  void values(std::size_t first, std::size_t count, std::span<double> values, const RunContext&) const override {
    for (std::size_t i = 0; i < fields_[first].size(); ++i) {
      for (std::size_t k = 0; k < count; ++k) values[i * count + k] = public_ * fields_[first + k][i];
    }
  }
  double error(std::size_t) const override { return error_; }

  Points moved(const Points& rest, const FieldMotion& motion) const {
    Points points = rest;
    for (std::size_t f = 0; f < fields_.size(); ++f) {
      for (std::size_t i = 0; i < rest.size(); ++i) points[i] = points[i] + fields_[f][i] * motion.coefficients[f];
    }
    return points;
  }

 private:
  std::vector<std::vector<double>> fields_;
  double public_;  ///< of the values
  double error_;
};

/// Waves of the place and a little noise, one of ten nothing but noise.
GivenFields waves(const Points& rest, std::size_t fields, double unit, std::mt19937_64& random, double told = 1) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<std::vector<double>> values(fields);
  for (auto& field : values) {
    const Vec3 along = (1 / unit) * Vec3{uniform(random), uniform(random), uniform(random)};
    const double phase = 3 * uniform(random), noise = uniform(random) > 0.8 ? 1 : 0.01;
    for (const Vec3& x : rest) field.push_back((1 - noise) * std::sin(dot(along, x) + phase) + noise * uniform(random));
  }
  return GivenFields(std::move(values), told);
}

FieldMotion motion_of(std::vector<Vec3> coefficients, double unit) {
  FieldMotion motion{std::move(coefficients), {}, 1e-13 * unit};
  motion.uncertainties.resize(motion.coefficients.size());
  return motion;
}

FieldMotion at_random(std::size_t fields, double size, double unit, std::mt19937_64& random) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<Vec3> coefficients;
  for (std::size_t f = 0; f < fields; ++f) {
    const double share = f % 3 == 2 ? 0 : size * unit;  // some do not move
    coefficients.push_back(share * Vec3{uniform(random), uniform(random), uniform(random)});
  }
  return motion_of(std::move(coefficients), unit);
}

void compare(const Points& rest, const CellSet& cells, double unit, std::mt19937_64& random) {
  for (const std::size_t count : {1, 4, 11}) {
    const GivenFields fields = waves(rest, count, unit, random);
    const InversionCheck check(rest, cells, fields);
    for (const double size : {0.0, 1e-4, 1e-3, 0.01, 0.05, 0.2, 1.0}) {
      SCOPED_TRACE(testing::Message() << count << " fields, size " << size);
      const FieldMotion motion = at_random(count, size, unit, random);
      const Points to = fields.moved(rest, motion);
      expect_same(check.amplitude(to, motion), cell_by_cell(rest, rest, to, cells));
    }
  }
}

Points scaled(Points points, double unit, double height) {
  for (Vec3& p : points) p = {unit * p[0], unit * p[1], unit * height * p[2]};
  return points;
}

TEST(FieldBounds, AnswersAreThoseOfEveryCell) {
  std::mt19937_64 random(5);
  const Grid g = grid(5, 5, 5);
  for (const double unit : {1e-3, 1.0, 1e3}) {
    for (const double height : {1.0, 1e-3, -1.0}) {
      SCOPED_TRACE(testing::Message() << unit << " x " << height);
      compare(scaled(shaken(g.points, 0.1, random), unit, height), &g.cells, unit, random);
    }
  }
}

// One node moves, so the coefficients clear all cells but those around it: these alone decide.
TEST(FieldBounds, AnswersAreThoseOfTheFewCellsThatAreNotCleared) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const Grid g = grid(12, 12, 12);
  const Points rest = shaken(g.points, 0.1, random);
  const double spacing = 0.5 * distance(g.points[0], g.points[1]);
  std::vector<double> bump(rest.size());
  bump[rest.size() / 2] = 1;
  const GivenFields fields({bump});
  const InversionCheck check(rest, &g.cells, fields);
  std::size_t inverted = 0, sound = 0;
  for (const double size : {0.05, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4}) {
    SCOPED_TRACE(size);
    const double by = size * spacing;
    const FieldMotion motion = motion_of({by * Vec3{uniform(random), uniform(random), uniform(random)}}, 1);
    const Points to = fields.moved(rest, motion);
    const SafeAmplitude found = check.amplitude(to, motion);
    expect_same(found, cell_by_cell(rest, rest, to, &g.cells));
    ++(found.amplitude < 1 ? inverted : sound);
  }
  EXPECT_GT(inverted, 0u);
  EXPECT_GT(sound, 0u);
}

TEST(FieldBounds, AnswersAreThoseOfEveryElement) {
  std::mt19937_64 random(6);
  for (std::size_t i = 0; i < element_types; ++i) {
    const auto type = static_cast<ElementType>(i);
    SCOPED_TRACE(shape(type).name);
    const auto [rest, elements] = shaken_elements(type, 60, 4, random);
    compare(rest, &elements, 1, random);
  }
}

/// A mesh with its certificate, as InversionCheck has it.
struct Subject {
  Subject(const Points& points, const CellSet& set) : rest(points), cells(moving(set, points)) {
    std::vector<char> left_out;
    std::vector<double> determinants;
    for (std::size_t c = 0; c < cells->size(); ++c) {
      left_out.push_back(cells->state(rest, c).inverted);
      determinants.push_back(cells->state(rest, c).determinant);
    }
    certificate.emplace(rest, *cells, left_out, determinants, RunContext{});
  }
  std::vector<std::uint32_t> doubtful(const FieldBounds& bounds, const FieldMotion& motion, double floor = 0) const {
    FieldBounds::Doubtful found;
    bounds.doubtful(motion, floor, 0, bounds.cluster_count(), found);
    found.unproven.insert(found.unproven.end(), found.low.begin(), found.low.end());
    return found.unproven;
  }

  Points rest;
  std::unique_ptr<MovingCells> cells;
  std::optional<MotionCertificate> certificate;
};

/// For every node the direction in which the normalized determinant of a cell falls fastest, as three fields.
GivenFields downhill(const Subject& subject, std::size_t c, double size, double told = 1) {
  std::vector<std::vector<double>> values(3, std::vector<double>(subject.rest.size()));
  const double step = 1e-6 * size;
  for (const PointId p : subject.cells->nodes().of(c)) {
    Vec3 direction{};
    Points points = subject.rest;
    for (std::size_t k = 0; k < 3; ++k) {
      points[p][k] = subject.rest[p][k] + step;
      const double above = subject.cells->state(points, c).determinant;
      points[p][k] = subject.rest[p][k] - step;
      direction[k] = subject.cells->state(points, c).determinant - above;
      points[p][k] = subject.rest[p][k];
    }
    for (std::size_t k = 0; k < 3 && norm(direction) > 0; ++k) values[k][p] = direction[k] / norm(direction);
  }
  return GivenFields(std::move(values), told);
}

/// The largest multiple of the three fields along the axes that leaves the cell cleared, and whether all that is said of cells
/// there is true.
std::pair<double, bool> limit(const Subject& subject, const GivenFields& fields, std::size_t c, double size) {
  const FieldBounds bounds(subject.rest, *subject.certificate, fields, {});
  const auto by = [&](double s) { return motion_of({{s, 0, 0}, {0, s, 0}, {0, 0, s}}, size); };
  double low = 0, high = size;
  for (int k = 0; k < 50; ++k) {
    const double middle = 0.5 * (low + high);
    const auto found = subject.doubtful(bounds, by(middle));
    (std::find(found.begin(), found.end(), c) == found.end() ? low : high) = middle;
  }
  bool holds = true;
  for (const double share : {1.0, 0.7, 0.3}) {
    const Points to = fields.moved(subject.rest, by(share * low));
    const double determinant = subject.cells->state(to, c).determinant;
    holds = holds && subject.cells->first_inversion(subject.rest, to, c, 1) == std::numeric_limits<double>::infinity();
    // What is cleared above a floor is above it.
    for (const double floor : {0.9 * determinant, determinant, 1.1 * determinant}) {
      const auto found = subject.doubtful(bounds, by(share * low), floor);
      holds = holds && (determinant > floor || std::find(found.begin(), found.end(), c) != found.end());
    }
  }
  return {low, holds};
}

TEST(FieldBounds, HoldInTheDirectionThatHurtsMost) {
  std::mt19937_64 random(8);
  std::size_t found = 0, noticed = 0;
  for (int round = 0; round < 60; ++round) {
    const double unit = round % 3 == 0 ? 1e-3 : round % 3 == 1 ? 1.0 : 1e3, height = round % 2 == 0 ? 1.0 : 1e-2;
    const Grid g = grid(3, 3, 2);
    const Subject subject(scaled(shaken(g.points, 0.1, random), unit, height), &g.cells);
    const auto c = static_cast<std::size_t>(round) % subject.cells->size();
    const auto [most, holds] = limit(subject, downhill(subject, c, unit * height), c, unit);
    if (most == 0) continue;
    ++found;
    EXPECT_TRUE(holds) << round;
    // The same fields, of which a hundredth is told: cells are cleared that are inverted.
    noticed += !limit(subject, downhill(subject, c, unit * height, 0.01), c, unit).second;
  }
  EXPECT_GT(found, 35u);
  EXPECT_GT(noticed, 15u);
}

// The stretch and the residual of a cell as its points have them are never beyond what the fields say, so whoever is cleared is
// cleared by them, too.
TEST(FieldBounds, ClearNothingThatTheDeformationOfTheCellDoesNot) {
  std::mt19937_64 random(10);
  const Grid g = grid(6, 5, 4);
  std::size_t cleared = 0, close = 0, alone = 0;
  for (const auto& [height, shaking] : {std::pair(1.0, 0.08), {0.02, 0.08}, {1.0, 0.25}, {0.1, 0.25}}) {
    const Subject subject(scaled(shaken(g.points, shaking, random), 1, height), &g.cells);
    for (const std::size_t count : {1, 2, 10, 19}) {
      const GivenFields fields = waves(subject.rest, count, 4, random);
      const FieldBounds bounds(subject.rest, *subject.certificate, fields, {});
      for (double size = height * 1e-3; size < 5; size *= 1.15) {
        FieldMotion motion = at_random(count, size, 1, random);
        if (alone++ % 2 == 0) std::fill(motion.coefficients.begin(), motion.coefficients.end() - 1, Vec3{});
        const Points to = fields.moved(subject.rest, motion);
        for (const double floor : {0.0, 0.4, 0.7}) {
          const auto found = subject.doubtful(bounds, motion, floor);
          for (std::uint32_t c = 0; c < subject.cells->size(); ++c) {
            if (std::find(found.begin(), found.end(), c) != found.end()) continue;
            const auto bound = subject.certificate->bound(c, subject.certificate->stretch(to, c));
            ASSERT_TRUE(bound.sound && bound.determinant > floor)
                << height << ", " << count << " fields, size " << size << ", " << c;
            ++cleared;
            close += bound.determinant < 1.02 * floor + 0.01;
          }
        }
      }
    }
  }
  EXPECT_GT(cleared, 10000u);
  EXPECT_GT(close, 20u);
}

// What is told of a field or of a motion only makes more cells doubtful.
TEST(FieldBounds, ErrorsAndUncertaintiesCount) {
  const Grid g = grid(4, 4, 4);
  const Subject subject(g.points, &g.cells);
  std::mt19937_64 random(9);
  const GivenFields fields = waves(g.points, 2, 1, random);
  const FieldBounds bounds(subject.rest, *subject.certificate, fields, {});
  FieldMotion motion = motion_of({{1e-3, 0, 0}, {0, 1e-3, 0}}, 1);
  EXPECT_EQ(subject.doubtful(bounds, motion).size(), 0u);
  motion.rounding = 1;
  EXPECT_EQ(subject.doubtful(bounds, motion).size(), subject.cells->size());
  motion.rounding = 0;
  motion.uncertainties[1] = 1;
  EXPECT_EQ(subject.doubtful(bounds, motion).size(), subject.cells->size());
  motion.uncertainties[1] = 0;
  EXPECT_EQ(subject.doubtful(bounds, motion).size(), 0u);
  // Without a gradient.
  const std::vector<double> constant(g.points.size(), 2.0);
  const FieldBounds exact(subject.rest, *subject.certificate, GivenFields({constant}), {}),
      inexact(subject.rest, *subject.certificate, GivenFields({constant}, 1, 0.01), {});
  FieldMotion shift = motion_of({{30, 0, 0}}, 1);
  EXPECT_EQ(subject.doubtful(exact, shift).size(), 0u);
  EXPECT_EQ(subject.doubtful(inexact, shift).size(), subject.cells->size());
  shift.uncertainties[0] = 0.15;
  EXPECT_EQ(subject.doubtful(exact, shift).size(), subject.cells->size());
  motion.coefficients[0][2] = std::nan("");
  EXPECT_EQ(subject.doubtful(bounds, motion).size(), subject.cells->size());
}

// Turned as a whole: the norms of the gradients of three fields would not do it, their sum does.
TEST(FieldBounds, GradientsOfFieldsAreAdded) {
  const Grid g = grid(4, 4, 4);
  const Subject subject(g.points, &g.cells);
  std::vector<std::vector<double>> places(3);
  for (const Vec3& p : g.points) {
    for (std::size_t k = 0; k < 3; ++k) places[k].push_back(p[k]);
  }
  const GivenFields fields(places);
  const FieldBounds bounds(subject.rest, *subject.certificate, fields, {});
  const double angle = 0.6, c = std::cos(angle) - 1, s = std::sin(angle);
  EXPECT_EQ(subject.doubtful(bounds, motion_of({{c, s, 0}, {-s, c, 0}, {0, 0, 0}}, 1)).size(), 0u);
  EXPECT_EQ(subject.doubtful(bounds, motion_of({{-0.8, 0, 0}, {0, -0.8, 0}, {0, 0, 0}}, 1)).size(), subject.cells->size());
}

// On a fine mesh nearly nothing is left to look at, and not much more than what a look at all points leaves.
TEST(FieldBounds, ClearMostCells) {
  const Grid g = grid(20, 20, 20);
  const Subject subject(g.points, &g.cells);
  std::vector<double> bump;
  for (const Vec3& p : g.points) bump.push_back(std::exp(-0.02 * dot(p - Vec3{10, 10, 10}, p - Vec3{10, 10, 10})));
  const GivenFields fields({bump});
  const FieldBounds bounds(subject.rest, *subject.certificate, fields, {});
  for (const double by : {0.1, 0.5, 2.0}) {
    const FieldMotion motion = motion_of({{0, 0.6 * by, 0.8 * by}}, 1);
    const Points to = fields.moved(g.points, motion);
    std::size_t left = 0;
    for (std::size_t c = 0; c < subject.cells->size(); ++c) {
      const auto bound = subject.certificate->bound(c, subject.certificate->stretch(to, c));
      left += !(bound.sound && bound.determinant > 0.2);
    }
    EXPECT_LE(subject.doubtful(bounds, motion, 0.2).size(), left + left / 4 + 80) << by;
  }
}

TEST(FieldBounds, NotANumberClearsNothing) {
  const Grid g = grid(3, 3, 3);
  const Subject subject(g.points, &g.cells);
  std::vector<double> field(g.points.size(), 1e-3);
  field[17] = std::nan("");
  const GivenFields fields({field});
  const FieldBounds bounds(subject.rest, *subject.certificate, fields, {});
  const auto found = subject.doubtful(bounds, motion_of({{1, 0, 0}}, 1));
  for (std::size_t c = 0; c < subject.cells->size(); ++c) {
    const auto nodes = subject.cells->nodes().of(c);
    if (std::find(nodes.begin(), nodes.end(), PointId{17}) == nodes.end()) continue;
    EXPECT_TRUE(std::find(found.begin(), found.end(), c) != found.end()) << c;
  }
}

TEST(FieldBounds, BadInput) {
  const Grid g = grid(2, 2, 2);
  const GivenFields fields({std::vector<double>(g.points.size(), 1.0)});
  const InversionCheck with(g.points, &g.cells, fields), without(g.points, &g.cells);
  const FieldMotion motion = motion_of({{1, 0, 0}}, 1), two = motion_of({{1, 0, 0}, {0, 1, 0}}, 1);
  expect_error(ErrorCode::invalid_argument, {"motion", "2", "1 fields"}, [&] { with.amplitude(g.points, two); });
  expect_error(ErrorCode::invalid_argument, {"motion", "without"}, [&] { without.amplitude(g.points, motion); });
  expect_error(ErrorCode::invalid_argument, {"points"}, [&] { with.amplitude(Points(3), motion); });
  Points far = g.points;
  far[5][1] = std::numeric_limits<double>::infinity();
  expect_error(ErrorCode::invalid_argument, {"points[5]"}, [&] { with.amplitude(far, motion_of({{0, 1e300, 0}}, 1)); });
  EXPECT_GT(InversionCheck::bytes_for(&g.cells, g.points.size(), 1), InversionCheck::bytes_for(&g.cells, g.points.size()));
}

}  // namespace
}  // namespace deform::field_bounds_test
