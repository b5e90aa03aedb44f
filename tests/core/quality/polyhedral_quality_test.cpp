// SPDX-License-Identifier: GPL-3.0-or-later
// Cells whose measures are known: boxes, sheared, skewed, slender, inverted, two-dimensional.
#include "core/quality/polyhedral_quality.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/quality/safe_amplitude.h"
#include "tests/core/quality/cell_shapes.h"
#include "tests/support/expect_error.h"

namespace deform::polyhedral_quality_test {
namespace {

using test::Grid;
using test::grid;

TEST(PolyhedralQuality, CubesAreIdeal) {
  const Grid g = grid(3, 2, 4);
  const PolyhedralQuality q = polyhedral_quality(g.points, g.cells);
  EXPECT_EQ(q.cells, 24u);
  EXPECT_EQ(q.internal_faces, 2u * 8 + 3u * 4 + 6u * 3);
  EXPECT_NEAR(q.total_volume, 24, 1e-12);
  EXPECT_NEAR(q.least_volume.value, 1, 1e-12);
  EXPECT_NEAR(q.largest_non_orthogonality.value, 0, 1e-5);
  EXPECT_NEAR(q.largest_skewness.value, 0, 1e-12);
  EXPECT_NEAR(q.largest_aspect_ratio.value, 1, 1e-12);
  EXPECT_NEAR(q.least_flatness.value, 1, 1e-12);
  EXPECT_LT(q.largest_openness.value, 1e-15);
  EXPECT_EQ(q.failed_checks(), 0u);
}

TEST(PolyhedralQuality, ShearIsNonOrthogonal) {
  Grid g = grid(2, 2, 2);
  for (Vec3& p : g.points) p[0] += 0.5 * p[2];  // faces across z: cells above each other are shifted
  const PolyhedralQuality q = polyhedral_quality(g.points, g.cells);
  EXPECT_NEAR(q.largest_non_orthogonality.value, std::atan(0.5) * 180 / M_PI, 1e-9);
  EXPECT_NEAR(q.total_volume, 8, 1e-12);
  EXPECT_EQ(q.non_orthogonal_faces, 0u);
  PolyhedralLimits strict;
  strict.non_orthogonality = 20;
  EXPECT_EQ(polyhedral_quality(g.points, g.cells, strict).non_orthogonal_faces, 8u);
}

TEST(PolyhedralQuality, SaysItCellByCell) {
  Grid g = grid(2, 2, 2);
  for (Vec3& p : g.points) {
    if (p[2] > 1.5) p[0] += 0.5;  // the upper layer is sheared
  }
  const PolyhedralQuality q = polyhedral_quality(g.points, g.cells);
  ASSERT_EQ(q.cell_volume.size(), 8u);
  for (const double volume : q.cell_volume) EXPECT_NEAR(volume, 1, 1e-12);
  // Centres of the upper layer moved by 1/4: across the faces between the layers, and in the upper layer across those of x.
  const double between = std::atan(0.25) * 180 / M_PI, within = std::atan(0.5) * 180 / M_PI;
  for (std::size_t c = 0; c < 8; ++c) EXPECT_NEAR(q.cell_non_orthogonality[c], c < 4 ? between : within, 1e-9) << c;
  EXPECT_EQ(std::accumulate(q.histogram.begin(), q.histogram.end(), std::size_t{0}), g.cells.internal_faces());
  EXPECT_EQ(q.histogram[2], 4u) << "14 degrees";
  EXPECT_EQ(q.histogram[5], 2u) << "26.6 degrees";
  EXPECT_EQ(std::accumulate(q.skewness_histogram.begin(), q.skewness_histogram.end(), std::size_t{0}), g.cells.face_count());
  ASSERT_EQ(q.worst.size(), g.cells.internal_faces());
  EXPECT_NEAR(q.face_non_orthogonality[q.worst[0]], within, 1e-9);
  EXPECT_EQ(q.worst[0], q.largest_non_orthogonality.id);
}

TEST(PolyhedralQuality, SlenderCells) {
  Grid g = grid(2, 1, 1);
  for (Vec3& p : g.points) p[1] *= 0.01;
  const PolyhedralQuality q = polyhedral_quality(g.points, g.cells);
  EXPECT_NEAR(q.largest_aspect_ratio.value, 100, 1e-9);
  g.cells.empty_faces.assign(g.cells.face_count(), 0);
  for (std::size_t f = 0; f < g.cells.face_count(); ++f) {
    const auto corners = g.cells.face(f);
    double low = 1e9, high = -1e9;
    for (const PointId p : corners) low = std::min(low, g.points[p][1]), high = std::max(high, g.points[p][1]);
    g.cells.empty_faces[f] = high - low < 1e-12;
  }
  const PolyhedralQuality flat = polyhedral_quality(g.points, g.cells);
  EXPECT_EQ(flat.geometric_dimensions, 2);
  EXPECT_NEAR(flat.largest_aspect_ratio.value, 1, 1e-9) << "the empty direction does not count";
}

TEST(PolyhedralQuality, NamesInvertedCells) {
  Grid g = grid(3, 3, 3);
  g.points[1 + 4 * (1 + 4 * 1)] = {2.7, 2.7, 2.7};  // through cell (1, 1, 1)
  const PolyhedralQuality q = polyhedral_quality(g.points, g.cells);
  EXPECT_GT(q.negative_volumes, 0u);
  EXPECT_GE(q.inverted_cells, q.negative_volumes);
  ASSERT_EQ(q.inverted.size(), q.inverted_cells);
  EXPECT_EQ(q.least_volume.id, 1u + 3 * (1 + 3 * 1));
  EXPECT_EQ(std::count(q.inverted.begin(), q.inverted.end(), q.least_volume.id), 1);
  EXPECT_LT(q.least_volume.value, 0);
  EXPECT_GT(q.wrong_pyramids, 0u);
  EXPECT_GT(q.failed_checks(), 1u);
}

// In the mirror all volumes are negative, the largest one too.
TEST(PolyhedralQuality, ExtremeVolumesAreThoseOfCells) {
  Grid g = grid(3, 2, 2);
  for (Vec3& p : g.points) p[0] = p[0] * p[0];  // cells 1, 3 and 5 wide
  for (const double sign : {1.0, -1.0}) {
    Points points = g.points;
    for (Vec3& p : points) p[0] *= sign;
    const PolyhedralQuality q = polyhedral_quality(points, g.cells);
    EXPECT_NEAR(q.least_volume.value, sign > 0 ? 1 : -5, 1e-12);
    EXPECT_NEAR(q.largest_volume.value, sign > 0 ? 5 : -1, 1e-12);
    EXPECT_EQ(q.least_volume.id % 3, sign > 0 ? 0u : 2u);
    EXPECT_EQ(q.largest_volume.id % 3, sign > 0 ? 2u : 0u);
    EXPECT_NEAR(q.total_volume, sign * 36, 1e-11);
    EXPECT_EQ(q.negative_volumes, sign > 0 ? 0u : 12u);
  }
}

struct Counted {
  double amplitude;
  std::size_t negative_volumes, severe, errors, pyramids, skew, failed_checks;
};

// What checkMesh of OpenFOAM 1912 counts in 5 x 4 x 4 cubes whose inner points were moved like this.
TEST(PolyhedralQuality, CountsOfBrokenMeshesAreThoseOfCheckMesh) {
  for (const Counted& expected : {Counted{0.6, 0, 0, 0, 0, 0, 0}, Counted{0.9, 0, 6, 0, 0, 0, 0},
                                  Counted{1.5, 0, 23, 32, 72, 8, 3}, Counted{3, 17, 36, 59, 135, 6, 5}}) {
    SCOPED_TRACE(expected.amplitude);
    Grid g = grid(5, 4, 4);
    const double size[] = {5, 4, 4};
    for (std::size_t i = 0; i < g.points.size(); ++i) {
      Vec3& p = g.points[i];
      bool inside = true;
      for (std::size_t k = 0; k < 3; ++k) inside = inside && p[k] > 0 && p[k] < size[k];
      for (std::size_t k = 0; inside && k < 3; ++k) {
        p[k] += expected.amplitude * std::sin(3.7 * static_cast<double>(i) + 2.3 * static_cast<double>(k));
      }
    }
    const PolyhedralQuality q = polyhedral_quality(g.points, g.cells);
    EXPECT_EQ(q.negative_volumes, expected.negative_volumes);
    EXPECT_EQ(q.non_orthogonal_faces, expected.severe);
    EXPECT_EQ(q.non_orthogonality_errors, expected.errors);
    EXPECT_EQ(q.wrong_pyramids, expected.pyramids);
    EXPECT_EQ(q.skew_faces, expected.skew);
    EXPECT_EQ(q.failed_checks(), expected.failed_checks);
    // One meaning of inverted: that of the checks on the way of a design, and of every cell with a wrong pyramid.
    EXPECT_EQ(q.inverted_cells, InversionCheck(g.points, &g.cells).at_rest().count);
    EXPECT_EQ(q.inverted_cells > 0, q.wrong_pyramids + q.negative_volumes > 0);
    EXPECT_GE(q.inverted_cells, q.negative_volumes);
  }
}

TEST(PolyhedralQuality, NamesTheChecksThatFail) {
  Grid g = grid(3, 3, 3);
  EXPECT_TRUE(polyhedral_quality(g.points, g.cells).failures().empty());
  for (Vec3& p : g.points) p[1] = -p[1];
  const PolyhedralQuality q = polyhedral_quality(g.points, g.cells);
  std::vector<std::string> names;
  for (const auto& failure : q.failures()) names.push_back(failure.check);
  EXPECT_EQ(names, (std::vector<std::string>{"aspect ratio", "cell volumes", "non-orthogonality", "face pyramids"}));
  EXPECT_EQ(q.inverted_cells, 27u);
  // In a mesh whose faces all look inwards nothing is inverted, though checkMesh fails it.
  PolyhedralLimits limits;
  limits.left_handed = left_handed_cells(g.points, &g.cells);
  const PolyhedralQuality left = polyhedral_quality(g.points, g.cells, limits);
  EXPECT_EQ(left.inverted_cells, 0u);
  EXPECT_EQ(left.left_handed, 27u);
  EXPECT_EQ(left.negative_volumes, 27u);
}

TEST(PolyhedralQuality, OpenCells) {
  Grid g = grid(2, 1, 1);
  g.cells.owner.back() = 1 - g.cells.owner.back();
  EXPECT_GT(polyhedral_quality(g.points, g.cells).open_cells, 0u);
}

TEST(PolyhedralQuality, SameBitsForAnyNumberOfThreads) {
  Grid g = grid(20, 20, 20);
  for (std::size_t i = 0; i < g.points.size(); ++i) g.points[i][i % 3] += 0.2 * std::sin(static_cast<double>(i));
  RunContext one;
  one.threads = 1;
  const PolyhedralQuality a = polyhedral_quality(g.points, g.cells, {}, one), b = polyhedral_quality(g.points, g.cells);
  EXPECT_EQ(a.total_volume, b.total_volume);
  EXPECT_EQ(a.largest_skewness.value, b.largest_skewness.value);
  EXPECT_EQ(a.largest_skewness.id, b.largest_skewness.id);
  EXPECT_EQ(a.average_non_orthogonality, b.average_non_orthogonality);
}

TEST(PolyhedralQuality, Refuses) {
  Grid g = grid(1, 1, 1);
  g.cells.face_points[5] = 8;
  test::expect_error(ErrorCode::invalid_argument, {"faces[1]", "point 8", "8"}, [&] { polyhedral_quality(g.points, g.cells); });
  test::expect_error(ErrorCode::invalid_argument, {"no cells"}, [&] { polyhedral_quality(g.points, {}); });
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  const Grid good = grid(2, 2, 2);
  test::expect_error(ErrorCode::cancelled, {}, [&] { polyhedral_quality(good.points, good.cells, {}, context); });
}

}  // namespace
}  // namespace deform::polyhedral_quality_test
