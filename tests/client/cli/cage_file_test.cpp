// SPDX-License-Identifier: GPL-3.0-or-later
// Cages of setup files: their points and faces come from mesh files.
#include "client/cli/setup/reading.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "client/cli/setup/control_lattice.h"
#include "core/io/mesh_file.h"
#include "core/mesh/cages/cage_around.h"
#include "core/mesh/mesh.h"
#include "tests/support/expect_error.h"

namespace deform::cli::cage_file_test {
namespace {

using test::expect_error;

class CageFile : public testing::Test {
 protected:
  CageFile() { std::filesystem::create_directory(folder_); }
  ~CageFile() override { std::filesystem::remove_all(folder_); }

  void write(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }
  v1::Setup read(const std::string& cage) const {
    write("setup.yaml",
          "geometry: 0123456789abcdef\nmethod: {cage: " + cage + "}\nhandles: [{name: a, region: {control: {ids: [3, 0]}}}]\n");
    return read_setup_file(folder_ / "setup.yaml").setup;
  }

  const std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() / ("deform_cage_file_" + std::to_string(::getpid()));
};

constexpr const char* tetrahedron = "v 0 0 0\nv 4 0 0\nv 0 4 0\nv 0 0 4.5\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

constexpr const char* octahedron =
    "v 1 0 0\nv -1 0 0\nv 0 2 0\nv 0 -2 0\nv 0 0 1.5\nv 0 0 -1.5\n"
    "f 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\nf 3 1 6\nf 2 3 6\nf 4 2 6\nf 1 4 6\n";

TEST_F(CageFile, IsPutIntoTheSetup) {
  write("cage.obj", tetrahedron);
  const v1::Setup setup = read("{file: cage.obj, basis: BASIS_NEVER}");
  const v1::CageMethod& cage = setup.method().cage();
  EXPECT_EQ(cage.file(), "");
  EXPECT_THAT(cage.vertices(), testing::ElementsAre(0, 0, 0, 4, 0, 0, 0, 4, 0, 0, 0, 4.5));
  EXPECT_THAT(cage.triangles(), testing::ElementsAre(0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3));
  EXPECT_EQ(cage.basis(), v1::BASIS_NEVER);

  EXPECT_TRUE(selects_controls(setup));
  EXPECT_EQ(control_places(setup, Mesh()), (std::vector<Vec3>{{0, 0, 0}, {4, 0, 0}, {0, 4, 0}, {0, 0, 4.5}}));
  EXPECT_EQ(control_points_of(setup.handles(0).region(), setup, Mesh(), "a"), (std::vector<PointId>{0, 3}));
}

/// A cage that a setup has made is that of `deform cage mesh`, and the same every time.
TEST_F(CageFile, IsMadeAroundTheMesh) {
  write("ball.obj", octahedron);
  const auto read_with = [&](const std::string& method, const std::string& rest = "") {
    write("ball.yaml",
          "geometry: ball.obj\nmethod: " + method + "\nhandles: [{name: a, region: {control: {ids: [3, 0]}}}]\n" + rest);
    return read_setup_file(folder_ / "ball.yaml").setup;
  };
  const auto expect_cage = [&](const v1::CageMethod& cage, CageKind kind, std::size_t points, double offset,
                               double symmetry_tolerance = 0) {
    CageRequest request;
    request.kind = kind;
    request.points = points;
    request.offset = offset;
    request.symmetry_tolerance = symmetry_tolerance;
    const CageAround expected = cage_around(*io::read_mesh_file(folder_ / "ball.obj")->mesh(), request);
    EXPECT_FALSE(cage.has_generate());
    ASSERT_EQ(static_cast<std::size_t>(cage.vertices_size()), 3 * expected.mesh.point_count());
    for (int i = 0; i < cage.vertices_size(); ++i) EXPECT_EQ(cage.vertices(i), expected.mesh.points[i / 3][i % 3]);
    EXPECT_THAT(cage.triangles(), testing::ElementsAreArray(expected.mesh.face_points));
  };
  // The octahedron is its own mirror image. Where handles select vertices by number that counts only if the file says so.
  const double usual = CageRequest::usual_symmetry_tolerance;
  expect_cage(read_with("{cage: {generate: {kind: WRAP, points: 100}, control: MESH}}").method().cage(), CageKind::wrap, 100, 0,
              usual);
  expect_cage(read_with("{cage: {generate: {points: 100, symmetry_tolerance: 0}, control: MESH}}").method().cage(),
              CageKind::wrap, 100, 0);
  expect_cage(read_with("{cage: {generate: {points: 100, symmetry_tolerance: 0.01}}}").method().cage(), CageKind::wrap, 100, 0,
              0.01);
  expect_cage(read_with("{cage: {generate: {kind: HULL, points: 80, offset: 0.25}}}").method().cage(), CageKind::hull, 80, 0.25);
  expect_cage(read_with("{cage: {generate: {kind: BOX, points: 26}}}").method().cage(), CageKind::box, 26, 0);
  expect_cage(read_with("{cage: {generate: {kind: BOX, points: 26}, control: MESH}}").method().cage(), CageKind::box, 26, 0,
              usual);
  expect_cage(read_with("{cage: {generate: {kind: BOX, points: 26, symmetry_tolerance: 0.01}}}").method().cage(), CageKind::box,
              26, 0, 0.01);
  const v1::Setup defaults = read_with("{cage: {generate: {}}}");
  expect_cage(defaults.method().cage(), CageKind::wrap, 400, 0);
  EXPECT_EQ(read_with("{cage: {generate: {}}}").SerializeAsString(), defaults.SerializeAsString());
  EXPECT_EQ(read_with("{cage: {generate: {}}}").method().cage().control(), v1::FFD_CONTROL_DEFAULT);
  // The cage of a further method.
  const v1::Setup two =
      read_with("{rbf: {}}",
                "then: [{method: {cage: {generate: {kind: BOX, points: 8}}}, handles: [{name: b, region: {control: "
                "{ids: [1]}}}]}]\n");
  expect_cage(two.then(0).method().cage(), CageKind::box, 8, 0);

  const auto refused = [&](const std::string& method, const std::vector<const char*>& parts) {
    expect_error(ErrorCode::invalid_argument, parts, [&] { read_with(method); });
  };
  refused("{cage: {generate: {points: 7}}}", {"ball.yaml: method.cage.generate: ", "8", "10000"});
  refused("{cage: {generate: {symmetry_tolerance: 0.2}}}", {"method.cage.generate: symmetry_tolerance", "0 to 0.1"});
  refused("{cage: {generate: {}, file: ball.obj}}", {"method.cage.file: generate is given as well"});
  refused("{cage: {generate: {}, vertices: [0, 0, 0]}}", {"method.cage.generate: vertices and triangles are given as well"});
  refused("{cage: {}}", {"method.cage.file: missing", "generate"});
  expect_error(ErrorCode::invalid_argument, {"method.cage.generate: the cage is made around the mesh", "deform cage mesh"},
               [&] { read("{generate: {}}"); });
}

// Cages of the half of a ball with y >= 0: with MESH around the images, too; with CONTROLS a box that ends in the plane, or a
// cage that is its own mirror image.
TEST_F(CageFile, IsMadeForHalfModels) {
  write("half.obj",
        "v 1 0 0\nv -1 0 0\nv 0 2 0\nv 0 0 1.5\nv 0 0 -1.5\nf 1 3 4\nf 3 2 4\nf 3 1 5\nf 2 3 5\ng cut\nf 1 4 2\nf 1 2 5\n");
  const auto read_with = [&](const std::string& cage, const std::string& plane) {
    write("half.yaml", "geometry: half.obj\nmethod: {cage: " + cage + "}\nsymmetry: [{" + plane +
                           "}]\nhandles: [{name: a, region: {control: {ids: [3, 0]}}}]\n");
    return read_setup_file(folder_ / "half.yaml").setup;
  };
  const auto box_of = [](const v1::Setup& setup) {
    Box box;
    const auto& at = setup.method().cage().vertices();
    for (int i = 0; i < at.size(); i += 3) box.add({at[i], at[i + 1], at[i + 2]});
    return box;
  };
  const std::string given = "point: [0.3, 0, 1], normal: [0, -2, 0]", region = "region: {group: cut}";
  for (const std::string& plane : {given, region}) {
    for (const CageKind kind : {CageKind::hull, CageKind::wrap}) {
      CageRequest request;
      request.kind = kind;
      request.points = 98;
      request.planes = {{{0, 0, 0}, {0, 1, 0}}};
      const CageAround expected = cage_around(*io::read_mesh_file(folder_ / "half.obj")->mesh(), request);
      const std::string name = kind == CageKind::hull ? "HULL" : "WRAP";
      const auto cage = read_with("{generate: {kind: " + name + ", points: 98}, control: MESH}", plane).method().cage();
      EXPECT_THAT(cage.triangles(), testing::ElementsAreArray(expected.mesh.face_points)) << "its own mirror image";
    }
    for (const char* kind : {"BOX", "HULL", "WRAP"}) {
      const Box box = box_of(read_with(std::string("{generate: {kind: ") + kind + ", points: 98}, control: MESH}", plane));
      EXPECT_LT(box.min[1], -2) << kind;
      EXPECT_GT(box.max[1], 2) << kind;
    }
    const Box box = box_of(read_with("{generate: {kind: BOX, points: 26, offset: 0.25}}", plane));
    EXPECT_EQ(box.min, (Vec3{-1.25, 0, -1.75}));
    EXPECT_EQ(box.max, (Vec3{1.25, 2.25, 1.75}));
  }
  for (const std::string& plane : {given, region}) {
    for (const CageKind kind : {CageKind::hull, CageKind::wrap}) {
      CageRequest request;
      request.kind = kind;
      request.points = 120;
      request.planes = {{{0, 0, 0}, {0, 1, 0}}};
      const CageAround expected = cage_around(*io::read_mesh_file(folder_ / "half.obj")->mesh(), request);
      const std::string name = kind == CageKind::hull ? "HULL" : "WRAP";
      const auto cage = read_with("{generate: {kind: " + name + ", points: 120}, coordinates: GREEN}", plane).method().cage();
      ASSERT_EQ(static_cast<std::size_t>(cage.vertices_size()), 3 * expected.mesh.point_count());
      for (int i = 0; i < cage.vertices_size(); ++i) EXPECT_EQ(cage.vertices(i), expected.mesh.points[i / 3][i % 3]);
    }
  }
  const auto refused = [&](const std::string& cage, const std::string& plane, const std::vector<const char*>& parts) {
    expect_error(ErrorCode::invalid_argument, parts, [&] { read_with(cage, plane); });
  };
  refused("{generate: {kind: BOX}}", "point: [0, 0, 0], normal: [0.1, 1, 0]",
          {"half.yaml: method.cage.generate: ", "symmetry[0]", "perpendicular to an axis", "kind WRAP or HULL"});
  refused("{generate: {kind: BOX}}", "region: {ids: [0, 2, 3]}", {"symmetry[0]", "`point` and `normal`"});
}

TEST_F(CageFile, EveryFormatGivesTheSameTriangles) {
  write("cage.off", "OFF\n4 4 0\n0 0 0\n4 0 0\n0 4 0\n0 0 4.5\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n");
  EXPECT_EQ(read("{file: cage.off}").method().cage().triangles_size(), 12);
  const auto facet = [](const char* a, const char* b, const char* c) {
    return std::string("facet normal 0 0 0\nouter loop\nvertex ") + a + "\nvertex " + b + "\nvertex " + c +
           "\nendloop\nendfacet\n";
  };
  const char *o = "0 0 0", *x = "4 0 0", *y = "0 4 0", *z = "0 0 4.5";
  write("cage.stl", "solid cage\n" + facet(o, y, x) + facet(o, x, z) + facet(o, z, y) + facet(x, y, z) + "endsolid cage\n");
  EXPECT_EQ(read("{file: cage.stl}").method().cage().vertices_size(), 12) << "corners at one place are one vertex";
}

TEST_F(CageFile, SaysWhatIsWrong) {
  write("cage.obj", tetrahedron);
  write("quads.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 2 3 4\n");
  expect_error(ErrorCode::not_found, {"setup.yaml: method.cage.file", "none.obj"}, [&] { read("{file: none.obj}"); });
  expect_error(ErrorCode::invalid_argument, {"setup.yaml: method.cage.file: missing", "deform cage mesh"}, [&] { read("{}"); });
  expect_error(ErrorCode::invalid_argument, {"method.cage.file", "quads.obj", "face 1 has 4 corners"},
               [&] { read("{file: quads.obj}"); });
  expect_error(ErrorCode::invalid_argument, {"method.cage.file", "as well"},
               [&] { read("{file: cage.obj, vertices: [0, 0, 0]}"); });
  std::string many;
  for (int i = 0; i < 10001; ++i) many += "v " + std::to_string(i) + " 0 0\n";
  write("many.obj", many + "f 1 2 3\n");
  expect_error(ErrorCode::invalid_argument, {"many.obj", "has 10001 points", "10000"}, [&] { read("{file: many.obj}"); });
}

}  // namespace
}  // namespace deform::cli::cage_file_test
