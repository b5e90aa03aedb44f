// SPDX-License-Identifier: GPL-3.0-or-later
// Integer arrays of cells name groups by one rule, whichever of VTK's formats a mesh is stored in.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include "core/io/mesh_file.h"

namespace deform::io::vtk_groups_test {
namespace {

struct CellArray {
  std::string legacy_type, xml_type, name, legacy_name;
  std::vector<std::string> values;  ///< of two hexahedra and two quads
};

std::string joined(const std::vector<std::string>& values) {
  std::string text;
  for (const std::string& value : values) text += value + " ";
  return text;
}

/// Two cubes side by side, one side of each, and arrays of these four cells.
std::string legacy(const std::vector<CellArray>& arrays) {
  std::string text =
      "# vtk DataFile Version 3.0\ntwo cubes\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 12 double\n"
      "0 0 0 1 0 0 2 0 0 0 1 0 1 1 0 2 1 0\n0 0 1 1 0 1 2 0 1 0 1 1 1 1 1 2 1 1\n"
      "CELLS 4 28\n8 0 1 4 3 6 7 10 9\n8 1 2 5 4 7 8 11 10\n4 0 3 4 1\n4 2 5 11 8\nCELL_TYPES 4\n12 12 9 9\nCELL_DATA 4\n";
  text += "FIELD FieldData " + std::to_string(arrays.size()) + "\n";
  for (const auto& array : arrays) {
    text += array.legacy_name + " 1 4 " + array.legacy_type + "\n" + joined(array.values) + "\n";
  }
  return text;
}

std::string xml(const std::vector<CellArray>& arrays) {
  std::string text =
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\">\n"
      "<UnstructuredGrid><Piece NumberOfPoints=\"12\" NumberOfCells=\"4\">\n<CellData>\n";
  for (const auto& array : arrays) {
    text += "<DataArray type=\"" + array.xml_type + "\" Name=\"" + array.name + "\" format=\"ascii\">" + joined(array.values) +
            "</DataArray>\n";
  }
  return text +
         "</CellData>\n<Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">"
         "0 0 0 1 0 0 2 0 0 0 1 0 1 1 0 2 1 0 0 0 1 1 0 1 2 0 1 0 1 1 1 1 1 2 1 1</DataArray></Points>\n<Cells>\n"
         "<DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">0 1 4 3 6 7 10 9 1 2 5 4 7 8 11 10 0 3 4 1 2 5 11 "
         "8</DataArray>\n<DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">8 16 20 24</DataArray>\n"
         "<DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">12 12 9 9</DataArray>\n</Cells>\n"
         "</Piece></UnstructuredGrid>\n</VTKFile>\n";
}

const CellArray quality{"double", "Float64", "quality", "quality", {"1", "2", "3", "4"}};
const CellArray parts{"int", "Int32", "part", "part", {"7", "-7", "1", "7"}};
const CellArray bytes{"unsigned_char", "UInt8", "zone", "zone", {"1", "2", "255", "2"}};
const CellArray wide{"vtktypeint64", "Int64", "MaterialIds", "MaterialIds", {"1", "9007199254740993", "1", "4"}};
const CellArray spaced{"short", "Int16", "Patch Id &amp; more", "Patch%20Id%20&%20more", {"5", "6", "5", "6"}};

TEST(VtkGroups, OfAllFormatsAreTheSame) {
  const std::vector<std::string> materials{"MaterialIds_1", "cellZone:MaterialIds_1", "MaterialIds_4",
                                           "MaterialIds_9007199254740993"};
  // Where faces and cells have a value in common, the cells are the zone.
  const std::vector<std::pair<std::vector<CellArray>, std::vector<std::string>>> cases = {
      {{}, {}},
      {{quality}, {}},
      {{parts}, {"part_-7", "part_1", "part_7", "cellZone:part_7"}},
      {{quality, parts}, {"part_-7", "part_1", "part_7", "cellZone:part_7"}},
      {{bytes, parts}, {"zone_1", "zone_2", "cellZone:zone_2", "zone_255"}},
      {{parts, wide}, materials},
      {{wide, bytes}, materials},
      {{spaced}, {"Patch Id & more_5", "Patch Id & more_6", "cellZone:Patch Id & more_5", "cellZone:Patch Id & more_6"}},
  };
  for (const auto& [arrays, names] : cases) {
    const auto vtk = parse_mesh(legacy(arrays), "a.vtk"), vtu = parse_mesh(xml(arrays), "a.vtu");
    std::vector<std::string> found;
    for (const Group& group : vtu->mesh()->groups) found.push_back(group.name);
    EXPECT_THAT(found, testing::UnorderedElementsAreArray(names));
    ASSERT_EQ(vtk->mesh()->groups.size(), names.size());
    for (std::size_t g = 0; g < names.size(); ++g) {
      const Group &a = vtk->mesh()->groups[g], &b = vtu->mesh()->groups[g];
      EXPECT_EQ(a.name, b.name);
      EXPECT_EQ(a.points, b.points) << a.name;
      EXPECT_EQ(a.faces, b.faces) << a.name;
    }
    EXPECT_EQ(vtu->mesh()->cell_count(), 2u);
    EXPECT_EQ(vtu->with_points(vtu->mesh()->points), xml(arrays)) << "written back unchanged";
    Points moved = vtu->mesh()->points;
    for (Vec3& p : moved) p[2] += 1;
    const auto again = parse_mesh(vtu->with_points(moved), "a.vtu");
    ASSERT_EQ(again->mesh()->groups.size(), names.size());
    for (std::size_t g = 0; g < names.size(); ++g) EXPECT_EQ(again->mesh()->groups[g].points, vtu->mesh()->groups[g].points);
  }
}

TEST(VtkGroups, OfSurfacesAreTheSame) {
  const std::string vtk =
      "# vtk DataFile Version 3.0\ntwo\nASCII\nDATASET POLYDATA\nPOINTS 4 float\n0 0 0 1 0 0 1 1 0 0 1 0\n"
      "POLYGONS 2 8\n3 0 1 2\n3 0 2 3\nCELL_DATA 2\nSCALARS part int 1\nLOOKUP_TABLE default\n3 4\n";
  const std::string vtp =
      "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\"><PolyData>"
      "<Piece NumberOfPoints=\"4\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"2\">"
      "<CellData Scalars=\"part\"><DataArray type=\"Int32\" Name=\"part\" format=\"ascii\">3 4</DataArray></CellData>"
      "<Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0 1 0 0 1 1 0 0 1 0</DataArray></Points>"
      "<Polys><DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\">0 1 2 0 2 3</DataArray>"
      "<DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">3 6</DataArray></Polys></Piece></PolyData></VTKFile>\n";
  for (const auto& [file, name] : {std::pair{vtk, "a.vtk"}, {vtp, "a.vtp"}}) {
    const auto mesh = parse_mesh(file, name)->mesh();
    ASSERT_EQ(mesh->groups.size(), 2u) << name;
    EXPECT_EQ(mesh->groups[0].name, "part_3");
    EXPECT_EQ(mesh->groups[0].faces, std::vector<FaceId>{0});
    EXPECT_EQ(mesh->groups[1].name, "part_4");
  }
}

}  // namespace
}  // namespace deform::io::vtk_groups_test
