// SPDX-License-Identifier: GPL-3.0-or-later
// OpenFOAM polyMesh: two cubes side by side, in text and in every binary layout, with zones; folders; what is refused.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>

#include "core/io/binary/byte_order.h"
#include "core/io/formats/openfoam/openfoam_folder.h"
#include "tests/core/io/text_diff.h"
#include "tests/support/expect_error.h"

namespace deform::io::openfoam_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::UnorderedElementsAre;

std::string header(const std::string& type, const std::string& format = "ascii", const std::string& arch = "") {
  return "/* comment (1 2 */\nFoamFile\n{\n    version 2.0;\n    format " + format + ";\n" +
         (arch.empty() ? "" : "    arch \"" + arch + "\";\n") + "    class " + type + ";\n}\n// * * * //\n\n";
}

// Points x + 3 y + 6 z of a 3 x 2 x 2 grid; cell 0 left, cell 1 right.
const std::string points_text = R"(12
(
(0 0 0) (1 0 0) (2 0 0)
(0 1.50 0) ( 1 1.50 0 )   (2 1.50 0)
(0 0 1e-1) // a comment
(1 0 1e-1) (2 0 1e-1)
(0 1.50 +.1) (1 1.50 .1) (2 1.50 .1)
)
)";
const std::vector<std::vector<std::uint32_t>> faces_list = {{1, 4, 10, 7},  // between the cells
                                                            {0, 6, 9, 3},   // inlet
                                                            {2, 5, 11, 8},  // outlet
                                                            {0, 1, 7, 6},  {1, 2, 8, 7}, {3, 9, 10, 4}, {4, 10, 11, 5},  // sides
                                                            {0, 3, 4, 1},  {1, 4, 5, 2}, {6, 7, 10, 9}, {7, 8, 11, 10}};
const std::vector<std::uint32_t> owner_list = {0, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1};

std::string joined(const std::vector<std::uint32_t>& numbers) {
  std::string text = std::to_string(numbers.size()) + "(";
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (i > 0) text += ' ';
    text += std::to_string(numbers[i]);
  }
  text += ')';
  return text;
}

std::string faces_text() {
  std::string text = std::to_string(faces_list.size()) + "\n(\n";
  for (const auto& face : faces_list) text += joined(face) + "\n";
  return text + ")\n";
}

FoamFiles ascii_files() {
  FoamFiles files;
  files.points = {header("vectorField") + points_text, "points"};
  files.faces = {header("faceList") + faces_text(), "faces"};
  files.owner = {header("labelList") + joined(owner_list), "owner"};
  files.neighbour = {header("labelList") + "1{1}", "neighbour"};
  files.boundary = {header("polyBoundaryMesh") + R"(3
(
    inlet { type patch; nFaces 1; startFace 1; }
    outlet { type patch; physicalType "a \\ b"; nFaces 1; startFace 2; }
    sides { type wall; inGroups 2(wall all); nested { list (1 2 (3)); } nFaces 8; startFace 3; }
)
)",
                    "boundary"};
  return files;
}

std::string packed(const std::vector<std::uint64_t>& values, std::size_t bytes, std::endian order) {
  std::string raw(values.size() * bytes, '\0');
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (bytes == 8) {
      store_scalar(raw.data() + 8 * i, values[i], order);
    } else {
      store_scalar(raw.data() + 4 * i, static_cast<std::uint32_t>(values[i]), order);
    }
  }
  return std::to_string(values.size()) + "\n(" + raw + ")\n";
}

FoamFiles binary_files(const Points& points, std::size_t label, std::size_t scalar, std::endian order) {
  const std::string arch = std::string(order == std::endian::little ? "LSB" : "MSB") + ";label=" + std::to_string(8 * label) +
                           ";scalar=" + std::to_string(8 * scalar);
  const auto head = [&](const char* type) { return header(type, "binary", arch); };
  FoamFiles files = ascii_files();
  std::vector<std::uint64_t> coordinates, offsets{0}, corners;
  for (const Vec3& p : points) {
    for (const double x : p) {
      coordinates.push_back(scalar == 8 ? std::bit_cast<std::uint64_t>(x) : std::bit_cast<std::uint32_t>(static_cast<float>(x)));
    }
  }
  std::string raw = packed(coordinates, scalar, order);
  raw.replace(0, raw.find('\n'), std::to_string(points.size()));
  for (const auto& face : faces_list) {
    corners.insert(corners.end(), face.begin(), face.end());
    offsets.push_back(corners.size());
  }
  files.points.bytes = head("vectorField") + raw;
  files.faces.bytes = head("faceCompactList") + packed(offsets, label, order) + packed(corners, label, order);
  files.owner.bytes = head("labelList") + packed({owner_list.begin(), owner_list.end()}, label, order);
  files.neighbour.bytes = head("labelList") + packed({1}, label, order);
  files.cell_zones = {head("regIOobject") + "1\n(\nright\n{\n    type cellZone;\ncellLabels      List<label> " +
                          packed({1}, label, order) + ";\n}\n)\n",
                      "cellZones"};
  files.face_zones = {head("regIOobject") + "2\n(\nmiddle\n{\n    type faceZone;\nfaceLabels List<label> " +
                          packed({0}, label, order) + ";\nflipMap List<bool> 1\n(" + std::string(1, '\0') +
                          ");\n}\nempty\n{\nfaceLabels List<label> 0;\nflipMap List<bool> 0;\n}\n)\n",
                      "faceZones"};
  return files;
}

const Group& group(const Mesh& mesh, const std::string& name) {
  const Group* found = mesh.find_group(name);
  if (found == nullptr) throw Error(ErrorCode::not_found, "no group " + name);
  return *found;
}

TEST(OpenFoam, BoundaryFacesAndPatches) {
  const auto file = parse_openfoam(ascii_files());
  const auto mesh = file->mesh();
  EXPECT_EQ(file->format(), Format::openfoam);
  ASSERT_EQ(mesh->point_count(), 12u);
  EXPECT_EQ(mesh->points[10], (Vec3{1, 1.5, 0.1}));
  ASSERT_EQ(mesh->face_count(), 10u);
  EXPECT_EQ(mesh->face_points.size(), 40u);
  EXPECT_EQ(mesh->face_points[0], 0u);
  EXPECT_EQ(mesh->face_points[1], 6u);
  EXPECT_THAT(group(*mesh, "inlet").faces, ElementsAre(0));
  EXPECT_THAT(group(*mesh, "outlet").faces, ElementsAre(1));
  EXPECT_EQ(group(*mesh, "sides").faces.size(), 8u);
  EXPECT_THAT(group(*mesh, "wall").faces, ElementsAre(2, 3, 4, 5, 6, 7, 8, 9));
  EXPECT_EQ(mesh->groups.size(), 5u);
}

TEST(OpenFoam, ZonesBecomeGroups) {
  FoamFiles files = ascii_files();
  files.point_zones = {header("regIOobject") + "1 ( corner { type pointZone; pointLabels 2(11 0); } )", "pointZones"};
  files.face_zones = {
      header("regIOobject") + "1(inlet {type faceZone; faceLabels List<label> 2(0 1); flipMap List<bool> 2(0 0);})", "faceZones"};
  files.cell_zones = {header("regIOobject") + "2(right{type cellZone;cellLabels List<label> 1(1);} empty{cellLabels 0();})",
                      "cellZones"};
  const auto mesh = parse_openfoam(files)->mesh();
  EXPECT_THAT(group(*mesh, "corner").points, ElementsAre(0, 11));
  EXPECT_THAT(group(*mesh, "faceZone:inlet").faces, ElementsAre(0));
  EXPECT_THAT(group(*mesh, "faceZone:inlet").points, ElementsAre(1, 4, 7, 10));
  EXPECT_THAT(group(*mesh, "right").points, ElementsAre(1, 2, 4, 5, 7, 8, 10, 11));
  EXPECT_EQ(mesh->find_group("empty"), nullptr);
}

TEST(OpenFoam, EveryBinaryLayout) {
  const auto plain = parse_openfoam(ascii_files())->mesh();
  for (const std::size_t label : {4, 8}) {
    for (const std::size_t scalar : {4, 8}) {
      for (const std::endian order : {std::endian::little, std::endian::big}) {
        const FoamFiles files = binary_files(plain->points, label, scalar, order);
        const auto file = parse_openfoam(files);
        const auto mesh = file->mesh();
        for (std::size_t i = 0; i < 12; ++i) {
          for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(mesh->points[i][k], plain->points[i][k], scalar == 4 ? 1e-7 : 0);
        }
        EXPECT_EQ(mesh->face_points, plain->face_points);
        EXPECT_THAT(group(*mesh, "right").points, ElementsAre(1, 2, 4, 5, 7, 8, 10, 11));
        EXPECT_THAT(group(*mesh, "middle").points, ElementsAre(1, 4, 7, 10));
        EXPECT_EQ(file->with_points(mesh->points), files.points.bytes);
        Points moved = mesh->points;
        moved[3] = {0.5, -2, 8};
        FoamFiles again = files;
        again.points.bytes = file->with_points(moved);
        EXPECT_EQ(again.points.bytes.size(), files.points.bytes.size());
        EXPECT_EQ(parse_openfoam(again)->mesh()->points, moved);
      }
    }
  }
}

TEST(OpenFoam, OnlyCoordinatesChange) {
  const FoamFiles files = ascii_files();
  const auto file = parse_openfoam(files);
  EXPECT_EQ(file->with_points(file->mesh()->points), files.points.bytes);
  Points moved = file->mesh()->points;
  moved[4] = {1.25, -1e-7, 0};
  moved[11][2] = 3;
  const std::string written = file->with_points(moved);
  FoamFiles again = files;
  again.points.bytes = written;
  EXPECT_EQ(parse_openfoam(again)->mesh()->points, moved);
  EXPECT_NE(written.find("( 1.25 -1e-07 0 )   (2 1.50 0)"), std::string::npos) << written;
  EXPECT_EQ(test::changed_words(files.points.bytes, written).size(), 3u);
}

struct Spoilt {
  const char* name;
  std::function<void(FoamFiles&)> spoil;
  std::vector<const char*> message;
};

void replace(std::string& bytes, const std::string& from, const std::string& to) {
  const std::size_t at = bytes.find(from);
  ASSERT_NE(at, std::string::npos) << from;
  bytes.replace(at, from.size(), to);
}

TEST(OpenFoam, RefusesWhatIsWrong) {
  const std::vector<Spoilt> table = {
      {"no points", [](auto& f) { f.points.bytes = ""; }, {"points: line 1", "the number of points"}},
      {"points without count", [](auto& f) { replace(f.points.bytes, "12\n(", "("); }, {"points", "integer"}},
      {"many points", [](auto& f) { replace(f.points.bytes, "12\n(", "1200000\n("); }, {"points", "1200000"}},
      {"negative", [](auto& f) { replace(f.points.bytes, "12\n(", "-2\n("); }, {"points", "-2"}},
      {"one point less", [](auto& f) { replace(f.points.bytes, "(0 0 0)", ""); }, {"points", "a point"}},
      {"two coordinates", [](auto& f) { replace(f.points.bytes, "(1 0 0)", "(1 0)"); }, {"points: line 12", "coordinate"}},
      {"nan", [](auto& f) { replace(f.points.bytes, "(1 0 0)", "(1 nan 0)"); }, {"points: line 12", "finite"}},
      {"word", [](auto& f) { replace(f.points.bytes, "(1 0 0)", "(1 x 0)"); }, {"points: line 12", "\"x"}},
      {"endless comment", [](auto& f) { f.points.bytes = "/* "; }, {"points", "comment"}},
      {"format", [](auto& f) { replace(f.points.bytes, "ascii", "xml"); }, {"points", "neither ascii nor binary"}},
      {"truncated binary", [](auto& f) { replace(f.points.bytes, "ascii", "binary"); }, {"points"}},
      {"corner", [](auto& f) { replace(f.faces.bytes, "4(2 5 11 8)", "4(2 5 12 8)"); }, {"faces: line", "12", "0..12"}},
      {"corners", [](auto& f) { replace(f.faces.bytes, "4(2 5 11 8)", "5(2 5 11 8)"); }, {"faces", "corner"}},
      {"face count", [](auto& f) { replace(f.faces.bytes, "11\n(", "12\n("); }, {"faces", "corners of a face"}},
      {"patch", [](auto& f) { replace(f.boundary.bytes, "nFaces 8", "nFaces 9"); }, {"boundary", "\"sides\"", "12", "11"}},
      {"patch inside",
       [](auto& f) { replace(f.boundary.bytes, "startFace 1;", "startFace 0;"); },
       {"boundary", "inlet", "internal"}},
      {"patch brace", [](auto& f) { f.boundary.bytes.resize(f.boundary.bytes.size() - 10); }, {"boundary"}},
      {"zone",
       [](auto& f) {
         f.cell_zones = {"1(a{cellLabels 1(2);})", "cellZones"};
       },
       {"cellZones", "member of the zone 2", "0..2"}},
      {"owners",
       [](auto& f) {
         f.cell_zones = {"1(a{cellLabels 1(1);})", "cellZones"}, f.owner.bytes = "1(0)";
       },
       {"owner", "1 owners"}},
      {"huge cell",
       [](auto& f) {
         f.cell_zones = {"1(a{cellLabels 1(1);})", "cellZones"}, f.neighbour.bytes = "1(4000000000)";
       },
       {"neighbour", "4000000000"}},
      {"huge uniform list",
       [](auto& f) {
         f.cell_zones = {"1(a{cellLabels 4000000000{1};})", "cellZones"};
       },
       {"cellZones"}},
  };
  for (const Spoilt& row : table) {
    SCOPED_TRACE(row.name);
    FoamFiles files = ascii_files();
    row.spoil(files);
    test::expect_error(ErrorCode::invalid_argument, row.message, [&] { parse_openfoam(files); });
  }
}

class OpenFoamFolder : public testing::Test {
 protected:
  OpenFoamFolder() : folder_(fs::path(testing::TempDir()) / ("openfoam_" + std::to_string(::getpid()))) {
    fs::remove_all(folder_);
    const FoamFiles files = ascii_files();
    const fs::path mesh = folder_ / "constant" / "polyMesh";
    fs::create_directories(mesh);
    write_file(mesh / "points.gz", files.points.bytes);
    write_file(mesh / "faces.gz", files.faces.bytes);
    write_file(mesh / "owner", files.owner.bytes);
    write_file(mesh / "neighbour", files.neighbour.bytes);
    write_file(mesh / "boundary", files.boundary.bytes);
  }
  ~OpenFoamFolder() override { fs::remove_all(folder_); }
  const fs::path folder_;
};

TEST_F(OpenFoamFolder, EveryWayToNameIt) {
  for (const char* name : {"", "constant/polyMesh", "constant/polyMesh/points.gz"}) {
    const auto file = read_mesh_file(folder_ / name);
    EXPECT_EQ(file->mesh()->point_count(), 12u) << name;
    EXPECT_TRUE(file->compressed);
  }
}

TEST_F(OpenFoamFolder, WritesPointsOfATimeAndReadsThem) {
  const auto file = read_mesh_file(folder_);
  Points moved = file->mesh()->points;
  for (Vec3& p : moved) p[0] += 0.25;
  write_mesh_file(*file, moved, folder_ / "0.5");
  EXPECT_EQ(read_mesh_file(folder_ / "0.5")->mesh()->points, moved) << "its faces are those of constant/polyMesh";
  EXPECT_EQ(read_mesh_file(folder_ / "0.5")->mesh()->face_count(), 10u);
  write_mesh_file(*file, moved, folder_ / "elsewhere" / "points.gz");
  EXPECT_EQ(read_file(folder_ / "elsewhere" / "points.gz"), file->with_points(moved));
  EXPECT_EQ(read_mesh_file(folder_)->mesh()->points, file->mesh()->points) << "the original stays";
}

TEST_F(OpenFoamFolder, TwoFoldersOfOneTimeAreRefused) {
  const auto file = read_mesh_file(folder_);
  write_mesh_file(*file, file->mesh()->points, folder_ / "0.5");
  const std::string there = "is the same time as " + (folder_ / "0.5").string();
  for (const fs::path& output : {folder_ / "0.50", folder_ / "5e-1" / "", folder_ / "0.500" / "polyMesh" / ".."}) {
    test::expect_error(ErrorCode::invalid_argument, {output.c_str(), there.c_str()},
                       [&] { check_openfoam_output(folder_, output); });
  }
  for (const char* output : {"0.5", "0.51", "5", "0.5.orig", "fine"}) {
    EXPECT_NO_THROW(check_openfoam_output(folder_, folder_ / output)) << output;
  }
  EXPECT_NO_THROW(check_openfoam_output(folder_, folder_.parent_path() / "elsewhere" / "0.50"));
}

TEST_F(OpenFoamFolder, SaysWhatIsMissing) {
  fs::remove(folder_ / "constant" / "polyMesh" / "faces.gz");
  test::expect_error(ErrorCode::not_found, {"cannot open", "faces"}, [&] { read_mesh_file(folder_); });
  fs::remove(folder_ / "constant" / "polyMesh" / "points.gz");
  test::expect_error(ErrorCode::invalid_argument, {folder_.c_str(), "without an OpenFOAM mesh", "constant/polyMesh/points"},
                     [&] { read_mesh_file(folder_); });
  for (const char* name : {"0.07", "0.07/fluid", "processor0"}) {
    test::expect_error(ErrorCode::not_found, {"cannot open", name, "no such file or folder"},
                       [&] { read_mesh_file(folder_ / name); });
  }
}

/// Two other cubes: the same cells, but with one more point in every face.
void write_other_topology(const fs::path& mesh) {
  fs::create_directories(mesh);
  const FoamFiles files = ascii_files();
  write_file(mesh / "points", header("vectorField") + "14\n(" + std::string(points_text.begin() + 4, points_text.end() - 2) +
                                  "(0 0 5) (0 0 6))\n");
  std::string faces = std::to_string(faces_list.size()) + "\n(\n";
  for (std::size_t f = 0; f < faces_list.size(); ++f) {
    auto face = faces_list[f];
    if (f > 8) face.push_back(f == 9 ? 12 : 13);
    faces += joined(face) + "\n";
  }
  write_file(mesh / "faces", header("faceList") + faces + ")\n");
  write_file(mesh / "owner", files.owner.bytes);
  write_file(mesh / "neighbour", files.neighbour.bytes);
  write_file(mesh / "boundary", files.boundary.bytes);
}

// As OpenFOAM's Time::findInstance(): each file in the last time up to the one that is read.
TEST_F(OpenFoamFolder, TimesHaveTheTopologyOfTheLastOneBefore) {
  write_other_topology(folder_ / "0.2" / "polyMesh");
  const auto other = read_mesh_file(folder_ / "0.2");
  ASSERT_EQ(other->mesh()->point_count(), 14u);
  Points moved = other->mesh()->points;
  moved[3][1] += 0.01;
  write_mesh_file(*other, moved, folder_ / "0.5");
  write_mesh_file(*read_mesh_file(folder_), read_mesh_file(folder_)->mesh()->points, folder_ / "1e-1");
  for (const char* name : {"0.5", "0.5/", "0.5/polyMesh", "0.5/polyMesh/points"}) {
    const auto file = read_mesh_file(folder_ / name);
    EXPECT_EQ(file->mesh()->points, moved) << name;
    EXPECT_EQ(file->mesh()->cells->face(10).size(), 5u) << "the faces of 0.2";
  }
  EXPECT_EQ(read_mesh_file(folder_ / "1e-1")->mesh()->cells->face(10).size(), 4u) << "those of 0.2 are later";
  // Times without a mesh of their own.
  fs::create_directories(folder_ / "0.7");
  fs::create_directories(folder_ / "0.15");
  EXPECT_EQ(read_mesh_file(folder_ / "0.7")->mesh()->points, moved);
  EXPECT_EQ(read_mesh_file(folder_ / "0.15")->mesh()->point_count(), 12u);
  EXPECT_EQ(read_mesh_file(folder_)->mesh()->point_count(), 12u) << "a case is its mesh in constant";
}

TEST_F(OpenFoamFolder, RefusesPointsOfAnotherTopology) {
  write_other_topology(folder_ / "0.2" / "polyMesh");
  fs::create_directories(folder_ / "0.1" / "polyMesh");
  fs::copy_file(folder_ / "0.2" / "polyMesh" / "points", folder_ / "0.1" / "polyMesh" / "points");
  test::expect_error(ErrorCode::invalid_argument, {"0.1", "14 points", "constant", "12", "another mesh"},
                     [&] { read_mesh_file(folder_ / "0.1"); });
  fs::create_directories(folder_ / "0.3" / "polyMesh");
  write_file(folder_ / "0.3" / "polyMesh" / "points", header("vectorField") + points_text);
  test::expect_error(ErrorCode::invalid_argument, {"faces", "12", "0..12"}, [&] { read_mesh_file(folder_ / "0.3"); });
}

TEST_F(OpenFoamFolder, PointsAloneBorrowTheFacesOfAnotherMesh) {
  const auto file = read_mesh_file(folder_);
  Points moved = file->mesh()->points;
  for (Vec3& p : moved) p[1] -= 0.5;
  const fs::path alone = folder_ / "results" / "a";
  write_mesh_file(*file, moved, alone);
  test::expect_error(ErrorCode::not_found, {"faces", "--before", "link"}, [&] { read_mesh_file(alone); });
  ReadOptions borrowing;
  for (const char* lender : {"", "constant/polyMesh", "constant/polyMesh/points.gz"}) {
    borrowing.faces_of = folder_ / lender;
    const auto read = read_mesh_file(alone, borrowing);
    EXPECT_EQ(read->mesh()->points, moved) << lender;
    EXPECT_EQ(read->mesh()->cells->owner, file->mesh()->cells->owner);
    EXPECT_EQ(read->mesh()->groups.size(), file->mesh()->groups.size());
  }
  // Those of its own case come first.
  write_other_topology(folder_ / "other" / "constant" / "polyMesh");
  borrowing.faces_of = folder_ / "other";
  write_mesh_file(*file, moved, folder_ / "0.5");
  EXPECT_EQ(read_mesh_file(folder_ / "0.5", borrowing)->mesh()->cells->face(10).size(), 4u);
  // Faces of another mesh are noticed, and a lender that is none lends nothing.
  test::expect_error(ErrorCode::invalid_argument, {"other", "faces", "0..12"}, [&] { read_mesh_file(alone, borrowing); });
  borrowing.faces_of = folder_ / "missing.obj";
  test::expect_error(ErrorCode::not_found, {"faces"}, [&] { read_mesh_file(alone, borrowing); });
}

TEST_F(OpenFoamFolder, Regions) {
  write_other_topology(folder_ / "constant" / "solid" / "polyMesh");
  fs::create_directories(folder_ / "constant" / "fluid");
  fs::rename(folder_ / "constant" / "polyMesh", folder_ / "constant" / "fluid" / "polyMesh");
  const auto solid = read_mesh_file(folder_ / "constant" / "solid");
  EXPECT_EQ(solid->mesh()->point_count(), 14u);
  Points moved = solid->mesh()->points;
  moved[0][2] -= 0.5;
  write_mesh_file(*solid, moved, folder_ / "2" / "solid");
  EXPECT_EQ(read_mesh_file(folder_ / "2" / "solid")->mesh()->points, moved);
  fs::create_directories(folder_ / "2" / "fluid");
  EXPECT_EQ(read_mesh_file(folder_ / "2" / "fluid")->mesh()->point_count(), 12u);
  test::expect_error(ErrorCode::invalid_argument, {"several regions", "constant/fluid", "constant/solid"},
                     [&] { read_mesh_file(folder_); });
  // Results go where they are found again.
  const fs::path source = folder_ / "constant" / "solid";
  EXPECT_NO_THROW(check_output(source, folder_ / "3" / "solid"));
  EXPECT_NO_THROW(check_output(source, folder_ / "3" / "solid" / "polyMesh" / "points"));
  EXPECT_NO_THROW(check_output(source, fs::path(testing::TempDir()) / "elsewhere"));
  for (const char* output : {"3", "result"}) {
    test::expect_error(ErrorCode::invalid_argument, {output, "region solid", "1/solid"},
                       [&] { check_output(source, folder_ / output); });
  }
  test::expect_error(ErrorCode::invalid_argument, {"is an OpenFOAM case", "1/solid"}, [&] { check_output(source, folder_); });
}

TEST_F(OpenFoamFolder, CasesAreNoOutputs) {
  EXPECT_NO_THROW(check_output(folder_, folder_ / "0.1"));
  EXPECT_NO_THROW(check_output(folder_, folder_ / "constant" / "polyMesh" / "points"));
  EXPECT_NO_THROW(check_output(folder_, folder_ / "design_0001"));
  test::expect_error(ErrorCode::invalid_argument, {"1/fluid", "has no regions", "such as"},
                     [&] { check_output(folder_, folder_ / "1" / "fluid"); });
  const fs::path other = folder_ / "other";
  fs::create_directories(other / "constant");
  for (const fs::path& output : {folder_, folder_ / "", other}) {
    test::expect_error(ErrorCode::invalid_argument, {"is an OpenFOAM case", "time folder", "/1"},
                       [&] { check_output(folder_, output); });
  }
}

TEST_F(OpenFoamFolder, DecomposedCases) {
  fs::create_directories(folder_ / "whole" / "constant");
  for (const char* part : {"processor0", "processor1"}) {
    write_other_topology(folder_ / "whole" / part / "constant" / "polyMesh");
  }
  test::expect_error(ErrorCode::not_found, {"processor0/constant/polyMesh/pointProcAddressing", "reconstructParMesh"},
                     [&] { read_mesh_file(folder_ / "whole"); });
  const fs::path part = folder_ / "whole" / "processor1";
  EXPECT_EQ(read_mesh_file(part)->mesh()->point_count(), 14u);
  EXPECT_NO_THROW(check_output(part, part / "1"));
  EXPECT_NO_THROW(check_output(part, fs::path(testing::TempDir()) / "elsewhere"));
  for (const char* output : {"1", "result", "processor0/1"}) {
    test::expect_error(ErrorCode::invalid_argument, {output, "processor1", "part of a decomposed case", "processor1/1"},
                       [&] { check_output(part, folder_ / "whole" / output); });
  }
  // The whole case beside its parts.
  write_other_topology(folder_ / "whole" / "constant" / "polyMesh");
  EXPECT_NO_THROW(check_output(folder_ / "whole", folder_ / "whole" / "1"));
  test::expect_error(ErrorCode::invalid_argument, {"processor0/1", "the whole case", "whole/1"},
                     [&] { check_output(folder_ / "whole", folder_ / "whole" / "processor0" / "1"); });
}

// Before OpenFOAM 1.5 `neighbour` was as long as `owner`.
TEST(OpenFoam, OldNeighbours) {
  FoamFiles files = ascii_files();
  files.neighbour.bytes = header("labelList") + "11(1 -1 -1 -1 -1 -1 -1 -1 -1 -1 -1)";
  const auto mesh = parse_openfoam(files)->mesh();
  EXPECT_EQ(mesh->cells->internal_faces(), 1u);
  EXPECT_EQ(mesh->cells->cell_count, 2u);
  EXPECT_EQ(mesh->face_count(), 10u);
  for (const std::size_t label : {4u, 8u}) {
    for (const std::endian order : {std::endian::little, std::endian::big}) {
      FoamFiles binary = binary_files(mesh->points, label, 8, order);
      std::vector<std::uint64_t> entries(11, label == 8 ? ~std::uint64_t{0} : 0xffffffffu);
      entries[0] = 1;
      const std::string arch =
          std::string(order == std::endian::little ? "LSB" : "MSB") + ";label=" + std::to_string(8 * label) + ";scalar=64";
      binary.neighbour.bytes = header("labelList", "binary", arch) + packed(entries, label, order);
      EXPECT_EQ(parse_openfoam(binary)->mesh()->cells->neighbour, (std::vector<std::uint32_t>{1}));
    }
  }
  files.neighbour.bytes = "2(-1 1)";
  test::expect_error(ErrorCode::invalid_argument, {"neighbour", "face 0", "internal face 1"}, [&] { parse_openfoam(files); });
  files.neighbour.bytes = "2(1 -2)";
  test::expect_error(ErrorCode::invalid_argument, {"neighbour", "-1"}, [&] { parse_openfoam(files); });
  files.neighbour.bytes = "1(1)";
  files.owner.bytes = "11(0 0 1 0 1 0 1 0 1 0 -1)";
  test::expect_error(ErrorCode::invalid_argument, {"owner", "-1"}, [&] { parse_openfoam(files); });
}

}  // namespace
}  // namespace deform::io::openfoam_test
