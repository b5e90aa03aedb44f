// SPDX-License-Identifier: GPL-3.0-or-later
// Medit: a cube with a pyramid on top and two tetrahedra beside it, surface elements on the boundary and inside.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include "core/io/mesh_file.h"
#include "core/quality/element_quality.h"
#include "tests/core/io/text_diff.h"
#include "tests/support/expect_error.h"

namespace deform::io::medit_test {
namespace {

using testing::ElementsAre;

const std::string text = R"(MeshVersionFormatted 2
# a comment
Dimension
3
Vertices 11
0 0 0 7
1.0 0 0 7
1 1 0 7
0 1 0 7
0 0 1 7
1 0 1 7
1 1 1 7
  0 1 1  7
.5 0.5 1.5 7
2 0.5 +0.5 0
2 0 0.5 0
Corners 2
1 2
Triangles
2
5 6 9 2
6 3 10 4
Quadrilaterals
2
1 4 3 2  1
5 6 7 8  3
Tangents 1
0 0 1
Hexahedra 1
1 2 3 4 5 6 7 8 1
Pyramids 1
5 6 7 8 9 2
Tetrahedra 2
2 3 6 10 1
2 10 6 11 1
End
Vertices 1
)";

const Group& group(const Mesh& mesh, const std::string& name) {
  const Group* found = mesh.find_group(name);
  if (found == nullptr) throw Error(ErrorCode::not_found, "no group " + name);
  return *found;
}

TEST(Medit, BoundaryGroupsAndElements) {
  const auto file = parse_mesh(text, "a.mesh");
  EXPECT_EQ(file->format(), Format::medit);
  const auto mesh = file->mesh();
  EXPECT_EQ(mesh->point_count(), 11u);
  EXPECT_EQ(mesh->points[9], (Vec3{2, 0.5, 0.5}));
  const auto elements = file->elements();
  ASSERT_NE(elements, nullptr);
  ASSERT_EQ(elements->size(), 4u);
  EXPECT_EQ(elements->types[1], ElementType::pyramid);
  // Five sides of the cube, four of the pyramid, three of each tetrahedron; the tetrahedra touch the cube with no whole face.
  EXPECT_EQ(mesh->face_count(), 5u + 4 + 3 + 3);
  EXPECT_EQ(group(*mesh, "ref_1").faces.size(), 1u);
  EXPECT_THAT(group(*mesh, "ref_1").points, ElementsAre());
  EXPECT_THAT(group(*mesh, "ref_3").faces, ElementsAre());
  EXPECT_THAT(group(*mesh, "ref_3").points, ElementsAre(4, 5, 6, 7)) << "between cube and pyramid";
  EXPECT_EQ(group(*mesh, "ref_2").faces.size(), 1u);
  EXPECT_EQ(group(*mesh, "ref_4").faces.size(), 1u);
  EXPECT_THAT(group(*mesh, "volume_2").points, ElementsAre(4, 5, 6, 7, 8));
  EXPECT_EQ(element_quality(mesh->points, *elements).inverted_elements, 0u);
}

TEST(Medit, OnlyCoordinatesChange) {
  const auto file = parse_mesh(text, "a.mesh");
  EXPECT_EQ(file->with_points(file->mesh()->points), text);
  Points moved = file->mesh()->points;
  moved[7] = {-0.25, 1, 1e-3};
  const std::string written = file->with_points(moved);
  EXPECT_NE(written.find("\n  -0.25 1 0.001  7\n"), std::string::npos) << written;
  EXPECT_EQ(test::changed_words(text, written).size(), 2u);
  EXPECT_EQ(parse_mesh(written, "a.mesh")->mesh()->points, moved);
}

TEST(Medit, SurfaceAlone) {
  const auto file =
      parse_mesh("MeshVersionFormatted 1\nDimension 3\nVertices 3 0 0 0 1 1 0 0 1 0 1 0 1\nTriangles 1 1 2 3 5\nEnd\n", "b.mesh");
  EXPECT_EQ(file->elements(), nullptr);
  EXPECT_EQ(file->mesh()->face_count(), 1u);
  EXPECT_THAT(group(*file->mesh(), "ref_5").faces, ElementsAre(0));
}

TEST(Medit, RefusesWhatIsWrong) {
  const auto spoilt = [](const std::string& from, const std::string& to) {
    std::string bytes = text;
    bytes.replace(bytes.find(from), from.size(), to);
    return bytes;
  };
  const std::pair<std::string, std::vector<const char*>> table[] = {
      {"", {"MeshVersionFormatted"}},
      {"ply\n", {"MeshVersionFormatted"}},
      {"MeshVersionFormatted 2\nEnd\n", {"no Vertices"}},
      {"MeshVersionFormatted 2\n\\ End\n", {"line 2", "unexpected"}},
      {spoilt("3\nVertices", "2\nVertices"), {"line 4", "dimension 2"}},
      {spoilt("Vertices 11", "Vertices 12"), {"a.mesh: line", "vertex coordinate", "Corners"}},
      {spoilt("Vertices 11", "Vertices -1"), {"line 5", "-1"}},
      {spoilt("Vertices 11", "Vertices 99999999999"), {"line 5", "99999999999"}},
      {spoilt("1.0 0 0 7", "nan 0 0 7"), {"line 7", "finite"}},
      {spoilt("1.0 0 0 7", "x 0 0 7"), {"line 7", "number"}},
      {spoilt("6 3 10 4", "6 3 12 4"), {"Triangles[1]", "12", "1..11"}},
      {spoilt("6 3 10 4", "6 0 10 4"), {"Triangles[1]", "0", "1..11"}},
      {spoilt("Hexahedra 1", "Hexahedra 1000"), {"Hexahedra", "1000"}},
      {spoilt("Pyramids 1", "Pyramids 2"), {"line"}},
      {spoilt("End", "Vertices 1\n0 0 0 1\nEnd"), {"second section"}},
      {spoilt("Tetrahedra 2", "Tetrahedra 4\n2 3 6 10 1\n2 3 6 10 1"), {"elements[", "belongs to 3 elements"}},
      {text.substr(0, text.find("Pyramids") + 14), {"the file ends"}},
  };
  for (const auto& [bytes, message] : table) {
    SCOPED_TRACE(bytes.substr(0, 60));
    test::expect_error(ErrorCode::invalid_argument, message, [&, &input = bytes] { parse_mesh(input, "a.mesh"); });
  }
}

}  // namespace
}  // namespace deform::io::medit_test
