// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/reading.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "client/cli/output/result_json.h"
#include "client/setup/id_files.h"
#include "tests/support/expect_error.h"

namespace deform::setup_file_test {
namespace {

using test::expect_error;

v1::Setup parse(const std::string& text) {
  v1::Setup setup;
  cli::parse_yaml(text, "car.yaml", setup);
  return setup;
}

TEST(SetupFile, ReadsWhatTheDocumentationShows) {
  const auto setup = parse(R"(
geometry: ahmed.obj                     # a file (registered on the way) or a geometry id
method: {rbf: {kernel: TRIHARMONIC, polynomial_degree: 1}}
handles:
  - {name: slant, region: {group: slant}}
  - {name: roof,  region: {intersection: [{group: roof}, {box: {min: [0.2, -1, 0], max: [.8, +1, 1e0]}}]}}
fixed: [{group: nose}, {ids: [1, 2, 4294967295]}, {open_boundary: true}, {boundary: true}, {grow: {region: {group: 12}, rings: 3}}]
variables:
  - {name: roof_up,    handle: roof,  translate: [0, 0, 1], lower: -0.05, upper: 0.05}
  - {name: slant_turn, handle: slant, rotate: {axis: [0, 1, 0], centre: [0, 0, 0.3]}, lower: -0.2, upper: 0.2}   # radians
symmetry: [{point: [0, 0, 0], normal: [0, 1, 0]}, {region: {group: symmetry}}]
seed: 18446744073709551615
)");
  EXPECT_EQ(setup.geometry(), "ahmed.obj");
  EXPECT_EQ(setup.method().rbf().kernel(), v1::TRIHARMONIC);
  EXPECT_EQ(setup.method().rbf().polynomial_degree(), 1u);
  EXPECT_EQ(setup.handles(1).region().intersection(1).box().max(0), 0.8);
  EXPECT_EQ(setup.handles(1).region().intersection(1).box().max(1), 1.0);
  EXPECT_EQ(setup.fixed(1).ids(2), 4294967295u);
  EXPECT_TRUE(setup.fixed(2).open_boundary());
  EXPECT_TRUE(setup.fixed(3).boundary());
  EXPECT_EQ(setup.fixed(4).grow().region().group(), "12");
  EXPECT_TRUE(setup.variables(0).has_lower());
  EXPECT_EQ(setup.variables(1).rotate().centre(2), 0.3);
  EXPECT_EQ(setup.symmetry(0).normal(1), 1.0);
  EXPECT_EQ(setup.symmetry(1).region().group(), "symmetry");
  EXPECT_EQ(setup.seed(), 18446744073709551615u);
}

TEST(SetupFile, ReadsConstraintsAndTheirOptions) {
  const auto setup = parse(R"(
method: {mls: {}}
constraints:
  - {name: walls, rigid: {layers: 3}, regions: [{group: car_body}]}
  - {name: bore, cylindrical: {radius: KEPT}, regions: [{group: bore}], exact: true, weight: 1e7}
constraint_options: {tolerance: 1e-9, iterations: 500}
)");
  EXPECT_EQ(setup.constraints(0).rigid().layers(), 3u);
  EXPECT_FALSE(setup.constraints(0).exact());
  EXPECT_EQ(setup.constraints(1).cylindrical().radius(), v1::KEPT);
  EXPECT_TRUE(setup.constraints(1).exact());
  EXPECT_EQ(setup.constraint_options().tolerance(), 1e-9);
  EXPECT_EQ(setup.constraint_options().iterations(), 500u);
  EXPECT_EQ(parse(cli::setup_text(setup)).SerializeAsString(), setup.SerializeAsString());
}

TEST(SetupFile, JsonIsYamlAndComesBack) {
  const auto setup = parse(R"({"geometry": "0123456789abcdef", "handles": [{"name": "a \"b\"\t\u00fc", "region": {"all": true}}],
                               "variables": [{"name": "v", "handle": "x", "translate": [0.1, 1e-300, -2], "lower": 0}], "seed": 5})");
  EXPECT_EQ(setup.handles(0).name(), "a \"b\"\t\xc3\xbc");
  EXPECT_EQ(parse(cli::setup_text(setup)).SerializeAsString(), setup.SerializeAsString());
}

struct BadRow {
  const char* text;
  std::vector<const char*> message;
};

TEST(SetupFile, NamesLineAndReason) {
  const std::vector<BadRow> table = {
      {"", {"car.yaml:1", "empty"}},
      {"# nothing\n", {"car.yaml:1", "empty"}},
      {"- a\n- b\n", {"car.yaml:1", "expected a map", "got a list"}},
      {"geometry: a\nhandels: []\n", {"car.yaml:2", "unknown key \"handels\"", "did you mean \"handles\""}},
      {"handles:\n  - name: a\n    regio: {group: b}\n", {"car.yaml:3", "handles[0]", "\"regio\"", "\"region\""}},
      {"fixed:\n  - {xyzzy: 1}\n", {"car.yaml:2", "fixed[0]", "expected one of group, box"}},
      {"geometry: a\ngeometry: b\n", {"car.yaml:2", "stands there twice"}},
      {"handles: {name: a}\n", {"car.yaml:1", "handles: expected a list, got a map"}},
      {"handles:\n  - roof\n", {"car.yaml:2", "handles[0]: expected a map of name, region", "\"roof\""}},
      {"geometry: [a]\n", {"car.yaml:1", "geometry: expected a text, got a list"}},
      {"geometry:\n", {"car.yaml:1", "geometry", "got nothing"}},
      {"variables:\n  - lower: \"-1\"\n", {"car.yaml:2", "lower: expected a finite number, got the text \"-1\""}},
      {"variables:\n  - lower: \"0.05*Q\"\n", {"car.yaml:2", "lower: expected a finite number, got the text \"0.05*Q\"", "Q"}},
      {"variables:\n  - lower: low\n", {"car.yaml:2", "variables[0].lower: expected a finite number, got \"low\""}},
      {"variables:\n  - lower: .nan\n", {"car.yaml:2", "finite number"}},
      {"variables:\n  - upper: .inf\n", {"car.yaml:2", "finite number"}},
      {"variables:\n  - upper: 1e999\n", {"car.yaml:2", "finite number"}},
      {"variables:\n  - upper: 1,5\n", {"car.yaml:2", "finite number"}},
      {"variables:\n  - translate:\n      - 1\n      - x\n", {"car.yaml:4", "translate[1]"}},
      {"variables:\n  - translate: 1\n", {"car.yaml:2", "expected a list"}},
      {"fixed: [{ids: [-1]}]\n", {"car.yaml:1", "fixed[0].ids[0]: expected an integer from 0 to 4294967295, got \"-1\""}},
      {"fixed: [{ids: [4294967296]}]\n", {"ids[0]", "4294967295"}},
      {"fixed: [{ids: [1.5]}]\n", {"ids[0]", "integer"}},
      {"fixed: [{open_boundary: yes}]\n", {"expected true or false, got \"yes\""}},
      {"method: {rbf: {kernel: triharmonic}}\n", {"kernel", "is none of", "did you mean \"TRIHARMONIC\""}},
      {"method: {rbf: {kernel: 1}}\n", {"kernel", "is none of"}},
      {"constraints: [{rigid: {layers: -1}}]\n", {"car.yaml:1", "constraints[0].rigid.layers: expected an integer"}},
      {"constraints: [{exact: 1}]\n", {"constraints[0].exact: expected true or false"}},
      {"constraint_options: {tolerence: 1}\n", {"\"tolerence\"", "\"tolerance\""}},
      {"constraint_options: {iterations: 1e3}\n", {"constraint_options.iterations: expected an integer"}},
      {"symmetry: [{sector: {count: -4}}]\n", {"symmetry[0].sector.count: expected an integer from 2 to 10000, got \"-4\""}},
      {"method: {ffd: {lattice: {points: [4, -4, 4]}}}\n",
       {"points[1]: expected an integer from 4 to 1000, with basis BERNSTEIN from 2 to 16"}},
      {"seed: -1\n", {"seed", "18446744073709551615"}},
      {"handles: [\n", {"car.yaml:"}},
      {"a: b: c\n", {"car.yaml:1"}},
      {"geometry: *nowhere\n", {"car.yaml:1"}},
      {"geometry: \"a\xff\"\n", {"car.yaml"}},
  };
  for (const auto& row : table) {
    SCOPED_TRACE(row.text);
    expect_error(ErrorCode::invalid_argument, row.message, [&] { parse(row.text); });
  }
}

TEST(SetupFile, DeepNestingIsRefused) {
  std::string text = "fixed: [";
  for (int k = 0; k < 200; ++k) text += "{complement: ";
  text += "{all: true}";
  for (int k = 0; k < 200; ++k) text += "}";
  expect_error(ErrorCode::invalid_argument, {"car.yaml", "deep"}, [&] { parse(text + "]\n"); });
}

/// The parser of YAML has a limit of its own and says "bad file" there.
TEST(SetupFile, DeeperNestingIsToldWithItsPlace) {
  std::string text = "geometry: a\nfixed: [";
  for (int k = 0; k < 600; ++k) text += "{complement: ";
  text += "{all: true}" + std::string(600, '}') + "]\n";
  // The map, the list and 98 complements are a depth of 100.
  const std::string place = "car.yaml:2: column " + std::to_string(8 + 98 * 13 + 1) + ": nested deeper than 100";
  expect_error(ErrorCode::invalid_argument, {place.c_str()}, [&] { parse(text); });
}

/// A folder with a mesh of sides 1, 2 and 4.
class SetupWithLengths : public testing::Test {
 protected:
  SetupWithLengths() {
    std::filesystem::create_directories(folder_);
    write("box.obj", "v 1 0 0\nv 2 0 4\nv 2 2 0\nf 1 2 3\n");
  }
  ~SetupWithLengths() override { std::filesystem::remove_all(folder_); }
  std::filesystem::path write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
    return folder_ / name;
  }
  const std::filesystem::path folder_ = std::filesystem::temp_directory_path() / ("deform_lengths_" + std::to_string(::getpid()));
};

TEST_F(SetupWithLengths, TakesExpressionsOfThem) {
  const v1::Setup setup = cli::read_setup_file(write("a.yaml", R"(
fixed: [{sphere: {centre: [Lx, -Ly/2, 2*Lz], radius: L}}]
variables: [{name: v, handle: h, translate: [0, 0, sqrt(2)], upper: 0.05*L, lower: -pi/4}]
geometry: box.obj
)"))
                              .setup;
  const double diagonal = std::sqrt(1.0 + 4 + 16);
  EXPECT_EQ(setup.fixed(0).sphere().centre(0), 1);
  EXPECT_EQ(setup.fixed(0).sphere().centre(1), -1);
  EXPECT_EQ(setup.fixed(0).sphere().centre(2), 8);
  EXPECT_DOUBLE_EQ(setup.fixed(0).sphere().radius(), diagonal);
  EXPECT_EQ(setup.variables(0).translate(2), std::sqrt(2.0));
  EXPECT_DOUBLE_EQ(setup.variables(0).upper(), 0.05 * diagonal);
  EXPECT_DOUBLE_EQ(setup.variables(0).lower(), -std::atan(1.0));
}

TEST_F(SetupWithLengths, SaysWhenThereIsNoMeshToMeasure) {
  const auto refused = [&](const std::string& text, const std::vector<const char*>& parts) {
    expect_error(ErrorCode::invalid_argument, parts, [&] { cli::read_setup_file(write("a.yaml", text)); });
  };
  const std::string variable = "variables:\n  - {upper: 0.1*L}\n";
  refused(variable + "geometry: 0123456789abcdef\n",
          {"a.yaml:2", "variables[0].upper", "\"0.1*L\"", "`geometry` names no mesh file"});
  refused(variable, {"a.yaml:2", "`geometry` names no mesh file"});
  refused("variables: [{upper: 0.1*D}]\ngeometry: box.obj\n", {"a.yaml:1", "column 5", "there is no name \"D\""});
  refused("seed: 2*3\ngeometry: box.obj\n", {"seed: expected an integer"});
  refused("variables: [{upper: \"23\"}]\ngeometry: box.obj\n", {"the text \"23\""});
  refused("variables: [{upper: \"2*D\"}]\ngeometry: box.obj\n", {"the text \"2*D\"", "there is no name \"D\""});
}

TEST_F(SetupWithLengths, SetsOfOneNameAreRefused) {
  write("ids.json", R"({"bore": [1, 2], "rim": [{"bore": 1, "bore": 2}], "bore": [3]})");
  write("other.json", R"({"bore": [1, 2], "rim": {"bore": [4], "rim": [5]}})");
  client::IdFiles files(folder_);
  for (const char* set : {"bore", "rim"}) {
    expect_error(ErrorCode::invalid_argument, {"ids.json", "two sets \"bore\""}, [&] { files.ids("ids.json", set); });
  }
  EXPECT_EQ(files.ids("other.json", "bore"), (std::vector<PointId>{1, 2}));
}

TEST(SetupFile, TellsIdsFromFiles) {
  EXPECT_TRUE(cli::looks_like_id("0123abcd"));
  EXPECT_FALSE(cli::looks_like_id("0123abc"));
  EXPECT_FALSE(cli::looks_like_id("0123abcx"));
  EXPECT_FALSE(cli::looks_like_id(std::string(65, 'a')));
}

}  // namespace
}  // namespace deform::setup_file_test
