// SPDX-License-Identifier: GPL-3.0-or-later
// Kinds to projections: names, units and what is refused.
#include "core/constraints/constraint.h"

#include <cmath>

#include "core/constraints/cylinder.h"
#include "tests/core/constraints/projection_checks.h"
#include "tests/support/expect_error.h"

namespace deform::constraint_test {
namespace {

using namespace test;

using Regions = std::vector<Points>;

Points grid(double height = 0) {
  Points points;
  for (int i = 0; i < 5; ++i) {
    for (int j = 0; j < 4; ++j) points.push_back({0.1 * i + 0.01 * j * j, 0.08 * j, height});
  }
  return points;
}

const std::vector<ConstraintKind>& kinds() {
  static const std::vector<ConstraintKind> all = {Planar{},      Circular{}, Cylindrical{},
                                                  Spherical{},   Conical{},  Straight{},
                                                  FeatureLine{}, Rigid{},    FixedPlane{{}, {0, 0, 2}},
                                                  Symmetric{},   Coplanar{}, Parallel{},
                                                  Orthogonal{},  Distance{}, Extent{{0, 1, 0}, Bound::minimum, 0.1}};
  return all;
}

TEST(Constraint, EveryKindIsMadeAndCalledByItsName) {
  ASSERT_EQ(kinds().size(), std::variant_size_v<ConstraintKind>);
  Points mirrored = grid(0.3);
  for (Vec3& p : mirrored) p[2] = 0.8 - p[2];
  for (std::size_t k = 0; k < kinds().size(); ++k) {
    const ConstraintKind& kind = kinds()[k];
    ASSERT_EQ(kind.index(), k);
    SCOPED_TRACE(kind_name(kind));
    const bool two = region_counts(kind)[1] > 1;
    const Regions rest = two ? Regions{grid(0.3), mirrored} : Regions{noisy(grid(), 0.02, 3)};
    const auto projection = make_projection(kind, rest);
    EXPECT_EQ(projection->point_count(), two ? 40u : 20u);
    if (!std::holds_alternative<Coplanar>(kind)) {
      EXPECT_EQ(projection->kind(), kind_name(kind));
    }
    Points all;
    for (const Points& region : rest) all.insert(all.end(), region.begin(), region.end());
    expect_survives(*projection, all);
  }
}

// In half models: what names a plane or an axis is reflected, what fits one shape may continue through the plane.
TEST(Constraint, EveryKindSaysWhatItsMirrorImageIs) {
  for (ConstraintKind kind : kinds()) {
    SCOPED_TRACE(kind_name(kind));
    const Placement placement = placement_of(kind);
    const std::vector<double> before = numbers_of(kind);
    for (Vec3* const point : placement.points) (*point)[0] += 1;
    for (Vec3* const direction : placement.directions) (*direction)[0] += 1;
    const bool placed = !placement.points.empty() || !placement.directions.empty();
    EXPECT_EQ(numbers_of(kind) != before, placed) << "they are its options";
    // A symmetric region without a plane has its own in each image.
    EXPECT_EQ(mirroring_of(kind) == Mirroring::direction, placed || std::holds_alternative<Symmetric>(kind));
    if (mirroring_of(kind) == Mirroring::shape) {
      EXPECT_EQ(region_counts(kind)[1], 1u);
    }
  }
  EXPECT_EQ(mirroring_of(Planar{}), Mirroring::shape);
  EXPECT_EQ(mirroring_of(Rigid{}), Mirroring::shape);
  EXPECT_EQ(mirroring_of(Rigid{2}), Mirroring::relation) << "columns of cells are no shape";
  EXPECT_EQ(mirroring_of(Parallel{}), Mirroring::relation);
  EXPECT_EQ(mirroring_of(Symmetric{}), Mirroring::direction) << "the plane is found in each image";
  ConstraintKind symmetric = Symmetric{Symmetric::Plane{{1, 2, 3}, {0, 0, 1}}};
  EXPECT_EQ(placement_of(symmetric).points.size(), 1u);
  EXPECT_EQ(placement_of(symmetric).directions.size(), 1u);
}

TEST(Constraint, LengthsAreInModelUnits) {
  const UnitMap units{{100, 200, 300}, 50};
  // The plane z = 310 is z = 0.2 in unit coordinates.
  const auto plane = make_projection(FixedPlane{{0, 0, 310}, {0, 0, 5}}, Regions{grid()}, units);
  for (const Vec3& p : projected(*plane, grid()).points) EXPECT_NEAR(p[2], 0.2, 1e-15);
  const auto thickness = make_projection(Distance{Bound::equal, 10.0}, Regions{grid(), grid(0.1)}, units);
  Points both = grid(), upper = grid(0.1);
  both.insert(both.end(), upper.begin(), upper.end());
  const Points apart = projected(*thickness, both).points;
  EXPECT_NEAR(apart[20][2] - apart[0][2], 0.2, 1e-15);
  const auto height = make_projection(Extent{{0, 0, 1}, Bound::maximum, 2.5}, Regions{both}, units);
  const Points low = projected(*height, both).points;
  EXPECT_NEAR(low[20][2] - low[0][2], 0.05, 1e-15);
  const auto at_least = make_projection(Extent{{0, 0, 1}, Bound::minimum, 25}, Regions{both}, units);
  const Points high = projected(*at_least, both).points;
  EXPECT_NEAR(high[20][2] - high[0][2], 0.5, 1e-15);
}

TEST(Constraint, KeptSizesAreThoseAtRest) {
  Points ring;
  for (int i = 0; i < 48; ++i) ring.push_back({0.2 * std::cos(0.7 * i), 0.2 * std::sin(0.7 * i), 0.4 * (i % 4)});
  Points larger = ring;
  for (Vec3& p : larger) p[0] *= 1.25, p[1] *= 1.25;
  const Points y = projected(*make_projection(Cylindrical{Size::kept}, Regions{ring}), larger).points;
  EXPECT_NEAR(cylinder_curvature(y), 1 / 0.2, 1e-9);
  EXPECT_NEAR(squared(y, larger), 48 * 0.05 * 0.05, 0.02)
      << "about the same axis, nearly: the points are not quite evenly around it";
  expect_error(ErrorCode::invalid_argument, {"constraint.radius", "flat"}, [&] {
    make_projection(Circular{Size::kept}, Regions{{{0, 0, 0}, {1, 1, 1}, {2, 2, 2}, {4, 4, 4}}});
  });
}

TEST(Constraint, SymmetryOfOneRegion) {
  Points x = grid();
  for (const Vec3& p : grid()) x.push_back({p[0], -1 - p[1], p[2]});
  const auto found = make_projection(Symmetric{}, Regions{x});
  expect_unmoved(*found, x);
  expect_error(ErrorCode::invalid_argument, {"constraint.plane", "none found"},
               [] { make_projection(Symmetric{}, Regions{normal_noise(20, 9)}); });
  Symmetric given;
  given.plane = Symmetric::Plane{{0, -0.5, 0}, {0, 3, 0}};
  expect_unmoved(*make_projection(given, Regions{x}), x);
  x.push_back({7, 7, 7});
  expect_error(ErrorCode::invalid_argument, {"constraints[3].regions", "1 of 41", "point 40"},
               [&] { make_projection(given, Regions{x}, {}, "constraints[3]"); });
}

TEST(Constraint, RefusesBadInput) {
  const auto refused = [](const ConstraintKind& kind, const Regions& rest, const std::vector<const char*>& parts) {
    expect_error(ErrorCode::invalid_argument, parts, [&] { make_projection(kind, rest, {}, "constraints[1]"); });
  };
  const Points x = grid();
  refused(Planar{}, {}, {"constraints[1].regions", "0 given", "planar takes 1"});
  refused(Planar{}, {x, x}, {"2 given"});
  refused(Coplanar{}, {x}, {"1 given", "2 to 1000"});
  refused(Orthogonal{}, {x, x, x}, {"3 given", "takes 2"});
  const std::pair<ConstraintKind, const char*> least[] = {
      {Planar{}, "at least 4"},  {Circular{}, "at least 4"}, {Cylindrical{}, "at least 6"}, {Spherical{}, "at least 5"},
      {Conical{}, "at least 7"}, {Straight{}, "at least 3"}, {FeatureLine{}, "at least 3"}, {Rigid{}, "at least 2"}};
  for (const auto& [kind, limit] : least) {
    const auto count = static_cast<std::size_t>(limit[9] - '1');
    refused(kind, {Points(x.begin(), x.begin() + static_cast<std::ptrdiff_t>(count))}, {"constraints[1].region", limit});
    EXPECT_NO_THROW(make_projection(kind, Regions{Points(x.begin(), x.begin() + static_cast<std::ptrdiff_t>(count) + 1)}));
  }
  refused(Parallel{}, {x, {{0, 0, 0}, {1, 0, 0}}}, {"constraints[1].regions[1]", "2 points", "at least 3"});
  refused(Planar{}, {{}}, {"constraints[1].regions[0]", "0 points"});
  Points broken = x;
  broken[7][1] = std::nan("");
  refused(Planar{}, {broken}, {"constraints[1].regions[0].points[7]", "coordinate y", "finite"});
  refused(FixedPlane{{0, 0, 0}, {0, 0, 0}}, {x}, {"constraints[1].normal", "must not be zero"});
  refused(FixedPlane{{0, INFINITY, 0}, {0, 0, 1}}, {x}, {"constraints[1].point", "finite"});
  refused(Symmetric{{}, 0.5}, {x}, {"constraints[1].tolerance", "0.1"});
  refused(Distance{Bound::equal, 0.0}, {x, grid(1)}, {"constraints[1].value", "above 0"});
  refused(Distance{}, {x, x}, {"constraints[1].regions", "point 0", "coincide"});
  refused(Extent{{0, 0, 0}}, {x}, {"constraints[1].axis"});
  refused(Extent{{0, 0, 1}, Bound::minimum, -1}, {x}, {"constraints[1].value", "negative"});
  refused(Extent{{0, 0, 1}, Bound::equal, 1}, {x}, {"constraints[1].bound"});
  refused(Extent{{0, 1, 0}, Bound::minimum, 1, 0.5}, {x}, {"constraints[1].ends", "0.5"});
  refused(Extent{{0, 0, 1}, Bound::minimum, 1}, {x}, {"constraints[1].regions", "no extent"});
  expect_error(ErrorCode::invalid_argument, {"units", "positive"}, [&] { make_projection(Planar{}, Regions{x}, {{}, 0}); });
}

}  // namespace
}  // namespace deform::constraint_test
