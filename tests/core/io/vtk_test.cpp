// SPDX-License-Identifier: GPL-3.0-or-later
// Legacy VTK: a cube under a wedge with surface cells on and between them, in every version and form; surfaces, lattices,
// quadratic cells, polyhedra.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <bit>

#include "core/io/binary/byte_order.h"
#include "core/io/mesh_file.h"
#include "core/quality/element_quality.h"
#include "tests/core/io/text_diff.h"
#include "tests/support/expect_error.h"

namespace deform::io::vtk_test {
namespace {

using testing::ElementsAre;

const std::string points_text = R"(POINTS 10 double
0 0 0 1 0 0 1 1 0 0 1.0 0
0 0 1 1 0 1 1 1 1 0 1 1
0.5 0 2 0.5 1 2
)";
const std::string types_text = "CELL_TYPES 5\n12\n13\n9\n5\n3\n";
const std::string data_text = R"(CELL_DATA 5
SCALARS quality double 1
LOOKUP_TABLE default
0.5 nan 1 1 1
FIELD FieldData 2
ids 1 5 vtktypeint64
7 7 8 8 8
my%20part 1 5 int
1 2 5 6 7
)";

std::string spoilt(std::string bytes, const std::string& from, const std::string& to) {
  return bytes.replace(bytes.find(from), from.size(), to);
}

std::string old_file() {
  return "# vtk DataFile Version 3.0\na title\nASCII\nDATASET UNSTRUCTURED_GRID\n" + points_text +
         "CELLS 5 28\n8 0 1 2 3 4 5 6 7\n6 4 5 8 7 6 9\n4 0 3 2 1\n3 4 5 8\n2 8 9\n\n" + types_text + "\n" + data_text;
}

std::string new_file() {
  return "# vtk DataFile Version 5.1\na title\nASCII\nDATASET UNSTRUCTURED_GRID\nFIELD FieldData 1\nwho 1 2 string\na%20b\n\n" +
         points_text +
         "METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 2.4\n\n"
         "CELLS 6 23\nOFFSETS vtktypeint64\n0 8 14 18 21 23\nCONNECTIVITY vtktypeint64\n0 1 2 3 4 5 6 7 4 5 8 7 6 9 0 3 2 1 4 5 "
         "8 8 9\n" +
         types_text + data_text;
}

void expect_cube_and_wedge(const MeshFile& file, const std::string& label) {
  const auto mesh = file.mesh();
  ASSERT_EQ(mesh->point_count(), 10u);
  EXPECT_EQ(mesh->points[9], (Vec3{0.5, 1, 2}));
  ASSERT_NE(file.elements(), nullptr);
  EXPECT_THAT(file.elements()->nodes(0), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7));
  EXPECT_THAT(file.elements()->nodes(1), ElementsAre(4, 8, 5, 7, 9, 6));
  EXPECT_EQ(element_quality(mesh->points, *file.elements()).inverted_elements, 0u);
  EXPECT_EQ(mesh->face_count(), 5u + 4);
  if (label.empty()) return;
  ASSERT_NE(mesh->find_group(label + "_5"), nullptr);
  EXPECT_EQ(mesh->find_group(label + "_5")->faces.size(), 1u);
  EXPECT_EQ(mesh->find_group(label + "_6")->faces.size(), 1u);
  EXPECT_THAT(mesh->find_group(label + "_7")->points, ElementsAre(8, 9));
  EXPECT_THAT(mesh->find_group(label + "_2")->points, ElementsAre(4, 5, 6, 7, 8, 9));
}

TEST(Vtk, OldAndNewListsOfCells) {
  expect_cube_and_wedge(*parse_mesh(old_file(), "a.vtk"), "");
  EXPECT_EQ(parse_mesh(old_file(), "a.vtk")->format(), Format::vtk);
  const auto mesh = parse_mesh(new_file(), "a.vtk")->mesh();
  EXPECT_EQ(mesh->find_group("ids_8")->faces.size(), 2u) << "the first array of integers";
  const auto named = parse_mesh(spoilt(new_file(), "my%20part", "Material"), "a.vtk");
  expect_cube_and_wedge(*named, "Material");
}

TEST(Vtk, OnlyCoordinatesChange) {
  for (const std::string& bytes : {old_file(), new_file()}) {
    const auto file = parse_mesh(bytes, "a.vtk");
    EXPECT_EQ(file->with_points(file->mesh()->points), bytes);
    Points moved = file->mesh()->points;
    moved[3] = {-0.25, 1, 1e-3};
    const std::string written = file->with_points(moved);
    EXPECT_NE(written.find("\n0 0 0 1 0 0 1 1 0 -0.25 1.0 0.001\n"), std::string::npos) << written;
    EXPECT_EQ(test::changed_words(bytes, written).size(), 2u);
    EXPECT_EQ(parse_mesh(written, "a.vtk")->mesh()->points, moved);
  }
}

// ---- binary ----

template <typename T>
std::string big(std::initializer_list<T> values) {
  std::string bytes;
  for (const T value : values) {
    char raw[sizeof(T)];
    if constexpr (sizeof(T) == 8) {
      store_scalar(raw, std::bit_cast<std::uint64_t>(value), std::endian::big);
    } else if constexpr (sizeof(T) == 4) {
      store_scalar(raw, std::bit_cast<std::uint32_t>(value), std::endian::big);
    } else {
      raw[0] = static_cast<char>(value);
    }
    bytes.append(raw, sizeof raw);
  }
  return bytes;
}

/// A tetrahedron and one of its faces; values whose bytes look like blanks, line ends and digits.
std::string binary_file(bool new_lists) {
  const std::string strings = std::string(
                                  "\xc3"
                                  "a\nb",
                                  4) +
                              std::string("\x80\x00", 2);
  return std::string("# vtk DataFile Version ") + (new_lists ? "5.1" : "2.0") +
         "\ntitle\nBINARY\nDATASET UNSTRUCTURED_GRID\nFIELD f 2\nnames 1 2 string\n" + strings + "\nnumbers 2 1 short\n\n \n \n" +
         "POINTS 4 float\n" + big<float>({0, 0, 0, 8.5e-33F, 0, 0, 0, 1, 0, 0, 0, 1}) + "\n" +
         (new_lists ? "CELLS 3 7\nOFFSETS vtktypeint64\n" + big<std::int64_t>({0, 4, 7}) + "\nCONNECTIVITY vtkIdType\n" +
                          big<std::int32_t>({0, 1, 2, 3, 0, 2, 1})
                    : "CELLS 2 9\n" + big<std::int32_t>({4, 0, 1, 2, 3, 3, 0, 2, 1})) +
         "\nCELL_TYPES 2\n" + big<std::int32_t>({10, 5}) + "\nPOINT_DATA 4\nVECTORS v double\n" + std::string(96, '\n') +
         "\nCOLOR_SCALARS c 3\n" + std::string(12, ' ') + "\nLOOKUP_TABLE t 2\n" + std::string(8, '\n') +
         "\nSCALARS bits bit\nLOOKUP_TABLE t\n\n" + "\nTEXTURE_COORDINATES uv 2 float\n" + std::string(32, '1') +
         "\nCELL_DATA 2\nSCALARS RegionId unsigned_char\nLOOKUP_TABLE default\n" + big<std::uint8_t>({10, 200}) + "\n";
}

TEST(Vtk, Binary) {
  for (const bool new_lists : {false, true}) {
    const std::string bytes = binary_file(new_lists);
    const auto file = parse_mesh(bytes, "a.vtk");
    const auto mesh = file->mesh();
    EXPECT_EQ(mesh->points[1], (Vec3{8.5e-33F, 0, 0}));
    EXPECT_EQ(mesh->points[3], (Vec3{0, 0, 1}));
    EXPECT_THAT(file->elements()->nodes(0), ElementsAre(0, 1, 2, 3));
    EXPECT_THAT(mesh->find_group("RegionId_200")->faces, ElementsAre(0));
    EXPECT_EQ(file->with_points(mesh->points), bytes);
    Points moved = mesh->points;
    moved[2] = {0.1, -3, 0};
    const std::string written = file->with_points(moved);
    const std::size_t at = bytes.find("POINTS 4 float\n") + 15 + 24;
    EXPECT_EQ(written, std::string(bytes).replace(at, 8, big<float>({0.1F, -3})));
    EXPECT_EQ(parse_mesh(written, "a.vtk")->mesh()->points[2][0], static_cast<double>(0.1F));
  }
}

// ---- other data sets ----

TEST(Vtk, PolyData) {
  const auto file = parse_mesh(
      "# vtk DataFile Version 2.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 5 float\n0 0 0  1 0 0  1 1 0  0 1 0  0 2 0\n"
      "TRIANGLE_STRIPS 1 5\n4 0 1 3 2\nPOLYGONS 2 10\n4 0 1 2 3\n4 3 2 4 3\nLINES 1 3\n2 0 4\nVERTICES 1 2\n1 4\n"
      "CELL_DATA 5\nSCALARS part int\nLOOKUP_TABLE default\n1 2 3 3 4\n",
      "a.vtk");
  const auto mesh = file->mesh();
  EXPECT_EQ(file->elements(), nullptr);
  EXPECT_THAT(mesh->face_sizes, ElementsAre(4, 4, 3, 3));
  EXPECT_THAT(mesh->face_points, ElementsAre(0, 1, 2, 3, 3, 2, 4, 3, 0, 1, 3, 1, 2, 3))
      << "polygons, then the strip as triangles";
  EXPECT_THAT(mesh->find_group("part_1")->points, ElementsAre(4));
  EXPECT_THAT(mesh->find_group("part_2")->points, ElementsAre(0, 4));
  EXPECT_THAT(mesh->find_group("part_3")->faces, ElementsAre(0, 1));
  EXPECT_THAT(mesh->find_group("part_4")->faces, ElementsAre(2, 3));
}

TEST(Vtk, StructuredGrid) {
  std::string text = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_GRID\nDIMENSIONS 3 2 2\nPOINTS 12 double\n";
  for (int i = 0; i < 12; ++i)
    text += std::to_string(i % 3) + " " + std::to_string(i / 3 % 2) + " " + std::to_string(i / 6) + "\n";
  const auto solid = parse_mesh(text, "a.vtk");
  EXPECT_THAT(solid->elements()->nodes(1), ElementsAre(1, 2, 5, 4, 7, 8, 11, 10));
  EXPECT_EQ(element_quality(solid->mesh()->points, *solid->elements()).least_scaled_jacobian.value, 1);
  const auto sheet = parse_mesh(spoilt(text, "3 2 2", "6 1 2"), "a.vtk");
  EXPECT_EQ(sheet->elements(), nullptr);
  EXPECT_THAT(sheet->mesh()->face_sizes, ElementsAre(4, 4, 4, 4, 4));
  EXPECT_THAT(std::vector<PointId>(sheet->mesh()->face_points.begin(), sheet->mesh()->face_points.begin() + 4),
              ElementsAre(0, 1, 7, 6));
  EXPECT_EQ(parse_mesh(spoilt(text, "3 2 2", "12 1 1"), "a.vtk")->mesh()->face_count(), 0u);
}

// ---- kinds of cells ----

std::string one_cell(int type, const std::string& coordinates, int points) {
  std::string text = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS " + std::to_string(points) +
                     " double\n" + coordinates + "\nCELLS 1 " + std::to_string(points + 1) + "\n" + std::to_string(points);
  for (int i = 0; i < points; ++i) text.append(1, ' ').append(std::to_string(i));
  return text + "\nCELL_TYPES 1\n" + std::to_string(type) + "\n";
}

// Parametric coordinates as VTK's cells give them, doubled; of wedges with x and y exchanged: the base seen from outside.
const std::string square = "0 0 0 2 0 0 2 2 0 0 2 0 ", top_square = "0 0 2 2 0 2 2 2 2 0 2 2 ";
const std::string square_edges = "1 0 0 2 1 0 1 2 0 0 1 0 ", top_edges = "1 0 2 2 1 2 1 2 2 0 1 2 ",
                  pillars = "0 0 1 2 0 1 2 2 1 0 2 1 ";
const std::string triangle = "0 0 0 2 0 0 0 2 0 ", top_triangle = "0 0 2 2 0 2 0 2 2 ";
const std::string triangle_edges = "1 0 0 1 1 0 0 1 0 ", top_triangle_edges = "1 0 2 1 1 2 0 1 2 ",
                  three_pillars = "0 0 1 2 0 1 0 2 1 ";
const std::string wedge_out = "0 0 0 0 2 0 2 0 0 0 0 2 0 2 2 2 0 2 ",
                  wedge_out_edges = "0 1 0 1 1 0 1 0 0 0 1 2 1 1 2 1 0 2 0 0 1 0 2 1 2 0 1 ";

struct CellCase {
  const char* name;
  int type;
  ElementType element;
  std::string coordinates;
  double volume;
};
std::ostream& operator<<(std::ostream& out, const CellCase& cell) { return out << cell.name; }

class VtkCellTest : public testing::TestWithParam<CellCase> {};

TEST_P(VtkCellTest, NodesStandWhereTheElementWantsThem) {
  const ElementShape& form = shape(GetParam().element);
  const auto file = parse_mesh(one_cell(GetParam().type, GetParam().coordinates, static_cast<int>(form.nodes)), "a.vtk");
  ASSERT_NE(file->elements(), nullptr);
  const Elements& elements = *file->elements();
  const Points& points = file->mesh()->points;
  ASSERT_EQ(elements.size(), 1u);
  EXPECT_EQ(elements.types[0], GetParam().element);
  const auto quality = element_quality(points, elements);
  EXPECT_NEAR(quality.total_volume, GetParam().volume, 1e-12) << "each node once, positive";
  EXPECT_EQ(quality.inverted_elements, 0u);
  const auto nodes = elements.nodes(0);
  if (!form.quadratic()) return;
  for (std::size_t e = 0; e < form.edges.size(); ++e) {
    for (int k = 0; k < 3; ++k) {
      EXPECT_EQ(points[nodes[form.corners + e]][k], (points[nodes[form.edges[e][0]]][k] + points[nodes[form.edges[e][1]]][k]) / 2)
          << e;
    }
  }
  for (std::size_t f = 0; f < form.faces.size(); ++f) {
    if (form.face_centre(f) == ElementShape::no_node) continue;
    for (int k = 0; k < 3; ++k) {
      double sum = 0;  // corner, mid, corner, mid, ...
      for (std::size_t c = 0; c < form.faces[f].size(); c += 2) sum += points[nodes[form.faces[f][c]]][k];
      EXPECT_EQ(points[nodes[form.face_centre(f)]][k], sum / 4) << f;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, VtkCellTest,
    testing::Values(
        CellCase{"Tetrahedron", 10, ElementType::tetrahedron, "0 0 0 1 0 0 0 1 0 0 0 1", 1.0 / 6},
        CellCase{"Voxel", 11, ElementType::hexahedron, "0 0 0 1 0 0 0 1 0 1 1 0 0 0 1 1 0 1 0 1 1 1 1 1", 1},
        CellCase{"Hexahedron", 12, ElementType::hexahedron, square + top_square, 8},
        CellCase{"WedgeByParameters", 13, ElementType::prism, triangle + top_triangle, 4},
        CellCase{"WedgeByFigure", 13, ElementType::prism, wedge_out, 4},
        CellCase{"Pyramid", 14, ElementType::pyramid, square + "1 1 2", 8.0 / 3},
        CellCase{"Tetrahedron10", 24, ElementType::tetrahedron10, triangle + "0 0 2 " + triangle_edges + "0 0 1 1 0 1 0 1 1",
                 8.0 / 6},
        CellCase{"Hexahedron20", 25, ElementType::hexahedron20, square + top_square + square_edges + top_edges + pillars, 8},
        CellCase{"Wedge15ByParameters", 26, ElementType::prism15,
                 triangle + top_triangle + triangle_edges + top_triangle_edges + three_pillars, 4},
        CellCase{"Wedge15ByFigure", 26, ElementType::prism15, wedge_out + wedge_out_edges, 4},
        CellCase{"Pyramid13", 27, ElementType::pyramid13, square + "0 0 2 " + square_edges + "0 0 1 1 0 1 1 1 1 0 1 1", 8.0 / 3},
        CellCase{"Hexahedron27", 29, ElementType::hexahedron27,
                 square + top_square + square_edges + top_edges + pillars + "0 1 1 2 1 1 1 0 1 1 2 1 1 1 0 1 1 2 1 1 1", 8},
        CellCase{"Wedge18ByParameters", 32, ElementType::prism18,
                 triangle + top_triangle + triangle_edges + top_triangle_edges + three_pillars + "1 0 1 1 1 1 0 1 1", 4},
        CellCase{"Wedge18ByFigure", 32, ElementType::prism18, wedge_out + wedge_out_edges + "0 1 1 1 1 1 1 0 1", 4}),
    [](const auto& tested) { return std::string(tested.param.name); });

TEST(Vtk, QuadraticSurfaceCells) {
  const auto faces = [](int type, int points) {
    std::string coordinates;
    for (int i = 0; i < points; ++i) coordinates += std::to_string(i) + " 0 0 ";
    const auto mesh = parse_mesh(one_cell(type, coordinates, points), "a.vtk")->mesh();
    return std::pair(mesh->face_sizes, mesh->face_points);
  };
  EXPECT_THAT(faces(22, 6).second, ElementsAre(0, 3, 1, 4, 2, 5));
  EXPECT_THAT(faces(23, 8).second, ElementsAre(0, 4, 1, 5, 2, 6, 3, 7));
  EXPECT_THAT(faces(30, 6).second, ElementsAre(0, 4, 1, 2, 5, 3));
  EXPECT_THAT(faces(36, 10).second, ElementsAre(0, 5, 1, 6, 2, 7, 3, 8, 4, 9));
  EXPECT_THAT(faces(34, 7).first, ElementsAre(4, 4, 4));
  EXPECT_THAT(faces(28, 9).first, ElementsAre(4, 4, 4, 4));
  EXPECT_THAT(faces(8, 4).second, ElementsAre(0, 1, 3, 2));
  EXPECT_THAT(faces(7, 5).first, ElementsAre(5));
  EXPECT_TRUE(faces(4, 3).first.empty());
  EXPECT_TRUE(faces(0, 1).first.empty());
}

/// Two cubes, the lower one as a polyhedron; as VTK 9 writes them.
std::string polyhedra(const std::string& lower) {
  return "# vtk DataFile Version 4.2\nvtk output\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 12 double\n0 0 0 1 0 0 0 1 0 1 1 0 "
         "0 0 1 1 0 1 0 1 1 1 1 1 0 0 2 1 0 2 0 1 2 1 1 2\nCELLS 3 46\n" +
         lower + "\n8 4 5 7 6 8 9 11 10\n4 0 1 3 2\nCELL_TYPES 3\n42\n12\n9\nCELL_DATA 3\nSCALARS m int\nLOOKUP_TABLE d\n1 2 3\n";
}
const std::string outward = "31 6 4 0 2 3 1 4 4 5 7 6 4 0 1 5 4 4 1 3 7 5 4 3 2 6 7 4 2 0 4 6";
const std::string inward = "31 6 4 1 3 2 0 4 6 7 5 4 4 4 5 1 0 4 5 7 3 1 4 7 6 2 3 4 6 4 0 2";

TEST(Vtk, Polyhedra) {
  for (const std::string& lower : {outward, inward}) {
    const auto file = parse_mesh(polyhedra(lower), "a.vtk");
    EXPECT_EQ(file->elements(), nullptr);
    const auto cells = file->cells();
    ASSERT_NE(cells, nullptr);
    EXPECT_EQ(cells->cell_count, 2u);
    EXPECT_EQ(cells->internal_faces(), 1u);
    EXPECT_EQ(cells->face_count(), 11u);
    EXPECT_EQ(cells->owner[0], 0u);
    EXPECT_EQ(cells->neighbour[0], 1u);
    const auto mesh = file->mesh();
    EXPECT_EQ(mesh->face_count(), 10u);
    EXPECT_EQ(mesh->find_group("m_3")->faces.size(), 1u);
    const auto between = cells->face(0);  // from the owner to the neighbour: its area vector points up
    double area = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      const Vec3 &a = mesh->points[between[i]], &b = mesh->points[between[(i + 1) % 4]];
      area += (a[0] * b[1] - a[1] * b[0]) / 2;
    }
    EXPECT_EQ(area, 1);
  }
}

// ---- what is wrong ----

TEST(Vtk, RefusesWhatIsWrong) {
  const std::string old = old_file(), now = new_file(), binary = binary_file(true);
  const std::pair<std::string, std::vector<const char*>> table[] = {
      {"", {"# vtk DataFile Version"}},
      {"# vtk DataFile Version x\n", {"line 1"}},
      {spoilt(old, "3.0", "6.0"), {"line 1", "version 6", "1 to 5"}},
      {spoilt(old, "ASCII", "UTF-8"), {"line 3", "ASCII or BINARY", "utf-8"}},
      {spoilt(old, "DATASET UNSTRUCTURED_GRID", "DATASET STRUCTURED_POINTS"), {"line 3", "structured_points", "POLYDATA"}},
      {spoilt(old, "POINTS 10 double", "FOO 10 double"), {"line 5", "unknown keyword \"foo\""}},
      {spoilt(old, "POINTS 10 double", "POINTS 10 int"), {"line 5", "float or double"}},
      {spoilt(old, "POINTS 10 double", "POINTS 0 double"), {"line 5", "POINTS 0"}},
      {spoilt(old, "POINTS 10 double", "POINTS -1 double"), {"line 5", "-1"}},
      {spoilt(old, "POINTS 10 double", "POINTS 99999999 double"), {"99999999 x 3", "bytes left"}},
      {spoilt(old, "POINTS 10 double", "POINTS 9223372036854775807 double"), {"9223372036854775807 x 3", "bytes left"}},
      {spoilt(old, "POINTS 10 double", "POINTS 11 double"), {"line 9", "number", "CELLS"}},
      {spoilt(old, "POINTS 10 double", "POINTS 9 double"), {"line 8", "unknown keyword \"0.5\""}},
      {spoilt(old, "1.0 0", "inf 0"), {"line 6", "inf", "finite"}},
      {spoilt(old, "CELLS 5 28", points_text + "CELLS 5 28"), {"line 9", "second section of POINTS"}},
      {spoilt(old, "CELLS 5 28", "CELLS 29 28"), {"line 9", "29 cells in a list of 28"}},
      {spoilt(old, "CELLS 5 28", "CELLS 5 29"), {"line 14", "the list of cells has 1 numbers too many"}},
      {spoilt(old, "CELLS 5 28", "CELLS 5 27"), {"line 13", "cell 4", "2 points", "only 2 numbers left"}},
      {spoilt(old, "CELLS 5 28", "CELLS 4 28"), {"3 numbers too many"}},
      {spoilt(old, "CELLS 5 28", "CELLS 5 2600000"), {"2600000", "bytes left"}},
      {spoilt(old, "8 0 1", "-8 0 1"), {"line 10", "-8 points"}},
      {spoilt(old, "8 0 1", "8 0 10"), {"a.vtk: cells[0]", "point 10", "10 points"}},
      {spoilt(old, "8 0 1", "8 0 -1"), {"line 10", "point -1"}},
      {spoilt(old, "CELL_TYPES 5\n12\n", "CELL_TYPES 4\n"), {"5 CELLS", "4 CELL_TYPES"}},
      {spoilt(old, "\n12\n", "\n256\n"), {"line 17", "type 256"}},
      {spoilt(old, "\n12\n", "\n10\n"), {"cells[0]", "type 10 has 4 points, found 8"}},
      {spoilt(old, "\n12\n", "\n15\n"), {"cells[0]", "type 15", "not supported"}},
      {spoilt(old, "\n9\n", "\n12\n"), {"cells[2]", "type 12 has 8 points"}},
      {spoilt(old, "\n5\n", "\n36\n"), {"cells[3]", "type 36 of 3 points"}},
      {spoilt(old, "\n3\n", "\n7\n"), {"cells[4]", "type 7 of 2 points"}},
      {spoilt(now, "0 8 14", "1 8 14"), {"OFFSETS[0] is 1", "rise from 0"}},
      {spoilt(now, "0 8 14", "0 8 7"), {"OFFSETS[2] is 7"}},
      {spoilt(now, "21 23", "21 24"), {"OFFSETS[5] is 24", "23"}},
      {spoilt(now, "21 23", "21 22"), {"last offset is 22"}},
      {spoilt(now, "OFFSETS v", "OFFSET v"), {"expected OFFSETS"}},
      {spoilt(now, "CONNECTIVITY vtktypeint64", "CONNECTIVITY double"), {"integer type"}},
      {spoilt(now, "who 1 2 string", "who 1 2 variant"), {"line 6", "\"who\"", "unknown type"}},
      {spoilt(now, "who 1 2 string", "who 1 20000000000 string"), {"20000000000", "bytes left"}},
      {spoilt(now, "my%20part 1 5 int\n1 2 5 6 7\n", "my%20part 1 5 int\n1 2 5"), {"5 x 1 values", "5 bytes left"}},
      {spoilt(binary, "POINTS 4 float", "POINTS 4000 float"), {"byte ", "4000 x 3"}},
      {spoilt(binary, big<float>({0, 1, 0, 0}), big<float>({0, std::numeric_limits<float>::infinity(), 0, 0})),
       {"byte ", "finite"}},
      {spoilt(binary, "CELL_TYPES 2", "CELL_TYPES 2000"), {"byte ", "2000 x 1"}},
      {spoilt(binary, "\xc3", "\x3f"), {"byte ", "a string of "}},
      {polyhedra(spoilt(outward, "31 6", "31 7")), {"cells[0]", "face 6 of 7"}},
      {polyhedra(spoilt(outward, "31 6", "31 5")), {"cells[0]", "5 numbers too many"}},
      {polyhedra(spoilt(outward, "31 6", "31 3")), {"cells[0]", "less than 4 faces"}},
      {polyhedra(spoilt(outward, "4 2 0 4 6", "4 2 0 4 12")), {"cells[0]", "point 12"}},
      {polyhedra(spoilt(outward, "4 2 0 4 6", "4 0 2 3 1")), {"cells[0]", "stands there twice"}},
      {polyhedra(spoilt(outward, "6 4 0 2 3 1", "6 2 0 2 3 1")), {"cells[0]", "face 0 has 2 points"}},
  };
  for (const auto& [bytes, message] : table) {
    SCOPED_TRACE(std::string(message[0]).append(1, ' ').append(message.back()));
    test::expect_error(ErrorCode::invalid_argument, message, [&, &input = bytes] { parse_mesh(input, "a.vtk"); });
  }
  EXPECT_NO_THROW(parse_mesh(old + "ODDITY\n1 2 3\n", "a.vtk")) << "behind the data anything may follow";
}

}  // namespace
}  // namespace deform::io::vtk_test
