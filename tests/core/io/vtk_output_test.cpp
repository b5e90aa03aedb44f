// SPDX-License-Identifier: GPL-3.0-or-later
// Files for ParaView: their structure here, what VTK makes of them in read_vtk.py where it is installed.
#include "core/io/vtk_output.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <numeric>

#include "core/io/binary/byte_order.h"
#include "core/io/mesh_file.h"
#include "tests/support/expect_error.h"

namespace deform::io::vtk_output_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;

/// One element of a type, sheared so that no two directions are alike: affine, mid nodes amid.
struct OneElement {
  Points points;
  Elements elements;
};
OneElement one(ElementType type) {
  const ElementShape& form = shape(type);
  Points corners;
  switch (form.corners) {
    case 4:
      corners = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
      break;
    case 5:
      corners = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.5, 0.5, 1}};
      break;
    case 6:
      corners = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}};
      break;
    default:
      corners = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
  }
  for (Vec3& p : corners) p = {2 * p[0] + 0.3 * p[1], 3 * p[1] + 0.2 * p[2], 5 * p[2] + 0.1 * p[0]};
  OneElement result;
  result.points = corners;
  const auto add_mean = [&](const std::vector<std::uint8_t>& of) {
    Vec3 sum{};
    for (const auto node : of) {
      for (int k = 0; k < 3; ++k) sum[k] += corners[node][k] / static_cast<double>(of.size());
    }
    result.points.push_back(sum);
  };
  if (form.quadratic()) {
    for (const auto& edge : form.edges) add_mean({edge[0], edge[1]});
    result.points.resize(form.nodes);
    for (std::size_t f = 0; f < form.faces.size(); ++f) {
      const std::uint8_t centre = form.face_centre(f);
      if (centre == ElementShape::no_node) continue;
      std::vector<std::uint8_t> around;
      for (std::size_t c = 0; c < form.faces[f].size(); c += 2) around.push_back(form.faces[f][c]);
      add_mean(around);
      result.points[centre] = result.points.back();
      result.points.pop_back();
    }
    if (type == ElementType::hexahedron27) {
      add_mean({0, 1, 2, 3, 4, 5, 6, 7});
      result.points[26] = result.points.back();
      result.points.pop_back();
    }
  }
  std::vector<PointId> nodes(form.nodes);
  std::iota(nodes.begin(), nodes.end(), 0u);
  result.elements.add(type, nodes);
  return result;
}

/// Two cubes side by side; the face between them first.
struct TwoCells {
  Points points;
  PolyhedralCells cells;
};
TwoCells two_cells() {
  TwoCells two;
  for (int k = 0; k < 2; ++k) {
    for (int j = 0; j < 2; ++j) {
      for (int i = 0; i < 3; ++i) two.points.push_back({double(i), double(j), double(k)});
    }
  }
  const auto add = [&](std::uint32_t owner, std::initializer_list<PointId> corners) {
    two.cells.face_points.insert(two.cells.face_points.end(), corners);
    two.cells.face_offsets.push_back(two.cells.face_points.size());
    two.cells.owner.push_back(owner);
  };
  add(0, {1, 4, 10, 7});
  two.cells.neighbour = {1};
  for (const PointId c : {0u, 1u}) {
    add(c, {c, c + 3, c + 4, c + 1});
    add(c, {c + 6, c + 7, c + 10, c + 9});
    add(c, {c, c + 1, c + 7, c + 6});
    add(c, {c + 3, c + 9, c + 10, c + 4});
  }
  add(0, {0, 6, 9, 3});
  add(1, {2, 5, 11, 8});
  two.cells.cell_count = 2;
  return two;
}

/// The appended values of an array, as VTK finds them: by its offset.
template <typename T>
std::vector<T> array_of(const std::string& bytes, const std::string& name) {
  const std::size_t at = bytes.find("Name=\"" + name + "\""), offset_at = bytes.find("offset=\"", at) + 8;
  const std::size_t data = bytes.find("<AppendedData encoding=\"raw\">\n_") + 31;
  if (at == std::string::npos || data < 31) throw std::runtime_error("no array " + name);
  const char* place = bytes.data() + data + std::stoull(bytes.substr(offset_at));
  const auto size = load_scalar<std::uint64_t>(place, std::endian::little);
  std::vector<T> values(size / sizeof(T));
  for (std::size_t i = 0; i < values.size(); ++i) {
    if constexpr (sizeof(T) == 8) {
      values[i] = std::bit_cast<T>(load_scalar<std::uint64_t>(place + 8 + 8 * i, std::endian::little));
    } else if constexpr (sizeof(T) == 4) {
      values[i] = std::bit_cast<T>(load_scalar<std::uint32_t>(place + 8 + 4 * i, std::endian::little));
    } else {
      values[i] = static_cast<T>(place[8 + i]);
    }
  }
  return values;
}

TEST(VtkOutput, LinearElements) {
  const OneElement prism = one(ElementType::prism);
  const std::string bytes = vtu_bytes(prism.points, prism.elements, {{}, {{"q <1>", 1, {0.25}}}}, "x.vtu");
  EXPECT_TRUE(
      bytes.starts_with("<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" "
                        "byte_order=\"LittleEndian\" header_type=\"UInt64\">"));
  EXPECT_NE(bytes.find("NumberOfPoints=\"6\" NumberOfCells=\"1\""), std::string::npos);
  EXPECT_THAT(array_of<std::int64_t>(bytes, "connectivity"), ElementsAre(0, 2, 1, 3, 5, 4)) << "VTK's base looks outward";
  EXPECT_THAT(array_of<std::int64_t>(bytes, "offsets"), ElementsAre(6));
  EXPECT_THAT(array_of<char>(bytes, "types"), ElementsAre(13));
  EXPECT_THAT(array_of<double>(bytes, "q &lt;1&gt;"), ElementsAre(0.25));
  const auto points = array_of<double>(bytes, "Points");
  ASSERT_EQ(points.size(), 18u);
  EXPECT_EQ(points[16], prism.points[5][1]);
}

// Mid nodes stand behind the corners, each amid the corners that VTK's documentation names for it.
TEST(VtkOutput, QuadraticElements) {
  using Ends = std::vector<std::pair<std::size_t, std::size_t>>;
  const std::pair<ElementType, Ends> cases[] = {
      {ElementType::tetrahedron10, {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}}},
      {ElementType::pyramid13, {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {0, 4}, {1, 4}, {2, 4}, {3, 4}}},
      {ElementType::pyramid14, {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {0, 4}, {1, 4}, {2, 4}, {3, 4}}},
      {ElementType::prism15, {{0, 1}, {1, 2}, {2, 0}, {3, 4}, {4, 5}, {5, 3}, {0, 3}, {1, 4}, {2, 5}}},
      {ElementType::prism18, {{0, 1}, {1, 2}, {2, 0}, {3, 4}, {4, 5}, {5, 3}, {0, 3}, {1, 4}, {2, 5}, {0, 4}, {1, 5}, {2, 3}}},
      {ElementType::hexahedron20,
       {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {4, 5}, {5, 6}, {6, 7}, {7, 4}, {0, 4}, {1, 5}, {2, 6}, {3, 7}}},
      {ElementType::hexahedron27,
       {{0, 1},
        {1, 2},
        {2, 3},
        {3, 0},
        {4, 5},
        {5, 6},
        {6, 7},
        {7, 4},
        {0, 4},
        {1, 5},
        {2, 6},
        {3, 7},
        {0, 7},
        {1, 6},
        {0, 5},
        {3, 6},
        {0, 2},
        {4, 6},
        {0, 6}}}};
  for (const auto& [type, ends] : cases) {
    SCOPED_TRACE(shape(type).name);
    const OneElement element = one(type);
    const auto nodes = array_of<std::int64_t>(vtu_bytes(element.points, element.elements, {}, "x.vtu"), "connectivity");
    const std::size_t corners = shape(type).corners;
    ASSERT_EQ(nodes.size(), corners + ends.size());
    for (std::size_t i = 0; i < ends.size(); ++i) {
      const Vec3 &a = element.points[static_cast<std::size_t>(nodes[ends[i].first])],
                 &b = element.points[static_cast<std::size_t>(nodes[ends[i].second])],
                 &mid = element.points[static_cast<std::size_t>(nodes[corners + i])];
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(mid[k], (a[k] + b[k]) / 2, 1e-14) << "node " << corners + i;
    }
  }
}

TEST(VtkOutput, Polyhedra) {
  const TwoCells two = two_cells();
  const std::string bytes = vtu_bytes(two.points, two.cells, {}, "x.vtu");
  EXPECT_THAT(array_of<char>(bytes, "types"), ElementsAre(42, 42));
  EXPECT_THAT(array_of<std::int64_t>(bytes, "offsets"), ElementsAre(8, 16));
  const auto faces = array_of<std::int64_t>(bytes, "faces");
  EXPECT_THAT(array_of<std::int64_t>(bytes, "faceoffsets"), ElementsAre(31, 62));
  EXPECT_EQ(std::vector<std::int64_t>(faces.begin(), faces.begin() + 6), (std::vector<std::int64_t>{6, 4, 1, 4, 10, 7}));
  EXPECT_EQ(std::vector<std::int64_t>(faces.begin() + 31, faces.begin() + 37), (std::vector<std::int64_t>{6, 4, 7, 10, 4, 1}))
      << "seen from the neighbour the face turns round";
}

Mesh surface() {
  Mesh mesh;
  mesh.points = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.5, 2, 0}};
  mesh.face_sizes = {3, 2, 4, 1, 5};
  mesh.face_points = {0, 1, 2, 0, 1, 0, 1, 2, 3, 4, 0, 1, 2, 4, 3};
  return mesh;
}

TEST(VtkOutput, SurfacesKeepTheirOrderUnlessFacesAreNone) {
  Mesh mesh = surface();
  const VtkArrays arrays{{{"curvature", 1, {1, 2, 3, 4, 5}}}, {{"quality", 1, {0, 1, 2, 3, 4}}}};
  const std::string mixed = vtp_bytes(mesh, arrays, "x.vtp");
  EXPECT_THAT(array_of<std::int64_t>(mixed, "face"), ElementsAre(3, 1, 0, 2, 4));
  EXPECT_THAT(array_of<double>(mixed, "quality"), ElementsAre(3, 1, 0, 2, 4));
  mesh.face_sizes = {3, 4, 5};
  mesh.face_points = {0, 1, 2, 0, 1, 2, 3, 0, 1, 2, 4, 3};
  const std::string plain = vtp_bytes(mesh, {arrays.points, {{"quality", 1, {7, 8, 9}}}}, "x.vtp");
  EXPECT_EQ(plain.find("Name=\"face\""), std::string::npos);
  EXPECT_THAT(array_of<double>(plain, "quality"), ElementsAre(7, 8, 9));
  EXPECT_THAT(array_of<double>(plain, "curvature"), ElementsAre(1, 2, 3, 4, 5));
}

TEST(VtkOutput, IntegersStayIntegersAndTextsAreFieldData) {
  using Type = VtkArray::Type;
  VtkArrays arrays;
  arrays.points.push_back({"region", 1, {0, -1, 2, 3, 100000}, Type::int32});
  arrays.points.push_back({"colour", 3, std::vector<double>(15, 255), Type::uint8});
  arrays.texts.push_back({"names", {"free", "", "Tür"}});
  const std::string bytes = vtp_bytes(surface(), arrays, "x.vtp");
  EXPECT_NE(bytes.find("type=\"Int32\" Name=\"region\""), std::string::npos);
  EXPECT_NE(bytes.find("type=\"UInt8\" Name=\"colour\" NumberOfComponents=\"3\""), std::string::npos);
  EXPECT_THAT(array_of<std::int32_t>(bytes, "region"), ElementsAre(0, -1, 2, 3, 100000));
  EXPECT_EQ(array_of<std::uint8_t>(bytes, "colour"), std::vector<std::uint8_t>(15, 255));
  EXPECT_NE(bytes.find("<FieldData>\n<DataArray type=\"String\" Name=\"names\" NumberOfTuples=\"3\" format=\"ascii\">\n"
                       "102 114 101 101 0\n0\n84 195 188 114 0\n</DataArray>\n</FieldData>\n<Piece "),
            std::string::npos);
  EXPECT_EQ(parse_mesh(bytes, "x.vtp")->mesh()->points, surface().points) << "our own reader passes over them";
  // An integer array of cells names groups when the file is read back.
  const std::string labelled = vtp_bytes(surface(), {{}, {{"part", 1, {4, 4, 5, 5, 5}, Type::int32}}}, "x.vtp");
  EXPECT_NE(parse_mesh(labelled, "x.vtp")->mesh()->find_group("part_5"), nullptr);
}

TEST(VtkOutput, Refuses) {
  const OneElement tetrahedron = one(ElementType::tetrahedron);
  const auto expect = [](std::vector<const char*> parts, const auto& action) {
    test::expect_error(ErrorCode::invalid_argument, parts, action);
  };
  expect({"out.vtp", ".vtu"}, [&] { write_vtu(tetrahedron.points, tetrahedron.elements, {}, "out.vtp"); });
  expect({"out.vtu", ".vtp"}, [&] { write_vtp(surface(), {}, "out.vtu"); });
  expect({"x.vtu", "\"q\"", "2 values", "1 elements"}, [&] {
    vtu_bytes(tetrahedron.points, tetrahedron.elements, {{}, {{"q", 1, {1, 2}}}}, "x.vtu");
  });
  expect({"x.vtu", "\"d\"", "3 for each of the 4 points"}, [&] {
    vtu_bytes(tetrahedron.points, tetrahedron.elements, {{{"d", 3, {1, 2}}}, {}}, "x.vtu");
  });
  Elements beyond = tetrahedron.elements;
  beyond.points[3] = 4;
  expect({"point 4", "there are 4"}, [&] { vtu_bytes(tetrahedron.points, beyond, {}, "x.vtu"); });
}

TEST(VtkOutput, VtkReadsIt) {
  const fs::path folder = fs::path(testing::TempDir()) / "deform_vtk_output";
  fs::remove_all(folder);
  fs::create_directories(folder);
  std::string table;
  for (std::size_t i = 0; i < element_types; ++i) {
    const auto type = static_cast<ElementType>(i);
    const ElementShape& form = shape(type);
    const OneElement element = one(type);
    const std::string name = std::string(form.name) + ".vtu";
    write_vtu(element.points, element.elements, {}, folder / name);
    // The determinant of the affine map times the volume of the reference element.
    const double volume = (2 * 3 * 5 + 0.3 * 0.2 * 0.1) * (form.corners == 4   ? 1.0 / 6
                                                           : form.corners == 5 ? 1.0 / 3
                                                           : form.corners == 6 ? 0.5
                                                                               : 1);
    const std::size_t nodes = type == ElementType::pyramid14 ? 13 : form.nodes;
    table += name + " " + std::to_string(volume) + " " + std::to_string(nodes) + "\n";
  }
  write_file(folder / "elements.txt", table);
  const TwoCells two = two_cells();
  VtkArray moved{"displacement", 3, {}};
  for (int i = 0; i < 36; ++i) moved.values.push_back(i);
  write_vtu(two.points, two.cells, {{moved}, {{"volume", 1, {1, 1.5}}}}, folder / "cells.vtu");
  const double none = std::numeric_limits<double>::quiet_NaN();
  write_vtp(surface(), {{{"a \"name\" & <more>", 1, {none, 0.5, 0, 0, 0}}}, {{"face_quality", 1, {0, 1, 2, 3, 4}}}},
            folder / "surface.vtp");
  const std::string command = std::string(DEFORM_PYTHON) + " " + DEFORM_READ_VTK + " " + folder.string();
  EXPECT_EQ(std::system(command.c_str()), 0);
  fs::remove_all(folder);
}

}  // namespace
}  // namespace deform::io::vtk_output_test
