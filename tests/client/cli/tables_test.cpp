// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <optional>

#include "client/cli/setup/motions.h"
#include "client/cli/setup/point_match.h"
#include "client/cli/setup/reading.h"
#include "client/cli/sweep/sweep_designs.h"
#include "tests/support/expect_error.h"

namespace deform::tables_test {
namespace {

using test::expect_error;

TEST(Csv, ReadsQuotesCommentsAndLineEnds) {
  const auto csv =
      cli::parse_csv("\xef\xbb\xbf# designs\r\nname, a ,\"b,c\"\r\n\r\n\"x \"\"y\"\"\",1, 2\n z ,+3e-2,-.5\n", "t.csv");
  EXPECT_EQ(csv.header, (std::vector<std::string>{"name", "a", "b,c"}));
  ASSERT_EQ(csv.rows.size(), 2u);
  EXPECT_EQ(csv.rows[0].fields[0], "x \"y\"");
  EXPECT_EQ(csv.rows[1].line, 5u);
  EXPECT_EQ(csv.number(csv.rows[1], 1), 0.03);
  EXPECT_EQ(csv.number(csv.rows[1], 2), -0.5);
}

TEST(Csv, ReadsWhatSemicolonsSeparate) {
  const auto csv = cli::parse_csv("name;roof_up;\"a,b\"\nx,y;0.03;1\n\"u;v\";0,03;1,2,3\n", "t.csv");
  EXPECT_EQ(csv.header, (std::vector<std::string>{"name", "roof_up", "a,b"}));
  ASSERT_EQ(csv.rows.size(), 2u);
  EXPECT_EQ(csv.rows[0].fields[0], "x,y");
  EXPECT_EQ(csv.number(csv.rows[0], 1), 0.03);
  EXPECT_EQ(csv.rows[1].fields[0], "u;v");
  expect_error(ErrorCode::invalid_argument, {"t.csv:3: roof_up: ", "\"0,03\"; decimals are written with a point: 0.03"},
               [&] { csv.number(csv.rows[1], 1); });
  try {
    csv.number(csv.rows[1], 2);
    FAIL() << "1,2,3 is no number";
  } catch (const Error& error) {
    EXPECT_EQ(std::string(error.what()).find("decimals"), std::string::npos) << error.what();
  }
  EXPECT_EQ(cli::parse_csv("a;b,c\n1,2\n", "t.csv").header, (std::vector<std::string>{"a;b", "c"}))
      << "commas separate where there are some";
}

TEST(Csv, RefusesWithTheLine) {
  expect_error(ErrorCode::invalid_argument, {"t.csv", "empty"}, [] { cli::parse_csv("\n# c\n", "t.csv"); });
  expect_error(ErrorCode::invalid_argument, {"t.csv:3", "1 fields, the header has 2"},
               [] { cli::parse_csv("a,b\n1,2\n3\n", "t.csv"); });
  expect_error(ErrorCode::invalid_argument, {"t.csv:1", "two columns"}, [] { cli::parse_csv("a,a\n", "t.csv"); });
  expect_error(ErrorCode::invalid_argument, {"t.csv:1", "column 2"}, [] { cli::parse_csv("a,\n", "t.csv"); });
  expect_error(ErrorCode::invalid_argument, {"t.csv:2", "quote"}, [] { cli::parse_csv("a\n\"x\n", "t.csv"); });
  expect_error(ErrorCode::invalid_argument, {"t.csv:2: a: ", "\"nan\""}, [] {
    const auto csv = cli::parse_csv("a\nnan\n", "t.csv");
    csv.number(csv.rows[0], 0);
  });
}

std::vector<PointId> points_of(const std::string& handle) {
  if (handle == "roof") return {3, 5, 9};
  throw Error(ErrorCode::invalid_argument, "no such handle");
}

/// Points 3, 5 and 9 are what matters; 5 and 9 coincide.
const Points& rest_points() {
  static const Points points{{0, 0, 0},  {0, 0, 0}, {0, 0, 0}, {1, 2, 3}, {0, 0, 0},
                             {-4, 5, 6}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}, {-4, 5, 6}};
  return points;
}

std::vector<v1::Motion> motions_of(const std::string& text, double tolerance = 1e-3) {
  return cli::read_motions(cli::parse_csv(text, "m.csv"), points_of, {rest_points(), tolerance});
}

std::vector<double> only_displacements(const std::vector<v1::Motion>& motions) {
  std::vector<double> xyz;
  if (motions.size() != 1 || motions[0].displacements_size() != 1) return xyz;
  const std::string& bytes = motions[0].displacements(0).xyz();
  xyz.resize(bytes.size() / sizeof(double));
  std::memcpy(xyz.data(), bytes.data(), bytes.size());
  return xyz;
}

TEST(Motions, PositionsById) {
  EXPECT_EQ(only_displacements(motions_of("handle,point,x,y,z\nroof,9,-3,5,6\nroof,3,1,2,4\nroof,5,-4,5,6.5\n")),
            (std::vector<double>{0, 0, 1, 0, 0, 0.5, 1, 0, 0}));
}

TEST(Motions, DisplacementsByPlace) {
  const std::vector<double> expected{1, 2, 3, 4, 5, 6, 7, 8, 9};
  EXPECT_EQ(
      only_displacements(motions_of("handle,x,y,z,dx,dy,dz\nroof,-4,5,6,4,5,6\nroof,1,2,3,1,2,3\nroof,-4,5,6.0004,7,8,9\n")),
      expected)
      << "of coincident points the first is named first";
  const auto refused = [](const std::string& lines, double tolerance, std::vector<const char*> parts) {
    expect_error(ErrorCode::invalid_argument, parts, [&] { motions_of("handle,x,y,z,dx,dy,dz\n" + lines, tolerance); });
  };
  refused("roof,1,2,3.002,0,0,0\n", 1e-3, {"m.csv:2", "within 0.001", "--match-tolerance"});
  refused("roof,1,2,3,0,0,0\nroof,1,2,3,0,0,0\n", 1e-3, {"m.csv:3", "no line has named yet"});
  refused("roof,1,2,3.002,0,0,0\n", 1e-2, {"2 of its 3 points are missing", "point 5"});
  refused("roof,1e300,0,0,0,0,0\n", 1e-3, {"m.csv:2"});
}

TEST(Motions, PlacesAreFoundAcrossCells) {
  Points points;
  std::vector<PointId> ids;
  for (int i = 0; i < 2000; ++i) {
    ids.push_back(static_cast<PointId>(points.size()));
    points.push_back({std::sin(1.0 * i), std::cos(1.7 * i), 0.01 * i - 10});
  }
  const cli::PointMatch match(points, ids, 0.3);
  const std::vector<char> taken(ids.size());
  for (int k = 0; k < 500; ++k) {
    const Vec3 place{1.2 * std::cos(2.3 * k), 1.2 * std::sin(3.1 * k), 0.05 * k - 12};
    std::optional<std::size_t> expected;
    double least = 0.3;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double d = std::hypot(points[i][0] - place[0], points[i][1] - place[1], points[i][2] - place[2]);
      if (d <= least && !(expected && d == least)) {
        least = d;
        expected = i;
      }
    }
    EXPECT_EQ(match.nearest(place, taken), expected) << k;
  }
}

TEST(Motions, ReadsMatricesAndDisplacements) {
  const auto matrices = motions_of("handle,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23\nroof,1,0,0,0.5,0,1,0,0,0,0,1,-2\n");
  ASSERT_EQ(matrices.size(), 1u);
  EXPECT_EQ(matrices[0].affine(3), 0.5);
  EXPECT_EQ(matrices[0].affine(11), -2);
  EXPECT_EQ(only_displacements(motions_of("handle,point,dx,dy,dz\nroof,9,7,8,9\nroof,3,1,2,3\nroof,5,4,5,6\n")),
            (std::vector<double>{1, 2, 3, 4, 5, 6, 7, 8, 9}));
}

TEST(Motions, RefusesWithTheLine) {
  const auto refused = [](const char* text, std::vector<const char*> parts) {
    expect_error(ErrorCode::invalid_argument, parts, [&] { motions_of(text); });
  };
  refused("a,b\n1,2\n", {"the columns are none of"});
  refused("handle,point,dx,dy,dz\n", {"no motion"});
  refused("handle,point,dx,dy,dz\nroot,3,1,2,3\n", {"m.csv:2", "no such handle"});
  refused("handle,point,dx,dy,dz\nroof,4,1,2,3\n", {"m.csv:2", "point 4 is not in handle \"roof\""});
  refused("handle,point,dx,dy,dz\nroof,-3,1,2,3\n", {"m.csv:2", "point id"});
  refused("handle,point,dx,dy,dz\nroof,3,1,2,3\nroof,3,1,2,3\n", {"m.csv:3", "twice"});
  refused("handle,point,dx,dy,dz\nroof,3,1,x,3\n", {"m.csv:2: dy"});
  refused("handle,point,dx,dy,dz\nroof,3,1,2,3\n", {"2 of its 3 points are missing, the first is point 5"});
}

v1::Setup two_variables() {
  v1::Setup setup;
  setup.add_variables()->set_name("roof_up");
  setup.add_variables()->set_name("slant_turn");
  return setup;
}

TEST(Settings, FillOneValuePerVariable) {
  EXPECT_EQ(cli::parse_settings({"slant_turn=-1e-2"}, two_variables()), (std::vector<double>{0, -0.01}));
  EXPECT_TRUE(cli::parse_settings({}, two_variables()).empty());
  v1::Setup odd = two_variables();
  odd.mutable_variables(0)->set_name("v=1");
  EXPECT_EQ(cli::parse_settings({"v=1=0.5"}, odd), (std::vector<double>{0.5, 0}));
  const auto refused = [](const char* setting, std::vector<const char*> parts) {
    expect_error(ErrorCode::invalid_argument, parts, [&] { cli::parse_settings({setting}, two_variables()); });
  };
  refused("roof_up", {"expected NAME=VALUE"});
  refused("roofup=1", {"did you mean \"roof_up\""});
  refused("x=1", {"it has roof_up, slant_turn"});
  refused("roof_up=1m", {"finite number"});
  expect_error(ErrorCode::invalid_argument, {"set twice"}, [] {
    cli::parse_settings({"roof_up=1", "roof_up=2"}, two_variables());
  });
}

cli::DesignTable designs_of(const std::string& text, const v1::Setup& setup = two_variables()) {
  return cli::read_designs(cli::parse_csv(text, "d.csv", cli::BadRows::keep), setup);
}

TEST(SweepDesigns, NamesAndHashes) {
  const auto designs = designs_of("slant_turn\n1\n2\n").designs;
  ASSERT_EQ(designs.size(), 2u);
  EXPECT_EQ(designs[1].name, "design_0002");
  EXPECT_EQ(designs[1].where, "d.csv:3: ");
  EXPECT_EQ(designs[1].values, (std::vector<double>{0, 2}));
  const cli::SweepIdentity identity{"system", "raw_f64", 0, ".obj"};
  EXPECT_NE(cli::design_hash(identity, designs[0]), cli::design_hash(identity, designs[1]));
  EXPECT_NE(cli::design_hash(identity, designs[0]), cli::design_hash({"other", "raw_f64", 0, ".obj"}, designs[0]));
}

TEST(SweepDesigns, ABadTableIsRefused) {
  expect_error(ErrorCode::invalid_argument, {"no design"}, [] { designs_of("roof_up\n"); });
  expect_error(ErrorCode::invalid_argument, {"did you mean"}, [] { designs_of("roof_upp\n1\n"); });
}

v1::Setup bounded() {
  v1::Setup setup = two_variables();
  setup.mutable_variables(0)->set_lower(-0.05);
  setup.mutable_variables(0)->set_upper(0.05);
  setup.mutable_variables(1)->set_upper(0.1);
  return setup;
}

TEST(SweepDesigns, EveryBadRowIsNamedAndTheOthersGoOn) {
  const auto table = designs_of(
      "name,roof_up,slant_turn\n"
      "a,0.05,-7\n"
      "b,0.3,0\n"
      "a/b,0,0\n"
      "c,one,0\n"
      "d,0\n"
      "# a comment\n"
      "a,0,0\n"
      "e,\"0,0\n"
      "f,-0.01,0.2\n"
      "g,0,0.1\n",
      bounded());
  std::vector<std::string> good;
  for (const auto& design : table.designs) good.push_back(design.name);
  EXPECT_EQ(good, (std::vector<std::string>{"a", "g"}));
  const std::vector<std::pair<std::string, std::string>> expected{
      {"b", "d.csv:3: roof_up: 0.3 is outside of its bounds [-0.05, 0.05]"},
      {"d.csv:4", "d.csv:4: name: \"a/b\" cannot be a file name: letters, digits and _ - . + only, at most 80"},
      {"c", "d.csv:5: roof_up: expected a finite number, got \"one\""},
      {"d", "d.csv:6: 2 fields, the header has 3"},
      {"d.csv:8", "d.csv:8: name: \"a\" stands there twice"},
      {"e", "d.csv:9: a quote is not closed"},
      {"f", "d.csv:10: slant_turn: 0.2 is outside of its bounds [-inf, 0.1]"}};
  ASSERT_EQ(table.bad.size(), expected.size());
  for (std::size_t k = 0; k < expected.size(); ++k) {
    EXPECT_EQ(table.bad[k].name, expected[k].first);
    EXPECT_EQ(table.bad[k].reason, expected[k].second);
  }
}

TEST(SweepDesigns, BadRowsCountWhereNamesAreNumbers) {
  const auto table = designs_of("roof_up\n0.01\nx\n1,2\n0.02\n", bounded());
  ASSERT_EQ(table.designs.size(), 2u);
  EXPECT_EQ(table.designs[1].name, "design_0004");
  EXPECT_EQ(table.bad[0].name, "design_0002");
  EXPECT_EQ(table.bad[1].name, "design_0003");
}

TEST(SweepDesigns, ABoundInSinglePrecisionIsTheBound) {
  v1::DesignVariable variable = bounded().variables(0);
  for (const double bound : {0.05, -0.05}) {
    EXPECT_FALSE(cli::out_of_bounds(variable, bound));
    EXPECT_FALSE(cli::out_of_bounds(variable, static_cast<double>(static_cast<float>(bound))));
    EXPECT_FALSE(cli::out_of_bounds(variable, bound + std::copysign(0.99e-7, bound)));
    EXPECT_TRUE(cli::out_of_bounds(variable, bound + std::copysign(2e-7, bound)));
  }
  variable.set_lower(-HUGE_VAL);
  EXPECT_TRUE(cli::out_of_bounds(variable, 0.051));
  variable.set_upper(1e9);
  EXPECT_FALSE(cli::out_of_bounds(variable, 1e9 + 64));
  variable.clear_lower();
  variable.clear_upper();
  EXPECT_FALSE(cli::out_of_bounds(variable, 1e300));
}

}  // namespace
}  // namespace deform::tables_test
