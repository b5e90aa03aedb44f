// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/region.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <limits>
#include <optional>

#include "tests/core/mesh/named_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::region_test {
namespace {

using test::expect_error;
using testing::ElementsAre;
using testing::IsEmpty;

using Ids = std::vector<PointId>;

Region group(const char* name) { return {Region::GroupName{name}}; }
Region ids(Ids list) { return {Region::Ids{std::move(list)}}; }
Region grown(Region child, int rings) { return {Region::Grow{{std::move(child)}, rings}}; }

/// 5 x 5 points (0..4, 0..4) with groups "left" (faces), "corner" (a point) and "nothing".
class RegionTest : public testing::Test {
 protected:
  RegionTest() : mesh_(test::quad_grid(4, 4)) {
    mesh_.groups = {{"left", {}, {0, 4, 8, 12}}, {"corner", {24}, {}}, {"nothing", {}, {}}};
  }
  Ids chosen(const Region& region) const { return select(region, mesh_, "handle \"h\""); }
  void expect_refused(const Region& region, const std::vector<const char*>& parts) const {
    expect_error(ErrorCode::invalid_argument, {"handle \"h\": "}, [&] { chosen(region); });
    expect_error(ErrorCode::invalid_argument, parts, [&] { chosen(region); });
  }
  Mesh mesh_;
};

TEST_F(RegionTest, AllIsEveryPoint) { EXPECT_EQ(chosen({Region::All{}}).size(), 25U); }

TEST_F(RegionTest, AGroupIsItsPointsAndThoseOfItsFaces) {
  EXPECT_THAT(chosen(group("left")), ElementsAre(0, 1, 5, 6, 10, 11, 15, 16, 20, 21));
  EXPECT_THAT(chosen(group("corner")), ElementsAre(24));
  EXPECT_THAT(chosen(group("nothing")), IsEmpty());
}

TEST_F(RegionTest, BoxesAreClosed) {
  EXPECT_THAT(chosen({Region::InBox{{1, 1, 0}, {2, 2, 0}}}), ElementsAre(6, 7, 11, 12));
  EXPECT_THAT(chosen({Region::InBox{{4, 4, 0}, {4, 4, 0}}}), ElementsAre(24));
  EXPECT_THAT(chosen({Region::InBox{{1.1, 1.1, -1}, {1.9, 1.9, 1}}}), IsEmpty());
}

TEST_F(RegionTest, SpheresAreClosed) {
  EXPECT_THAT(chosen({Region::InSphere{{2, 2, 0}, 1}}), ElementsAre(7, 11, 12, 13, 17));
  EXPECT_THAT(chosen({Region::InSphere{{2, 2, 0}, 0}}), ElementsAre(12));
  EXPECT_THAT(chosen({Region::InSphere{{0, 0, 5}, 5}}), ElementsAre(0));
}

TEST_F(RegionTest, CylindersAreClosedAtCapsAndSide) {
  EXPECT_THAT(chosen({Region::InCylinder{{1, 2, 0}, {3, 2, 0}, 0}}), ElementsAre(11, 12, 13));
  EXPECT_THAT(chosen({Region::InCylinder{{3, 2, 0}, {1, 2, 0}, 1}}), ElementsAre(6, 7, 8, 11, 12, 13, 16, 17, 18));
  EXPECT_THAT(chosen({Region::InCylinder{{2, 2, -9}, {2, 2, 9}, 1}}), ElementsAre(7, 11, 12, 13, 17));
}

TEST_F(RegionTest, HalfSpacesAreClosedAndNeedNoUnitNormal) {
  EXPECT_THAT(chosen({Region::InHalfSpace{{3, 0, 0}, {0.001, 0, 0}}}), ElementsAre(3, 4, 8, 9, 13, 14, 18, 19, 23, 24));
  EXPECT_THAT(chosen({Region::InHalfSpace{{0, 0, 0}, {-100, -100, 0}}}), ElementsAre(0));
}

TEST_F(RegionTest, IdsComeBackSortedAndUnique) { EXPECT_THAT(chosen(ids({7, 3, 7, 0})), ElementsAre(0, 3, 7)); }

TEST_F(RegionTest, OpenBoundaryIsTheRim) {
  const Ids rim = chosen({Region::OpenBoundary{}});
  EXPECT_EQ(rim.size(), 16U);
  const Ids inside = chosen({Region::Complement{{{Region::OpenBoundary{}}}}});
  EXPECT_THAT(inside, ElementsAre(6, 7, 8, 11, 12, 13, 16, 17, 18));
  const Mesh closed = test::tetrahedron();
  EXPECT_THAT(select({Region::OpenBoundary{}}, closed, "x"), IsEmpty());
}

TEST_F(RegionTest, Combinators) {
  const Region a = ids({1, 2, 3}), b = ids({3, 4}), c = ids({2, 9});
  EXPECT_THAT(chosen({Region::Union{{a, b, c}}}), ElementsAre(1, 2, 3, 4, 9));
  EXPECT_THAT(chosen({Region::Intersection{{a, b}}}), ElementsAre(3));
  EXPECT_THAT(chosen({Region::Intersection{{a, b, c}}}), IsEmpty());
  EXPECT_THAT(chosen({Region::Difference{{a, b, c}}}), ElementsAre(1));
  EXPECT_THAT(chosen({Region::Union{{a}}}), ElementsAre(1, 2, 3));
  EXPECT_THAT(chosen({Region::Difference{{a}}}), ElementsAre(1, 2, 3));
  EXPECT_EQ(chosen({Region::Complement{{a}}}).size(), 22U);
}

TEST_F(RegionTest, GrowAddsRingsOfNeighbours) {
  EXPECT_THAT(chosen(grown(ids({12}), 0)), ElementsAre(12));
  EXPECT_THAT(chosen(grown(ids({12}), 1)), ElementsAre(6, 7, 8, 11, 12, 13, 16, 17, 18));
  EXPECT_EQ(chosen(grown(ids({12}), 1000)).size(), 25U);
  EXPECT_THAT(chosen(grown(group("nothing"), 3)), IsEmpty());
}

TEST_F(RegionTest, TreesNest) {
  // The rim of the left strip without the outer boundary's corners.
  const Region tree{Region::Difference{{{Region::Intersection{{group("left"), {Region::OpenBoundary{}}}}}, grown(ids({0}), 1)}}};
  EXPECT_THAT(chosen(tree), ElementsAre(10, 15, 20, 21));
}

TEST_F(RegionTest, UnknownGroupsComeWithTheNearestNames) {
  expect_refused(group("lift"), {"group \"lift\" does not exist", "did you mean \"left\""});
  expect_refused(group("zzzzzzzzzz"), {"group \"zzzzzzzzzz\"", "the geometry has \"left\", \"corner\", \"nothing\""});
  mesh_.groups.clear();
  expect_refused(group("left"), {"the geometry has no groups"});
}

TEST_F(RegionTest, ManyGroupsAreNotAllListed) {
  mesh_.groups.clear();
  for (int i = 0; i < 20; ++i) mesh_.groups.push_back({"patch_number_" + std::to_string(i), {}, {}});
  expect_refused(group("qqqqqqqqqqqqqqqqqqqqqqqqqq"), {"patch_number_7", "and 12 more"});
}

TEST_F(RegionTest, ValuesOutsideTheirRangeAreRefused) {
  const double inf = std::numeric_limits<double>::infinity(), nan = std::numeric_limits<double>::quiet_NaN();
  expect_refused(ids({1, 25}), {"ids[1]", "point 25", "25 points"});
  expect_refused({Region::InBox{{0, 2, 0}, {1, 1, 1}}}, {"box", "min.y", "max.y"});
  expect_refused({Region::InBox{{0, nan, 0}, {1, 1, 1}}}, {"box.min", "coordinate y"});
  expect_refused({Region::InBox{{0, 0, 0}, {1, 1, inf}}}, {"box.max", "coordinate z"});
  expect_refused({Region::InSphere{{0, 0, nan}, 1}}, {"sphere.centre", "coordinate z"});
  expect_refused({Region::InSphere{{0, 0, 0}, -1}}, {"sphere.radius", "negative"});
  expect_refused({Region::InSphere{{0, 0, 0}, inf}}, {"sphere.radius", "finite"});
  expect_refused({Region::InCylinder{{0, 0, 0}, {0, 0, 1}, -0.5}}, {"cylinder.radius"});
  expect_refused({Region::InCylinder{{inf, 0, 0}, {0, 0, 1}, 1}}, {"cylinder.start"});
  expect_refused({Region::InCylinder{{1, 1, 1}, {1, 1, 1}, 1}}, {"cylinder", "no length"});
  expect_refused({Region::InHalfSpace{{0, 0, 0}, {0, 0, 0}}}, {"half_space.normal", "zero"});
  expect_refused({Region::InHalfSpace{{0, nan, 0}, {0, 0, 1}}}, {"half_space.point", "coordinate y"});
  expect_refused(grown(ids({0}), -1), {"grow.rings", "-1", "0..1000"});
  expect_refused(grown(ids({0}), 1001), {"grow.rings", "1001"});
}

TEST_F(RegionTest, TheNumberOfChildrenIsChecked) {
  expect_refused({Region::Union{}}, {"union", "at least one"});
  expect_refused({Region::Intersection{}}, {"intersection", "at least one"});
  expect_refused({Region::Difference{}}, {"difference", "at least one"});
  expect_refused({Region::Complement{}}, {"complement", "exactly one", "not 0"});
  expect_refused({Region::Complement{{ids({0}), ids({1})}}}, {"complement", "exactly one", "not 2"});
  expect_refused({Region::Grow{}}, {"grow", "exactly one"});
}

TEST_F(RegionTest, NestingEndsAtSixtyFour) {
  Region region = ids({3});
  for (int depth = 1; depth < 64; ++depth) region = Region{Region::Complement{{region}}};
  EXPECT_EQ(chosen(region).size(), 24U);  // 63 complements
  expect_refused(Region{Region::Complement{{region}}}, {"nested deeper than 64"});
}

// ---- control points ----

Region range(std::optional<Region::LatticeRange::Range> i, std::optional<Region::LatticeRange::Range> j,
             std::optional<Region::LatticeRange::Range> k) {
  return {Region::LatticeRange{{i, j, k}}};
}
Region controls(Ids list) { return {Region::ControlIds{std::move(list)}}; }
const ControlSet lattice{4 * 3 * 2, {{4, 3, 2}}};

Ids chosen_controls(const Region& region, const ControlSet& from = lattice) {
  return select_controls(region, from, "handle \"h\"");
}

TEST(ControlRegions, RangesAreClosedAndMissingOnesAreTheWholeAxis) {
  EXPECT_THAT(chosen_controls(range({{1, 2}}, {{2, 2}}, {{0, 1}})), ElementsAre(9, 10, 21, 22));
  EXPECT_THAT(chosen_controls(range({{3, 3}}, {}, {{1, 1}})), ElementsAre(15, 19, 23));
  EXPECT_EQ(chosen_controls(range({}, {}, {})).size(), 24u);
}

TEST(ControlRegions, Combine) {
  EXPECT_THAT(chosen_controls(controls({7, 3, 7})), ElementsAre(3, 7));
  EXPECT_THAT(chosen_controls({Region::Union{{controls({20}), range({{0, 0}}, {}, {{0, 0}})}}}), ElementsAre(0, 4, 8, 20));
  EXPECT_THAT(chosen_controls({Region::Intersection{{controls({3, 4, 5}), range({{0, 0}}, {}, {})}}}), ElementsAre(4));
  EXPECT_THAT(chosen_controls({Region::Difference{{controls({3, 4, 5}), range({{0, 0}}, {}, {})}}}), ElementsAre(3, 5));
  EXPECT_THAT(chosen_controls({Region::Complement{{range({{0, 2}}, {}, {})}}}), ElementsAre(3, 7, 11, 15, 19, 23));
  EXPECT_THAT(chosen_controls(controls({4}), {5, std::nullopt}), ElementsAre(4)) << "without a lattice";
}

TEST(ControlRegions, RefuseWhatThereIsNot) {
  const auto refused = [](const Region& region, const std::vector<const char*>& parts, const ControlSet& from = lattice) {
    expect_error(ErrorCode::invalid_argument, {"handle \"h\": "}, [&] { chosen_controls(region, from); });
    expect_error(ErrorCode::invalid_argument, parts, [&] { chosen_controls(region, from); });
  };
  refused(controls({3, 24}), {"control.ids[1]", "control point 24", "24"});
  refused(range({}, {{1, 3}}, {}), {"lattice.j", "[1, 3]", "3 control points", "0 to 2"});
  refused(range({{2, 1}}, {}, {}), {"lattice.i", "[2, 1]"});
  refused(range({}, {}, {}), {"lattice", "control"}, {5, std::nullopt});
  refused({Region::All{}}, {"points of the mesh", "lattice"});
  refused({Region::Union{{controls({1}), ids({1})}}}, {"points of the mesh"});
  refused({Region::Complement{}}, {"complement", "exactly one"});
}

TEST_F(RegionTest, ControlPointsAreNoPoints) {
  expect_refused(range({}, {}, {}), {"lattice", "CONTROLS"});
  expect_refused(controls({1}), {"control", "CONTROLS"});
  expect_refused({Region::Union{{ids({1}), controls({1})}}}, {"control", "CONTROLS"});
}

}  // namespace
}  // namespace deform::region_test
