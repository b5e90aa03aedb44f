// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/symmetry_sides.h"

#include <gtest/gtest.h>

#include "core/base/vectors.h"
#include "tests/core/deformers/mirrored.h"

namespace deform::symmetry_sides_test {
namespace {

using test::HalfModel;

TEST(SymmetrySides, CountsPointsBeyondAnyPlaneAndTellsTheFarthest) {
  for (const test::Frame& frame : {test::Frame{}, test::oblique()}) {
    for (std::size_t planes = 1; planes <= 3; ++planes) {
      const HalfModel model(planes, frame);
      const PlaneSides sides = symmetry_sides(model.setup, *model.half);
      EXPECT_FALSE(sides.empty());
      EXPECT_EQ(sides.crossings(model.half->points, 0).points, 0U) << "at rest";
      Points points = model.half->points;
      const double diagonal = bounding_box(points).diagonal();
      points[7] = frame.point({0.5, 0.5, 0.5 + 3});  // on the right side of all
      points[11] = frame.point({-0.1, 0.5, 0.5});
      points[50] = frame.point({0.4, -0.3, 0.5});  // the first plane is kept
      points[90] = frame.point({-0.2, 0.5, -0.25});
      points[20] = frame.point({-1e-10 * diagonal, 0.5, 0.5});  // rounding
      const PlaneSides::Crossings found = sides.crossings(points, 0);
      EXPECT_EQ(found.points, planes == 1 ? 2U : 3U);
      EXPECT_EQ(found.farthest, planes == 1 ? 90U : 50U);
      EXPECT_NEAR(found.distance, planes == 1 ? 0.2 : 0.3, 1e-14 * diagonal);
      // Block by block the same.
      PlaneSides::Crossings sum;
      for (std::size_t first = 0; first < points.size(); first += 40) {
        sum.add(sides.crossings(std::span(points).subspan(first, std::min<std::size_t>(40, points.size() - first)), first));
      }
      EXPECT_EQ(sum.points, found.points);
      EXPECT_EQ(sum.farthest, found.farthest);
      EXPECT_EQ(sum.distance, found.distance);
    }
  }
}

TEST(SymmetrySides, OfAFittedPlaneBeginBeyondItsPoints) {
  HalfModel model(1, test::oblique());
  Mesh mesh = *model.half;
  Region::Ids side;
  double up = 1;
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    if ((model.mask[i] & 1u) == 0) continue;
    side.ids.push_back(static_cast<PointId>(i));
    mesh.points[i] = mesh.points[i] + (up * 4e-7) * model.frame.axes[0];
    up = -up;
  }
  model.setup.symmetry = {{Region{side}}};
  const PlaneSides sides = symmetry_sides(model.setup, mesh);
  EXPECT_EQ(sides.crossings(mesh.points, 0).points, 0U) << "points of the plane keep their distance";
  mesh.points[60] = model.frame.point({-1e-5, 0.5, 0.5});
  EXPECT_EQ(sides.crossings(mesh.points, 0).points, 1U);
}

TEST(SymmetrySides, NoneWithoutPlanes) {
  HalfModel model(1, test::Frame{});
  model.setup.symmetry.clear();
  const PlaneSides sides = symmetry_sides(model.setup, *model.half);
  EXPECT_TRUE(sides.empty());
  const Points points{{-9, -9, -9}};
  EXPECT_EQ(sides.crossings(points, 0).points, 0U);
}

TEST(SymmetrySides, AreToldInOneSentence) {
  EXPECT_EQ((PlaneSides::Crossings{1873, 0.046, 17}.text(8241)),
            "1873 of 8241 points crossed a symmetry plane, point 17 farthest, by 0.046");
}

}  // namespace
}  // namespace deform::symmetry_sides_test
