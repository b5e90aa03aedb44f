// SPDX-License-Identifier: GPL-3.0-or-later
// NGON_n and NFACE_n of CGNS files made by libcgns, in the layouts of CGNS 3 and 4.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include "core/io/mesh_file.h"
#include "core/quality/polyhedral_quality.h"
#include "tests/core/io/cgns_writer.h"
#include "tests/support/expect_error.h"

namespace deform::io::cgns_polyhedra_test {
namespace {

using test::CgnsWriter;
using testing::ElementsAre;

const Group& group(const Mesh& mesh, const std::string& name) {
  const Group* found = mesh.find_group(name);
  if (found == nullptr) throw Error(ErrorCode::not_found, "no group " + name);
  return *found;
}

/// Two cubes side by side by their faces: 1 is the one between them, 2..6 belong to the left, 7..11 to the right.
struct Pair {
  Points points;
  CgnsWriter::Numbers offsets{0}, faces, cell_offsets{0, 6, 12}, cells;
};
Pair two_cubes() {
  Pair pair;
  for (int x = 0; x < 3; ++x) {
    for (const auto& [y, z] : std::initializer_list<std::pair<double, double>>{{0, 0}, {1, 0}, {1, 1}, {0, 1}}) {
      pair.points.push_back({static_cast<double>(x), y, z});
    }
  }
  const auto add = [&](std::initializer_list<cgsize_t> corners) {
    pair.faces.insert(pair.faces.end(), corners);
    pair.offsets.push_back(static_cast<cgsize_t>(pair.faces.size()));
  };
  add({5, 6, 7, 8});  // its normal points to the right
  for (const cgsize_t left : {0, 4}) {
    const cgsize_t end = left == 0 ? 0 : 8;
    if (left == 0) add({end + 1, end + 4, end + 3, end + 2});
    if (left == 4) add({end + 1, end + 2, end + 3, end + 4});
    for (cgsize_t k = 0; k < 4; ++k) {
      const cgsize_t next = (k + 1) % 4;
      add({left + k + 1, left + 4 + k + 1, left + 4 + next + 1, left + next + 1});  // inward
    }
  }
  pair.cells = {1, 2, -3, -4, -5, -6, -1, 7, -8, -9, -10, -11};
  return pair;
}

void expect_two_cubes(const MeshFile& file) {
  ASSERT_NE(file.cells(), nullptr);
  EXPECT_EQ(file.elements(), nullptr);
  EXPECT_EQ(file.cells()->cell_count, 2u);
  EXPECT_EQ(file.cells()->internal_faces(), 1u);
  EXPECT_EQ(file.mesh()->face_count(), 10u);
  const PolyhedralQuality q = polyhedral_quality(file.mesh()->points, *file.cells());
  EXPECT_NEAR(q.total_volume, 2, 1e-14);
  EXPECT_NEAR(q.least_volume.value, 1, 1e-14);
  EXPECT_EQ(q.wrong_pyramids, 0u);
  EXPECT_EQ(q.failed_checks(), 0u);
}

TEST(CgnsPolyhedra, CellsThatNameTheirFaces) {
  const Pair pair = two_cubes();
  CgnsWriter writer(CG_FILE_HDF5);
  const int zone = writer.unstructured("z", pair.points, 2);
  writer.lists(zone, "faces", NGON_n, pair.offsets, pair.faces);
  writer.lists(zone, "cells", NFACE_n, pair.cell_offsets, pair.cells);
  writer.condition(zone, "left", PointList, {2}, 1, FaceCenter);
  writer.condition(zone, "middle", PointRange, {1, 1}, 2, FaceCenter);
  const std::string bytes = writer.bytes();
  const auto file = parse_mesh(bytes, "a.cgns");
  expect_two_cubes(*file);
  EXPECT_THAT(group(*file->mesh(), "left").faces, ElementsAre(0));
  EXPECT_THAT(group(*file->mesh(), "middle").points, ElementsAre(4, 5, 6, 7));
  EXPECT_EQ(file->mesh()->find_group("faces"), nullptr);
  Points moved = pair.points;
  moved[4][0] = 1.25;
  const auto back = parse_mesh(file->with_points(moved), "a.cgns");
  EXPECT_EQ(back->mesh()->points, moved);
  EXPECT_EQ(back->cells()->face_points, file->cells()->face_points);

  // CGNS 3: lengths within the lists.
  const auto inlined = [](const CgnsWriter::Numbers& offsets, const CgnsWriter::Numbers& entries) {
    CgnsWriter::Numbers result;
    for (std::size_t i = 0; i + 1 < offsets.size(); ++i) {
      result.push_back(offsets[i + 1] - offsets[i]);
      result.insert(result.end(), entries.begin() + offsets[i], entries.begin() + offsets[i + 1]);
    }
    return result;
  };
  std::string old = bytes;
  for (const char* section : {"/Base/z/faces", "/Base/z/cells"}) old = test::without(old, section, "ElementStartOffset");
  old = test::with_numbers(old, "/Base/z/faces/ElementConnectivity", inlined(pair.offsets, pair.faces));
  old = test::with_numbers(old, "/Base/z/cells/ElementConnectivity", inlined(pair.cell_offsets, pair.cells));
  expect_two_cubes(*parse_mesh(old, "a.cgns"));

  // All signs positive, as some programs write: the face between is turned by where the cells lie, the others stay as they are.
  CgnsWriter::Numbers unsigned_cells = pair.cells;
  unsigned_cells[6] = 1;
  expect_two_cubes(*parse_mesh(test::with_numbers(bytes, "/Base/z/cells/ElementConnectivity", unsigned_cells), "a.cgns"));
}

// A triangle between two cells that both name it without a sign, whichever of them it faces.
TEST(CgnsPolyhedra, TrianglesBetweenCellsAreTurnedByWhereTheCellsLie) {
  for (const bool turned : {false, true}) {
    for (const bool left_first : {false, true}) {
      SCOPED_TRACE(testing::Message() << turned << left_first);
      CgnsWriter::Numbers faces{1, 2, 3, /* left */ 2, 1, 4, 3, 2, 4, 1, 3, 4, /* right */ 3, 1, 5, 2, 3, 5, 1, 2, 5};
      if (turned) std::swap(faces[1], faces[2]);
      CgnsWriter writer(CG_FILE_HDF5);
      const int zone = writer.unstructured("z", {{0, 0, 0}, {0, 1, 0}, {0, 0, 1}, {-1, 0, 0}, {1, 0, 0}}, 2);
      writer.lists(zone, "faces", NGON_n, {0, 3, 6, 9, 12, 15, 18, 21}, faces);
      writer.lists(zone, "cells", NFACE_n, {0, 4, 8},
                   left_first ? CgnsWriter::Numbers{1, 2, 3, 4, 1, 5, 6, 7} : CgnsWriter::Numbers{1, 5, 6, 7, 1, 2, 3, 4});
      const auto file = parse_mesh(writer.bytes(), "a.cgns");
      const PolyhedralQuality q = polyhedral_quality(file->mesh()->points, *file->cells());
      EXPECT_NEAR(q.least_volume.value, 1.0 / 6, 1e-15);
      EXPECT_NEAR(q.largest_volume.value, 1.0 / 6, 1e-15);
      EXPECT_EQ(q.wrong_pyramids, 0u);
    }
  }
}

TEST(CgnsPolyhedra, FacesThatNameTheirCells) {
  const Pair pair = two_cubes();
  CgnsWriter writer(CG_FILE_HDF5);
  const int zone = writer.unstructured("z", pair.points, 2);
  const int section = writer.lists(zone, "faces", NGON_n, pair.offsets, pair.faces);
  // First the cell that a normal leaves, then the one that it enters; then two columns of the sides within the cell.
  writer.parents(zone, section, {100, 100, 0, 0, 0, 0, 200, 0, 0, 0, 0, 200, 0, 100, 100, 100, 100, 0, 200, 200, 200, 200,
                                 0,   0,   0, 0, 0, 0, 0,   0, 0, 0, 0, 0,   0, 0,   0,   0,   0,   0, 0,   0,   0,   0});
  const std::string bytes = writer.bytes();
  expect_two_cubes(*parse_mesh(bytes, "a.cgns"));
  const auto surface = parse_mesh(test::without(bytes, "/Base/z/faces", "ParentElements"), "a.cgns");
  EXPECT_EQ(surface->cells(), nullptr);
  EXPECT_EQ(surface->mesh()->face_count(), 11u);
  EXPECT_EQ(group(*surface->mesh(), "faces").faces.size(), 11u);
}

TEST(CgnsPolyhedra, RefusesWhatIsWrong) {
  const Pair pair = two_cubes();
  CgnsWriter writer(CG_FILE_HDF5);
  const int zone = writer.unstructured("z", pair.points, 2);
  writer.lists(zone, "faces", NGON_n, pair.offsets, pair.faces);
  writer.lists(zone, "cells", NFACE_n, pair.cell_offsets, pair.cells);
  const std::string polyhedra = writer.bytes();
  CgnsWriter both(CG_FILE_HDF5);
  const int beside = both.unstructured("z", pair.points, 2);
  both.lists(beside, "faces", NGON_n, pair.offsets, pair.faces);
  both.lists(beside, "cells", NFACE_n, pair.cell_offsets, pair.cells);
  both.section(beside, "hexa", HEXA_8, 1, {1, 2, 3, 4, 5, 6, 7, 8});
  const std::string cells = "/Base/z/cells/ElementConnectivity";
  const std::pair<std::string, std::vector<const char*>> table[] = {
      {test::with_numbers(polyhedra, cells, {1, 2, -3, -4, -5, -6, -1, 7, -8, -9, -10, -77}), {"cells", "face -77"}},
      {test::with_numbers(polyhedra, cells, {1, 2, -3, -4, -5, -6, -1, 1, -8, -9, -10, -11}), {"face 0", "more than 2 cells"}},
      {test::with_numbers(polyhedra, cells, {1, 2, -3, -4, -5, -6, -1, 7, -8, -9, -10}),
       {"ElementStartOffset", "2 elements", "to 11"}},
      {test::with_numbers(polyhedra, "/Base/z/faces/ElementStartOffset", {0, 4, 8, 12, 16, 20, 24, 28, 32, 36, 40, 45}),
       {"ElementStartOffset", "11 elements", "44"}},
      {test::with_numbers(polyhedra, "/Base/z/faces/ElementStartOffset", {0, 4, 4, 12, 16, 20, 24, 28, 32, 36, 40, 44}),
       {"faces", "element 2 claims 0 entries", "has 40 left"}},
      {test::without(polyhedra, "/Base/z/faces", "ElementStartOffset"), {"faces", "the connectivity ends within element"}},
      {both.bytes(), {"polyhedra", "beside elements"}},
  };
  for (const auto& [input, message] : table) {
    SCOPED_TRACE(message.back());
    test::expect_error(ErrorCode::invalid_argument, message, [&, &input = input] { parse_mesh(input, "a.cgns"); });
  }
}

}  // namespace
}  // namespace deform::io::cgns_polyhedra_test
