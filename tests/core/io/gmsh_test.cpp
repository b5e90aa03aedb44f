// SPDX-License-Identifier: GPL-3.0-or-later
// Gmsh: one mesh, a cube with a pyramid on top, in every version and encoding of the format.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "core/io/binary/byte_order.h"
#include "core/io/mesh_file.h"
#include "core/quality/element_quality.h"
#include "tests/core/io/text_diff.h"
#include "tests/support/expect_error.h"

namespace deform::io::gmsh_test {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;

struct Form {
  const char* version = "4.1";
  bool binary = false;
  std::endian order = std::endian::little;
  int size_bytes = 8;  // of size_t
  bool parametric = false;

  bool v2() const { return version[0] == '2'; }
  bool v40() const { return std::string(version) == "4"; }
  bool v41() const { return std::string(version) == "4.1"; }
};

std::ostream& operator<<(std::ostream& out, const Form& form) {
  out << form.version << (form.binary ? (form.order == std::endian::big ? " big" : " little") : " text") << " size_t "
      << form.size_bytes;
  return out << (form.parametric ? " parametric" : "");
}

/// Writes values as the form says.
class Writer {
 public:
  explicit Writer(const Form& form) : form_(form) {}
  Writer& text(const std::string& text) {
    bytes_ += text;
    return *this;
  }
  Writer& integers(std::initializer_list<std::int64_t> values) {
    for (const std::int64_t value : values) put(static_cast<std::uint64_t>(value), value, 4);
    return *this;
  }
  Writer& sizes(std::initializer_list<std::int64_t> values) {
    for (const std::int64_t value : values) put(static_cast<std::uint64_t>(value), value, form_.size_bytes);
    return *this;
  }
  Writer& tag(std::int64_t value) {
    put(static_cast<std::uint64_t>(value), value, form_.v41() ? form_.size_bytes : 4);
    return *this;
  }
  Writer& numbers(std::initializer_list<double> values) {
    for (const double value : values) put(std::bit_cast<std::uint64_t>(value), value, 8);
    return *this;
  }
  Writer& line() {
    if (!form_.binary) bytes_ += '\n';
    return *this;
  }
  std::string take() { return std::move(bytes_); }

 private:
  template <typename T>
  void put(std::uint64_t raw, T value, int size) {
    if (!form_.binary) {
      bytes_ += testing::PrintToString(value) + ' ';
      return;
    }
    bytes_.resize(bytes_.size() + static_cast<std::size_t>(size));
    char* at = bytes_.data() + bytes_.size() - size;
    if (size == 4) {
      store_scalar(at, static_cast<std::uint32_t>(raw), form_.order);
    } else {
      store_scalar(at, raw, form_.order);
    }
  }
  const Form form_;
  std::string bytes_;
};

struct Node {
  std::int64_t tag;
  Vec3 at;
  int dimension;  // of its entity
};
// Sparse tags in any order.
const std::vector<Node> nodes = {{12, {0, 0, 0}, 0},    {5, {1, 0, 0}, 1},   {7, {1, 1, 0}, 1}, {900000, {0, 1, 0}, 2},
                                 {1, {0, 0, 1}, 2},     {2, {1, 0, 1}, 2},   {3, {1, 1, 1}, 2}, {4, {0, 1, 1}, 2},
                                 {8, {0.5, 0.5, 2}, 3}, {9, {7, 7, 7.25}, 3}};
struct Element {
  int dimension;
  std::int64_t entity, type;
  std::vector<std::int64_t> groups;
  std::vector<std::int64_t> tags;
};
const std::vector<Element> elements = {
    {0, 1, 15, {6}, {12}},          {1, 1, 1, {3}, {12, 5}},  {2, 1, 3, {1, 2}, {12, 900000, 7, 5}},
    {2, 2, 3, {9}, {1, 2, 3, 4}},   {2, 3, 2, {}, {1, 2, 8}}, {3, 1, 5, {4}, {12, 5, 7, 900000, 1, 2, 3, 4}},
    {3, 2, 7, {8}, {1, 2, 3, 4, 8}}};

void write_nodes(Writer& out, const Form& form) {
  const auto parameters = [&](const Node& node) {
    for (int k = 0; form.parametric && k < node.dimension && (!form.v2() || node.dimension < 3); ++k) out.numbers({0.5});
  };
  out.text(form.v2() && form.parametric ? "$ParametricNodes\n" : "$Nodes\n");
  if (form.v2()) out.text(std::to_string(nodes.size()) + "\n");
  if (!form.v2()) out.sizes({static_cast<std::int64_t>(nodes.size()), static_cast<std::int64_t>(nodes.size())});
  if (form.v41()) out.sizes({1, 900000});
  if (!form.v2()) out.line();
  for (const Node& node : nodes) {  // each in a block of its own
    if (form.v40()) out.integers({1, node.dimension, form.parametric});
    if (form.v41()) out.integers({node.dimension, 1, form.parametric});
    if (!form.v2()) out.sizes({1}).line();
    out.tag(node.tag);
    if (form.v41()) out.line();
    out.numbers({node.at[0], node.at[1], node.at[2]});
    if (form.v2() && form.parametric) out.integers({node.dimension, 1});
    parameters(node);
    out.line();
  }
  if (form.binary) out.text("\n");
  out.text(form.v2() && form.parametric ? "$EndParametricNodes\n" : "$EndNodes\n");
}

void write_entities(Writer& out, const Form& form) {
  out.text("$Entities\n").sizes({1, 1, 3, 2}).line();
  for (const Element& element : elements) {
    out.integers({element.entity}).numbers({0, 0, 0});
    if (element.dimension > 0 || form.v40()) out.numbers({1, 1, 1});
    out.sizes({static_cast<std::int64_t>(element.groups.size())});
    for (const std::int64_t group : element.groups) out.integers({group == 2 ? -2 : group});
    if (element.dimension > 0) out.sizes({2}).integers({1, -2});
    out.line();
  }
  out.text(form.binary ? "\n$EndEntities\n" : "$EndEntities\n");
}

void write_elements(Writer& out, const Form& form) {
  out.text("$Elements\n");
  std::int64_t number = 0;
  // Version 2 repeats an element for each of its groups.
  if (form.v2()) out.text(std::to_string(elements.size() + 1) + "\n");
  if (!form.v2()) out.sizes({static_cast<std::int64_t>(elements.size()), static_cast<std::int64_t>(elements.size())});
  if (form.v41()) out.sizes({1, 7});
  if (!form.v2()) out.line();
  for (const Element& element : elements) {
    const std::vector<std::int64_t> groups = element.groups.empty() ? std::vector<std::int64_t>{0} : element.groups;
    for (std::size_t copy = 0; copy < (form.v2() ? groups.size() : 1); ++copy) {
      if (form.v40()) out.integers({element.entity, element.dimension, element.type}).sizes({1}).line();
      if (form.v41()) out.integers({element.dimension, element.entity, element.type}).sizes({1}).line();
      if (form.v2() && form.binary) out.integers({element.type, 1, 2});
      out.tag(++number);
      if (form.v2() && !form.binary) out.integers({element.type, 2});
      if (form.v2()) out.integers({groups[copy], element.entity});
      for (const std::int64_t tag : element.tags) out.tag(tag);
      out.line();
    }
  }
  out.text(form.binary ? "\n$EndElements\n" : "$EndElements\n");
}

std::string mesh_in(const Form& form) {
  Writer out(form);
  out.text(std::string("$MeshFormat\n") + form.version + (form.binary ? " 1 " : " 0 ") + std::to_string(form.size_bytes) + "\n");
  if (form.binary) out.integers({1}).text("\n");
  out.text("$EndMeshFormat\n$Comments\nof no interest: $Nodes\n$EndComments\n");
  out.text("$PhysicalNames\n5\n2 1 \"wall\"\n2 2 \"all of \"it\"\"\n3 4 \"box\"\n1 3 \"edge\"\n0 6 \"box\"\n$EndPhysicalNames\n");
  if (!form.v2()) write_entities(out, form);
  write_nodes(out, form);
  write_elements(out, form);
  return out.text("$Periodic\n0\n$EndPeriodic\n").take();
}

const Group& group(const Mesh& mesh, const std::string& name) {
  const Group* found = mesh.find_group(name);
  if (found == nullptr) throw Error(ErrorCode::not_found, "no group " + name);
  return *found;
}

class GmshForms : public testing::TestWithParam<Form> {};

TEST_P(GmshForms, GroupsAndElements) {
  const auto file = parse_mesh(mesh_in(GetParam()), "a.msh");
  EXPECT_EQ(file->format(), Format::gmsh);
  const auto mesh = file->mesh();
  ASSERT_EQ(mesh->point_count(), nodes.size());
  for (std::size_t i = 0; i < nodes.size(); ++i) EXPECT_EQ(mesh->points[i], nodes[i].at);
  const auto volume = file->elements();
  ASSERT_NE(volume, nullptr);
  EXPECT_THAT(volume->types, ElementsAre(ElementType::hexahedron, ElementType::pyramid));
  EXPECT_EQ(element_quality(mesh->points, *volume).inverted_elements, 0u);
  EXPECT_EQ(mesh->face_count(), 5u + 4);
  EXPECT_THAT(group(*mesh, "wall").faces, SizeIs(1));
  EXPECT_EQ(group(*mesh, "all of \"it\"").faces, group(*mesh, "wall").faces);
  EXPECT_THAT(group(*mesh, "physical_2d_9").faces, IsEmpty());
  EXPECT_THAT(group(*mesh, "physical_2d_9").points, ElementsAre(4, 5, 6, 7)) << "between cube and pyramid";
  EXPECT_THAT(group(*mesh, "physical_3d_8").points, ElementsAre(4, 5, 6, 7, 8));
  EXPECT_THAT(group(*mesh, "edge").points, ElementsAre(0, 1));
  EXPECT_THAT(group(*mesh, "box").points, ElementsAre(0)) << "a name of several groups goes to points first";
  EXPECT_THAT(group(*mesh, "cellZone:box").points, SizeIs(8));
  EXPECT_EQ(mesh->groups.size(), 7u);
  std::vector<std::int32_t> entities = file->face_entities;
  ASSERT_EQ(entities.size(), mesh->face_count());
  EXPECT_EQ(entities.at(group(*mesh, "wall").faces.front()), 1);
  std::sort(entities.begin(), entities.end());
  EXPECT_THAT(entities, ElementsAre(0, 0, 0, 0, 0, 0, 0, 1, 3)) << "2 is between cube and pyramid";
}

TEST_P(GmshForms, OnlyCoordinatesChange) {
  const std::string bytes = mesh_in(GetParam());
  const auto file = parse_mesh(bytes, "a.msh");
  EXPECT_EQ(file->with_points(file->mesh()->points), bytes);
  Points moved = file->mesh()->points;
  moved[3] = {0, -1e-3, 0.1};
  moved[9][2] = 1.0 / 3;
  const std::string written = file->with_points(moved);
  EXPECT_EQ(parse_mesh(written, "a.msh")->mesh()->points, moved);
  if (!GetParam().binary) {
    EXPECT_THAT(test::changed_words(bytes, written), SizeIs(3));
    return;
  }
  ASSERT_EQ(written.size(), bytes.size());
  std::size_t first = 0, changed = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    if (written[i] == bytes[i]) continue;
    if (changed++ == 0) first = i;
  }
  EXPECT_LE(changed, 3u * 8);
  EXPECT_GT(first, bytes.find("Nodes\n"));
}

TEST_P(GmshForms, EveryPrefixIsReadOrRefused) {
  const std::string bytes = mesh_in(GetParam());
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    try {
      parse_mesh(bytes.substr(0, size), "a.msh")->mesh()->validate();
    } catch (const Error& error) {
      ASSERT_EQ(error.code(), ErrorCode::invalid_argument) << size << ": " << error.what();
    }
  }
}

std::vector<Form> forms() {
  std::vector<Form> all;
  for (const char* version : {"2.2", "4", "4.1"}) {
    for (const bool parametric : {false, true}) {
      all.push_back({version, false, std::endian::little, 8, parametric});
      for (const std::endian order : {std::endian::little, std::endian::big})
        all.push_back({version, true, order, 8, parametric});
    }
  }
  all.push_back({"4.1", true, std::endian::little, 4, true});
  all.push_back({"4.1", true, std::endian::big, 4, false});
  return all;
}

INSTANTIATE_TEST_SUITE_P(All, GmshForms, testing::ValuesIn(forms()), [](const auto& tested) {
  std::string name = testing::PrintToString(tested.param);
  std::replace_if(
      name.begin(), name.end(), [](char c) { return c == '.' || c == ' '; }, '_');
  return name;
});

/// The numbers of nodes and edges from the figures of Gmsh's manual ("Node ordering"): nodes of an element at their places,
/// those of edges and faces amid the corners that are named here.
struct Quadratic {
  int type;
  ElementType expected;
  std::vector<Vec3> corners;
  std::vector<std::vector<int>> between;
};

TEST(Gmsh, QuadraticElements) {
  const std::vector<Vec3> cube = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
  const std::vector<Vec3> prism = {cube[0], cube[1], cube[3], cube[4], cube[5], cube[7]};
  const std::vector<Vec3> pyramid = {cube[0], cube[1], cube[2], cube[3], {0.5, 0.5, 1}};
  const std::vector<std::vector<int>> cube_edges = {{0, 1}, {0, 3}, {0, 4}, {1, 2}, {1, 5}, {2, 3},
                                                    {2, 6}, {3, 7}, {4, 5}, {4, 7}, {5, 6}, {6, 7}};
  const std::vector<std::vector<int>> prism_edges = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 4}, {2, 5}, {3, 4}, {3, 5}, {4, 5}};
  const std::vector<std::vector<int>> pyramid_edges = {{0, 1}, {0, 3}, {0, 4}, {1, 2}, {1, 4}, {2, 3}, {2, 4}, {3, 4}};
  const auto with = [](std::vector<std::vector<int>> edges, const std::vector<std::vector<int>>& more) {
    edges.insert(edges.end(), more.begin(), more.end());
    return edges;
  };
  const Quadratic table[] = {
      {11, ElementType::tetrahedron10, {cube[0], cube[1], cube[3], cube[4]}, {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {2, 3}, {1, 3}}},
      {17, ElementType::hexahedron20, cube, cube_edges},
      {12, ElementType::hexahedron27, cube,
       with(cube_edges,
            {{0, 3, 2, 1}, {0, 1, 5, 4}, {0, 4, 7, 3}, {1, 2, 6, 5}, {2, 3, 7, 6}, {4, 5, 6, 7}, {0, 1, 2, 3, 4, 5, 6, 7}})},
      {18, ElementType::prism15, prism, prism_edges},
      {13, ElementType::prism18, prism, with(prism_edges, {{0, 1, 4, 3}, {0, 3, 5, 2}, {1, 2, 5, 4}})},
      {19, ElementType::pyramid13, pyramid, pyramid_edges},
      {14, ElementType::pyramid14, pyramid, with(pyramid_edges, {{0, 3, 2, 1}})},
  };
  for (const Quadratic& tested : table) {
    SCOPED_TRACE(tested.type);
    std::vector<Vec3> points = tested.corners;
    for (const auto& among : tested.between) {
      Vec3 middle{};
      for (const int corner : among) {
        for (std::size_t k = 0; k < 3; ++k) {
          middle[k] += tested.corners[static_cast<std::size_t>(corner)][k] / static_cast<double>(among.size());
        }
      }
      points.push_back(middle);
    }
    const std::string count = std::to_string(points.size());
    std::string text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n" + count + "\n", all;
    for (std::size_t i = 0; i < points.size(); ++i) {
      all.append(" ").append(std::to_string(i + 1));
      text += std::to_string(i + 1);
      for (const double c : points[i]) text.append(" ").append(testing::PrintToString(c));
      text += "\n";
    }
    text += "$EndNodes\n$Elements\n1\n1 " + std::to_string(tested.type) + " 0" + all + "\n$EndElements\n";
    const auto file = parse_mesh(text, "q.msh");
    const auto read = file->elements();
    ASSERT_THAT(read->types, ElementsAre(tested.expected));
    const ElementShape& form = shape(tested.expected);
    const auto expect_amid = [&](PointId point, const auto& corners) {
      Vec3 middle{};
      for (const auto c : corners) {
        for (std::size_t k = 0; k < 3; ++k) {
          middle[k] += file->mesh()->points[read->nodes(0)[c]][k] / static_cast<double>(corners.size());
        }
      }
      EXPECT_EQ(file->mesh()->points[point], middle) << "node " << point;
    };
    for (std::size_t e = 0; e < form.edges.size(); ++e) expect_amid(read->nodes(0)[form.corners + e], form.edges[e]);
    for (std::size_t f = 0; f < form.faces.size(); ++f) {
      if (form.face_centre(f) != ElementShape::no_node) expect_amid(read->nodes(0)[form.face_centre(f)], form.faces[f]);
    }
  }
}

const std::string head = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n";
const std::string triangle = "$Nodes\n3\n1 0 0 0\n2 1 0 0\n3 0 1 0\n$EndNodes\n";

TEST(Gmsh, SurfaceAlone) {
  const auto file = parse_mesh(head + triangle + "$Elements\n2\n1 2 2 4 1 1 2 3\n2 2 2 4 1 1 2 3\n$EndElements\n", "b.msh");
  EXPECT_EQ(file->elements(), nullptr);
  EXPECT_THAT(group(*file->mesh(), "physical_2d_4").faces, ElementsAre(0, 1)) << "the same group twice: two faces";
  EXPECT_EQ(parse_mesh(head + triangle, "points.msh")->mesh()->face_count(), 0u);
}

TEST(Gmsh, OtherElementsOfTheSameNodesAreNoRepetition) {
  const auto surface = parse_mesh(head + triangle + "$Elements\n2\n1 8 2 4 1 1 2 3\n2 2 2 5 1 1 2 3\n$EndElements\n", "b.msh");
  EXPECT_EQ(surface->mesh()->face_count(), 1u);
  EXPECT_THAT(group(*surface->mesh(), "physical_2d_5").faces, ElementsAre(0)) << "after a quadratic line";

  const std::string four = "$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n";
  const auto solid =
      parse_mesh(head + four + "$Elements\n2\n1 3 2 4 1 1 2 3 4\n2 4 2 5 1 1 2 3 4\n$EndElements\n", "tetrahedron.msh");
  ASSERT_NE(solid->elements(), nullptr);
  EXPECT_EQ(solid->elements()->size(), 1u) << "after a quadrilateral";
  EXPECT_EQ(solid->mesh()->face_count(), 4u);
}

TEST(Gmsh, NamesOfVersion20HaveNoDimension) {
  const std::string text = "$MeshFormat\n2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n4 \"skin\"\n$EndPhysicalNames\n" + triangle +
                           "$Elements\n1\n1 2 1 4 1 2 3\n$EndElements\n";
  EXPECT_THAT(group(*parse_mesh(text, "b.msh")->mesh(), "skin").faces, ElementsAre(0));
}

TEST(Gmsh, PartitionedEntitiesHaveGroups) {
  const std::string text =
      "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 1 0\n1 0 0 0 1 1 0 1 5 0\n$EndEntities\n"
      "$PartitionedEntities\n2\n1\n3 1\n0 0 1 0\n7 2 1 2 1 2 0 0 0 1 1 0 1 5 0\n$EndPartitionedEntities\n"
      "$Nodes\n1 3 1 3\n2 7 0 3\n1\n2\n3\n0 0 0\n1 0 0\n0 1 0\n$EndNodes\n"
      "$Elements\n1 1 1 1\n2 7 2 1\n1 1 2 3\n$EndElements\n";
  EXPECT_THAT(group(*parse_mesh(text, "b.msh")->mesh(), "physical_2d_5").faces, ElementsAre(0));
  EXPECT_THAT(parse_mesh(text, "b.msh")->face_entities, ElementsAre(1)) << "that of the whole surface";
}

TEST(Gmsh, RefusesWhatIsWrong) {
  const auto with = [](const std::string& lines) { return head + triangle + "$Elements\n" + lines; };
  const std::string text = mesh_in({}), binary = mesh_in({"2.2", true});
  const auto spoilt = [](std::string bytes, const std::string& from, const std::string& to) {
    bytes.replace(bytes.find(from), from.size(), to);
    return bytes;
  };
  const std::pair<std::string, std::vector<const char*>> table[] = {
      {"", {"line 1", "$MeshFormat"}},
      {"solid\n", {"$MeshFormat"}},
      {"$NOD\n1\n1 0 0 0\n$ENDNOD\n", {"version 1 of the MSH format"}},
      {"$Nodes\n", {"$MeshFormat", "$Nodes"}},
      {"$MeshFormat\n3 0 8\n$EndMeshFormat\n", {"line 2", "version \"3\"", "2, 4.0 and 4.1"}},
      {"$MeshFormat\n2.2 2 8\n$EndMeshFormat\n", {"line 2", "file type 2"}},
      {"$MeshFormat\n2.2 0 4\n$EndMeshFormat\n", {"line 2", "data size 4", "8"}},
      {"$MeshFormat\n4.1 0 16\n$EndMeshFormat\n", {"data size 16", "4 or 8"}},
      {"$MeshFormat\n2.2 1 8\nxxxx\n$EndMeshFormat\n", {"byte 20", "integer 1"}},
      {"$MeshFormat\n2.2 0 8\n$Nodes\n", {"$EndMeshFormat"}},
      {head, {"no nodes"}},
      {head + "$Comments\n", {"$Comments", "$EndComments"}},
      {head + "$Nodes\n0\n$EndNodes\n", {"no nodes"}},
      {head + triangle + triangle, {"line 10", "second section"}},
      {head + "$Nodes\n2\n1 0 0 0\n$EndNodes\n", {"line 7", "integer", "$EndNodes"}},
      {head + "$Nodes\n99999999\n1 0 0 0\n$EndNodes\n", {"line 5", "99999999", "bytes left"}},
      {head + "$Nodes\n-1\n$EndNodes\n", {"line 5", "-1"}},
      {head + "$Nodes\n2\n1 0 0 0\n1 0 0 1\n$EndNodes\n", {"line 7", "node 1"}},
      {head + "$Nodes\n1\n1 0 inf 0\n$EndNodes\n", {"line 6", "finite"}},
      {head + "$Nodes\n1\n1 0 0 0\n", {"$EndNodes"}},
      {head + "$Elements\n1\n", {"before the nodes"}},
      {head + "$PhysicalNames\n1\n2 1 wall\n", {"line 6", "in quotes", "wall"}},
      {head + "$PhysicalNames\n1\n2 1 \"wall\n", {"line 6", "closing quote"}},
      {with("1\n1 29 0 1 2\n$EndElements\n"), {"line 12", "type 29"}},
      {with("1\n1 2 1 4 1 2 4\n$EndElements\n"), {"line 12", "node 4"}},
      {with("2\n1 2 1 4 1 2 3\n$EndElements\n"), {"line 13", "integer"}},
      {with("1\n1 2 99 4 1 2 3\n$EndElements\n"), {"line 12", "tags", "99"}},
      {spoilt(text, "$EndEntities", "$EndEntitis"), {"expected $EndEntities"}},
      {spoilt(text, "0 1 0 1 \n12", "4 1 0 1 \n12"), {"dimension 4"}},
      {spoilt(text, "$Nodes\n10 10 ", "$Nodes\n9 10 "), {"9 nodes", "10"}},
      {spoilt(text, "$Elements\n7 7", "$Elements\n7 8"), {"7 elements", "8"}},
      {spoilt(text, "3 2 7 1", "3 2 77 1"), {"type 77"}},
      {binary.substr(0, binary.size() / 2), {"byte"}},
  };
  for (const auto& [bytes, message] : table) {
    SCOPED_TRACE(bytes.substr(0, 80));
    std::vector<const char*> parts = message;
    parts.push_back("a.msh: ");
    test::expect_error(ErrorCode::invalid_argument, parts, [&, &input = bytes] { parse_mesh(input, "a.msh"); });
  }
}

}  // namespace
}  // namespace deform::io::gmsh_test
